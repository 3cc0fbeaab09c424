"""Shared fixtures."""

# ruff: noqa: E402

import gc
import importlib
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import objectfolder  # noqa: F401  (it chooses the kernels of OpenBLAS before NumPy is there)

# Before numpy is there: tests run beside each other, and a task of the pipeline has one thread, too.
os.environ.update(OMP_NUM_THREADS="1", MKL_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
# Tests edit code and start processes that import it: within one second, and at one size, Python would take
# the bytecode of before the edit for that of the new text.
os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
# Of the checkout there is bytecode: what pytest makes of the tests takes half of the time of collecting them.
sys.dont_write_bytecode = False
gc.disable()  # nothing of a million objects goes while tests are collected

import pytest
from filelock import FileLock

from objectfolder.products.provenance import fingerprint
from tests import cpu_seconds, drawn_examples, release_half

if TYPE_CHECKING:
    from objectfolder.surface.textured_mesh import TexturedMesh

REPOSITORY = Path(__file__).parents[1]
COLLECTED = pytest.StashKey[list[str]]()
MADE_BEFORE = 8  # what one name was made of that stays in the cache: branches, kernels of a processor
RELEASE_HALF = pytest.StashKey[release_half.ReleaseHalf]()
# Looked for once a process: without it, each factorisation searches the whole environment for MKL.
PLACE_OF_MKL = "PYPARDISO_MKL_RT"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the tests that protect a release, and a list of what the tests cost."""
    packages = "run tests marked `release`, too: all, changed (by git), or those of packages a.b,c"
    parser.addoption("--release", default="", metavar="PACKAGES", help=packages)
    listed = "list the N dearest tests and fixtures in CPU seconds, and the sum of each folder"
    parser.addoption("--cpu-seconds", type=int, default=0, metavar="N", help=listed)


def pytest_configure(config: pytest.Config) -> None:
    """Import DVC: it logs to the stream that it finds then, and that of a test's own is closed after it."""
    importlib.import_module("dvc.logger")
    cpu_seconds.register(config, config.getoption("--cpu-seconds"))
    release = config.getoption("--release")
    config.stash[RELEASE_HALF] = release_half.register(config, release)
    drawn_examples.load_profile(many=release == "all")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Name a failure as it happens: a run that is ended from outside prints no summary."""
    if report.failed and "PYTEST_XDIST_WORKER" not in os.environ:
        print(f"\nFAILED {report.nodeid} ({report.when}): {_last_line(report)}", flush=True)


def _last_line(report: pytest.TestReport) -> str:
    """Return the line that pytest's summary gives of a failure."""
    crash = getattr(report.longrepr, "reprcrash", None)
    return str(crash.message if crash else report.longrepr or "").strip().partition("\n")[0]


@pytest.fixture(scope="session", autouse=True)
def _dvc_keeps_to_itself(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What DVC knows of files of repositories of tests goes with them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DVC_SITE_CACHE_DIR", str(tmp_path_factory.mktemp("dvc")))
        patch.setenv("DVC_NO_ANALYTICS", "1")
        yield


def pytest_collection_finish() -> None:
    """Write no bytecode of what tests make, and look for garbage among what they make alone."""
    sys.dont_write_bytecode = True
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Remember what was collected, before any of it is deselected or sorted.

    Slow is what asks for a browser, or for a fixture that the module names in ``SLOW_FIXTURES``.
    Modules with many slow tests come first, so that no process is left alone with one of them at the end.
    """
    config.stash[COLLECTED] = [item.nodeid for item in items]
    if "COLLECTED_FILE" in os.environ:
        Path(os.environ["COLLECTED_FILE"]).write_text("\n".join(config.stash[COLLECTED]))
    for item in items:
        dear = {"browser", *getattr(getattr(item, "module", None), "SLOW_FIXTURES", ())}
        if dear.intersection(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


@pytest.fixture(scope="session")
def collected(request: pytest.FixtureRequest) -> list[str]:
    """Names of all tests that this process collected, in order."""
    return request.config.stash[COLLECTED]


@pytest.fixture(scope="session")
def release_marks(request: pytest.FixtureRequest) -> dict[str, tuple[object, ...]]:
    """What the marks ``release`` of all collected tests name, by the name of the test."""
    return request.config.stash[RELEASE_HALF].marks


@pytest.fixture(scope="session")
def make_once(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Callable[..., Path]:
    """A function that fills a folder once for all processes of a run: ``make_once(name, fill)``.

    With a third argument, all that decides what is made in values that JSON holds, the folder lies in
    pytest's cache, where later runs with the same find it. ``pytest --cache-clear`` forgets it.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if hasattr(request.config, "workerinput") else base
    cache = getattr(request.config, "cache", None)

    def make(name: str, fill: Callable[[Path], None], inputs: Mapping[str, Any] | None = None) -> Path:
        if cache is None or inputs is None:
            return _filled(shared / f"shared-{name}", fill)
        folder = cache.mkdir("made") / name
        folder.mkdir(exist_ok=True)
        entry = _filled(folder / fingerprint(inputs)[:16], fill)
        entry.touch()
        by_age = sorted(filter(Path.is_dir, folder.iterdir()), key=lambda path: path.stat().st_mtime)
        for path in by_age[:-MADE_BEFORE]:
            shutil.rmtree(path, ignore_errors=True)
        return entry

    return make


def _filled(folder: Path, fill: Callable[[Path], None]) -> Path:
    """Return the folder, which the first process that asks fills while others wait."""
    partial = folder.with_suffix(".partial")
    with FileLock(folder.with_suffix(".lock")):
        if not folder.is_dir():
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir()
            fill(partial)
            partial.rename(folder)
    return folder


@pytest.fixture(scope="session", autouse=True)
def _kernels_compiled_once(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> None:
    """Let workers compile no kernel that another is compiling."""
    if hasattr(request.config, "workerinput"):
        from tests import kernels_once

        kernels_once.register(tmp_path_factory.getbasetemp().parent)


@pytest.fixture(autouse=True)
def _environment_restored() -> Iterator[None]:
    """Leave no variable behind: commands called in the process of the tests set some for what they start."""
    before = dict(os.environ)
    yield
    for name in os.environ.keys() - before.keys() - {PLACE_OF_MKL}:
        del os.environ[name]
    os.environ.update(before)


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands of this process show no status, which on a busy machine stands before their error."""
    monkeypatch.setattr("pipeline.cli.printing.QUIET_S", 1e6)


@pytest.fixture(scope="session")
def shared_objects() -> Path:
    """Folder of real scanned objects with its catalogue; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("OBJECTFOLDER_SCANS", REPOSITORY.parent / "shared" / "objects"))
    if not (folder / "catalogue.csv").is_file():
        pytest.skip(f"no scanned objects at {folder}; set OBJECTFOLDER_SCANS to a folder with catalogue.csv")
    return folder


@pytest.fixture(scope="session")
def glass_bar() -> "TexturedMesh":
    """A 120 x 30 x 8 mm bar with a striped texture."""
    from tests.small_file import bar_mesh  # imports every sense, which few tests need

    return bar_mesh()


@pytest.fixture(scope="session")
def small_file() -> Path:
    """A verified Object File of the bar, with its truth beside it: ``views.zarr.zip``, ``modes.zarr.zip``."""
    return REPOSITORY / "tests" / "data" / "bar" / "bar.safetensors"
