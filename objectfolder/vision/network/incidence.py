"""Where camera rays meet the surface, and what light reaches those points directly."""

from dataclasses import dataclass

import numpy as np

from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.network.holes import without_holes
from objectfolder.vision.network.surface_maps import SurfaceMaps

# Cycles lifts the start of grazing shadow rays off the flat facet, onto the surface that the corner normals
# describe; below this cosine, its default.
TERMINATOR_COSINE = 0.1
# Distance (unit frame) by which a shadow ray starts off its own face.
SELF_OFFSET = 1e-4
# The nearest that a light is told to be to a point (unit frame).
NEAREST = 1e-3
# Cosine with the facet to which mirror rays are lifted that a bent normal sends below it; Cycles bends the
# normal to the same end.
LEAST_MIRROR_COSINE = 0.01


@dataclass(frozen=True)
class Incidence:
    """Points of the surface seen by n rays, and the light that arrives there; unit frame, float64.

    Parameters
    ----------
    position, normal, to_camera, to_light
        (n, 3); the last three of unit length, the normal is the shading normal on the camera's side.
    distance
        (n,) distance to the light, at least `NEAREST`.
    irradiance
        (n,) visibility * max(0, cos) / distance^2: 4 pi / power times the irradiance.
    """

    position: np.ndarray
    normal: np.ndarray
    to_camera: np.ndarray
    to_light: np.ndarray
    distance: np.ndarray
    irradiance: np.ndarray


@dataclass(frozen=True)
class MirrorHits:
    """What the surface shows of itself at n of its points, were it a mirror; unit frame, float64.

    Parameters
    ----------
    row
        (m,) the points whose mirror rays meet the surface.
    face, barycentric, direction
        (m,), (m, 3) where, and the (m, 3) unit directions of these rays.
    """

    row: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    direction: np.ndarray


class UnitSurface:
    """A surface queried in its unit frame.

    Parameters
    ----------
    surface, frame
        The surface, and where it lies.
    maps
        Of it, on its triangles in the unit frame.

    Attributes
    ----------
    surface, triangles
        What rays meet: the surface without its holes, and its triangles (F, 3, 3) in the unit frame.
    bends
        Whether a map bends its normals.
    """

    def __init__(self, surface: Surface, frame: UnitFrame, maps: SurfaceMaps | None = None) -> None:
        self._maps = maps
        self._cut = without_holes(maps) if maps is not None and "alpha" in maps else None
        self.surface = surface if self._cut is None else self._cut.surface
        self.frame = frame
        self.triangles = frame.to_unit(self.surface.vertices)[self.surface.faces]
        self.bends = maps is not None and "normal" in maps

    def in_stored(self, face: np.ndarray, barycentric: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return face (n,) and barycentric coordinates (n, 3) in the surface with its holes."""
        return (face, barycentric) if self._cut is None else self._cut.in_parent(face, barycentric)

    def bent(
        self, face: np.ndarray, barycentric: np.ndarray, normal: np.ndarray, side: np.ndarray
    ) -> np.ndarray:
        """Return normals (n, 3) as maps bend them, on the sides (n,) that are seen; `normal` without maps."""
        if self._maps is None or not self.bends:
            return normal
        return self._maps.bent(*self.in_stored(face, barycentric)) * side[:, None]

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the face (n,) (-1: none) and barycentric coordinates (n, 3) of each ray's first hit."""
        hits = self.surface.ray_hits(self.frame.to_object(origins), directions)
        return hits.face, hits.barycentric

    def incidence(
        self, face: np.ndarray, barycentric: np.ndarray, directions: np.ndarray, light_position: np.ndarray
    ) -> Incidence:
        """Return what reaches the points hit by rays along `directions` from a light, (3,) or (n, 3)."""
        position, normal, upright, facet, corner_normals = self._seen(face, barycentric, directions)
        triangles = self.triangles[face]
        to_light = light_position - position
        distance = np.linalg.norm(to_light, axis=1)
        to_light /= np.maximum(distance, 1e-9)[:, None]
        distance = np.maximum(distance, NEAREST)
        cosine = np.einsum("ij,ij->i", upright, to_light)
        lit = np.flatnonzero(cosine > 0)
        start = shadow_ray_start(
            position[lit], triangles[lit], corner_normals[lit], barycentric[lit], facet[lit],
            np.einsum("ij,ij->i", facet[lit], to_light[lit]), cosine[lit],
        )  # fmt: skip
        target = np.broadcast_to(light_position, position.shape)[lit]
        blocked = self.surface.occluded(self.frame.to_object(start), self.frame.to_object(target))
        irradiance = np.zeros(len(position))
        irradiance[lit] = np.where(blocked, 0.0, cosine[lit] / distance[lit] ** 2)
        if self.bends:
            irradiance[lit] *= bent_share(upright[lit], normal[lit], to_light[lit])
        return Incidence(position, normal, -directions, to_light, distance, irradiance)

    def seen(
        self, face: np.ndarray, barycentric: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and shading normals (n, 3) of the points hit by rays along `directions`."""
        return self._seen(face, barycentric, directions)[:2]

    def _seen(
        self, face: np.ndarray, barycentric: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return position, normals bent by maps and not, facet and corner normals on the side seen."""
        corner_normals, facet = self.surface.corner_normals[face], self.surface.face_normals[face]
        position = np.einsum("ij,ijk->ik", barycentric, self.triangles[face])
        # The side seen decides where a normal points, as in Cycles: scans have inverted and open faces.
        side = np.where(np.einsum("ij,ij->i", facet, directions) > 0, -1.0, 1.0)
        facet, corner_normals = facet * side[:, None], corner_normals * side[:, None, None]
        bent = np.einsum("ij,ijk->ik", barycentric, corner_normals)
        upright = bent / np.maximum(np.linalg.norm(bent, axis=1, keepdims=True), 1e-12)
        return position, self.bent(face, barycentric, upright, side), upright, facet, corner_normals

    def mirrored(self, face: np.ndarray, points: Incidence) -> MirrorHits:
        """Trace the mirror ray of each of the points, which lie on faces (n,)."""
        facet = self.surface.face_normals[face]
        facet = facet * np.where(np.einsum("ij,ij->i", facet, points.to_camera) < 0, -1.0, 1.0)[:, None]
        start, directions = mirror_rays(points.position, points.normal, points.to_camera, facet)
        faces, barycentric = self.first_hits(start, directions)
        row = np.flatnonzero(faces >= 0)
        return MirrorHits(row, faces[row], barycentric[row], directions[row])


def bent_share(upright: np.ndarray, bent: np.ndarray, to_light: np.ndarray) -> np.ndarray:
    """Return what bending a normal does to irradiance, a factor (n,), as Cycles has it for matt surfaces.

    The cosines' ratio, times the share that the bumps themselves leave of light that grazes the surface: a
    microfacet shadowing (Conty Estevez, Lecocq and Stein 2019, "A Microfacet-Based Shadowing Function to
    Solve the Bump Terminator Problem", Ray Tracing Gems, chapter 12).

    Parameters
    ----------
    upright, bent, to_light
        (n, 3) unit vectors; the light is above the plane of the first.
    """
    cosine = np.maximum(np.einsum("ij,ij->i", upright, to_light), 1e-9)
    after = np.maximum(np.einsum("ij,ij->i", bent, to_light), 0.0)
    turned = np.maximum(np.einsum("ij,ij->i", upright, bent), 1e-9)
    width2 = np.clip((1 / turned**2 - 1) / 8, 0.0, 1.0)
    left = 2 / (1 + np.sqrt(1 + width2 * np.maximum(1 / cosine**2 - 1, 0.0)))
    return np.asarray(left * after / cosine)


def mirror_rays(
    position: np.ndarray, normal: np.ndarray, to_camera: np.ndarray, facet: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions (n, 3) of mirror rays; `facet` is on the camera's side."""
    camera = np.einsum("ij,ij->i", normal, to_camera)[:, None]
    directions = 2 * camera * normal - to_camera
    rise = np.einsum("ij,ij->i", facet, directions)[:, None]
    directions += np.maximum(LEAST_MIRROR_COSINE - rise, 0.0) * facet
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return position + SELF_OFFSET * facet, directions


def shadow_ray_start(
    position: np.ndarray,
    triangles: np.ndarray,
    corner_normals: np.ndarray,
    barycentric: np.ndarray,
    facet: np.ndarray,
    facet_cosine: np.ndarray,
    cosine: np.ndarray,
) -> np.ndarray:
    """Return the points (n, 3) from which shadow rays start, lifted near the terminator as Cycles does.

    The lift is along the interpolated normal by half the bulge of the quadratic patch through the
    corners, sum_ij b_i b_j (n_j - n_i) . (v_j - v_i), or by the height of the lowest corner tangent
    plane where that is more. It fades in where the light grazes the facet.

    Parameters
    ----------
    position, facet
        (n, 3) points and facet normals.
    triangles, corner_normals
        (n, 3, 3).
    barycentric
        (n, 3).
    facet_cosine, cosine
        (n,) cosine of the light with the facet's and with the shading normal; the latter positive.
    """
    near = np.where(
        cosine < TERMINATOR_COSINE,
        2.0 - (facet_cosine + cosine) / TERMINATOR_COSINE,
        1.0 - facet_cosine / TERMINATOR_COSINE,
    )
    amount = np.clip(near, 0.0, 1.0)
    # Where the light is behind the facet the ray is meant to meet it, unless the lift clears it.
    start = position + SELF_OFFSET * facet
    lifted = np.flatnonzero(amount > 0)
    v, n, b = triangles[lifted], corner_normals[lifted], barycentric[lifted]
    bulge = np.zeros(len(lifted))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        bulge += b[:, i] * b[:, j] * np.einsum("ij,ij->i", n[:, j] - n[:, i], v[:, j] - v[:, i])
    planes = []
    for i in range(3):
        rise = np.einsum("ijk,ik->ij", v - v[:, i : i + 1], n[:, i]).max(axis=1)
        planes.append(np.maximum(np.einsum("ij,ij->i", v[:, i] - position[lifted], n[:, i]) + rise, 0.0))
    height = np.maximum(np.minimum(np.minimum(planes[0], planes[1]), planes[2]), bulge / 2)
    start[lifted] += (amount[lifted] * height)[:, None] * np.einsum("ij,ijk->ik", b, n)
    return start
