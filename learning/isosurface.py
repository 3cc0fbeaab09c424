"""The surface of a shape whose occupancy is known on a grid over the unit cube."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from learning.shapes import HALF_SIDE, Floats


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
