"""Fewer, longer tetrahedra for the same solid: edges are collapsed while its boundary keeps to a surface.

A filling by fTetWild follows its input's triangles; elements of high order want long flat ones, one through
a wall. A collapse moves one vertex onto its neighbour (Dey, Edelsbrunner, Guha and Nekhayev, "Topology
Preserving Edge Contraction", 1999, for when that changes nothing but the mesh): as every element stays
positive and the topology the same, no wall is broken and no two are merged.
"""

from collections import defaultdict
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from objectfolder.solid.element_shape import LOCAL_EDGES, shape
from objectfolder.solid.solid import LOCAL_FACES
from objectfolder.surface.bounding_boxes import closest_barycentric

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Triangle = tuple[int, int, int]
TURN = 0.2  # cosine of the most a boundary face may turn in one collapse
MOST_ROUNDS = 400


class BoundaryFit:
    """Points of the surface a solid stands for, each with the boundary face it is nearest to.

    Parameters
    ----------
    points, tolerance, distance
        (n, 3), how far the boundary may come to lie from each (n,), and lies now (n,): a point that is
        farther than its tolerance may stay as far.
    faces
        (n, 3) vertices of the boundary face nearest to each.
    """

    def __init__(self, points: Floats, tolerance: Floats, distance: Floats, faces: Integers) -> None:
        self.points = points
        self.allowed = np.maximum(tolerance, distance)
        self.tolerance = tolerance
        self._of_face: dict[Triangle, list[int]] = defaultdict(list)
        for index, corners in enumerate(np.sort(faces, axis=1).tolist()):
            self._of_face[tuple(corners)].append(index)

    def moves(self, vertices: Floats, old: Integers, new: Integers) -> bool:
        """Hand the points of faces `old` on to faces `new`; False, and nothing done, where one is too far."""
        names = [_name(corners) for corners in old.tolist()]
        held = [index for name in names for index in self._of_face.get(name, ())]
        if held:
            squared = _squared_distances(vertices[new], self.points[held])
            distance = np.sqrt(squared.min(axis=0))
            if (distance > self.allowed[held]).any():
                return False
            self.allowed[held] = np.maximum(self.tolerance[held], distance)
        for name in names:
            self._of_face.pop(name, None)
        if held:
            fresh = [_name(corners) for corners in new.tolist()]
            for index, face in zip(held, squared.argmin(axis=0).tolist(), strict=True):
                self._of_face[fresh[face]].append(index)
        return True


class Quadrics:
    """Mean squared distance to the planes of the boundary faces that a vertex stands for (Garland, 1997)."""

    def __init__(self, vertices: Floats, boundary: Integers) -> None:
        a, b, c = (vertices[boundary[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal, axis=1) / 2
        normal = normal / np.maximum(2 * area, 1e-300)[:, None]
        plane = np.concatenate([normal, -np.einsum("ij,ij->i", normal, a)[:, None]], axis=1)
        self._matrix = np.zeros((len(vertices), 4, 4))
        self._area = np.zeros(len(vertices))
        for corner in boundary.T:
            np.add.at(self._matrix, corner, np.einsum("i,ij,ik->ijk", area, plane, plane))
            np.add.at(self._area, corner, area)

    def error(self, vertices: Floats, leaves: Integers, stays: Integers) -> Floats:
        """Squared error (n,) of vertices `leaves` (n,) put where `stays` (n,) are."""
        point = np.concatenate([vertices[stays], np.ones((len(stays), 1))], axis=1)
        matrix = self._matrix[leaves] + self._matrix[stays]
        total = self._area[leaves] + self._area[stays]
        return np.asarray(np.einsum("ij,ijk,ik->i", point, matrix, point) / np.maximum(total, 1e-300))

    def merge(self, leaves: Integers, stays: Integers) -> None:
        """Add what `leaves` stand for to `stays`."""
        self._matrix[stays] += self._matrix[leaves]
        self._area[stays] += self._area[leaves]


def coarsen(
    vertices: Floats,
    tetrahedra: Integers,
    fit: BoundaryFit,
    vertex_tolerance: Floats,
    thickness: Floats,
    longest_edge: float,
    *,
    least_shape: float = 0.2,
) -> Integers:
    """Collapse edges, cheapest first, as long as the boundary keeps to its points and elements their shape.

    Parameters
    ----------
    vertices, tetrahedra
        (v, 3), (t, 4), positively oriented.
    vertex_tolerance
        (v,) root mean square distance from the planes of the old boundary at which a vertex is too far.
    thickness
        (v,) of the object near each vertex.
    longest_edge
        No collapse makes a longer one.
    least_shape
        See `element_shape.shape`: elements get no worse than this, or than they were.

    Returns
    -------
    (t', 4) tetrahedra on the same vertices, not all of which they use.
    """
    tetrahedra = tetrahedra.copy()
    tolerance = vertex_tolerance.copy()
    quadrics = Quadrics(vertices, _boundary_rows(tetrahedra)[1])
    refused = np.zeros(0, dtype=np.int64)
    count = len(vertices)
    for _ in range(MOST_ROUNDS):
        outer, boundary = _boundary_rows(tetrahedra)
        leaves, stays, cost = _candidates(
            vertices, tetrahedra, boundary, quadrics, tolerance, longest_edge, refused
        )
        if len(leaves) == 0:
            break
        order, start = _incidence(tetrahedra, count)
        good = _keep_shape(
            vertices, tetrahedra, (order, start), leaves, stays, thickness, longest_edge, least_shape
        )
        bad_names = [(leaves * count + stays)[~good]]
        leaves, stays, cost = leaves[good], stays[good], cost[good]
        stars = _Stars(vertices, tetrahedra, order, start, outer, boundary)
        marked = np.zeros(count, dtype=bool)
        chosen: list[int] = []
        for index in np.argsort(cost, kind="stable").tolist():
            leaving, staying = int(leaves[index]), int(stays[index])
            ring = tetrahedra[stars.elements(leaving)].ravel()
            if marked[ring].any():
                continue
            if stars.collapses(leaving, staying, fit):
                marked[ring] = True
                chosen.append(index)
            else:
                bad_names.append(np.array([leaving * count + staying]))
        refused = np.concatenate([refused, *bad_names])
        leaves, stays = leaves[chosen], stays[chosen]
        quadrics.merge(leaves, stays)
        tolerance[stays] = np.minimum(tolerance[stays], tolerance[leaves])
        renamed = np.arange(count)
        renamed[leaves] = stays
        tetrahedra = renamed[tetrahedra]
        corners = np.sort(tetrahedra, axis=1)
        tetrahedra = tetrahedra[(corners[:, 1:] != corners[:, :-1]).all(axis=1)]
        # What was refused near a change may do now.
        refused = refused[~marked[refused // count]]
    return tetrahedra


def _candidates(
    vertices: Floats,
    tetrahedra: Integers,
    boundary: Integers,
    quadrics: Quadrics,
    tolerance: Floats,
    longest_edge: float,
    refused: Integers,
) -> tuple[Integers, Integers, Floats]:
    """The cheapest collapse of each vertex: who leaves (n,), onto whom (n,), and its cost (n,), at most 1.

    The cost is the greater of the squared length over the longest allowed and, for a vertex of the boundary,
    which may move along the boundary only, of the squared error over its tolerance.
    """
    count = len(vertices)
    outside = np.zeros(count, dtype=bool)
    outside[boundary] = True
    edge = _edge_names(tetrahedra[:, LOCAL_EDGES].reshape(-1, 2), count)
    along = np.isin(edge, _edge_names(boundary[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), count))
    first, second = edge // count, edge % count
    leaves, stays = np.concatenate([first, second]), np.concatenate([second, first])
    length = np.linalg.norm(vertices[leaves] - vertices[stays], axis=1)
    allowed = (~outside[leaves] | np.tile(along, 2)) & (length <= longest_edge)
    allowed &= ~np.isin(leaves * count + stays, refused)
    leaves, stays = leaves[allowed], stays[allowed]
    cost = (length[allowed] / longest_edge) ** 2
    outer = outside[leaves]
    error = quadrics.error(vertices, leaves[outer], stays[outer])
    cost[outer] = np.maximum(cost[outer], error / np.maximum(tolerance[leaves[outer]], 1e-300) ** 2)
    cheap = cost <= 1
    leaves, stays, cost = leaves[cheap], stays[cheap], cost[cheap]
    order = np.lexsort((stays, cost, leaves))
    best = order[np.concatenate([[True], leaves[order][1:] != leaves[order][:-1]])] if len(order) else order
    return leaves[best], stays[best], cost[best]


def _keep_shape(
    vertices: Floats,
    tetrahedra: Integers,
    incidence: tuple[Integers, Integers],
    leaves: Integers,
    stays: Integers,
    thickness: Floats,
    longest_edge: float,
    least_shape: float,
) -> NDArray[np.bool_]:
    """Which collapses (n,) leave elements that are positive, well shaped and not too long."""
    order, start = incidence
    size = start[leaves + 1] - start[leaves]
    owner = np.repeat(np.arange(len(leaves)), size)
    at = np.arange(size.sum()) + np.repeat(start[leaves] - (np.cumsum(size) - size), size)
    old = tetrahedra[order[at] // 4]
    before, _ = shape(vertices[old], thickness[old].min(axis=1))
    worst_before = np.full(len(leaves), np.inf)
    np.minimum.at(worst_before, owner, before)
    left = ~(old == stays[owner][:, None]).any(axis=1)
    old, owner = old[left], owner[left]
    new = np.where(old == leaves[owner][:, None], stays[owner][:, None], old)
    after, longest = shape(vertices[new], thickness[new].min(axis=1))
    worst, length = np.full(len(leaves), np.inf), np.zeros(len(leaves))
    np.minimum.at(worst, owner, after)
    np.maximum.at(length, owner, longest)
    floor = np.maximum(np.minimum(least_shape, worst_before), 1e-6)
    return np.asarray((worst >= floor) & (length <= longest_edge))


class _Stars:
    """The elements and boundary faces around vertices, for one round of collapses."""

    def __init__(
        self,
        vertices: Floats,
        tetrahedra: Integers,
        order: Integers,
        start: Integers,
        outer: NDArray[np.bool_],
        boundary: Integers,
    ) -> None:
        self._vertices, self._tetrahedra = vertices, tetrahedra
        self._order, self._start, self._outer = order, start, outer
        self._outside = np.zeros(len(vertices), dtype=bool)
        self._outside[boundary] = True

    def elements(self, vertex: int) -> Integers:
        """Elements (n,) at a vertex."""
        return self._order[self._start[vertex] : self._start[vertex + 1]] // 4

    def faces(self, vertex: int) -> Integers:
        """Boundary faces (n, 3) at a vertex."""
        elements = self.elements(vertex)
        faces = self._tetrahedra[elements][:, LOCAL_FACES][self._outer[elements]]
        return faces[(faces == vertex).any(axis=1)]

    def collapses(self, leaving: int, staying: int, fit: BoundaryFit) -> bool:
        """Whether a collapse keeps topology, boundary normals and fit; if so the fit is handed on."""
        here = [frozenset(t) for t in self._tetrahedra[self.elements(leaving)].tolist()]
        there = [frozenset(t) for t in self._tetrahedra[self.elements(staying)].tolist()]
        if not _linked(here, there, leaving, staying, 3):
            return False
        if not self._outside[leaving]:
            return True
        old = self.faces(leaving)
        faces_there = [frozenset(t) for t in self.faces(staying).tolist()]
        if not _linked([frozenset(t) for t in old.tolist()], faces_there, leaving, staying, 2):
            return False
        kept = old[~(old == staying).any(axis=1)]
        new = np.where(kept == leaving, staying, kept)
        before, after = _normals(self._vertices[kept]), _normals(self._vertices[new])
        turn = np.einsum("ij,ij->i", before, after)
        sizes = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        if (turn < TURN * sizes).any():
            return False
        return fit.moves(self._vertices, old, new)


def _linked(
    here: list[frozenset[int]], there: list[frozenset[int]], leaving: int, staying: int, dimension: int
) -> bool:
    """The link condition: what is joined to both ends of an edge is joined to the edge.

    `here` and `there` are the simplices of a dimension at either end. On a boundary, a closed surface, the
    edge has two of them.
    """
    around = [simplex - {leaving, staying} for simplex in here if staying in simplex]
    if dimension == 2 and len(around) != 2:
        return False
    for size in range(1, dimension + 1):
        from_here = {frozenset(c) for simplex in here for c in combinations(simplex - {leaving}, size)}
        from_there = {frozenset(c) for simplex in there for c in combinations(simplex - {staying}, size)}
        joined = {frozenset(c) for simplex in around for c in combinations(simplex, size)}
        common = {c for c in from_here & from_there if leaving not in c and staying not in c}
        if common - joined:
            return False
    return True


def _boundary_rows(tetrahedra: Integers) -> tuple[NDArray[np.bool_], Integers]:
    """Which faces (t, 4) of the elements are on the boundary, and these faces (f, 3)."""
    faces = tetrahedra[:, LOCAL_FACES].reshape(-1, 3)
    low, middle, high = np.sort(faces, axis=1).T
    size = int(faces.max()) + 1
    _, first, count = np.unique((low * size + middle) * size + high, return_index=True, return_counts=True)
    outer = np.zeros(len(faces), dtype=bool)
    outer[first[count == 1]] = True
    return outer.reshape(-1, 4), faces[outer]


def _incidence(tetrahedra: Integers, count: int) -> tuple[Integers, Integers]:
    """Corners (4 t,) sorted by vertex, and where each vertex's begin (count + 1,)."""
    corners = tetrahedra.ravel()
    starts = np.concatenate([[0], np.cumsum(np.bincount(corners, minlength=count))])
    return np.argsort(corners, kind="stable"), starts


def _edge_names(edges: Integers, count: int) -> Integers:
    """Distinct undirected edges (n, 2) as numbers, sorted."""
    return np.unique(edges.min(axis=1) * count + edges.max(axis=1))


def _normals(triangles: Floats) -> Floats:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _name(corners: list[int]) -> Triangle:
    low, middle, high = sorted(corners)
    return low, middle, high


def _squared_distances(triangles: Floats, points: Floats) -> Floats:
    """Squared distance (f, n) of each of (n, 3) points from each of (f, 3, 3) triangles."""
    pairs = np.repeat(triangles, len(points), axis=0)
    many = np.tile(points, (len(triangles), 1))
    gap = np.einsum("ij,ijk->ik", closest_barycentric(pairs, many), pairs) - many
    return np.einsum("ij,ij->i", gap, gap).reshape(len(triangles), len(points))
