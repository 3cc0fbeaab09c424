"""Where on a boundary the motion of a point beside it is read, without jumps.

A scan has parts that its solid has not: a web across a slit, a lip of a hole. The nearest place of the
boundary jumps there from one side of the slit to the other, and what is read jumps with it. Instead the
point follows all the boundary that is nearly as near: each triangle by the place on it nearest to the point,
which moves continuously because a triangle is convex, with the weight

    (1 - (d_i - d) / (4 (d - epsilon)))^2, zero where that bracket is negative,

of its distance d_i, the least distance d and the distance epsilon within which the surface and the boundary
are one. A point within epsilon is read at the nearest place alone; the farther away, the more it blends.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.surface.bounding_boxes import closest_barycentric
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Boundary farther than the nearest by so many times what the nearest is beyond epsilon has no weight.
REACH = 4.0
POINTS_AT_ONCE = 1000


def blended_places(
    surface: Surface, points: Floats, distance: Floats, epsilon_m: float
) -> tuple[Integers, Integers, Floats, Floats]:
    """Places on a boundary that points beside it follow.

    Parameters
    ----------
    surface
        The boundary, metres.
    points
        (n, 3) metres.
    distance
        (n,) metres to the nearest place, each above `epsilon_m`.
    epsilon_m
        Points so near have one place.

    Returns
    -------
    row, face
        (k,) int64: which point and which triangle; ascending rows, each at least once.
    barycentric
        (k, 3) float64, of the place on the triangle.
    share
        (k,) float64, positive, of sum 1 for each point.
    """
    triangles = surface.vertices[surface.faces]
    centre = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - centre[:, None], axis=2).max(axis=1)
    # Triangles of one octave of sizes at a time: a ball around a large one holds many small ones.
    octave = np.frexp(radius)[1]
    sizes = [np.flatnonzero(octave == each) for each in np.unique(octave)]
    trees = [(cKDTree(centre[of_size]), of_size, radius[of_size].max()) for of_size in sizes]
    width = REACH * (distance - epsilon_m)
    parts = []
    for start in range(0, len(points), POINTS_AT_ONCE):
        chunk = slice(start, start + POINTS_AT_ONCE)
        parts.append(_chunk(triangles, trees, points[chunk], distance[chunk], width[chunk], start))
    if not parts:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros((0, 3)), np.zeros(0)
    row, face, barycentric, share = (np.concatenate(each) for each in zip(*parts, strict=True))
    return row, face, barycentric, share


def _chunk(
    triangles: Floats,
    trees: Sequence[tuple[cKDTree, Integers, float]],
    points: Floats,
    distance: Floats,
    width: Floats,
    first: int,
) -> tuple[Integers, Integers, Floats, Floats]:
    rows, faces = [], []
    for tree, of_size, reach in trees:
        found = tree.query_ball_point(points, distance + width + reach)
        rows.append(np.repeat(np.arange(len(points)), [len(near) for near in found]))
        faces.append(of_size[np.concatenate([np.asarray(near, dtype=np.int64) for near in found])])
    row, face = np.concatenate(rows), np.concatenate(faces)
    order = np.lexsort((face, row))
    row, face = row[order], face[order]
    barycentric = closest_barycentric(triangles[face], points[row])
    place = np.einsum("nc,ncd->nd", barycentric, triangles[face])
    farther = np.linalg.norm(points[row] - place, axis=1)
    # The nearest by this arithmetic, which may differ in the last bit from the distance given.
    least = np.full(len(points), np.inf)
    np.minimum.at(least, row, farther)
    weight = np.maximum(1 - (farther - least[row]) / width[row], 0.0) ** 2
    kept = weight > 0
    row, face, barycentric, weight = row[kept], face[kept], barycentric[kept], weight[kept]
    return row + first, face, barycentric, weight / np.bincount(row, weight, len(points))[row]
