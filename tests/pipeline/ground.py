"""A data set of toys of realistic shape: three stages, four products an object, tasks of 50 to 200 ms.

Its tasks write down when they begin, its runs are processes, and those that they leave behind can be found.
"""

import contextlib
import hashlib
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import psutil
from toys import Toys

from objectfolder.errors import FormatError
from pipeline.dataset import products
from tests.patience import wait_until

REPOSITORY = Path(__file__).parents[2]
PACKAGE = "disturbed_toys"
STAGES = "ingest,tune,encode"
MARK = "DISTURBED_RUN"  # in the environment of every process of a run
GENEROUS_S = 180.0

TASKS = '''
"""Task bodies that take a while and make products of some size; each execution leaves a line."""

import os
import time
import zlib
from pathlib import Path

import numpy as np

from objectfolder.products.store import Array, Product
from objectfolder.products.tensor_file import TensorFile

LOG = Path(os.environ.get("EXECUTED_LOG") or Path(__file__).parents[1] / "executed.log")


def work(name, request, least_s, most_s):
    descriptor = os.open(LOG, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(descriptor, f"{name} {request.object_id} {os.getpid()} {time.time():.6f}\\n".encode())
    os.close(descriptor)
    share = zlib.crc32(f"{name} {request.object_id}".encode()) % 1000 / 1000
    time.sleep((least_s + (most_s - least_s) * share) * float(os.environ.get("PATIENCE", "1")))
    return np.random.default_rng(request.seed)


def ingest(request):
    chance = work("ingest", request, 0.05, 0.1)
    text = request.inputs["mesh"].read_text()
    if text.startswith("poison"):
        exec(text.partition(" ")[2])
    values = float(text) + chance.random((8, 4096))
    return Product(
        {"values": Array(values, ("row", "column"), "1", "toy")},
        {"digests": {"shape": text, "colour": "red"}},
    )


def tune(request):
    chance = work("tune", request, 0.08, 0.2)
    return Product({"values": Array(chance.random(1 << 16), ("mode",), "Hz", "toy")}, {})


def encode(request):
    chance = work("encode", request, 0.05, 0.15)
    tensors = {"weights": chance.random(1 << 17).astype(np.float32)}
    return TensorFile(tensors, {"format": "toy"}), Product({}, {"psnr_db": float(chance.random())})
'''


@dataclass(frozen=True)
class Execution:
    """A task body that began."""

    task: str
    object_id: str
    pid: int
    time: float

    @property
    def work(self) -> tuple[str, str]:
        """What it was about."""
        return self.task, self.object_id


def read_executions(log: Path) -> list[Execution]:
    """Return what task bodies wrote to their log."""
    lines = log.read_text().splitlines() if log.exists() else []
    return [Execution(task, name, int(pid), float(at)) for task, name, pid, at in map(str.split, lines)]


class Ground:
    """A data set of toys that disturbed runs make.

    Parameters
    ----------
    root
        Its folder, new.
    contents
        What each object is made from: a number, or ``poison`` and code.
    settings
        Of the cluster on this machine, besides its two workers.
    """

    def __init__(self, root: Path, contents: Mapping[str, str], **settings: object) -> None:
        self.root = root
        root.mkdir(parents=True, exist_ok=True)
        self.temporary = root / "temporary"
        self.temporary.mkdir()
        self.log = root / "executed.log"
        self.toys = Toys(root, PACKAGE)
        self.toys.tasks.write_text(TASKS)
        for object_id, content in contents.items():
            self.toys.add(object_id, content)
        self.toys.save()
        (root / "cluster").mkdir()
        (root / "cluster" / "local.yaml").write_text(
            json.dumps({"kwargs": {"threads_per_worker": 2}, **settings})
        )

    @property
    def environment(self) -> dict[str, str]:
        """Variables of every process of its runs."""
        return {
            **os.environ,
            MARK: str(self.root),
            "PYTHONPATH": os.pathsep.join([str(self.root), str(REPOSITORY)]),
            "TMPDIR": str(self.temporary),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }

    @property
    def works(self) -> set[tuple[str, str]]:
        """All that is to be done."""
        return {(stage.name, object_id) for stage in self.toys.stages for object_id in self.toys.rows}

    @property
    def folders(self) -> list[str]:
        """Where products lie, from its root."""
        return [kind.folder for stage in self.toys.stages for kind in stage.products]

    def start(self, *arguments: str, environment: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
        """Start the driver, or another Python of the run."""
        with open(self.root / "output.log", "ab") as output:
            return subprocess.Popen(
                [sys.executable, *(arguments or ("driver.py", STAGES))],
                cwd=self.root,
                env={**self.environment, **(environment or {})},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )

    def run(self, stages: str = STAGES, environment: Mapping[str, str] | None = None) -> int:
        """Run the driver to its end; return its exit code."""
        process = self.start("driver.py", stages, environment=environment)
        try:
            return process.wait(GENEROUS_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise

    def executions(self) -> list[Execution]:
        """Return what began, in order."""
        return read_executions(self.log)

    def counts(self) -> Counter[tuple[str, str]]:
        """Return how often each task of each object began."""
        return Counter(execution.work for execution in self.executions())

    def stands(self, work: tuple[str, str]) -> bool:
        """Whether all products of a task and object can be read."""
        stage = next(stage for stage in self.toys.stages if stage.name == work[0])
        return all(is_whole(path) for path in stage.targets(self.root, work[1]))

    def digests(self) -> dict[str, str]:
        """Return the SHA-256 of every product."""
        paths = (
            path
            for folder in self.folders
            for path in self.root.glob(f"{folder}/*")
            if not path.name.startswith(".")
        )
        return {
            str(path.relative_to(self.root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths
        }

    def processes(self) -> list[psutil.Process]:
        """Return the processes of its runs that are alive, wherever their parents are."""
        return marked(str(self.root))

    def end(self) -> None:
        """End the processes that its runs left behind."""
        for process in self.processes():
            with contextlib.suppress(psutil.Error):
                process.kill()

    def litter(self) -> list[str]:
        """Return temporary files left, but for locks, and half-written ones beside the products.

        The folder of a scheduler that was killed is Dask's, and goes when Dask starts there again.
        """
        left = [
            *(path for path in self.temporary.iterdir() if not path.is_dir()),
            *(
                path
                for path in self.temporary.glob("*/*")
                if path.suffix != ".lock" and not path.match("dask-scratch-space/scheduler-*")
            ),
            *self.root.glob("data/*/.*.partial"),
        ]
        return sorted(str(path.relative_to(self.root)) for path in left)


def marked(mark: str) -> list[psutil.Process]:
    """Return the living processes that carry a mark in their environment."""
    processes = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            if process.status() != psutil.STATUS_ZOMBIE and process.environ().get(MARK) == mark:
                processes.append(process)
    return processes


def is_whole(path: Path) -> bool:
    """Whether a product is there and undamaged."""
    try:
        products.verify(path)
        return products.read_fingerprint(path) is not None
    except (FormatError, OSError):
        return False


def wait_for(condition: Callable[[], object], what: str, seconds: float = GENEROUS_S) -> None:
    """Wait until `condition` holds.

    Raises
    ------
    TimeoutError
        It does not.
    """
    wait_until(condition, what, seconds)
