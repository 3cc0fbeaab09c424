"""Jobs whose inputs and products travel through a store: right bytes, sent once, kept from harm."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from processes import run
from store_runs import Elsewhere, elsewhere, flow, made
from toys import REPOSITORY

from objectfolder.errors import FormatError, InputError, SimulationError
from pipeline.dataset import products
from pipeline.dataset.job import Job
from pipeline.dataset.stages import OBJECTS, STAGES
from pipeline.dataset.task import Call, Request
from pipeline.sandbox.child import execute
from pipeline.sandbox.isolation import Child, ChildSettings
from pipeline.store.input_cache import InputCache
from pipeline.store.shipping import collect, publish
from pipeline.store.storage import STORE, Store, product_name, source_name

FINGERPRINT = "cd" * 32


@pytest.fixture
def store(tmp_path_factory, monkeypatch):
    """A folder as store, and a worker's cache and scratch apart from the data."""
    folder = tmp_path_factory.mktemp("store")
    monkeypatch.setenv(STORE, f"file://{folder}")
    monkeypatch.setenv("OBJECTFOLDER_STORE_PATIENCE_S", "1")
    monkeypatch.setenv("OBJECTFOLDER_CACHE", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setenv("OBJECTFOLDER_MEMO_GB", "0")
    scratch = tmp_path_factory.mktemp("scratch")
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    yield folder
    assert not list(scratch.glob("shipment-*")), "a shipment left something behind"


@pytest.fixture
def cache():
    return Path(os.environ["OBJECTFOLDER_CACHE"])


def test_workers_elsewhere_make_the_same_products(toys, store):
    toys.converge()
    assert len(toys.executed()) == 9
    expected = made(toys)
    _forget(toys, store)
    for summary in flow(toys, elsewhere(toys.root)):
        assert summary.computed == ("ball", "cup", "dish")
    assert len(toys.executed()) == 9
    assert made(toys) == expected
    assert all(summary.kept == ("ball", "cup", "dish") for summary in toys.converge())


def test_worker_sees_no_path_of_the_driver(toys, store):
    path_lists = []

    def run(call: Call):
        path_lists.append([*call.request.inputs.values(), *call.targets])
        assert call.state is None
        return execute(call)

    flow(toys, elsewhere(toys.root, run))
    assert len(path_lists) == 9
    assert not [path for paths in path_lists for path in paths if path.is_relative_to(toys.root)]


def test_what_is_in_the_store_is_neither_sent_nor_made_again(toys, store, monkeypatch):
    flow(toys, elsewhere(toys.root))
    toys.executed()
    first = made(toys)
    puts = []
    put = Store.put
    monkeypatch.setattr(Store, "put", lambda self, source, name: (puts.append(name), put(self, source, name)))
    for path in toys.root.glob("data/*/*"):
        path.unlink()
    for summary in toys.converge():
        assert summary.restored == ("ball", "cup", "dish")
    jobs = _jobs(toys, toys.tune)
    for finished in run(Elsewhere(toys.root), *jobs):
        assert finished.outcome.failure is None
        assert finished.outcome.wall_s == 0  # nothing ran
    assert toys.executed() == []
    assert puts == []
    assert made(toys) == first


def test_a_mesh_finds_the_files_that_it_refers_to(store, tmp_path):
    from PIL import Image

    scan = tmp_path / "scans of mine" / "mug"
    (scan / "textures").mkdir(parents=True)
    faces = "f 1/1 3/1 2/1\nf 1/1 2/1 4/1\nf 1/1 4/1 3/1\nf 2/1 3/1 4/1\n"
    (scan / "mug.obj").write_text(
        "mtllib ../mug.mtl\nusemtl skin\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt .5 .5\n" + faces
    )
    (scan.parent / "mug.mtl").write_text("newmtl skin\nmap_Kd mug/textures/skin.png\n")
    Image.fromarray(np.full((4, 4, 3), (200, 30, 60), np.uint8)).save(scan / "textures" / "skin.png")
    job = _object_job(tmp_path, scan / "mug.obj")
    assert len(job.inputs) == 3
    assert execute(job.call).failure is None
    (target,) = job.call.targets
    expected = target.read_bytes()
    target.unlink()
    (finished,) = run(Elsewhere(tmp_path), job)
    assert finished.outcome.failure is None
    assert target.read_bytes() == expected
    names = sorted(path.relative_to(store).as_posix() for path in store.rglob("*") if path.is_file())
    assert not [name for name in names if "mug" in name or "scans" in name]


def test_a_mesh_that_refers_to_a_place_of_the_drivers_machine_is_refused(store, tmp_path):
    scan, library = tmp_path / "scan", tmp_path / "elsewhere" / "skin.mtl"
    scan.mkdir()
    library.parent.mkdir()
    library.write_text("newmtl skin\nKd 1 0 0\n")
    (scan / "mug.obj").write_text(f"mtllib {library}\nusemtl skin\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    job = _object_job(tmp_path, scan / "mug.obj")
    assert job.inputs.keys() == {"mesh", "referred_0"}
    shipment = publish(job, Store(os.environ[STORE]))
    # As on a machine where that path is not.
    library.unlink()
    outcome = shipment.run(execute)
    assert "workers elsewhere do not have" in outcome.failure.error


def test_inputs_are_fetched_once_a_host(toys, store, cache, monkeypatch):
    gets = []
    get = Store.get
    monkeypatch.setattr(
        Store, "get", lambda self, *names: (gets.append((self.url, *names)), get(self, *names))[1]
    )
    flow(toys, elsewhere(toys.root))
    shared = [(name, target) for url, name, target in gets if url == os.environ[STORE]]
    worker = [name for name, target in shared if not target.is_relative_to(toys.root)]
    # Products come home, and the host that made them has them for its next job; meshes had to come.
    assert sorted(worker) == sorted(name for name in worker if name.startswith("sources/"))
    assert len(worker) == 3


def test_a_damaged_file_of_the_cache_is_fetched_anew(toys, store, cache):
    flow(toys, elsewhere(toys.root))
    toys.executed()
    expected = made(toys)
    for path in cache.rglob("*"):
        if path.is_file():
            path.write_bytes(path.read_bytes()[:-3])
    toys.set_parameter("training_views", 6)
    flow(toys, elsewhere(toys.root))
    assert len(toys.executed()) == 6
    assert made(toys).keys() == expected.keys()
    toys.set_parameter("training_views", 5)
    flow(toys, elsewhere(toys.root))
    assert made(toys) == expected


def test_the_cache_keeps_what_was_used_last_and_fits_its_cap(tmp_path):
    cache = InputCache(tmp_path / "cache", 3000)
    names = [source_name(f"{index:064x}") for index in range(5)]
    for age, name in enumerate(names):
        (tmp_path / "file").unlink(missing_ok=True)
        (tmp_path / "file").write_bytes(bytes([age]) * 1000)
        cache.add(name, tmp_path / "file")
        os.utime(tmp_path / "cache" / name, (age, age))
        if age == 2:
            assert cache.find(names[0], tmp_path / "used", lambda path: None)  # makes it the youngest
    entries = {name for name in names if (tmp_path / "cache" / name).exists()}
    assert entries == {names[0], names[3], names[4]}
    assert (tmp_path / "used").read_bytes() == bytes(1000)


def test_a_product_that_cannot_be_sent_is_kept_and_sent_by_the_next_run(toys, store, monkeypatch):
    toys.converge(toys.ingest)
    toys.executed()
    put = Store.put

    def broken(self, source, name):
        if "tuned" in name and self.url == os.environ[STORE]:
            raise SimulationError(self.url, "no success in 1 s of tries", "See whether it runs.")
        put(self, source, name)

    with monkeypatch.context() as during:
        during.setattr(Store, "put", broken)
        (summary,) = toys.flow(toys.tune, runner_for=elsewhere(toys.root))
    assert sorted(failure.object for failure in summary.failures) == ["ball", "cup", "dish"]
    assert "no success" in summary.failures[0].error
    assert not list(toys.root.glob("data/tuned/*"))
    assert len(toys.executed()) == 3
    (summary,) = toys.flow(toys.tune, runner_for=elsewhere(toys.root))
    assert summary.computed == ("ball", "cup", "dish")
    assert toys.executed() == []


def test_an_input_damaged_in_the_store_is_removed_and_sent_anew(toys, store):
    (job, *_) = _jobs(toys, toys.ingest)
    store_of_both = Store(os.environ[STORE])
    shipment = publish(job, store_of_both)
    (stored,) = (path for path in store.rglob("*") if path.is_file())
    stored.write_bytes(b"9.9")  # of the right size
    outcome = shipment.run(execute)
    assert "its copy of the input mesh was damaged" in outcome.failure.error
    assert not stored.exists()
    assert toys.executed() == []
    assert publish(job, store_of_both).run(execute).failure is None


def test_a_product_damaged_in_the_store_is_not_collected(toys, store):
    (job, *_) = _jobs(toys, toys.ingest)
    store_of_both = Store(os.environ[STORE])
    assert publish(job, store_of_both).run(execute).failure is None
    name = product_name(job.call.fingerprint, "ingested.zarr.zip")
    (store / name).write_bytes((store / name).read_bytes()[:-5])
    with pytest.raises(FormatError, match="missing or damaged"):
        collect(job, store_of_both)
    assert not (store / name).exists()
    assert not job.call.targets[0].exists()
    toys.executed()
    assert publish(job, store_of_both).run(execute).failure is None  # the worker still has it
    assert toys.executed() == []
    collect(job, store_of_both)
    products.verify(job.call.targets[0])


def test_an_input_changed_on_its_way_is_not_sent(toys, store):
    (job, *_) = _jobs(toys, toys.ingest)
    job.call.request.inputs["mesh"].write_text("7.0")
    with pytest.raises(InputError, match="changed since the run began"):
        publish(job, Store(os.environ[STORE]))
    job.call.request.inputs["mesh"].unlink()
    with pytest.raises(InputError, match="was removed"):
        publish(job, Store(os.environ[STORE]))
    assert not [path for path in store.rglob("*") if path.is_file()]


def test_a_child_process_takes_a_shipment_as_it_takes_a_call(toys, store):
    (job, *_) = _jobs(toys, toys.ingest)
    store_of_both = Store(os.environ[STORE])
    shipment = pickle.loads(pickle.dumps(publish(job, store_of_both)))
    with Child(toys.root, ChildSettings()) as child:
        outcome = child.run(shipment)
    assert outcome.failure is None
    assert outcome.wall_s > 0
    assert not job.call.targets[0].exists()
    collect(job, store_of_both)
    products.verify(job.call.targets[0])
    assert toys.executed() == ["ingest ball"]


def test_a_failing_task_fails_as_it_does_at_home(toys, store):
    toys.add("cup", "poison raise ValueError('no cup')")
    summary, *_ = flow(toys, elsewhere(toys.root))
    assert [failure.error for failure in summary.failures] == ["ValueError: no cup"]
    assert sorted(summary.computed) == ["ball", "dish"]


FETCH = """
import sys
from pathlib import Path
from objectfolder.products.provenance import file_digest
from objectfolder.errors import FormatError
from pipeline.store.input_cache import InputCache
from pipeline.sandbox.isolation import Child, ChildSettings
from pipeline.store.storage import Store, source_name

def check(path):
    if file_digest(path) != sys.argv[3]:
        raise FormatError(str(path), "damaged")

cache = InputCache(Path(sys.argv[2]), int(sys.argv[4]))
print("ready", flush=True)
for turn in range(int(sys.argv[5])):
    target = Path(sys.argv[6]) / f"{turn}"
    assert cache.fetch(Store(sys.argv[1]), source_name(sys.argv[3]), target, check)
    target.unlink()
"""


@pytest.mark.slow
def test_workers_of_one_host_share_the_cache_while_some_are_killed(store, cache, tmp_path):
    from objectfolder.products.provenance import file_digest

    large = tmp_path / "large"
    large.write_bytes(os.urandom(3_000_000))
    digest = file_digest(large)
    Store(os.environ[STORE]).put(large, source_name(digest))

    def worker(name: str, cap: int, turns: int) -> subprocess.Popen[str]:
        (tmp_path / name).mkdir()
        command = [sys.executable, "-c", FETCH, os.environ[STORE], str(cache), digest, str(cap), str(turns)]
        return subprocess.Popen(
            [*command, str(tmp_path / name)], cwd=REPOSITORY, stdout=subprocess.PIPE, text=True
        )

    # One whose cap is too small takes away what the others read.
    workers = [worker("steady", 10**9, 60), worker("small", 0, 60)]
    victim = worker("victim", 0, 10**6)
    assert victim.stdout.readline() == "ready\n"
    time.sleep(np.random.default_rng(3).uniform(0.1, 0.5))  # any moment will do
    victim.send_signal(signal.SIGKILL)
    victim.wait()
    assert [process.wait(120) for process in workers] == [0, 0]
    for path in cache.rglob("*"):
        if path.is_file() and not path.name.endswith(".partial"):
            assert file_digest(path) == digest


def _jobs(toys, stage) -> list[Job]:
    """What a driver would submit for a stage, whatever is there."""
    from objectfolder.products.provenance import fingerprint
    from pipeline.dataset.verified import Verified

    jobs = []
    for object_id, row in toys.rows.items():
        prepared = stage.prepare(toys.root, toys.parameters, object_id, row, Verified(toys.root))
        digest = fingerprint(prepared.parts)
        provenance = {**prepared.parts, "fingerprints": {**stage.lineage(prepared.parts), stage.name: digest}}
        call = Call(
            stage.name,
            stage.task,
            prepared.request,
            stage.targets(toys.root, object_id),
            digest,
            provenance,
            toys.root / products.STATE,
        )
        jobs.append(Job(call, inputs=prepared.inputs))
    return jobs


def _object_job(root: Path, mesh: Path) -> Job:
    """The first stage of the real pipeline for one mesh."""
    from objectfolder.making.mesh.readers.load import source_files
    from objectfolder.products.provenance import file_digest

    first, *referred = source_files(mesh)
    inputs = {"mesh": first, **{f"referred_{index}": path for index, path in enumerate(referred)}}
    request = Request("mug", inputs, {}, {"length_m": 0.1, "file_names": [mesh.name, None]}, 0)
    stage = STAGES["objects"]
    call = Call(stage.name, stage.task, request, (OBJECTS.path(root, "mug"),), FINGERPRINT, {})
    return Job(call, inputs={name: file_digest(path) for name, path in inputs.items()})


def _forget(toys, store) -> None:
    for path in (
        *toys.root.glob("data/*/*"),
        *store.rglob("*/*/*.*"),
    ):
        path.unlink()
