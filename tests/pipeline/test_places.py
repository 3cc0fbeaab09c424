"""Descriptions of where to run: read as they are meant, or refused with file, key and remedy."""

import sys

import pytest

from objectfolder.errors import InputError
from pipeline.cluster import machine_cluster
from pipeline.cluster.cluster import runner
from pipeline.cluster.places import KINDS, Place, read_place

ADDRESS = "tls://10.0.0.1:8786"


@pytest.fixture
def root(tmp_path, monkeypatch):
    for name in ("OBJECTFOLDER_CLUSTER", "DASK_SCHEDULER_ADDRESS"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "cluster").mkdir()
    return tmp_path


def write(root, text, name="local"):
    path = root / "cluster" / f"{name}.yaml"
    path.write_text(text)
    return path


def test_without_a_file_the_defaults_hold(root):
    assert read_place(root) == Place()
    assert read_place(root).listen == "127.0.0.1"


def test_the_places_that_come_with_the_code_can_be_read(pytestconfig):
    found = {read_place(pytestconfig.rootpath, kind).kind for kind in KINDS if kind != "address"}
    assert found == set(KINDS) - {"address"}


def test_what_is_named_goes_before_the_variables(root, monkeypatch):
    write(root, "kind: slurm\nslurm: {jobs: 3}\n", "mine")
    elsewhere = root / "elsewhere.yaml"
    elsewhere.write_text("workers: 5\n")
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "tcp://10.0.0.2:8786")
    assert read_place(root).address == "tcp://10.0.0.2:8786"
    monkeypatch.setenv("OBJECTFOLDER_CLUSTER", "mine")
    assert read_place(root).slurm.jobs == 3
    assert read_place(root, str(elsewhere)).workers == 5
    named = read_place(root, ADDRESS)
    assert (named.kind, named.address, named.tls) == ("address", ADDRESS, True)
    write(root, "kind: address\naddress: tcp://a:1\nreconnect_s: 7\ntls: true\n", "address")
    named = read_place(root, "tcp://10.0.0.3:1")
    assert (named.address, named.reconnect_s, named.tls) == ("tcp://10.0.0.3:1", 7, True)


def test_settings_of_children_stand_beside_the_others(root):
    write(root, "workers: 2\nthreads: 3\ntime_limit_s: 60\ndask: {distributed.admin.tick.limit: 1 hour}\n")
    place = read_place(root)
    assert (place.workers, place.child.threads, place.child.time_limit_s) == (2, 3, 60)
    assert place.dask == {"distributed.admin.tick.limit": "1 hour"}


@pytest.mark.parametrize(
    ("text", "finding", "remedy"),
    [
        ("worker: 2", "unknown key 'worker'", "Did you mean workers?"),
        ("kind: ssh\nssh: {host: [a]}", "unknown key 'ssh.host'", "Did you mean ssh.hosts?"),
        ("xyzzy: 2", "unknown key 'xyzzy'", "Known are address, child, cuda"),
        ("child: {threads: 2}", "unknown key 'child'", "Set memory_limit_bytes, recycle_above"),
        ("workers: many", "workers is 'many'", "Give a whole number or null."),
        ("workers: true", "workers is True", "Give a whole number or null."),
        ("workers: -1", "workers is -1", "Give a whole number or null."),
        ("memory_gb: 4 GB", "memory_gb is '4 GB'", "Give a number or null."),
        ("tls: 1", "tls is 1", "Give true or false."),
        ("kind: ssh\nssh: {hosts: a}", "ssh.hosts is 'a'", "Give a list, each entry a text."),
        ("kind: ssh\nssh: {hosts: [1]}", "ssh.hosts is [1]", "Give a list, each entry a text."),
        ("kind: ssh\nssh: [a]", "ssh is ['a']", "Give it settings of its own"),
        ("kind: ssh", "ssh.hosts is not set", "Name the machines"),
        ("kind: kubernetes", "kubernetes.image is not set", "Name the image"),
        ("kind: address", "address is not set", "Name the scheduler"),
        ("kind: cloud", "unknown kind 'cloud'", "Known are local, ssh, slurm, kubernetes, cuda, address."),
        (
            "kubernetes: {environment: {A: 1}}",
            "kubernetes.environment is {'A': 1}",
            "names, each with a text",
        ),
        ("- 1", "is no mapping", "docs/cluster.md"),
        ("a: [", "cannot be read", "Set OBJECTFOLDER_CLUSTER to one of local"),
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
    write(root, "workers: 1")
    with pytest.raises(InputError, match=r"slrum.*Set OBJECTFOLDER_CLUSTER to one of local"):
        read_place(root, "slrum")


@pytest.mark.parametrize(
    ("place", "module", "extra"),
    [
        (Place(kind="ssh"), "asyncssh", "ssh"),
        (Place(kind="slurm"), "dask_jobqueue", "slurm"),
        (Place(kind="kubernetes"), "kr8s", "kubernetes"),
    ],
)
def test_a_package_that_is_missing_is_named_with_the_way_to_get_it(root, monkeypatch, place, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    remedy = rf"not installed.*pip install 'objectfolder-factory\[{extra}\]'"
    with pytest.raises(InputError, match=remedy), runner(place, root, 5):
        pass


def test_each_process_gets_a_gpu_of_its_own(root):
    """The devices are names only; that each process sees its own and no other is what is tested."""
    place = read_place(root, str(write(root, "kind: cuda\ncuda: {devices: ['3', GPU-abc]}\n", "two")))
    from distributed import Client

    with (
        machine_cluster.start(place, 8, None) as address,
        Client(address, set_as_default=False) as client,
    ):
        client.wait_for_workers(2, timeout=120)
        seen = client.run(_visible)
    assert sorted(seen.values()) == ["3", "GPU-abc"]


def test_the_gpus_are_those_that_the_environment_shows(monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0, 2")
    assert machine_cluster.devices(Place(kind="cuda")) == ["0", "2"]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    with pytest.raises(InputError, match="no GPU is visible"):
        machine_cluster.devices(Place(kind="cuda"))
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="nvidia-smi names no GPU"):
        machine_cluster.devices(Place(kind="cuda"))


def _visible():
    import os

    return os.environ["CUDA_VISIBLE_DEVICES"]
