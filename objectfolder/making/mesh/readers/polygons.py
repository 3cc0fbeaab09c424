"""Polygons cut into triangles that keep every corner, concave polygons included.

Libraries for this (Mapbox's earcut among them) leave out corners on a straight side. The neighbours of the
polygon keep those corners, so the surface would no longer be closed.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

MOST_CONCAVE_CORNERS = 5000
"""Of a polygon that is cut ear by ear, which takes time of second order."""

_FLAT = 1e-12
"""Of the squared size of a polygon: areas below have no sign that means anything."""

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def triangulated(vertices: Floats, polygons: Sequence[Sequence[int]]) -> tuple[Indices, Indices]:
    """Cut polygons into triangles wound as they are.

    A polygon that its first corner sees whole is fanned from there. Another is projected along its mean
    normal and loses one ear after the other. One that crosses itself has no right answer: its triangles
    still end at its own edges, so that a closed surface stays closed.

    Parameters
    ----------
    vertices
        (V, 3), finite.
    polygons
        Vertices of each, at least three, each in 0..V-1.

    Returns
    -------
    places
        (T, 3) of the corners of each triangle, in the corners of all polygons one after the other.
    polygon
        (T,) which polygon it belongs to, ascending.

    Raises
    ------
    ValueError
        A concave polygon of more than `MOST_CONCAVE_CORNERS` corners.
    """
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    first = np.cumsum(counts - 2) - (counts - 2)
    corners = np.empty((int((counts - 2).sum()), 3), dtype=np.int64)
    for count in np.unique(counts):
        members = np.flatnonzero(counts == count)
        rows = first[members][:, None] + np.arange(count - 2)
        corners[rows] = _fan(int(count))
        if count == 3:
            continue
        points = vertices[np.array([polygons[member] for member in members])]
        for index in np.flatnonzero(~_seen_from_first_corner(points)):
            corners[rows[index]] = _ears(points[index])
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    return (np.cumsum(counts) - counts)[polygon][:, None] + corners, polygon


def _fan(count: int) -> Indices:
    second = np.arange(1, count - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=1)


def _mean_normals(points: Floats) -> Floats:
    """Newell's normals (n, 3) of polygons (n, k, 3), as long as twice their areas."""
    centred = points - points.mean(axis=1, keepdims=True)
    return np.asarray(np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1))


def _seen_from_first_corner(points: Floats) -> NDArray[np.bool_]:
    """Whether all triangles of the fans of polygons (n, k, 3) turn as the polygons do, (n,)."""
    normals = _mean_normals(points)
    lengths = np.linalg.norm(normals, axis=1)
    sides = points[:, 1:] - points[:, :1]
    turns = np.cross(sides[:, :-1], sides[:, 1:])
    along = np.einsum("nti,ni->nt", turns, normals) / np.maximum(lengths, 1e-300)[:, None]
    size = np.square(np.ptp(points, axis=1)).sum(axis=1)
    return np.asarray((along >= -_FLAT * size[:, None]).all(axis=1) | (lengths <= _FLAT * size))


def _ears(points: Floats) -> Indices:
    """Triangles (k - 2, 3) of one polygon (k, 3)."""
    if len(points) > MOST_CONCAVE_CORNERS:
        raise ValueError(f"a concave face of {len(points)} corners, more than {MOST_CONCAVE_CORNERS}")
    flat = _projected(points)
    least = _FLAT * float(np.square(np.ptp(flat, axis=0)).sum())
    rest = np.arange(len(flat))
    triangles = []
    while len(rest) > 3:
        before, after = flat[np.roll(rest, 1)], flat[np.roll(rest, -1)]
        corner = flat[rest]
        turn = _cross(corner - before, after - corner)
        reflex = corner[turn <= least]
        for place in np.flatnonzero(turn > least):
            if not _any_within(reflex, before[place], corner[place], after[place]):
                break
        else:
            place = int(np.argmin(np.abs(turn)))
        triangles.append([rest[place - 1], rest[place], rest[(place + 1) % len(rest)]])
        rest = np.delete(rest, place)
    return np.array([*triangles, rest.tolist()], dtype=np.int64)


def _projected(points: Floats) -> Floats:
    """Corners (k, 2) in the plane of the mean normal, counter-clockwise."""
    normal = _mean_normals(points[None])[0]
    normal = normal / np.linalg.norm(normal)
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    across = np.cross(normal, helper)
    across /= np.linalg.norm(across)
    centred = points - points.mean(axis=0)
    return np.stack([centred @ across, centred @ np.cross(normal, across)], axis=1)


def _cross(first: Floats, second: Floats) -> Floats:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _any_within(points: Floats, a: Floats, b: Floats, c: Floats) -> bool:
    """Whether any of (n, 2) lies in the triangle or on it, but for those at its corners."""
    inside = np.ones(len(points), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= _cross(end - start, points - start) >= 0
    for corner in (a, b, c):
        inside &= (points != corner).any(axis=1)
    return bool(inside.any())
