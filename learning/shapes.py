"""Shapes in the unit cube, and how alike two of them are, as Mescheder et al. (2019) measure it.

The cube is that of the unit frame with a margin. Distances are in lengths of the object's longest side.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree
from skimage.measure import marching_cubes

from learning.enclosure import Columns
from objectfolder.object_file import ObjectFile

Floats = NDArray[np.float64]
HALF_SIDE = 0.55  # of the cube: 10 % more than the object
EMPTY_DISTANCE = np.sqrt(3.0)  # of a prediction without a surface
VOLUME_POINTS = 100_000


@dataclass(frozen=True)
class Likeness:
    """How alike a predicted shape is to the true one.

    Attributes
    ----------
    iou : volume in both over volume in either
    chamfer : mean of the mean distances from each surface to the other, not squared
    normal_consistency : mean of |cos| between normals at nearest points, both ways: a surface turned inside
        out loses nothing, and unlike shapes have .54 to .63
    """

    iou: float
    chamfer: float
    normal_consistency: float


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


def likeness(
    predicted: trimesh.Trimesh | None, true: trimesh.Trimesh, iou: float, count: int, seed: int
) -> Likeness:
    """Compare two shapes.

    Parameters
    ----------
    predicted
        None if nothing was predicted.
    iou
        Their `overlap`.
    count
        Points of each surface.
    """
    if predicted is None or not len(predicted.faces):
        return Likeness(0.0, float(EMPTY_DISTANCE), 0.0)
    (predicted_points, faces_here), (true_points, faces_there) = (
        trimesh.sample.sample_surface(mesh, count, seed=seed + side)
        for side, mesh in enumerate((predicted, true))
    )
    normals = predicted.face_normals[faces_here], true.face_normals[faces_there]
    to_true, nearest_true = KDTree(true_points).query(predicted_points)
    to_predicted, nearest_predicted = KDTree(predicted_points).query(true_points)
    same = (
        np.abs((normals[0] * normals[1][nearest_true]).sum(axis=1)).mean(),
        np.abs((normals[1] * normals[0][nearest_predicted]).sum(axis=1)).mean(),
    )
    chamfer = (np.mean(to_true) + np.mean(to_predicted)) / 2
    return Likeness(iou, float(chamfer), float(np.mean(same)))


def grid_points(cells: int, mask: NDArray[np.bool_] | None = None) -> Floats:
    """Return corners (n, 3) of a grid of cells over the cube: all, or those of a mask (cells + 1, ...)."""
    line = np.linspace(-HALF_SIDE, HALF_SIDE, cells + 1)
    corners = np.ones(3 * [cells + 1], dtype=bool) if mask is None else mask
    return line[np.argwhere(corners)]


def surface_of(logits: NDArray[np.float32], cells: int) -> trimesh.Trimesh | None:
    """Return where the occupancy's logit, given at `grid_points`, is 0; None if nowhere."""
    side = cells + 1
    # A layer of empty corners closes what reaches the border.
    values = np.pad(logits.reshape(side, side, side), 1, constant_values=-10.0)
    if values.max() <= 0:
        return None
    vertices, faces, _, _ = marching_cubes(values, 0.0)
    return trimesh.Trimesh((vertices - 1) * (2 * HALF_SIDE / cells) - HALF_SIDE, faces[:, ::-1])
