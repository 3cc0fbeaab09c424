"""The real stages, as declared, over toy task bodies that count their executions."""

import csv
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from toys import REPOSITORY, commit, here

from pipeline.dataset.parameters import Parameters, read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import STAGES
from pipeline.run.converge import Summary, converge

SENSES = ("views", "modes", "touches")

COUNTING = '''
"""What all bodies share."""

from pathlib import Path

import numpy as np

from objectfolder.products.store import Array, Product

LOG = Path(__file__).parents[1] / "executed.log"


def executed(stage, request):
    with open(LOG, "a") as log:
        log.write(f"{stage} {request.object_id}\\n")


def product(value, **attributes):
    return Product({"values": Array(np.full(3, float(value % 97)), ("value",), "1", "toy")}, attributes)
'''

BODIES = {
    "objects": '''
"""A mesh is its numbers; comments in the file mean nothing."""

import hashlib

from .counting import executed, product


def run(request):
    executed("objects", request)
    text = request.inputs["mesh"].read_text()
    if "poison" in text:
        raise ValueError("no mesh")
    shape = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("#"))
    geometry = hashlib.sha256(shape.encode()).hexdigest()
    texture = request.inputs.get("texture")
    colour = hashlib.sha256(texture.read_bytes() if texture else b"").hexdigest()
    return product(
        1,
        digests={"geometry": geometry, "texture": colour, "body": geometry, "normals": geometry},
        length={"extents_m": [0.1, 0.1, 0.1]},
        area_m2=0.06,
        wall_thickness={"effective_m": 0.002, "median_m": 0.002, "thin_m": 0.002},
        warnings=["its walls are doubtful"] if "doubtful" in shape else [],
    )
''',
    "views": '''
"""Imports its dependency inside the function."""

from .counting import executed, product


def run(request):
    from .optics import INDEX

    executed("views", request)
    return product(request.seed * INDEX)
''',
    "modes": '''
"""Depends on a module that depends on another."""

from .counting import executed, product
from .elasticity import stiffness


def run(request):
    executed("modes", request)
    missed = request.object_id == "dish" and request.parameters["audio"]["accuracy_cents"] < 1
    said = ["accuracy_cents is not reached"] if missed else []
    return product(stiffness(request.record["material"]), warnings=said)
''',
    "touches": '''
"""What the sensor feels."""

from .counting import executed, product


def run(request):
    executed("touches", request)
    touch = request.parameters["touch"]
    return product(request.seed, sensor=touch["sensor"], contact=touch["contact"])
''',
    "collision": '''
"""Convex parts."""

from .counting import executed, product


def run(request):
    executed("collision", request)
    return product(request.seed, most_parts=request.parameters["collision"]["most_parts"])
''',
    "encode": '''
"""Weights."""

import numpy as np

from objectfolder.products.tensor_file import TensorFile

from .counting import executed


def run(request):
    executed("encode", request)
    return TensorFile({"weights": np.arange(5, dtype=np.float16)}, {"format": "toy"})
''',
    "fidelity": '''
"""Two products."""

import numpy as np

from objectfolder.products.tensor_file import TensorFile

from .counting import executed, product


def run(request):
    executed("fidelity", request)
    tensors = {"weights": np.arange(5, dtype=np.float16)}
    return TensorFile(tensors, {"name": request.record["name"]}), product(1)
''',
}
MODULES = {
    "counting": COUNTING,
    "optics": '"""Light."""\n\nINDEX = 3\n',
    "elasticity": '"""Solids."""\n\nfrom .units import PASCAL\n\n\ndef stiffness(material):\n'
    '    return int(material["youngs_modulus_pa"] * PASCAL)\n',
    "units": '"""Units."""\n\nPASCAL = 1.0\n',
    "stranger": '"""Nobody imports it."""\n\nVALUE = 1\n',
}
COLUMNS = ("id", "mesh", "texture", "material", "licence", "attribution", "mass_kg")


class Workshop:
    """Objects in a table, meshes and textures in files, and the stages over them.

    Parameters
    ----------
    root
        A new folder on ``sys.path``.
    package
        A name for the package of task bodies.
    """

    def __init__(self, root: Path, package: str) -> None:
        self.root = root
        self.bodies = root / package
        self.bodies.mkdir(parents=True)
        forget(package)
        for name, text in {"__init__": "", **MODULES, **BODIES}.items():
            (self.bodies / f"{name}.py").write_text(text)
        (root / "data").mkdir()
        for name in ("params.yaml", "data/materials.csv"):
            shutil.copy(REPOSITORY / name, root / name)
        self.stages: tuple[Stage, ...] = tuple(
            replace(stage, task=f"{package}.{name}:run", needs=frozenset()) for name, stage in STAGES.items()
        )
        self.table: list[dict[str, str]] = []

    def add(self, object_id: str, material: str = "steel", mesh: Path | None = None) -> None:
        """Add an object, with a mesh and a texture of its own where none is given."""
        if mesh is None:
            mesh = self.write(f"{object_id}.obj", f"# {object_id}\nv 0 0 {len(self.table)}\n")
            self.write(f"{object_id}.png", f"colour of {object_id}")
        row = {"id": object_id, "mesh": f"../{mesh.name}", "texture": f"../{mesh.stem}.png"}
        self.table.append({**row, "material": material, "licence": "CC0", "attribution": "A. Maker"})
        self.save()

    def row(self, object_id: str) -> dict[str, str]:
        """Return the row of an object in the table, to be changed and saved."""
        return next(row for row in self.table if row["id"] == object_id)

    def save(self) -> None:
        """Write the table."""
        with (self.root / "data/starter.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(self.table)

    def write(self, name: str, text: str) -> Path:
        """Write a file of the checkout."""
        path = self.root / name
        path.write_text(text)
        return path

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace the first place of a text: in params.yaml that of the default size, which stands first."""
        path = self.root / name
        text = path.read_text()
        assert old in text, (name, old)
        path.write_text(text.replace(old, new, 1))

    def edit_code(self, module: str, old: str, new: str) -> None:
        """Replace a text in the module of a body or one that it imports."""
        self.edit(f"{self.bodies.name}/{module}.py", old, new)

    def remember(self) -> None:
        """Keep the checkout as it is, beside it."""
        self._remembered = [dict(row) for row in self.table]
        shutil.copytree(self.root, self.root.with_name("remembered"))

    def restore(self) -> None:
        """Put back what was remembered."""
        self.table = [dict(row) for row in self._remembered]
        shutil.rmtree(self.root)
        shutil.copytree(self.root.with_name("remembered"), self.root)

    @property
    def parameters(self) -> Parameters:
        return read_parameters(self.root / "params.yaml")

    def converge(self) -> list[Summary]:
        """Converge all stages at once."""
        parameters = self.parameters
        rows = read_table(self.root, parameters.objects).rows
        summaries = converge(self.stages, self.root, parameters, rows, here)
        commit(self.root, self.stages)
        return summaries

    def executed(self) -> set[str]:
        """Converge, and return what was executed, each no more than once."""
        log = self.root / "executed.log"
        log.unlink(missing_ok=True)
        self.summaries = self.converge()
        lines = log.read_text().splitlines() if log.exists() else []
        assert len(set(lines)) == len(lines)
        return set(lines)

    def products(self) -> dict[str, bytes]:
        """Return every product by its path."""
        paths = (path for stage in self.stages for kind in stage.products for path in _files(self.root, kind))
        return {str(path.relative_to(self.root)): path.read_bytes() for path in paths}


def forget(package: str) -> None:
    """Take modules of a package out of this process: an earlier folder's, where tests run in any order."""
    for name in [name for name in sys.modules if name == package or name.startswith(f"{package}.")]:
        del sys.modules[name]


def _files(root: Path, kind: object) -> Sequence[Path]:
    return sorted((root / kind.folder).glob(f"*{kind.suffix}"))


@contextmanager
def made(folder: Path, package: str, **materials: str) -> Iterator[Workshop]:
    """A checkout where all is made and remembered: objects by their materials."""
    root = folder / "checkout"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root))
        workshop = Workshop(root, package)
        for object_id, material in materials.items():
            workshop.add(object_id, material)
        assert workshop.executed() == works(STAGES, *materials)
        workshop.remember()
        yield workshop


def works(stages: Sequence[str], *objects: str) -> set[str]:
    """Return the executions of all stages named for all objects named."""
    return {f"{stage} {object_id}" for stage in stages for object_id in objects}
