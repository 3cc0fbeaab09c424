"""A mesh of fewer faces, with the textures that it has, and how far its surface moved."""

import importlib.util
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from objectfolder.child_process import last_words, run_module
from objectfolder.errors import SimulationError
from objectfolder.extras import missing_package
from objectfolder.making.mesh.cleaning import welded
from objectfolder.surface.textured_mesh import TexturedMesh

DISTANCE_SAMPLES = 4_000
"""Points of each surface that its distance from the other is measured at."""
PATIENCE_S = 3600


@dataclass(frozen=True)
class Decimation:
    """A decimated mesh.

    Parameters
    ----------
    mesh
        Of at most the faces that were asked for; the source's normals are left out.
    faces_before
        Of the source.
    distance
        Largest distance between the two surfaces at `DISTANCE_SAMPLES` points of each and all vertices of the
        new one (Hausdorff), in units of the mesh.
    """

    mesh: TexturedMesh
    faces_before: int
    distance: float

    @property
    def distance_share(self) -> float:
        """`distance` over the longest side."""
        return self.distance / float(self.mesh.extents.max())


def decimate(mesh: TexturedMesh, faces: int) -> Decimation:
    """Bring a mesh to at most `faces` triangles by Blender's collapse of edges, in a child process.

    Vertices of equal position are welded before, so that nothing opens; seams of texture coordinates stay
    seams. A mesh that has no more faces is left as it is.

    Raises
    ------
    MissingPackageError
        Blender is not installed.
    SimulationError
        Blender failed, or could not reach so few faces.
    """
    before = len(mesh.faces)
    if before <= faces:
        return Decimation(mesh, before, 0.0)
    if importlib.util.find_spec("bpy") is None:
        raise missing_package("bpy", "factory", "is not installed: it decimates meshes, on Python 3.11")
    vertices, of_vertex = welded(mesh.vertices)
    corners = of_vertex[mesh.faces]
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    centre = vertices.mean(axis=0)  # Blender has single precision
    with tempfile.TemporaryDirectory(prefix="objectfolder-decimation-") as folder:
        source, target = Path(folder) / "mesh.npz", Path(folder) / "less.npz"
        np.savez(
            source,
            vertices=vertices - centre,
            faces=corners[whole],
            texture_coordinates=np.nan_to_num(mesh.texture_coordinates[whole]),
            face_texture=mesh.face_texture[whole],
            target=faces,
        )
        try:
            process = run_module("pipeline.run.decimation_process", source, target, timeout_s=PATIENCE_S)
        except subprocess.TimeoutExpired as error:
            raise SimulationError("Blender's decimation", "took too long") from error
        if process.returncode or not target.exists():
            raise SimulationError("Blender's decimation", f"failed ({last_words(process.stderr)})")
        less = np.load(target)
        result = replace(
            mesh,
            vertices=less["vertices"].astype(np.float64) + centre,
            faces=less["faces"].astype(np.int64),
            texture_coordinates=less["texture_coordinates"].astype(np.float64),
            face_texture=less["face_texture"].astype(np.int32),
            normals=None,
        )
    if len(result.faces) > faces:
        finding = f"stopped at {len(result.faces)} faces of {before}, where {faces} were asked for"
        raise SimulationError("Blender's decimation", finding, "Ask for more faces")
    forth = result.surface.closest_points(mesh.surface.sample(DISTANCE_SAMPLES, 0).points).distance
    points = np.concatenate([result.surface.sample(DISTANCE_SAMPLES, 1).points, result.vertices])
    back = mesh.surface.closest_points(points).distance
    return Decimation(result, before, float(max(forth.max(), back.max())))
