"""A surface brought to one size, place and order, so that what is computed on it does not depend on them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.surface import Surface

GRID = 2.0**-22  # of the diagonal: 60 nm on a bowl, and far above the rounding of a move or a scaling


@dataclass(frozen=True)
class NormalForm:
    """A surface about the origin with a bounding box of diagonal 1.

    Attributes
    ----------
    surface : dimensionless; vertices rounded to `GRID` and in lexicographic order, faces likewise
    centre_m : (3,) of the bounding box of the surface it was made from
    diagonal_m : length that 1 stands for
    """

    surface: Surface
    centre_m: NDArray[np.float64]
    diagonal_m: float

    def to_metres(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take dimensionless points (n, 3) back to where the object lies."""
        return points * self.diagonal_m + self.centre_m

    def from_metres(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Dimensionless points (n, 3) of places in metres."""
        return (points - self.centre_m) / self.diagonal_m


def normal_form(surface: Surface) -> NormalForm:
    """Move, scale, round and sort a surface.

    Surfaces that differ by a translation, a scaling or the order of vertices and faces have the same normal
    form: to the bit for powers of two, and otherwise but where a coordinate lies within rounding of the
    middle between two grid points (about one surface in a thousand). A rotated surface has another one.

    Vertices that rounding made equal are one, and faces with two equal corners are left out.

    Raises
    ------
    ValueError
        No face is left.
    """
    centre = surface.bounds.mean(axis=0)
    diagonal = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    return NormalForm(
        in_order((surface.vertices - centre) / diagonal, surface.faces),
        centre,
        diagonal,
    )


def in_order(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Surface:
    """Round and sort dimensionless vertices (v, 3) and faces (f, 3); winding is kept."""
    used, packed = np.unique(faces, return_inverse=True)
    rounded = np.round(vertices[used] / GRID) * GRID + 0.0
    distinct, number = np.unique(rounded, axis=0, return_inverse=True)
    faces = number.reshape(-1)[packed.reshape(faces.shape)]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not whole.any():
        raise ValueError("no face of the surface is larger than the rounding")
    faces = faces[whole]
    first = faces.argmin(axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return Surface(distinct, faces[np.lexsort(faces.T[::-1])])
