"""Shapes in the unit cube, which is that of the unit frame with a margin.

Distances are in lengths of the object's longest side.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

from learning.enclosure import Columns
from objectfolder.object_file import ObjectFile

Floats = NDArray[np.float64]
HALF_SIDE = 0.55  # of the cube: 10 % more than the object
VOLUME_POINTS = 100_000


def unit_mesh(file: ObjectFile) -> trimesh.Trimesh:
    """Return an object's surface in the unit frame; open where the object's is."""
    vertices = file.frame.to_unit(file.surface.vertices)
    return trimesh.Trimesh(vertices, file.surface.faces, process=False)


def volume_points(seed: int, count: int = VOLUME_POINTS) -> Floats:
    """Return points (count, 3) uniform in the cube."""
    return np.random.default_rng(seed).uniform(-HALF_SIDE, HALF_SIDE, (count, 3))


def near_surface(mesh: trimesh.Trimesh, count: int, seed: int, spread: float = 0.005) -> Floats:
    """Return points (count, 3) about a surface: uniform points of the cube starve thin objects."""
    points, _ = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return points + np.random.default_rng(seed).normal(scale=spread, size=points.shape)


def inside(mesh: trimesh.Trimesh | None, points: Floats) -> NDArray[np.bool_]:
    """Return which points a closed mesh has inside; none for no mesh."""
    return np.zeros(len(points), dtype=bool) if mesh is None else Columns(points).inside(mesh)


def overlap(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Return the intersection over the union of two volumes, by which points (n,) they hold."""
    either = np.count_nonzero(first | second)
    return np.count_nonzero(first & second) / either if either else 0.0
