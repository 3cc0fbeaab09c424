"""A data set of toys: a package of task bodies that count their executions, and stages over them."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pipeline.dataset.job import Finished, Job
from pipeline.dataset.manifest import list_products
from pipeline.dataset.parameters import Parameters, read_parameters
from pipeline.dataset.products import TENSORS, ProductKind
from pipeline.dataset.stage import ProductInput, Stage
from pipeline.dataset.verified import Verified
from pipeline.run.converge import RunnerFor, Summary, converge
from pipeline.sandbox.child import execute
from pipeline.store.product_cache import ProductCache
from pipeline.store.storage import copy_file

REPOSITORY = Path(__file__).parents[2]

TASKS = '''
"""Toy task bodies; each execution leaves a line in executed.log."""

import time
from pathlib import Path

import numpy as np

from objectfolder.products.store import Array, Product
from objectfolder.products.tensor_file import TensorFile


def executed(name, request):
    with open(Path(__file__).parents[1] / "executed.log", "a") as log:
        log.write(f"{name} {request.object_id}\\n")


def ingest(request):
    executed("ingest", request)
    text = request.inputs["mesh"].read_text()
    if text.startswith("poison"):
        code, _, text = text.partition("\\n")
        exec(code.partition(" ")[2])
    values = np.full((8, 300), float(text))
    return Product(
        {"values": Array(values, ("row", "column"), "1", "toy")},
        {"digests": {"shape": text, "colour": "red"}},
    )


def tune(request):
    executed("tune", request)
    time.sleep(request.parameters["vision.training_views"] / 1000)
    scale = request.record["material"]["stiffness"]
    return Product({"values": Array(np.full(4, scale * request.seed % 7.0), ("mode",), "Hz", "toy")}, {})


def encode(request):
    executed("encode", request)
    tensors = {"weights": np.arange(5, dtype=np.float16)}
    return TensorFile(tensors, {"format": "toy"}), Product({}, {"psnr_db": 40.0})
'''

DRIVER = '''
"""Converge one toy stage, as a process of its own."""

import json
import sys
from pathlib import Path

sys.path.insert(0, "@TESTS@")
from toys import Toys

from pipeline.cluster.cluster import runner
from pipeline.cluster.places import read_place
from pipeline.run.converge import converge

if __name__ == "__main__":
    root = Path.cwd()
    toys = Toys(root, "@PACKAGE@")
    toys.rows = json.loads(Path("rows.json").read_text())
    for row in toys.rows.values():
        row["mesh"] = Path(row["mesh"])
    stages = [getattr(toys, name) for name in sys.argv[1].split(",")]
    place = read_place(root)
    summaries = converge(
        stages, root, toys.parameters, toys.rows, lambda jobs: runner(place, root, jobs)
    )
    sys.exit(max(summary.exit_code(allow_failures=len(sys.argv) > 2) for summary in summaries))
'''

INGESTED = ProductKind("data/ingested", stage="ingest")
TUNED = ProductKind("data/tuned", stage="tune")
FILES = ProductKind("data/files", TENSORS, "encode")
QUALITY = ProductKind("data/quality", stage="encode")


class Toys:
    """A folder with toy objects and the stages ingest, tune and encode over them."""

    def __init__(self, root: Path, package: str) -> None:
        self.root = root
        self.package = package
        self.rows: dict[str, dict[str, object]] = {}
        self.tasks = root / package / "tasks.py"
        if not self.tasks.exists():
            self.tasks.parent.mkdir()
            (root / package / "__init__.py").write_text("")
            self.tasks.write_text(TASKS)
            (root / "params.yaml").write_text((REPOSITORY / "params.yaml").read_text())
            self.set_parameter("training_views", 5)
        self.ingest = Stage(
            "ingest",
            f"{package}.tasks:ingest",
            (INGESTED,),
            sources=lambda row: {"mesh": row["mesh"]},
        )
        self.tune = Stage(
            "tune",
            f"{package}.tasks:tune",
            (TUNED,),
            inputs=(ProductInput(INGESTED, ("digests.shape",)),),
            parameters=("vision.training_views",),
            fields=("material",),
        )
        self.encode = Stage(
            "encode",
            f"{package}.tasks:encode",
            (FILES, QUALITY),
            inputs=(ProductInput(INGESTED, ("digests.shape",)), ProductInput(TUNED)),
        )

    def add(self, object_id: str, content: str = "1.0") -> None:
        mesh = self.root / f"{object_id}.mesh"
        mesh.write_text(content)
        self.rows[object_id] = {"mesh": mesh, "material": {"stiffness": 3.0}}

    def set_parameter(self, name: str, value: int) -> None:
        path = self.root / "params.yaml"
        lines = path.read_text().splitlines(keepends=True)
        first = next(index for index, line in enumerate(lines) if line.strip().startswith(f"{name}:"))
        lines[first] = f"{lines[first].partition(name)[0]}{name}: {value}\n"
        path.write_text("".join(lines))

    @property
    def parameters(self) -> Parameters:
        return read_parameters(self.root / "params.yaml")

    @property
    def stages(self) -> tuple[Stage, ...]:
        return self.ingest, self.tune, self.encode

    def converge(self, *stages: Stage, runner_for: RunnerFor | None = None) -> list[Summary]:
        """Converge stages one after the other, as DVC does."""
        return [self.flow(stage, runner_for=runner_for)[0] for stage in stages or self.stages]

    def flow(self, *stages: Stage, runner_for: RunnerFor | None = None) -> list[Summary]:
        """Converge stages at once."""
        return converge(stages or self.stages, self.root, self.parameters, self.rows, runner_for or here)

    def commit(self) -> None:
        """Put all products into DVC's cache."""
        commit(self.root, self.stages)

    def save(self) -> None:
        """Write what a driver process needs."""
        (self.root / "rows.json").write_text(json.dumps(self.rows, default=str))
        driver = DRIVER.replace("@TESTS@", str(Path(__file__).parent)).replace("@PACKAGE@", self.package)
        (self.root / "driver.py").write_text(driver)

    def executed(self) -> list[str]:
        """Executions since the last time this was asked, sorted."""
        log = self.root / "executed.log"
        lines = log.read_text().splitlines() if log.exists() else []
        log.unlink(missing_ok=True)
        return sorted(lines)


def commit(root: Path, stages: Iterable[Stage]) -> None:
    """Put all products into DVC's cache, as DVC does, and note which they are."""
    cache = ProductCache(root)
    entries = list_products(root, stages, Verified(root))
    for entry in entries:
        if not cache.path(entry.md5).exists():
            copy_file(root / entry.path, cache.path(entry.md5))
    cache.add(entries)


class Here:
    """Runs jobs in this process, those with the longest chain first, and notes their order."""

    def __init__(self) -> None:
        self.order: list[str] = []
        self._jobs: list[Job] = []

    def submit(self, job: Job) -> None:
        self._jobs.append(job)

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        while self._jobs:
            job = max(self._jobs, key=lambda candidate: candidate.path_seconds)
            self._jobs.remove(job)
            self.order.append(f"{job.call.stage} {job.object_id}")
            yield Finished(job, execute(job.call))


@contextmanager
def here(jobs: int) -> Iterator[Here]:
    """Who runs jobs in this process."""
    assert jobs > 0
    yield Here()


def python(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], cwd=root, capture_output=True, text=True, check=False)


def read_record(path: Path) -> list[dict[str, Any]]:
    """The lines of the record of a run, without those that a kill cut short."""
    entries = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        with suppress(ValueError):
            entries.append(json.loads(line))
    return entries
