"""A triangle surface that answers queries: rays, occlusion, closest points, samples, normals, edges."""

import importlib.util
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from objectfolder.surface.bounding_boxes import BoundingBoxTree, closest_barycentric, intersect
from objectfolder.surface.connectivity import EdgeTable, Topology, edge_table, topology_of

SMOOTH_BELOW_DEG = 30.0
PAIRS_AT_ONCE = 1 << 20  # of corners: the memory that smooth normals take
SHARP_ABOVE_DEG = 50.0


@dataclass(frozen=True)
class Hits:
    """First hits of n rays: distance (n,) (infinity: none), face (n,) (-1: none), barycentric (n, 3)."""

    distance: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray


@dataclass(frozen=True)
class ClosestPoints:
    """Nearest points of the surface: points (n, 3), distance (n,), face (n,), barycentric (n, 3)."""

    points: np.ndarray
    distance: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: slice) -> "ClosestPoints":
        return ClosestPoints(self.points[rows], self.distance[rows], self.face[rows], self.barycentric[rows])


@dataclass(frozen=True)
class SurfaceSamples:
    """Points on the surface: points (n, 3), face (n,), barycentric (n, 3), unit normals (n, 3)."""

    points: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    normals: np.ndarray


class Surface:
    """A triangle surface in metres; open, several-piece and degenerate surfaces included.

    Parameters
    ----------
    vertices
        (V, 3) float64.
    faces
        (F, 3) integer.
    use_embree
        Trace rays with Embree (single precision search, double precision result); by default where it
        is installed. Without it the numpy tree of `bounding_boxes` is used. Both name the same face
        but for rays that pass within about 1e-7 of the object's size of an edge.
    normals
        (F, 3, 3) unit normals of the source at corners, zero where it has none; None for none at all.

    Raises
    ------
    ValueError
        A face that refers to a vertex that is not there, or coordinates that are not finite.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> triangle = Surface(corners, np.array([[0, 1, 2]]))
    >>> triangle.ray_hits(np.array([[0.2, 0.2, 3.0]]), np.array([[0.0, 0.0, -1.0]])).distance
    array([3.])
    >>> triangle.closest_points(np.array([[2.0, 0.0, 0.0]])).points
    array([[1., 0., 0.]])
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        use_embree: bool | None = None,
        normals: np.ndarray | None = None,
    ) -> None:
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64).reshape(-1, 3)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64).reshape(-1, 3)
        if len(self.faces) == 0 or self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise ValueError("a surface needs at least one face, and faces that refer to its vertices")
        if not np.isfinite(self.vertices).all():
            raise ValueError("the coordinates of a surface must be finite")
        self.face_normals, self.face_areas = face_normals_and_areas(self.vertices, self.faces)
        self.normals = normals
        self._use_embree = (
            importlib.util.find_spec("embreex") is not None if use_embree is None else use_embree
        )

    @property
    def area(self) -> float:
        """Total area, square metres."""
        return float(self.face_areas.sum())

    @cached_property
    def bounds(self) -> np.ndarray:
        """Corners (2, 3) of the bounding box of the faces, metres."""
        used = self.vertices[np.unique(self.faces)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @cached_property
    def corner_normals(self) -> np.ndarray:
        """Shading normals (F, 3, 3) at corners: the source's, else those of the rule of `corner_normals`."""
        by_rule = corner_normals(self.vertices, self.faces)
        if self.normals is None:
            return by_rule
        source = np.asarray(self.normals, dtype=np.float64)
        return np.where(source.any(axis=2, keepdims=True), source, by_rule)

    @cached_property
    def edges(self) -> EdgeTable:
        """The edges of the faces."""
        return edge_table(self.faces)

    @cached_property
    def topology(self) -> Topology:
        """What keeps the surface, if welded, from bounding a solid."""
        return topology_of(self.vertices, self.faces, self.edges, self.face_areas)

    @cached_property
    def _triangles(self) -> np.ndarray:
        return self.vertices[self.faces]

    @cached_property
    def _tree(self) -> BoundingBoxTree:
        return BoundingBoxTree(self._triangles)

    @cached_property
    def sampled_distance(self) -> "SampledDistance":
        """Distances for many points anywhere, fast and nearly exact."""
        return SampledDistance(self)

    @cached_property
    def _embree(self) -> tuple[Any, np.ndarray, float]:
        """Embree's scene, and the shift and factor that bring the object near unit size for floats."""
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        centre = self.bounds.mean(axis=0)
        factor = 1.0 / max(float(np.ptp(self.bounds, axis=0).max()), 1e-300)
        scene = rtcore_scene.EmbreeScene(robust=True)
        TriangleMesh(scene, ((self._triangles - centre) * factor).astype(np.float32))
        return scene, centre, factor

    def ray_hits(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Find the first hit of each ray, on either side of a face.

        Parameters
        ----------
        origins, directions
            (n, 3) metres; directions need not be unit, distances are in units of their length.
        """
        origins = np.asarray(origins, dtype=np.float64)
        directions = np.asarray(directions, dtype=np.float64)
        face = self._first_faces(origins, directions)
        hit = face >= 0
        distance = np.full(len(origins), np.inf)
        barycentric = np.zeros((len(origins), 3))
        # The search may be in single precision; where on its plane a face is hit is not.
        along, weights = intersect(self._triangles[face[hit]], origins[hit], directions[hit], tolerance=1e-3)
        distance[hit] = along
        weights = np.clip(weights, 0.0, 1.0)
        barycentric[hit] = weights / weights.sum(axis=1, keepdims=True)
        lost = hit.copy()
        lost[hit] = ~np.isfinite(along)
        face[lost], barycentric[lost] = -1, 0.0
        return Hits(distance, face, barycentric)

    def _first_faces(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        if len(origins) == 0:
            return np.zeros(0, dtype=np.int64)
        if not self._use_embree:
            return self._tree.nearest_hits(origins, directions)
        scene, centre, factor = self._embree
        local = ((origins - centre) * factor).astype(np.float32)
        return np.asarray(scene.run(local, directions.astype(np.float32), query="INTERSECT"), dtype=np.int64)

    def occluded(self, origins: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """Whether (n,) a face lies strictly between origins and targets, both (n, 3) metres.

        The caller moves the origins off the surface they lie on.
        """
        origins = np.asarray(origins, dtype=np.float64)
        towards = np.asarray(targets, dtype=np.float64) - origins
        if len(origins) == 0:
            return np.zeros(0, dtype=bool)
        if not self._use_embree:
            return self._tree.occluded(origins, towards)
        scene, centre, factor = self._embree
        local = ((origins - centre) * factor).astype(np.float32)
        scaled = (towards * factor).astype(np.float32)
        limits = np.full(len(origins), np.float32(1.0))
        return np.asarray(scene.run(local, scaled, dists=limits, query="OCCLUDED")) != -1

    def closest_points(self, points: np.ndarray) -> ClosestPoints:
        """Find the nearest point of the surface to each of (n, 3) points, metres."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        face = self._tree.closest_faces(points)
        barycentric = closest_barycentric(self._triangles[face], points)
        nearest = self.points_at(face, barycentric)
        return ClosestPoints(nearest, np.linalg.norm(points - nearest, axis=1), face, barycentric)

    def sample(self, count: int, seed: int) -> SurfaceSamples:
        """Draw `count` points uniformly by area."""
        random = np.random.default_rng(seed)
        edges = np.cumsum(self.face_areas)
        face = np.searchsorted(edges, random.random(count) * edges[-1], side="right")
        face = np.minimum(face, len(self.faces) - 1)
        root, second = np.sqrt(random.random(count)), random.random(count)
        barycentric = np.stack([1 - root, root * (1 - second), root * second], axis=1)
        return SurfaceSamples(
            self.points_at(face, barycentric), face, barycentric, self.normals_at(face, barycentric)
        )

    def points_at(self, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Points (n, 3) at barycentric coordinates (n, 3) of faces (n,)."""
        return np.einsum("ij,ijk->ik", barycentric, self._triangles[face])

    def normals_at(self, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Unit shading normals (n, 3) at barycentric coordinates (n, 3) of faces (n,)."""
        normals = np.einsum("ij,ijk->ik", barycentric, self.corner_normals[face])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.where(length > 1e-12, normals / np.maximum(length, 1e-300), self.face_normals[face])


class SampledDistance:
    """Distances to a surface for many points: a tree of samples proposes faces, exact distances decide.

    `Surface.closest_points` is exact and meant for points near the surface; this is fifty times faster for
    points anywhere, and may name a face that is farther than the nearest by less than the spacing of the
    samples. `Surface.sampled_distance` has the default samples, built once.

    Parameters
    ----------
    samples
        Points drawn uniformly by area, besides the centre of every face.
    """

    PROPOSALS = 16

    def __init__(self, surface: Surface, *, samples: int = 20000) -> None:
        from scipy.spatial import cKDTree  # an Object File is queried without it

        drawn = surface.sample(samples, 0)
        self._triangles = surface.vertices[surface.faces]
        self._face = np.concatenate([drawn.face, np.arange(len(surface.faces))])
        self._tree = cKDTree(np.concatenate([drawn.points, self._triangles.mean(axis=1)]))

    def roughly(self, points: np.ndarray) -> np.ndarray:
        """Distance (n,) to the nearest sample: never less than to the surface."""
        return np.asarray(self._tree.query(points)[0], dtype=np.float64)

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nearest place (n, 3) of the surface to each of (n, 3) points, its distance (n,) and face (n,)."""
        proposed = self._face[self._tree.query(points, k=self.PROPOSALS)[1]]
        best = np.full(len(points), np.inf)
        place, face = np.zeros((len(points), 3)), np.zeros(len(points), dtype=np.int64)
        for candidate in proposed.T:
            triangle = self._triangles[candidate]
            barycentric = closest_barycentric(triangle, points)
            position = np.einsum("ij,ijk->ik", barycentric, triangle)
            distance = np.linalg.norm(position - points, axis=1)
            nearer = distance < best
            best[nearer], place[nearer], face[nearer] = distance[nearer], position[nearer], candidate[nearer]
        return place, best, face


def face_normals_and_areas(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (F, 3) and areas (F,) of triangles; a face without area has a zero normal."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    cross = np.cross(b - a, c - a)
    doubled = np.linalg.norm(cross, axis=1)
    normals = np.divide(cross, doubled[:, None], out=np.zeros_like(cross), where=doubled[:, None] > 0)
    return normals, doubled / 2


def corner_angles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Interior angles (F, 3) in radians at each corner; 0 where an edge has no length."""
    corners = vertices[faces]
    angles = np.zeros(faces.shape)
    for corner in range(3):
        u = corners[:, (corner + 1) % 3] - corners[:, corner]
        v = corners[:, (corner + 2) % 3] - corners[:, corner]
        angles[:, corner] = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
    return angles


def corner_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Smooth normals (F, 3, 3) at the corners of each face, unit length.

    A corner averages the faces around its vertex, weighted by their angle there and by how little
    they turn from the corner's own face: fully below 30 degrees, not at all above 50, smoothly
    between, so that a small displacement of a vertex never switches a crease on or off.
    """
    normals, _ = face_normals_and_areas(vertices, faces)
    angles = corner_angles(vertices, faces)
    vertex = faces.ravel()
    order = np.argsort(vertex, kind="stable")
    count = np.bincount(vertex, minlength=len(vertices))
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    partners = count[vertex]
    ends = np.cumsum(partners)
    total = np.empty((len(vertex), 3))
    low, high = np.cos(np.radians(SHARP_ABOVE_DEG)), np.cos(np.radians(SMOOTH_BELOW_DEG))
    first = 0
    while first < len(vertex):
        # Every ordered pair of corners that share a vertex, some at a time.
        begin = ends[first] - partners[first]
        last = max(first + 1, int(np.searchsorted(ends, begin + PAIRS_AT_ONCE, side="right")))
        few = partners[first:last]
        own = np.repeat(np.arange(last - first), few)
        rank = np.arange(len(own)) - np.repeat(ends[first:last] - few - begin, few)
        partner = order[np.repeat(start[vertex[first:last]], few) + rank]
        cosine = np.einsum("ij,ij->i", normals[(own + first) // 3], normals[partner // 3])
        ramp = np.clip((cosine - low) / (high - low), 0.0, 1.0)
        weight = angles.ravel()[partner] * ramp * ramp * (3 - 2 * ramp)
        weighted = normals[partner // 3] * weight[:, None]
        for axis in range(3):
            total[first:last, axis] = np.bincount(own, weighted[:, axis], last - first)
        first = last
    length = np.linalg.norm(total, axis=1)
    flat = length < 1e-12
    total[flat] = normals[np.flatnonzero(flat) // 3]
    length[flat] = np.maximum(np.linalg.norm(total[flat], axis=1), 1e-300)
    return (total / length[:, None]).reshape(len(faces), 3, 3)
