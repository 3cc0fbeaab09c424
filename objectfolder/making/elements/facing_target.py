"""Places of a surface that face a given way, as smooth as the surface means them."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from objectfolder.surface.bounding_boxes import closest_barycentric
from objectfolder.surface.surface import (
    SHARP_ABOVE_DEG,
    SMOOTH_BELOW_DEG,
    EdgeTable,
    Surface,
    corner_angles,
    edge_table,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Hits = NDArray[np.bool_]
CANDIDATES = 12
TARGET_SAMPLES = 60_000
# Degrees between faces at a sharp edge.
SHARP_TURN = 35.0
# Degrees between faces up to which they stand for a round surface, and from which on they are what they say:
# sixteen sides are round, an octagon is an octagon.
ROUND, FACETED = 24.0, 34.0
# Depth of a face over that of the next one around a turn, from which on it is flat: the turn is a bevel's.
BEVEL_RATIO, BEVELLED = 2.0, 4.0
FLAT_TURN = 2.0
LEAST_FACING = 0.3  # cosine between a normal given and that of a place
NEAREST_CREASES = 4


class FacingTarget:
    """Nearest places of a surface with outward faces, and of its sharp edges.

    Triangles of a smooth surface cut its curvature off. Each is bent to its corners' normals by half of Phong
    tessellation (T. Boubekeur and M. Alexa, ACM Trans. Graph. 27, 2008), which with that share is exact for a
    sphere to second order; normals keep creases, so flat faces stay flat. Where faces turn far from
    one another, or are large beside bevels, as on furniture of few polygons, they are taken as flat.
    """

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self._triangles, self._normals = surface.vertices[surface.faces], _corner_normals(surface)
        extra = surface.sample(TARGET_SAMPLES, 0)
        self._points = np.concatenate([self._triangles.mean(axis=1), extra.points])
        self._faces = np.concatenate([np.arange(len(surface.faces)), extra.face])
        self._trees: dict[float, cKDTree] = {}
        edges, (first, second, turned) = _turns(surface)
        self._roundness = _roundness(surface, first, second, turned)
        sharp = edges.of_corner[first[turned > SHARP_TURN]]
        self._creases = np.asarray(surface.vertices[edges.vertices[sharp]])
        length = np.linalg.norm(self._creases[:, 1] - self._creases[:, 0], axis=1)
        typical = float(np.median(length)) if len(length) else 1.0
        parts = np.maximum(1, np.ceil(length / max(typical, 1e-300))).astype(np.int64)
        self._crease = np.repeat(np.arange(len(length)), parts)
        within = np.arange(len(self._crease)) - np.repeat(np.cumsum(parts) - parts, parts)
        at = ((within + 0.5) / parts[self._crease])[:, None]
        start, end = self._creases[self._crease, 0], self._creases[self._crease, 1]
        self._crease_tree = cKDTree(start + at * (end - start)) if len(length) else None

    def places(self, points: Floats, normals: Floats, reach: Floats) -> tuple[Floats, Floats, Hits]:
        """Nearest places (n, 3), unit normals there (n, 3), and whether one was found.

        Parameters
        ----------
        points, normals
            (n, 3), and (n, 3) unit: a place counts only where the surface faces along it.
        reach
            (n,) how far a place may be.
        """
        scale = float(np.median(reach))
        if scale not in self._trees:
            features = [self._points, scale * self._surface.face_normals[self._faces]]
            self._trees[scale] = cKDTree(np.concatenate(features, axis=1))
        _, nearest = self._trees[scale].query(np.concatenate([points, scale * normals], axis=1), CANDIDATES)
        candidates = self._faces[nearest]
        triangles = self._triangles[candidates].reshape(-1, 3, 3)
        barycentric = closest_barycentric(triangles, np.repeat(points, CANDIDATES, axis=0))
        flat = np.einsum("ij,ijk->ik", barycentric, triangles).reshape(len(points), CANDIDATES, 3)
        distance = np.linalg.norm(flat - points[:, None], axis=2)
        facing = np.einsum("nkd,nd->nk", self._surface.face_normals[candidates], normals) > LEAST_FACING
        distance[~facing] = np.inf
        best = distance.argmin(axis=1)
        rows = np.arange(len(points))
        face = candidates[rows, best]
        weights = barycentric.reshape(len(points), CANDIDATES, 3)[rows, best]
        corners = self._normals[face]
        height = np.einsum("ikd,ikd->ik", self._triangles[face] - flat[rows, best, None], corners)
        share = self._roundness[face][:, None] / 2
        bent = flat[rows, best] + share * np.einsum("ik,ikd->id", weights * height, corners)
        facing_there = np.einsum("ik,ikd->id", weights, corners)
        facing_there /= np.maximum(np.linalg.norm(facing_there, axis=1, keepdims=True), 1e-300)
        return bent, facing_there, distance[rows, best] <= reach

    def creases(self, points: Floats, reach: Floats) -> tuple[Floats, Hits]:
        """Nearest places (n, 3) of sharp edges, and whether one was found within `reach` (n,)."""
        if self._crease_tree is None:
            return points.copy(), np.zeros(len(points), dtype=bool)
        count = min(NEAREST_CREASES, len(self._crease))
        nearest = np.reshape(self._crease_tree.query(points, count)[1], (len(points), count))
        segment = self._creases[self._crease[nearest]]
        along = segment[:, :, 1] - segment[:, :, 0]
        offset = points[:, None] - segment[:, :, 0]
        squared = np.maximum(np.einsum("nkd,nkd->nk", along, along), 1e-300)
        part = np.einsum("nkd,nkd->nk", offset, along) / squared
        closest = segment[:, :, 0] + np.clip(part, 0, 1)[:, :, None] * along
        distance = np.linalg.norm(closest - points[:, None], axis=2)
        rows, best = np.arange(len(points)), distance.argmin(axis=1)
        return closest[rows, best], distance[rows, best] <= reach


def rounding(surface: Surface) -> tuple[float, float]:
    """Volume between the triangles of a surface and the round ones that they stand for, and its mean depth.

    The volume is positive where the triangles cut off what bulges; the depth is taken either way. Triangles
    are bent as those of `FacingTarget`; the integral over each is in closed form.
    """
    normals = _corner_normals(surface)
    _, (first, second, turned) = _turns(surface)
    corners = surface.vertices[surface.faces]
    corners = corners - corners.mean(axis=1, keepdims=True)
    height = np.einsum("fjd,fkd->fjk", corners, normals)
    own = np.einsum("fkk->fk", height)
    weighed = own / 3 - (height.sum(axis=1) + own) / 12  # mean of the height times its corner's weight
    upward = np.einsum("fkd,fd->fk", normals, surface.face_normals)
    depth = _roundness(surface, first, second, turned) / 2 * np.sum(weighed * upward, axis=1)
    area = surface.face_areas
    return float(area @ depth), float(area @ np.abs(depth) / area.sum())


def _turns(surface: Surface) -> tuple[EdgeTable, tuple[Integers, Integers, Floats]]:
    """Edges, and of each between two faces a corner of either face and the turn in degrees."""
    edges = edge_table(surface.faces)
    first, second = edges.manifold_pairs()
    normals = surface.face_normals
    cosine = np.einsum("ij,ij->i", normals[first // 3], normals[second // 3])
    return edges, (first, second, np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _corner_normals(surface: Surface) -> Floats:
    """Normals (f, 3, 3) at corners as those to be seen by, but for faces that are small among the others.

    Where the wall of a vessel meets the small faces of its rim the normal is the wall's: the mean would bulge
    the wall by a hundredth of its thickness.
    """
    normals, vertex = surface.face_normals, surface.faces.ravel()
    at = sparse.csr_array((np.ones(len(vertex)), (np.arange(len(vertex)), vertex)))
    own, neighbour = (at @ at.T).nonzero()
    turn = np.einsum("ij,ij->i", normals[own // 3], normals[neighbour // 3])
    low, high = np.cos(np.radians([SHARP_ABOVE_DEG, SMOOTH_BELOW_DEG]))
    ramp = np.clip((turn - low) / (high - low), 0.0, 1.0)
    area, largest = surface.face_areas[neighbour // 3], np.zeros(len(vertex))
    np.maximum.at(largest, own, np.where(ramp > 0, area, 0.0))
    share = BEVELLED * area / np.maximum(largest[own], 1e-300)
    weight = corner_angles(surface.vertices, surface.faces).ravel()[neighbour] * ramp * ramp * (3 - 2 * ramp)
    weight *= np.clip((share - 1) / (BEVELLED / BEVEL_RATIO - 1), 0.0, 1.0)
    total = np.stack(
        [np.bincount(own, weight * normals[neighbour // 3, axis], len(vertex)) for axis in range(3)], 1
    )
    flat = ~total.any(axis=1)
    total[flat] = normals[np.flatnonzero(flat) // 3]
    length = np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    return np.asarray((total / length).reshape(-1, 3, 3))


def _roundness(surface: Surface, first: Integers, second: Integers, turn_deg: Floats) -> Floats:
    """How far (f,) each face stands for a round one, 0 to 1.

    Parameters
    ----------
    first, second
        (e,) corners, numbered through all faces, of the two faces of an edge.
    turn_deg
        (e,) degrees between these.
    """
    # Normals at corners do not reach across a crease.
    smooth = (turn_deg > FLAT_TURN) & (turn_deg < SHARP_ABOVE_DEG)
    face_a, face_b, turn = first[smooth] // 3, second[smooth] // 3, turn_deg[smooth]
    widest, deepest = np.zeros(len(surface.faces)), np.ones(len(surface.faces))
    # Both are as wide as their common edge, so that areas are as depths.
    area = np.maximum(surface.face_areas, 1e-300)
    for face, neighbour in ((face_a, face_b), (face_b, face_a)):
        np.maximum.at(widest, face, turn)
        np.maximum.at(deepest, face, area[face] / area[neighbour])
    even = np.clip((BEVELLED - deepest) / (BEVELLED - BEVEL_RATIO), 0.0, 1.0)
    return np.asarray(np.clip((FACETED - widest) / (FACETED - ROUND), 0.0, 1.0) * even)
