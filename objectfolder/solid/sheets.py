"""Sheets: open patches of a surface that bound nothing, given a thickness on both sides."""

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.openings import apart, rim_of
from objectfolder.surface.surface import Surface, corner_angles

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
LONGEST_OFFSET = 2.0  # a corner of a cube moves by the root of 3


def thick_sheets(surface: Surface, sheet: NDArray[np.bool_], patch: Integers, wall_m: float) -> Surface:
    """A surface whose sheets have two sides, `wall_m` apart about where they were, and rims between these.

    Parameters
    ----------
    sheet
        (p,) bool, of each patch: what is made thick. Others stay as they are.
    patch
        (f,) number of each face.
    wall_m
        Metres.
    """
    thick = sheet[patch]
    parted = apart(Surface(surface.vertices, surface.faces[thick]), patch[thick])
    offset = wall_m / 2 * unit_offsets(parted)
    count, rim = len(parted.vertices), rim_of(parted.faces)
    start, end = rim.T
    sides = np.concatenate(
        [
            np.column_stack([end, start, start + count]),
            np.column_stack([end, start + count, end + count]),
        ]
    )
    faces = np.concatenate([parted.faces, parted.faces[:, ::-1] + count, sides])
    rest = surface.faces[~thick]
    return Surface(
        np.concatenate([parted.vertices + offset, parted.vertices - offset, surface.vertices]),
        np.concatenate([faces, rest + 2 * count]),
    )


def unit_offsets(surface: Surface) -> Floats:
    """How each vertex (v, 3) moves when all faces at it move outwards by one: a normal, longer at creases.

    Least squares of the faces' distances, weighted by their angles; directions that the faces hardly differ
    in are left out, so that a rough surface is moved along its mean normal.
    """
    normals, angles = surface.face_normals, corner_angles(surface.vertices, surface.faces)
    matrix = np.zeros((len(surface.vertices), 3, 3))
    vector = np.zeros((len(surface.vertices), 3))
    for corner, angle in zip(surface.faces.T, angles.T, strict=True):
        np.add.at(matrix, corner, np.einsum("f,fi,fj->fij", angle, normals, normals))
        np.add.at(vector, corner, angle[:, None] * normals)
    offset = np.einsum("vij,vj->vi", np.linalg.pinv(matrix, rcond=0.1, hermitian=True), vector)
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    return np.asarray(offset * np.minimum(1.0, LONGEST_OFFSET / np.maximum(length, 1e-300)))
