"""A data set of toys: a package of task bodies that count their executions, and stages over them."""

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.dataset.crew import Finished, Job, Lost, Slot
from pipeline.dataset.parameters import Parameters, read_parameters
from pipeline.dataset.products import TENSORS, ProductKind
from pipeline.dataset.stage import ProductInput, Stage
from pipeline.run.converge import CrewFor, Summary, converge
from pipeline.sandbox.child import execute

REPOSITORY = Path(__file__).parents[2]

TASKS = '''
"""Toy task bodies; each execution leaves a line in executed.log."""

import time
from pathlib import Path

import numpy as np

from objectfolder.store import Array, Product
from objectfolder.tensor_file import TensorFile


def executed(name, request):
    with open(Path(__file__).parents[1] / "executed.log", "a") as log:
        log.write(f"{name} {request.object_id}\\n")


def ingest(request):
    executed("ingest", request)
    text = request.inputs["mesh"].read_text()
    if text.startswith("poison"):
        exec(text.partition(" ")[2])
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

from pipeline.cluster.cluster import crew, read_place
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
        stages, root, toys.parameters, toys.rows, lambda jobs: crew(place, root, jobs)
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

    def converge(self, *stages: Stage, crew_for: CrewFor | None = None) -> list[Summary]:
        """Converge stages one after the other, as DVC does."""
        return [self.flow(stage, crew_for=crew_for)[0] for stage in stages or self.stages]

    def flow(self, *stages: Stage, crew_for: CrewFor | None = None) -> list[Summary]:
        """Converge stages at once."""
        return converge(stages or self.stages, self.root, self.parameters, self.rows, crew_for or here)

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


class Here:
    """A crew of one that runs jobs in this process, and notes their order."""

    def __init__(self) -> None:
        self.order: list[str] = []
        self._job: Job | None = None

    def slots(self) -> Mapping[str, Slot]:
        return {"here": Slot("here", "here")}

    def memory_bytes(self) -> Mapping[str, int]:
        return {"here": 1 << 40}

    def may_still_offer(self, needs: frozenset[str]) -> bool:
        return False

    def start(self, job: Job, slot: str) -> None:
        assert self._job is None
        self._job = job
        self.order.append(f"{job.call.stage} {job.call.request.object_id}")

    def wait(self) -> Sequence[Finished | Lost]:
        job, self._job = self._job, None
        assert job is not None
        return [Finished(job, "here", execute(job.call))]


@contextmanager
def here(jobs: int) -> Iterator[Here]:
    """Who runs jobs in this process."""
    assert jobs > 0
    yield Here()


def python(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], cwd=root, capture_output=True, text=True, check=False)
