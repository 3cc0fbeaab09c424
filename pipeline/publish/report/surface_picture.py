"""A surface drawn as plain clay: where on an object a point lies, seen from a side that shows it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from objectfolder.vision.compiled.rasteriser import edge_functions, rasterise
from pipeline.publish.report.pictures import indexed_uri

PIXELS = 200
FIELD_OF_VIEW_DEG = 32.0
# Box diagonals from the centre: the whole object is in the picture from every side.
DISTANCE = 1.95
FOCAL = PIXELS / 2 / np.tan(np.radians(FIELD_OF_VIEW_DEG / 2))
# Degrees above the horizon and around, that an object is looked at from.
ELEVATIONS_DEG = (25.0, 55.0, -25.0, 80.0, -60.0)
AZIMUTHS_DEG = tuple(range(15, 375, 30))
# Cosine between the surface's normal and the direction to the camera: oblique enough to show relief.
WANTED_COSINE = 0.75
SHOWING_COSINES = 0.4, 0.97
MOST_TRIES = 8
# A point counts as seen where the surface in its pixel, or in one beside it, is this near, in pixels.
NEAR_PIXELS = 2.0
# Grey of each level: nothing beside the object, then from shadow to light.
SHADES = 64
CLAY = np.repeat(np.linspace(70, 225, SHADES)[:, None], 3, axis=1)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles and what pictures of them need.

    Parameters
    ----------
    vertices, faces
        (V, 3) and (F, 3), metres.
    """

    vertices: np.ndarray
    faces: np.ndarray

    @cached_property
    def centre(self) -> np.ndarray:
        """Middle of the bounding box, metres."""
        return (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2

    @cached_property
    def size_m(self) -> float:
        """Diagonal of the bounding box, metres; 1 for a surface without extent."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0))) or 1.0

    @cached_property
    def face_normals(self) -> np.ndarray:
        """(F, 3) unit normals; zero for a face without area."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        normals = np.cross(b - a, c - a)
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


@dataclass(frozen=True, eq=False)
class Picture:
    """A surface from one side.

    Parameters
    ----------
    direction
        Unit vector from the object to the camera.
    seen
        (PIXELS, PIXELS) int32 face of each pixel, -1 beside the object.
    depth_m
        (PIXELS, PIXELS) along the camera's axis, metres; infinite beside the object.
    """

    surface: Surface
    direction: np.ndarray
    seen: np.ndarray
    depth_m: np.ndarray

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n, 2) pixels, x right and y down, and (n,) depths in metres of (n, 3) points."""
        local = _to_camera(self.surface, self.direction, np.asarray(points, dtype=np.float64))
        depth = -local[:, 2]
        x = PIXELS / 2 + FOCAL * local[:, 0] / depth
        y = PIXELS / 2 - FOCAL * local[:, 1] / depth
        return np.stack([x, y], axis=1), depth * self.surface.size_m

    def shows(self, point: np.ndarray) -> bool:
        """Whether nothing of the surface hides a point of it."""
        (pixel,), (depth,) = self.project(point[None])
        column, row = np.floor(pixel).astype(int)
        around = self.depth_m[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        return bool(around.size) and bool(np.abs(around - depth).min() <= NEAR_PIXELS * depth / FOCAL)

    @cached_property
    def uri(self) -> str:
        """The picture as a data URI, see-through beside the object."""
        return indexed_uri(self.shades, CLAY, transparent=0)

    @cached_property
    def shades(self) -> np.ndarray:
        """(PIXELS, PIXELS) uint8: grey from 1 up, lit from the upper left; 0 beside the object."""
        right, up, back = _axes(self.direction)
        light = (-0.45 * right + 0.55 * up + 0.9 * back) / np.linalg.norm([0.45, 0.55, 0.9])
        normals = self.surface.face_normals
        lit = np.clip(normals @ light * np.where(normals @ back < 0, -1.0, 1.0), 0, 1)
        levels = np.round(1 + (SHADES - 2) * lit).astype(np.uint8)
        return np.where(self.seen >= 0, levels[self.seen], np.uint8(0))


def picture(surface: Surface, direction: np.ndarray) -> Picture:
    """Draw a surface as seen from `direction`, a unit vector from the object to the camera."""
    vertices = _to_camera(surface, direction, surface.vertices)
    functions, reach = edge_functions(vertices, surface.faces, FOCAL, PIXELS / 2, PIXELS / 2)
    slots = np.arange(PIXELS * PIXELS, dtype=np.int32).reshape(PIXELS, PIXELS)
    seen = np.full((PIXELS * PIXELS, 1), -1, np.int32)
    nearness = np.zeros((PIXELS * PIXELS, 1), np.float32)
    middle = np.zeros(1, np.float32)
    rasterise(functions, reach, slots, 0, 0, middle, middle, seen, nearness)
    with np.errstate(divide="ignore"):
        depth = surface.size_m / nearness.reshape(PIXELS, PIXELS)
    return Picture(surface, direction, seen.reshape(PIXELS, PIXELS), depth)


def pictures_showing(surface: Surface, points: np.ndarray, normals: np.ndarray) -> list[Picture]:
    """Return for each of (n, 3) points a picture that shows it, obliquely where that is possible.

    As few sides as will do are drawn: at each turn the one that promises to show most of the points left.
    A point that a few sides do not show (deep in a vessel) has the picture along its normal; ask `shows`.
    """
    found: list[Picture | None] = [None] * len(points)
    directions = _directions()
    cosines = directions @ np.asarray(normals, dtype=np.float64).T
    least, most = SHOWING_COSINES
    promises = np.where((least <= cosines) & (cosines <= most), 1 - np.abs(cosines - WANTED_COSINE), 0.0)
    for _ in range(MOST_TRIES + len(points)):
        index = int(np.argmax(promises.sum(axis=1)))
        if not promises[index].any():
            break
        drawn = picture(surface, directions[index])
        for place in np.flatnonzero(promises[index]):
            if drawn.shows(points[place]):
                found[place] = drawn
                promises[:, place] = 0.0
        promises[index] = 0.0
    return [
        drawn if drawn is not None else picture(surface, normal)
        for drawn, normal in zip(found, normals, strict=True)
    ]


def _directions() -> np.ndarray:
    elevation, azimuth = np.radians(np.meshgrid(ELEVATIONS_DEG, AZIMUTHS_DEG, indexing="ij"))
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1).reshape(-1, 3)


def _axes(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the camera's right, up and back as unit vectors; the object's z is up where it can be."""
    up = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, direction)
    right /= np.linalg.norm(right)
    return right, np.cross(direction, right), direction


def _to_camera(surface: Surface, direction: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (n, 3) points in the camera's axes, the object's diagonal being 1."""
    local = (points - surface.centre) / surface.size_m - DISTANCE * direction
    return np.ascontiguousarray(local @ np.stack(_axes(direction)).T)
