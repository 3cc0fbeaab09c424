"""A surface without its holes: faces cut where a map of alpha passes one half."""

from dataclasses import dataclass

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.surface.surface import Surface
from objectfolder.vision.network.surface_maps import MAP_WHOLE, SurfaceMaps

MOST_HOLE_PIECES = 3 << 16
"""Triangles that faces with holes are cut into before the holes are left out; more make the cuts coarser."""

THERE = 0.5
"""The alpha from which the surface is there."""


@dataclass(frozen=True)
class CutSurface:
    """A surface whose faces are pieces of another's.

    Parameters
    ----------
    surface
        What is left, its corner normals those of the other surface.
    parent
        (F,) the face of the other surface that each face is a piece of.
    corners
        (F, 3, 3) barycentric coordinates in the parent of each corner.
    """

    surface: Surface
    parent: np.ndarray
    corners: np.ndarray

    def in_parent(self, face: np.ndarray, barycentric: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return face (n,) and barycentric coordinates (n, 3) in the other surface."""
        return self.parent[face], np.einsum("ij,ijk->ik", barycentric, self.corners[face])


def without_holes(maps: SurfaceMaps) -> CutSurface:
    """Return the surface of maps that have an alpha, cut along its contour of one half.

    Each face with a hole is divided evenly, about as finely as its alpha is known, and the contour is
    straight within a piece (as in marching triangles).

    Raises
    ------
    FormatError
        Nothing is left.
    """
    surface = maps.surface
    steps = _steps(maps)
    whole = np.flatnonzero(steps == 0)
    parents = [whole]
    corners = [np.broadcast_to(np.eye(3), (len(whole), 3, 3))]
    for count in np.unique(steps[steps > 0]):
        pieces = _divided(int(count))
        faces = np.flatnonzero(steps == count)
        parent = np.repeat(faces, len(pieces))
        inside = np.tile(pieces, (len(faces), 1, 1))
        alpha = maps.value("alpha", np.repeat(parent, 3), inside.reshape(-1, 3)).reshape(-1, 3)
        kept, corner = _cut(inside, alpha)
        parents.append(parent[kept])
        corners.append(corner)
    parent, corner = np.concatenate(parents), np.concatenate(corners)
    if not len(parent):
        raise FormatError("vision.map.alpha", "the surface is one hole")
    places = np.repeat(parent, 3), corner.reshape(-1, 3)
    vertices = surface.points_at(*places)
    normals = surface.normals_at(*places).reshape(-1, 3, 3)
    left = Surface(vertices, np.arange(len(vertices)).reshape(-1, 3), normals=normals)
    return CutSurface(left, parent, corner)


def _steps(maps: SurfaceMaps) -> np.ndarray:
    """Steps (F,) along an edge that a face is divided into; 0 for one without holes."""
    lattice = maps.lattice("alpha")
    steps = np.where(lattice.least(maps.levels["alpha"][:, 0]) / MAP_WHOLE["alpha"] < THERE, lattice.steps, 0)
    pieces = int((steps**2).sum())
    if pieces > MOST_HOLE_PIECES:
        steps = np.where(steps > 0, np.maximum(1, steps * (MOST_HOLE_PIECES / pieces) ** 0.5), 0).astype(
            np.int64
        )
    return np.asarray(steps)


def _divided(count: int) -> np.ndarray:
    """Barycentric corners (count^2, 3, 3) of the pieces of a triangle divided evenly."""
    j, i = np.divmod(np.arange(count * count), count)
    lower = i + j < count
    upper = i + j < count - 1
    origin = np.stack([i, j], axis=1)
    triangles = np.concatenate(
        [
            origin[lower, None] + np.array([[0, 0], [1, 0], [0, 1]]),
            origin[upper, None] + np.array([[1, 0], [1, 1], [0, 1]]),
        ]
    )
    share = triangles / count
    return np.concatenate([1 - share.sum(axis=2, keepdims=True), share], axis=2)


def _cut(corners: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which pieces (m,) of (n, 3, 3) the triangles (m, 3, 3) that are there come from."""
    there = alpha >= THERE
    count = there.sum(axis=1)
    rows, parts = [np.flatnonzero(count == 3)], [corners[count == 3]]
    for left in (1, 2):
        some = np.flatnonzero(count == left)
        # The corner unlike the others comes first.
        first = np.argmax(there[some] if left == 1 else ~there[some], axis=1)
        turned = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[some], turned[..., None], axis=1), 1, 0)
        x, y, z = np.take_along_axis(alpha[some], turned, axis=1).T[..., None]
        to_b, to_c = a + (THERE - x) / (y - x) * (b - a), a + (THERE - x) / (z - x) * (c - a)
        pieces = [(a, to_b, to_c)] if left == 1 else [(to_b, b, c), (to_b, c, to_c)]
        for piece in pieces:
            rows.append(some)
            parts.append(np.stack(piece, axis=1))
    return np.concatenate(rows), np.concatenate(parts)
