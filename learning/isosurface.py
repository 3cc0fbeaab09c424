"""The surface of a shape whose occupancy is known on a grid over the unit cube."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from skimage.measure import marching_cubes
from sklearn.preprocessing import normalize
from trimesh.smoothing import filter_laplacian

from learning.shapes import HALF_SIDE, Floats

SMOOTHING_ROUNDS = 4  # more gain on normals, and lose walls that are hardly thicker than a cell


def grid_points(cells: int, mask: NDArray[np.bool_] | None = None) -> Floats:
    """Return corners (n, 3) of a grid of cells over the cube: all, or those of a mask (cells + 1, ...)."""
    line = np.linspace(-HALF_SIDE, HALF_SIDE, cells + 1)
    corners = np.ones(3 * [cells + 1], dtype=bool) if mask is None else mask
    return line[np.argwhere(corners)]


def surface_of(logits: NDArray[np.float32], cells: int) -> trimesh.Trimesh | None:
    """Return where the occupancy's logit, given at `grid_points`, is 0, smoothed; None if nowhere.

    The logit is nearly a step, so marching cubes make stairs of the cells. The smoothing is of Laplace: in
    each of `SMOOTHING_ROUNDS` a vertex goes half way to the mean of its neighbours.
    """
    side = cells + 1
    # A layer of empty corners closes what reaches the border.
    values = np.pad(logits.reshape(side, side, side), 1, constant_values=-10.0)
    if values.max() <= 0:
        return None
    vertices, faces, _, _ = marching_cubes(values, 0.0)
    mesh = trimesh.Trimesh((vertices - 1) * (2 * HALF_SIDE / cells) - HALF_SIDE, faces[:, ::-1])
    means = normalize(mesh.edges_sparse.astype(np.float64).tocsr(), norm="l1")
    return filter_laplacian(mesh, 0.5, SMOOTHING_ROUNDS, volume_constraint=False, laplacian_operator=means)
