"""A repository of a data set that costs nothing but overhead: the real stages, trivial task bodies.

Code, ``dvc.yaml`` and parameters are this project's. Only the bodies in ``pipeline/tasks`` are replaced:
each keeps the imports of the real one where they are never run, so that the code to identify is the
same, and makes a product with as many entries and as large attributes as a real one of the default size.
"""

import ast
import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

from bench.record import REPOSITORY

COPIED = (
    "objectfolder", "pipeline", "bench/results", "data/materials.csv", "data/retry.json",
    "data/selection/.gitignore", "dvc.yaml", "params.yaml", "requirements.lock",
)  # fmt: skip
# A variable by which this process may find other code, or compile all code in each process anew.
NOT_OF_USERS = ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE")
GITIGNORE = "__pycache__/\n/.objectfolder/\n/runs/\n"
DVCIGNORE = "__pycache__\n*.pyc\n*.partial\n.objectfolder\nruns\n"
MESH = """\
v 0 0 0
v {size} 0 0
v 0 {size} 0
v 0 0 {size}
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
"""

# Of products of the default size: images stored a chunk each, and bytes of attributes without provenance.
CHUNKS = {"objects": 0, "views": 560, "modes": 0, "touches": 450, "collision": 0, "fidelity": 24}
ATTRIBUTE_BYTES = {
    "objects": 2000,
    "views": 1500,
    "modes": 3600,
    "touches": 2500,
    "collision": 200,
    "encode": 3500,
}

HEADER = """
import hashlib

import numpy as np

from objectfolder.products.store import Array, Product
from objectfolder.products.tensor_file import TensorFile


def product(chunks, attributes):
    arrays = {"values": Array(np.zeros(8), ("value",), "1", "values")}
    if chunks:
        images = np.zeros((chunks, 64, 65), np.uint8)
        arrays["images"] = Array(images, ("image", "y", "x"), "1", "images")
    return Product(arrays, attributes)

"""
BODIES = {
    "objects": """
def prepare_object(request):
    digest = hashlib.sha256(request.inputs["mesh"].read_bytes()).hexdigest()
    measures = {
        "digests": {"geometry": digest, "texture": digest, "body": digest, "normals": digest},
        "length": {"extents_m": [0.19, 0.026, 0.009]},
        "area_m2": 0.0065,
        "wall_thickness": {"effective_m": 0.0017, "median_m": 0.0022, "thin_m": 0.0015},
    }
    return product(CHUNKS, {**measures, "warnings": [], "more": "x" * BYTES})
""",
    "views": """
def render_views(request):
    return product(CHUNKS, {"more": "x" * BYTES})
""",
    "modes": """
def compute_modes(request):
    return product(CHUNKS, {"warnings": [], "more": "x" * BYTES})
""",
    "touches": """
def press_sensor(request):
    touch = request.parameters["touch"]
    return product(CHUNKS, {"sensor": touch["sensor"], "contact": touch["contact"], "more": "x" * BYTES})
""",
    "collision": """
def part_object(request):
    measures = {"parts": 1, "union_iou": 1.0, "outward_m": 0.0, "absent": None}
    return product(CHUNKS, {**measures, "more": "x" * BYTES})
""",
    "encode": """
def encode_object(request):
    return TensorFile({"weights": np.zeros(8, np.float32)}, {"more": "x" * BYTES})
""",
    "verify": """
def verify_object(request):
    described = {"id": request.object_id, "name": request.record["name"]}
    tensors = TensorFile({"weights": np.zeros(8, np.float32)}, {"more": "x" * BYTES, "object": described})
    return tensors, product(CHUNKS, {"object": described, "more": "x" * BYTES})
""",
}


class OverheadRepository:
    """Trivial objects in a git repository under DVC.

    Parameters
    ----------
    root
        An empty or new folder.
    objects
        How many objects.
    """

    def __init__(self, root: Path, objects: int) -> None:
        self.root = root
        root.mkdir(parents=True, exist_ok=True)
        for name in COPIED:
            source = REPOSITORY / name
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                shutil.copytree(source, root / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, root / name)
        for name in BODIES:
            write_trivial_body(root / "pipeline" / "tasks" / f"{name}.py")
        (root / "cluster").mkdir()
        (root / "cluster" / "local.yaml").write_text("kwargs: {threads_per_worker: 2}\n")
        (root / ".gitignore").write_text(GITIGNORE)
        self.ids = [f"object_{index:05}" for index in range(objects)]
        for index, object_id in enumerate(self.ids):
            self.write_mesh(object_id, 0.1 + index * 1e-6)
        with (root / "data" / "starter.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("id", "mesh", "material"))
            writer.writerows((name, f"../meshes/{name}.obj", "steel") for name in self.ids)
        parameters = root / "params.yaml"
        parameters.write_text(parameters.read_text().replace("meshes: data/starter", "meshes: meshes"))
        self.run("git", "init", "-q")
        self.run("dvc", "init", "-q")
        (root / ".dvcignore").write_text(DVCIGNORE)

    def write_mesh(self, object_id: str, size_m: float) -> None:
        """Write a tetrahedron as the mesh of an object."""
        path = self.root / "meshes" / f"{object_id}.obj"
        path.parent.mkdir(exist_ok=True)
        path.write_text(MESH.format(size=size_m))

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run a command in the repository.

        Raises
        ------
        RuntimeError
            The command failed.
        """
        done = self.try_(*command)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)}: {done.stdout[-2000:]}{done.stderr[-4000:]}")
        return done

    def try_(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run a command in the repository, whatever comes of it."""
        environment = {name: value for name, value in os.environ.items() if name not in NOT_OF_USERS}
        folder = Path(sys.executable).parent
        environment |= {"DVC_NO_ANALYTICS": "1", "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}
        return subprocess.run(
            command, cwd=self.root, capture_output=True, text=True, check=False, env=environment
        )


def write_trivial_body(path: Path) -> None:
    """Put a trivial body in place of a task's, the imports of the real one kept where they never run."""
    imports = [
        ast.unparse(node)
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    stage = "fidelity" if path.stem == "verify" else path.stem
    body = BODIES[path.stem].replace("CHUNKS", str(CHUNKS.get(stage, 0)))
    body = body.replace("BYTES", str(ATTRIBUTE_BYTES.get(stage, 12_000)))
    path.write_text(HEADER + body + "\n\ndef real():\n" + "".join(f"    {line}\n" for line in imports))
