"""Descriptions of where to run: read as they are meant, or refused with file, key and remedy."""

import contextlib
import os
import sys
import threading
import time
from collections import Counter
from itertools import pairwise

import psutil
import pytest

from objectfolder.errors import InputError
from pipeline.cluster import cluster, pools
from pipeline.cluster.cluster import connect
from pipeline.cluster.places import Adapt, Place, read_place
from pipeline.dataset.job import BLENDER, GPU
from tests.patience import wait_until

ADDRESS = "tls://10.0.0.1:8786"
CLASSES = {
    "local": "distributed.LocalCluster",
    "cuda": "dask_cuda.LocalCUDACluster",
    "ssh": "distributed.SSHCluster",
    "slurm": "dask_jobqueue.SLURMCluster",
    "kubernetes": "dask_kubernetes.operator.KubeCluster",
}


@pytest.fixture
def root(tmp_path, monkeypatch):
    for name in ("OBJECTFOLDER_CLUSTER", "DASK_SCHEDULER_ADDRESS", "OBJECTFOLDER_TLS"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "cluster").mkdir()
    return tmp_path


def write(root, text, name="local"):
    path = root / "cluster" / f"{name}.yaml"
    path.write_text(text)
    return path


def test_the_places_that_come_with_the_code_name_their_classes(pytestconfig):
    places = {name: read_place(pytestconfig.rootpath, name) for name in CLASSES}
    assert {name: place.starts for name, place in places.items()} == CLASSES
    assert places["slurm"].adapt == Adapt(minimum=0, maximum=8)
    assert places["slurm"].capacity() == (8, 16, int(0.9 * 64e9))


def test_a_worker_serves_the_pools_that_it_was_started_for(monkeypatch):
    monkeypatch.setattr(pools, "offers_here", lambda: [BLENDER])
    assert pools.stated({GPU: 1.0}) == [GPU]
    assert pools.stated({pools.NOTHING: 1.0}) == []
    assert pools.stated({"memory": 1.0}) == [BLENDER]


def test_what_is_named_goes_before_the_variables(root, monkeypatch):
    assert read_place(root) == Place()
    write(root, "memory_gb: 3\nthreads: 2\ntime_limit_s: 60\n", "mine")
    elsewhere = root / "elsewhere.yaml"
    elsewhere.write_text("memory_gb: 5\n")
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "tcp://10.0.0.2:8786")
    assert read_place(root).address == "tcp://10.0.0.2:8786"
    monkeypatch.setenv("OBJECTFOLDER_CLUSTER", "mine")
    mine = read_place(root)
    assert (mine.memory_gb, mine.child.threads, mine.child.time_limit_s) == (3, 2, 60)
    assert read_place(root, str(elsewhere)).memory_gb == 5
    write(root, "reconnect_s: 7\n", "address")
    named = read_place(root, ADDRESS)
    assert (named.starts, named.address, named.reconnect_s) == ("", ADDRESS, 7)


@pytest.mark.parametrize(
    ("text", "finding", "remedy"),
    [
        ("kwarg: {}", "unknown key kwarg", "Did you mean kwargs?"),
        ("adapt: {maximun: 2}", "unknown key adapt.maximun", "Did you mean adapt.maximum?"),
        ("xyzzy: 2", "unknown key xyzzy", "Known are version, module"),
        ("memory_gb: 4 GB", "memory_gb is '4 GB'", "valid number"),
        ("memory_gb: -1", "memory_gb is -1", "greater than or equal to 0"),
        ("memory_gb: .nan", "memory_gb is nan", "finite number"),
        ("adapt: {minimum: 3, maximum: 2}", "adapt.maximum is 2", "must not be less than adapt.minimum"),
        ("version: 2", "version is 2", "1"),
        ("- 1", "holds no keys", "section with keys"),
        ("a: [", "cannot be read", "must be a YAML file"),
        ("[" * 60 + "]" * 60, "nested more than 50 deep", "must be a YAML file"),
        ("kwargs: &a {b: *a}", "a part contains itself", "must be a YAML file"),
        (
            "a: &a [0,0,0,0,0,0,0,0,0,0]\n"
            + "".join(f"{new}: &{new} [{','.join([f'*{old}'] * 10)}]\n" for old, new in pairwise("abcdef")),
            "more than 100000 values",
            "must be a YAML file",
        ),
        ("memory_gb: 1\nmemory_gb: 2", "the key 'memory_gb' occurs twice", "must be a YAML file"),
        ("threads: " + "9" * 5000, "Exceeds the limit", "must be a YAML file"),
        ("kwargs: {2020-01-01: 1}", "a key is neither a string nor a number", "Correct it"),
    ],
)
def test_what_cannot_be_is_refused(root, text, finding, remedy):
    path = write(root, text)
    with pytest.raises(InputError) as raised:
        read_place(root)
    assert raised.value.where == str(path)
    assert finding in raised.value.finding
    assert remedy in raised.value.remedy


def test_a_place_that_is_not_there_is_never_replaced_by_another(root):
    write(root, "memory_gb: 1")
    with pytest.raises(InputError, match=r"slrum.*Set OBJECTFOLDER_CLUSTER to one of local"):
        read_place(root, "slrum")


@pytest.mark.parametrize(
    ("name", "package", "remedy"),
    [
        ("ssh", "asyncssh", r"'objectfolder-factory\[ssh\]'"),
        ("slurm", "dask_jobqueue", r"'objectfolder-factory\[slurm\]'"),
        ("kubernetes", "dask_kubernetes", r"'objectfolder-factory\[kubernetes\]'"),
        ("cuda", "dask_cuda", "dask-cuda"),
    ],
)
def test_a_package_that_is_missing_is_named_with_the_way_to_get_it(
    root, pytestconfig, monkeypatch, name, package, remedy
):
    for module in [name for name in sys.modules if name.startswith(f"{package}.")]:
        monkeypatch.delitem(sys.modules, module)  # another test may have imported it
    monkeypatch.setitem(sys.modules, package, None)
    place = read_place(pytestconfig.rootpath, name).model_copy(update={"tls": False})
    with pytest.raises(InputError, match=rf"{package} is not installed.*pip install {remedy}"):
        _start(place, root)


def test_a_class_or_an_argument_that_does_not_exist_is_named_with_the_nearest(root):
    with pytest.raises(InputError, match=r"no such class. Did you mean LocalCluster\?"):
        _start(Place(class_name="LocalClutser"), root)
    with pytest.raises(InputError, match=r"kwargs\.threads_per_workers. Did you mean threads_per_worker\?"):
        _start(Place(kwargs={"threads_per_workers": 1}), root)
    pytest.importorskip("dask_jobqueue")
    with pytest.raises(InputError, match=r"kwargs\.walltimes. Did you mean walltime\?"):
        _start(Place(module="dask_jobqueue", class_name="SLURMCluster", kwargs={"walltimes": 1}), root)


@pytest.mark.parametrize("module", ["os", "subprocess"])
def test_what_is_no_cluster_is_never_called(root, tmp_path, module):
    name = {"os": "system", "subprocess": "Popen"}[module]
    place = Place(module=module, class_name=name, args=[f"touch {tmp_path}/mark"], tls=False)
    with pytest.raises(InputError, match="is no cluster of Dask"):
        _start(place, root)
    assert not (tmp_path / "mark").exists()


def _start(place, root):
    with connect(place, root, 5):
        pytest.fail("it started")


@pytest.mark.slow
def test_a_worker_killed_while_it_starts_is_started_again(root, capfd):
    """Other users of this machine cannot reach the scheduler, either."""
    killer = threading.Thread(target=_kill_a_starting_worker)
    killer.start()
    before = os.environ.get("PYTHONSAFEPATH")
    with connect(Place(kwargs={"threads_per_worker": 3}), root, 5) as client:
        client.wait_for_workers(1, timeout=120)
        killer.join()
        assert client.submit(sum, [1, 2]).result() == 3
        assert client.scheduler.address.startswith("tls://127.0.0.1:")
        assert list(client.nthreads().values()) == [3]
        assert os.environ["PYTHONSAFEPATH"] == "1"
    assert os.environ.get("PYTHONSAFEPATH") == before  # only workers are spawned with it
    said = capfd.readouterr().err
    assert "worker 0 did not start or has ended; started again" in said
    assert "Traceback" not in said


def _kill_a_starting_worker() -> None:
    while True:
        for child in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):  # it may have ended meanwhile
                if "spawn_main" in " ".join(child.cmdline()):
                    time.sleep(0.2)
                    child.kill()
                    return
        time.sleep(0.02)


@pytest.mark.slow
def test_a_cluster_adapts_from_no_worker_to_two_and_back(root):
    quick = {"interval": "200ms", "wait-count": 3, "target-duration": "1s"}
    quick = {f"distributed.adaptive.{name}": value for name, value in quick.items()}
    place = Place(adapt=Adapt(maximum=2), kwargs={"threads_per_worker": 1}, dask=quick)
    goes_on = root / "goes_on"
    with connect(place, root, 8) as client:
        assert client.nthreads() == {}
        tasks = client.map(_wait_for, [str(goes_on)] * 8, pure=False)
        wait_until(lambda: len(client.nthreads()) == 2, "two workers")
        goes_on.touch()
        client.gather(tasks)
        del tasks
        wait_until(lambda: client.nthreads() == {}, "no worker")


def _wait_for(path: str) -> None:
    while not os.path.exists(path):
        time.sleep(0.05)


def _pid_after(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def test_a_single_job_has_the_environment_of_its_place(root, monkeypatch):
    def started(*_arguments: object) -> None:
        raise LookupError("a cluster, whose workers have it")

    monkeypatch.setattr(cluster, "connect", started)
    place = Place(environment={"OBJECTFOLDER_DEVICE": "CUDA"})
    with pytest.raises(LookupError, match="a cluster"), cluster.runner(place, root, 1):
        pass


@pytest.mark.slow
@pytest.mark.release("pipeline.cluster")
def test_one_scheduler_gives_64_threads_of_8_processes_equal_shares(root):
    place = Place(kwargs={"n_workers": 8, "threads_per_worker": 8}, environment={"OMP_NUM_THREADS": "1"})
    with connect(place, root, 192) as client:
        client.wait_for_workers(8, timeout=600)
        shares = Counter(client.gather(client.map(_pid_after, [2.0] * 192, pure=False)))
    assert len(shares) == 8
    assert max(shares.values()) <= 48
