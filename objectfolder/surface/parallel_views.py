"""A surface seen along parallel rays, to scale."""

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.surface import Hits, Surface

Floats = NDArray[np.float64]

LIGHT_DIRECTION = np.array([-0.45, 0.55, 0.9]) / np.linalg.norm([0.45, 0.55, 0.9])
"""Direction to the lamp along the picture's right, up and back."""


def axes_towards(eye: Floats, above: Floats) -> Floats:
    """Return the (3, 3) axes of a picture from the direction `eye`, in which `above` is up, for `look`.

    Examples
    --------
    >>> axes_towards(np.array([2.0, 0, 0]), np.array([0.0, 0, 1])).tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    back = eye / np.linalg.norm(eye)
    right = np.cross(above, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def look(surface: Surface, axes: Floats, side: float, pixels: int, before: float) -> Hits:
    """Return what parallel rays first hit, a ray a pixel of a square, row by row from the top.

    Parameters
    ----------
    axes
        (3, 3) unit vectors: to the picture's right, up, and from the object to the eye.
    side
        Of the square, whose centre is that of the surface's bounds, metres.
    before
        How far before the centre rays begin, metres.

    Examples
    --------
    >>> from objectfolder.surface import Surface
    >>> triangle = Surface(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    >>> look(triangle, np.eye(3), side=2.0, pixels=4, before=1.0).face.reshape(4, 4)
    array([[-1, -1, -1, -1],
           [-1,  0, -1, -1],
           [-1,  0,  0, -1],
           [-1, -1, -1, -1]])
    """
    steps = ((np.arange(pixels) + 0.5) / pixels - 0.5) * side
    x, y = np.meshgrid(steps, -steps)
    origins = np.stack([x, y, np.full_like(x, before)], axis=-1).reshape(-1, 3) @ axes
    rays = np.broadcast_to(-axes[2], origins.shape)
    return surface.ray_hits(surface.bounds.mean(axis=0) + origins, rays)
