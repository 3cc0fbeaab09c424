"""Points of the surface and the light that would reach them unhindered: `incidence.py`, compiled."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from objectfolder.jit import arrayless, kernel
from objectfolder.vision.compiled.bounding_volumes import BoundingVolumes
from objectfolder.vision.network.incidence import (
    SELF_OFFSET,
    TERMINATOR_COSINE,
    UnitSurface,
    bent_share,
    mirror_rays,
)


@dataclass(frozen=True)
class Points:
    """Points (n,) of a surface as rays meet them; unit frame, float64.

    Parameters
    ----------
    face, barycentric, direction
        (n,), (n, 3) and the (n, 3) unit directions of the rays.
    position, normal, upright
        (n, 3), the latter two shading normals on the side seen, as maps bend them and without maps.
    side
        (n,) -1.0 where the back of the face is seen.
    """

    face: np.ndarray
    barycentric: np.ndarray
    direction: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    upright: np.ndarray
    side: np.ndarray

    def of(self, row: np.ndarray) -> "Points":
        """Return some of the points."""
        return Points(*(column.take(row, axis=0) for column in vars(self).values()))


class Triangles(NamedTuple):
    """Corners (F, 3, 3) in the unit frame, shading normals (F, 3, 3) there, unit normals (F, 3)."""

    corners: np.ndarray
    corner_normals: np.ndarray
    facets: np.ndarray


class LitSurface:
    """A surface in arrays that kernels take, and its bounding volumes."""

    def __init__(self, surface: UnitSurface) -> None:
        self.vertices = surface.frame.to_unit(surface.surface.vertices)
        self.faces = surface.surface.faces
        self.facets = np.ascontiguousarray(surface.surface.face_normals)
        corner_normals = np.ascontiguousarray(surface.surface.corner_normals)
        self._triangles = Triangles(np.ascontiguousarray(surface.triangles), corner_normals, self.facets)
        self.volumes = BoundingVolumes.of_triangles(self._triangles.corners)
        self._unit = surface

    def points(self, face: np.ndarray, barycentric: np.ndarray, direction: np.ndarray) -> Points:
        """Return the points of faces (n,) at barycentric coordinates (n, 3) that rays (n, 3) meet."""
        count = len(face)
        position, upright, side = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
        _surface_points(face, barycentric, direction, self._triangles, position, upright, side)
        normal = self._unit.bent(face, barycentric, upright, side)
        return Points(face, barycentric, direction, position, normal, upright, side)

    def unhindered(self, points: Points, lights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return irradiance (n,) but for shadow, and starts (n, 3) of shadow rays, 0 where there is none.

        As `incidence.UnitSurface.incidence` and `incidence.shadow_ray_start`; lights are (1, 3) or (n, 3).
        """
        irradiance, start = np.zeros(len(points.face)), np.zeros((len(points.face), 3))
        met = points.face, points.barycentric, points.position, points.upright, points.side
        working = np.empty((3, 3)), np.empty((3, 3))
        _unhindered(met, lights, self._triangles, TERMINATOR_COSINE, SELF_OFFSET, irradiance, start, working)
        return irradiance, start

    def light_from(
        self, points: Points, light: np.ndarray, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return irradiance (n,) but for shadow, and which (n,) of the lit points asked are in shadow.

        `light` is (3,) or (n, 3), one a point.
        """
        irradiance, start = self.unhindered(points, light.reshape(-1, 3))
        if self._unit.bends:
            to_light = light - points.position
            to_light /= np.maximum(np.linalg.norm(to_light, axis=1, keepdims=True), 1e-9)
            irradiance *= bent_share(points.upright, points.normal, to_light)
        lit = irradiance > 0 if mask is None else mask & (irradiance > 0)
        return irradiance, self.volumes.occluded(start, light, lit)

    def mirrored(self, points: Points) -> tuple[np.ndarray, Points]:
        """Return which of the points (m,) see the surface in their mirror rays, and what they see there."""
        facet = self.facets[points.face] * points.side[:, None]
        start, direction = mirror_rays(points.position, points.normal, -points.direction, facet)
        face, barycentric = self.volumes.first_hits(start, direction)
        row = np.flatnonzero(face >= 0)
        return row, self.points(face[row], barycentric[row], direction[row])


@arrayless(kernel)
def _surface_points(face, barycentric, directions, surface, position, normal, side):
    """Write position and shading normal (n, 3), and the side seen (n,): -1.0 the back."""
    triangles, corner_normals, facets = surface
    for i in range(len(face)):
        f = face[i]
        b0, b1, b2 = barycentric[i, 0], barycentric[i, 1], barycentric[i, 2]
        towards = (
            facets[f, 0] * directions[i, 0]
            + facets[f, 1] * directions[i, 1]
            + facets[f, 2] * directions[i, 2]
        )
        side[i] = -1.0 if towards > 0 else 1.0
        squared = 0.0
        for k in range(3):
            position[i, k] = b0 * triangles[f, 0, k] + b1 * triangles[f, 1, k] + b2 * triangles[f, 2, k]
            value = side[i] * (
                b0 * corner_normals[f, 0, k] + b1 * corner_normals[f, 1, k] + b2 * corner_normals[f, 2, k]
            )
            normal[i, k] = value
            squared += value * value
        length = max(math.sqrt(squared), 1e-12)
        for k in range(3):
            normal[i, k] /= length


@arrayless(kernel)
def _unhindered(points, lights, surface, terminator_cosine, self_offset, irradiance, start, working):
    """Write the answer of `LitSurface.unhindered`.

    `points` are faces, barycentric coordinates, positions, shading normals and sides; working memory are two
    (3, 3).
    """
    face, barycentric, position, normal, side = points
    (triangles, corner_normals, facets), (v, n) = surface, working
    for i in range(len(face)):
        f = face[i]
        light = lights[i % len(lights)]
        lx, ly, lz = light[0] - position[i, 0], light[1] - position[i, 1], light[2] - position[i, 2]
        distance = math.sqrt(lx * lx + ly * ly + lz * lz)
        scale = 1.0 / max(distance, 1e-9)
        lx, ly, lz = lx * scale, ly * scale, lz * scale
        cosine = normal[i, 0] * lx + normal[i, 1] * ly + normal[i, 2] * lz
        if not cosine > 0:
            continue
        irradiance[i] = cosine / max(distance, 1e-3) ** 2
        facet_cosine = side[i] * (facets[f, 0] * lx + facets[f, 1] * ly + facets[f, 2] * lz)
        for k in range(3):
            start[i, k] = position[i, k] + self_offset * side[i] * facets[f, k]
        if cosine < terminator_cosine:
            amount = 2.0 - (facet_cosine + cosine) / terminator_cosine
        else:
            amount = 1.0 - facet_cosine / terminator_cosine
        amount = min(max(amount, 0.0), 1.0)
        if not amount > 0:
            continue
        for corner in range(3):
            for k in range(3):
                v[corner, k] = triangles[f, corner, k]
                n[corner, k] = side[i] * corner_normals[f, corner, k]
        bulge, lowest = 0.0, np.inf
        for corner in range(3):
            after = (corner + 1) % 3
            turn, highest, plane = 0.0, 0.0, 0.0
            for k in range(3):
                turn += (n[after, k] - n[corner, k]) * (v[after, k] - v[corner, k])
                plane += (v[corner, k] - position[i, k]) * n[corner, k]
            bulge += barycentric[i, corner] * barycentric[i, after] * turn
            for other in range(3):
                rise = 0.0
                for k in range(3):
                    rise += (v[other, k] - v[corner, k]) * n[corner, k]
                highest = max(highest, rise)
            lowest = min(lowest, max(plane + highest, 0.0))
        height = amount * max(lowest, bulge / 2)
        for k in range(3):
            bent = barycentric[i, 0] * n[0, k] + barycentric[i, 1] * n[1, k] + barycentric[i, 2] * n[2, k]
            start[i, k] += height * bent
