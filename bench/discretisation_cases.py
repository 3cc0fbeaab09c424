"""Bodies on which ways of discretising are compared, their references, and meshes any library could take."""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.discretisation_outcome import MAX_FREQUENCY_HZ
from bench.references.bodies import BODIES
from objectfolder.audio.materials import Material, find_material, read_materials
from objectfolder.catalogue import read_catalogue
from objectfolder.mesh.ingest import ingest_object
from objectfolder.mesh.mesh import textured_mesh_of
from objectfolder.solid.solid import Solid, clean
from objectfolder.surface.surface import Surface

REPOSITORY = Path(__file__).parents[1]
SCANS = Path(os.environ.get("OBJECTFOLDER_SCANS", REPOSITORY.parent / "shared" / "objects"))
TETWILD = """
import numpy, pytetwild
given = numpy.load("in.npz")
vertices, tetrahedra = pytetwild.tetrahedralize(given["vertices"], given["faces"], num_threads=1, quiet=True)
numpy.savez("out.npz", vertices=vertices, tetrahedra=tetrahedra)
"""


@dataclass(frozen=True)
class Case:
    """A body to be solved.

    Attributes
    ----------
    name, surface, material : of the body
    reference_hz : undamped frequencies of its audible modes; None where our finest answer must serve
    """

    name: str
    surface: Surface
    material: Material
    reference_hz: np.ndarray | None


def materials() -> dict[str, Material]:
    return read_materials(REPOSITORY / "data" / "materials.csv")


def revolution_case(name: str) -> Case:
    """A body of revolution with its axisymmetric reference."""
    body = BODIES[name]()
    material = materials()[body.material]
    truth = body.spectrum(material, MAX_FREQUENCY_HZ)
    return Case(name, body.surface(), material, truth.frequencies_hz(material))


def scan_case(object_id: str, scans: Path) -> Case:
    """A scan of the catalogue in a folder."""
    known = materials()
    record = {r.id: r for r in read_catalogue(scans / "catalogue.csv", known).records}[object_id]
    mesh = ingest_object(record.mesh, None, record.length_m, object_id, with_textures=False)
    material = find_material(known, record.material, object_id)
    return Case(object_id, textured_mesh_of(mesh).surface, material, None)


def tetwild(surface: Surface) -> Solid:
    """The mesh that pytetwild makes as it comes: edges 1/20 and an envelope of 1/1000 of the diagonal."""
    with tempfile.TemporaryDirectory() as folder:  # it leaves files where it runs
        np.savez(Path(folder) / "in.npz", vertices=surface.vertices, faces=surface.faces.astype(np.int32))
        subprocess.run([sys.executable, "-c", TETWILD], cwd=folder, check=True, capture_output=True)
        with np.load(Path(folder) / "out.npz") as made:
            return clean(made["vertices"], made["tetrahedra"].astype(np.int64), {})
