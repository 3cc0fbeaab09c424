"""The outside of a solid of straight or bent elements, where mode shapes are read."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.making.elements.space import Space
from objectfolder.making.solid.solid import LOCAL_FACES, Solid
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Triangles along each side of a bent face as drawn.
DIVISIONS = 4


class Boundary:
    """Boundary of the elements of a space, drawn as small triangles in metres.

    Attributes
    ----------
    surface : triangles on the boundary, outward
    """

    def __init__(self, solid: Solid, space: Space, length: float) -> None:
        faces, element, opposite = solid.boundary()
        self._solid, self._space, self._length = solid, space, length
        # The space has the corners of an element in an order of its own.
        self._rank = np.argmax(solid.tetrahedra[:, :, None] == space.tetrahedra[:, None, :], axis=2)
        weights, triangles = _division(DIVISIONS if space.curved.any() else 1)
        many = len(weights)
        local = np.zeros((len(faces), many, 4))
        columns = LOCAL_FACES[opposite]
        np.put_along_axis(local, np.repeat(columns[:, None], many, axis=1), weights[None], axis=2)
        self._barycentric = self._in_order(np.repeat(element, many), local.reshape(-1, 4))
        positions = space.values(space.geometry, np.repeat(element, many), self._barycentric) * length
        drawn = (np.arange(len(faces))[:, None, None] * many + triangles).reshape(-1, 3)
        self.surface = Surface(positions, drawn)
        self._element = np.repeat(element, len(triangles))

    def evaluate(self, vectors: Floats, points: Floats, epsilon_m: float) -> tuple[Floats, Floats]:
        """Fields (n, ...) at points and how far each was moved to where it was read, (n,) metres.

        A point is read at the nearest point of the boundary, and the field continued linearly to it, or by
        twice `epsilon_m` where it is farther. A point that is inside by more than twice `epsilon_m` (a face
        of one part hidden in another) is read where it lies.

        Parameters
        ----------
        vectors
            (function, ...) coefficients.
        points
            (n, 3) metres.
        """
        nearest = self.surface.closest_points(points)
        distance = nearest.distance.copy()
        result = np.empty((len(points), *vectors.shape[1:]))
        outside = np.ones(len(points), dtype=bool)
        deep = np.flatnonzero(distance > 2 * epsilon_m)
        if len(deep):
            holder, inside = _locate(self._solid, points[deep])
            hit = holder >= 0
            holders = holder[hit]
            result[deep[hit]] = self._space.values(vectors, holders, self._in_order(holders, inside[hit]))
            distance[deep[hit]] = 0.0
            outside[deep[hit]] = False
        reached = np.minimum(2 * epsilon_m / np.maximum(distance, 1e-300), 1.0)
        at = np.flatnonzero(outside)
        element = self._element[nearest.face[at]]
        corners = self._barycentric[self.surface.faces[nearest.face[at]]]
        place = np.einsum("nc,ncb->nb", nearest.barycentric[at], corners)
        offset = points[at] / self._length - self._space.values(self._space.geometry, element, place)
        result[at] = self._space.values(vectors, element, place, offset * reached[at, None])
        return result, distance

    def at(self, vectors: Floats, face: Integers, barycentric: Floats) -> Floats:
        """Fields (n, ...) of `vectors` (function, ...) at (n, 3) coordinates in faces (n,) of the surface."""
        corners = self._barycentric[self.surface.faces[face]]
        return self._space.values(vectors, self._element[face], np.einsum("nc,ncb->nb", barycentric, corners))

    def normal_rms(self, vectors: Floats) -> Floats:
        """Root mean square over the boundary of the normal component of each mode (function, 3, modes)."""
        # The three-point rule of degree two in a triangle's inside.
        rule = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
        total = np.zeros(vectors.shape[2])
        faces, area, normals = self.surface.faces, self.surface.face_areas, self.surface.face_normals
        # In parts: values of all modes at all points at once would not fit.
        for start in range(0, len(faces), 4096):
            chunk = slice(start, start + 4096)
            corners = self._barycentric[faces[chunk]]
            for weights in rule:
                values = self._space.values(
                    vectors, self._element[chunk], np.einsum("c,ncb->nb", weights, corners)
                )
                total += (area[chunk] / 3) @ np.einsum("nk,nkm->nm", normals[chunk], values) ** 2
        return np.asarray(np.sqrt(total / self.surface.area))

    def _in_order(self, element: Integers, barycentric: Floats) -> Floats:
        """Coordinates as the space has its corners from coordinates as the solid has them."""
        result = np.empty_like(barycentric)
        np.put_along_axis(result, self._rank[element], barycentric, axis=1)
        return result


def _division(count: int) -> tuple[Floats, Integers]:
    """Points (p, 3) and triangles (t, 3) of a triangle cut `count` times along each side."""
    points = [(a, b, count - a - b) for a in range(count, -1, -1) for b in range(count - a, -1, -1)]
    number = {point: index for index, point in enumerate(points)}
    triangles = []
    for a, b, c in points:
        if a > 0:
            right, left = (a - 1, b + 1, c), (a - 1, b, c + 1)
            triangles.append((number[a, b, c], number[right], number[left]))
            if b > 0:
                triangles.append((number[a, b, c], number[left], number[a, b - 1, c + 1]))
    return np.array(points) / count, np.array(triangles, dtype=np.int64)


def _locate(solid: Solid, points: Floats) -> tuple[Integers, Floats]:
    """Element that holds each point, -1 for none, and the barycentric coordinates in it."""
    corner = solid.vertices[solid.tetrahedra]
    near = min(64, len(corner))
    _, candidates = cKDTree(corner.mean(axis=1)).query(points, near)
    candidates = np.asarray(candidates).reshape(len(points), near)
    inverse = np.linalg.inv(corner[:, 1:] - corner[:, :1])
    offset = points[:, None] - corner[candidates, 0]
    rest = np.einsum("nca,ncab->ncb", offset, inverse[candidates])
    barycentric = np.concatenate([1 - rest.sum(axis=2, keepdims=True), rest], axis=2)
    least = barycentric.min(axis=2)
    best = least.argmax(axis=1)
    rows = np.arange(len(points))
    return np.where(least[rows, best] >= -1e-9, candidates[rows, best], -1), barycentric[rows, best]
