"""Boundary elements bent onto the surface they stand for.

Few large elements carry a smooth wall well only when they follow its curvature: edges of the boundary become
parabolas, by least squares through the nearest points of the target surface that face the same way. Sharp
edges go to sharp edges. (Cubics follow the noise of a scan, which then takes functions of a higher order to
ring well: a scanned spoon was estimated four times further off.)
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.audio.hierarchic import EDGES, differentiate, evaluate, functions, quadrature
from objectfolder.audio.space import Space
from objectfolder.geometry.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
GEOMETRY_ORDER = 2
# Smallest Jacobian of a bent element over its own mean, and of an element with moved corners over before.
LEAST_JACOBIAN, LEAST_SHRINKING = 0.1, 0.4
CANDIDATES = 12
SAMPLES = 60_000
# Degrees between faces at a sharp edge.
SHARP_TURN = 35.0
# A boundary point may move by so much of the length of the shortest edge at it.
FARTHEST = 0.5


def curve(space: Space, faces: Integers, normals: Floats, target: Surface) -> tuple[Space, dict[str, Any]]:
    """Bend the boundary of straight elements onto a surface.

    Parameters
    ----------
    space
        Of order 2 or more, straight, positions in the unit of `target`.
    faces
        (f, 3) boundary triangles as corner numbers.
    normals
        (f, 3) their outward unit normals.
    target
        Outward faces.

    Returns
    -------
    Space, dict
        The same functions on bent elements, none folded; and what was done: `curved_elements`,
        `held_straight` (elements bent less than the surface asks because they would fold),
        `snapped_vertices`.

    Raises
    ------
    ValueError
        When the space is of order 1, which cannot hold the shape.
    """
    if space.order < GEOMETRY_ORDER:
        raise ValueError(f"elements of order {space.order} cannot be bent")
    nearest = _FacingPoints(target)
    geometry, snapped = _snap_vertices(space, faces, normals, nearest)
    geometry = _bend(space, geometry, faces, normals, nearest)
    geometry, held = _unfold(space, geometry)
    bent = space.shaped(geometry)
    return bent, {
        "curved_elements": int(bent.curved.sum()),
        "held_straight": held,
        "snapped_vertices": snapped,
    }


class _FacingPoints:
    """Nearest points of a surface that face a given way."""

    def __init__(self, target: Surface) -> None:
        self._target = target
        extra = target.sample(SAMPLES, 0)
        centres = target.vertices[target.faces].mean(axis=1)
        self._points = np.concatenate([centres, extra.points])
        self._faces = np.concatenate([np.arange(len(target.faces)), extra.face])
        self._trees: dict[float, cKDTree] = {}
        self._segments = _creases(target)
        length = np.linalg.norm(self._segments[:, 1] - self._segments[:, 0], axis=1)
        typical = float(np.median(length)) if len(length) else 1.0
        parts = np.maximum(1, np.ceil(length / max(typical, 1e-300))).astype(np.int64)
        self._segment = np.repeat(np.arange(len(length)), parts)
        within = np.arange(len(self._segment)) - np.repeat(np.cumsum(parts) - parts, parts)
        at = ((within + 0.5) / parts[self._segment])[:, None]
        start, end = self._segments[self._segment, 0], self._segments[self._segment, 1]
        self._crease_tree = cKDTree(start + at * (end - start)) if len(length) else None

    def creases(self, points: Floats, _: Floats, reach: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Nearest points (n, 3) of sharp edges, and whether one was found within `reach` (n,)."""
        if self._crease_tree is None:
            return points.copy(), np.zeros(len(points), dtype=bool)
        count = min(4, len(self._segment))
        found = np.reshape(self._crease_tree.query(points, count)[1], (len(points), count))
        segment = self._segments[self._segment[found]]
        along = segment[:, :, 1] - segment[:, :, 0]
        offset = points[:, None] - segment[:, :, 0]
        squared = np.maximum(np.einsum("nkd,nkd->nk", along, along), 1e-300)
        part = np.einsum("nkd,nkd->nk", offset, along) / squared
        closest = segment[:, :, 0] + np.clip(part, 0, 1)[:, :, None] * along
        distance = np.linalg.norm(closest - points[:, None], axis=2)
        rows, best = np.arange(len(points)), distance.argmin(axis=1)
        return closest[rows, best], distance[rows, best] <= reach / 2

    def __call__(self, points: Floats, normals: Floats, reach: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Nearest points (n, 3), and whether one was found within `reach` (n,) that faces along (n, 3)."""
        scale = float(np.median(reach))
        if scale not in self._trees:
            features = [self._points, scale * self._target.face_normals[self._faces]]
            self._trees[scale] = cKDTree(np.concatenate(features, axis=1))
        _, found = self._trees[scale].query(np.concatenate([points, scale * normals], axis=1), CANDIDATES)
        candidates = self._faces[found]
        corner = self._target.vertices[self._target.faces[candidates]]
        closest = _closest_on_triangles(np.repeat(points, CANDIDATES, axis=0), corner.reshape(-1, 3, 3))
        closest = closest.reshape(len(points), CANDIDATES, 3)
        distance = np.linalg.norm(closest - points[:, None], axis=2)
        facing = np.einsum("nkd,nd->nk", self._target.face_normals[candidates], normals) > 0.3
        distance[~facing] = np.inf
        best = distance.argmin(axis=1)
        rows = np.arange(len(points))
        return closest[rows, best], distance[rows, best] <= reach


def _creases(target: Surface) -> Floats:
    """Sharp edges of a surface, (n, 2, 3)."""
    faces = target.faces
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, inverse = np.unique(pairs, axis=0, return_inverse=True)
    sharp = _sharp(inverse.reshape(3, -1), target.face_normals, len(edges))
    return np.asarray(target.vertices[edges[sharp]])


def _closest_on_triangles(points: Floats, corner: Floats) -> Floats:
    """Nearest point of triangle i (n, 3, 3) to point i (n, 3)."""
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = (np.einsum("nd,nd->n", p, q) for p, q in ((u, u), (u, v), (v, v)))
    wu, wv = np.einsum("nd,nd->n", w, u), np.einsum("nd,nd->n", w, v)
    determinant = np.maximum(uu * vv - uv * uv, 1e-300)
    s, t = (vv * wu - uv * wv) / determinant, (uu * wv - uv * wu) / determinant
    best = a + s[:, None] * u + t[:, None] * v
    inside = (s >= 0) & (t >= 0) & (s + t <= 1)
    nearest = np.where(inside, np.linalg.norm(points - best, axis=1), np.inf)
    for start, edge in ((a, u), (a, v), (b, c - b)):
        along = np.einsum("nd,nd->n", points - start, edge) / np.maximum(
            np.einsum("nd,nd->n", edge, edge), 1e-300
        )
        candidate = start + np.clip(along, 0, 1)[:, None] * edge
        distance = np.linalg.norm(points - candidate, axis=1)
        closer = distance < nearest
        best[closer], nearest[closer] = candidate[closer], distance[closer]
    return best


def _snap_vertices(
    space: Space, faces: Integers, normals: Floats, nearest: _FacingPoints
) -> tuple[Floats, int]:
    """Geometry with boundary vertices on the surface, where that flattens no element."""
    vertex, outward = _mean_normals(faces.reshape(-1), np.repeat(normals, 3, axis=0))
    positions = space.geometry[: space.vertex_count]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    length = np.linalg.norm(positions[ends[:, 0]] - positions[ends[:, 1]], axis=1)
    shortest = np.full(space.vertex_count, np.inf)
    np.minimum.at(shortest, ends.ravel(), np.repeat(length, 2))
    reach = FARTHEST * shortest[vertex]
    moved, found = nearest(positions[vertex], outward, reach)
    corners = np.sort(faces, axis=1)
    pairs = np.concatenate([corners[:, [0, 1]], corners[:, [0, 2]], corners[:, [1, 2]]])
    edges, inverse = np.unique(pairs, axis=0, return_inverse=True)
    sharp = np.isin(vertex, edges[_sharp(inverse.reshape(3, -1), normals, len(edges))])
    at_crease, creased = nearest.creases(positions[vertex], outward, reach)
    moved[sharp & creased], found[sharp & creased] = at_crease[sharp & creased], True
    wanted = np.zeros_like(positions)
    wanted[vertex[found]] = moved[found] - positions[vertex[found]]
    before = _volumes(positions, space.tetrahedra)
    for _ in range(4):
        ratio = _volumes(positions + wanted, space.tetrahedra) / before
        bad = ratio < LEAST_SHRINKING
        if not bad.any():
            break
        wanted[space.tetrahedra[bad].ravel()] *= 0.5
    else:
        for _ in range(len(positions)):
            bad = _volumes(positions + wanted, space.tetrahedra) / before < LEAST_SHRINKING
            if not bad.any():
                break
            wanted[space.tetrahedra[bad].ravel()] = 0.0
    geometry = space.geometry.copy()
    geometry[: space.vertex_count] += wanted
    return geometry, int(np.count_nonzero(np.any(wanted != 0, axis=1)))


def _bend(space: Space, geometry: Floats, faces: Integers, normals: Floats, nearest: _FacingPoints) -> Floats:
    """Geometry with the edges of the boundary bent."""
    corners = np.sort(faces, axis=1)
    pairs = np.concatenate([corners[:, [0, 1]], corners[:, [0, 2]], corners[:, [1, 2]]])
    edges, inverse = np.unique(pairs, axis=0, return_inverse=True)
    inverse = inverse.reshape(3, -1)
    _, outward = _mean_normals(inverse.ravel(), np.tile(normals, (3, 1)))
    reach = FARTHEST / 2 * np.linalg.norm(geometry[edges[:, 1]] - geometry[edges[:, 0]], axis=1)
    numbers = _edge_functions(space, edges)
    sharp = _sharp(inverse, normals, len(edges))

    along = np.arange(1, 8) / 8
    on_edge = np.stack([1 - along, along, 0 * along, 0 * along], axis=1)
    movement, found = _movements(geometry[edges], on_edge[:, :2], outward, reach, nearest)
    at_crease, creased = _movements(geometry[edges], on_edge[:, :2], outward, reach, nearest.creases)
    use = sharp & creased
    movement[use], found[use] = at_crease[use], True
    geometry = geometry.copy()
    shape = evaluate(on_edge, GEOMETRY_ORDER)[
        :, next(i for i, f in enumerate(functions(2)) if f.corners == (0, 1))
    ]
    geometry[numbers[found]] = np.einsum("p,epd->ed", shape / (shape @ shape), movement[found])
    return geometry


def _movements(
    ends: Floats,
    weights: Floats,
    outward: Floats,
    reach: Floats,
    nearest: Callable[[Floats, Floats, Floats], tuple[Floats, NDArray[np.bool_]]],
) -> tuple[Floats, NDArray[np.bool_]]:
    """Ways (n, points, 3) from points of edges to the surface, and whether all of each have one."""
    points = np.einsum("pk,nkd->npd", weights, ends)
    many = len(weights)
    moved, found = nearest(points.reshape(-1, 3), np.repeat(outward, many, axis=0), np.repeat(reach, many))
    return moved.reshape(points.shape) - points, found.reshape(-1, many).all(axis=1)


def _sharp(edges_of_face: Integers, normals: Floats, count: int) -> NDArray[np.bool_]:
    """Which boundary edges (count,) part faces that turn by more than `SHARP_TURN`."""
    total = np.zeros((count, 3))
    shared = np.bincount(edges_of_face.ravel(), minlength=count)
    for row in edges_of_face:
        np.add.at(total, row, normals)
    # Two unit normals at an angle t have a sum of length 2 cos(t / 2).
    return (shared == 2) & (np.linalg.norm(total, axis=1) < 2 * np.cos(np.radians(SHARP_TURN) / 2))


def _edge_functions(space: Space, edges: Integers) -> Integers:
    """Functions of order 2 of edges (e, 2), (e,)."""
    pairs = [f.corners for f in functions(2)[4:]]
    keys = np.concatenate(
        [space.tetrahedra[:, a] * space.vertex_count + space.tetrahedra[:, b] for a, b in pairs]
    )
    every, first = np.unique(keys, return_index=True)
    wanted = np.searchsorted(every, edges[:, 0] * space.vertex_count + edges[:, 1])
    return np.asarray(space.numbers[:, 4:10].T.ravel()[first[wanted]])


def _unfold(space: Space, geometry: Floats) -> tuple[Floats, int]:
    """Geometry in which no element is folded or nearly so, and how many had to be bent less."""
    points, _ = quadrature(2 * GEOMETRY_ORDER)
    corners_too = np.concatenate([points, np.eye(4), (np.eye(4)[EDGES[:, 0]] + np.eye(4)[EDGES[:, 1]]) / 2])
    derivative = differentiate(corners_too, GEOMETRY_ORDER)
    reference = derivative[:, :, 1:] - derivative[:, :, :1]
    count = reference.shape[1]
    held = np.zeros(len(space.tetrahedra), dtype=bool)
    geometry = geometry.copy()
    for step in range(8):
        bent = np.flatnonzero(np.any(geometry[space.numbers[:, 4:count]] != 0, axis=(1, 2)))
        bad = []
        for start in range(0, len(bent), 2000):
            elements = bent[start : start + 2000]
            shape = geometry[space.numbers[elements, :count]]
            jacobian = np.einsum("qik,tid->tqkd", reference, shape, optimize=True)
            determinant = np.linalg.det(jacobian)
            straight = np.linalg.det(shape[:, 1:4] - shape[:, :1])
            bad.append(elements[(determinant / straight[:, None]).min(axis=1) < LEAST_JACOBIAN])
        folded = np.concatenate([*bad, np.zeros(0, dtype=np.int64)])
        if len(folded) == 0:
            break
        held[folded] = True
        geometry[np.unique(space.numbers[folded, 4:count])] *= 0.5 if step < 4 else 0.0
    return geometry, int(held.sum())


def _mean_normals(groups: Integers, normals: Floats) -> tuple[Integers, Floats]:
    """Distinct groups in ascending order and the unit mean of the normals of each."""
    unique, index = np.unique(groups, return_inverse=True)
    total = np.stack([np.bincount(index.ravel(), normals[:, axis]) for axis in range(3)], axis=1)
    return unique, total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def _volumes(positions: Floats, tetrahedra: Integers) -> Floats:
    """Six times the signed volumes (t,)."""
    corner = positions[tetrahedra]
    return np.asarray(np.linalg.det(corner[:, 1:] - corner[:, :1]))
