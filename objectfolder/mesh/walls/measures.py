"""How thick the walls of an object are, how thick it is at most, and what it encloses."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from objectfolder.mesh.solid_properties import solid_properties, topology_of
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume

RAYS = 2048
BALLS = 256
THIN_SHARE = 0.1

WALL_SHARE = 1 / 8
"""Of the middle one of an object's three sides: what is thicker is no wall of it."""

FACING_AWAY = -0.5
"""Cosine between the normals of the two sides of a wall: within 60 degrees of opposite."""


@dataclass(frozen=True)
class WallMeasures:
    """Measures of a cleaned surface; lengths in metres, None where no ray meets another side.

    Parameters
    ----------
    closed
        Watertight, wound consistently, around a positive volume.
    longest_m
        Longest side of the bounding box.
    area_m2, volume_m3
        Of an open surface the volume where the winding number is above a half, which is what sounds.
    effective_m
        2 V / A: the thickness of a thin plate of the same volume and area. A ball of radius r has 2 r / 3.
    median_m, thin_m
        Median and 5 % quantile over the area of the distance inwards along the normal to the other side.
    bulk_m
        Diameter of about the largest ball inside: how thick the object is at its thickest.
    wall_share
        Of the area, what is wall: the other side faces away within 60 degrees, at most `WALL_SHARE` of the
        middle side away.
    wall_median_m
        Median thickness of the walls alone.
    wall_thin_m
        `THIN_SHARE` of the whole area is wall thinner than this; None where less is wall.
    """

    closed: bool
    longest_m: float
    area_m2: float
    volume_m3: float
    effective_m: float
    median_m: float | None
    thin_m: float | None
    bulk_m: float
    wall_share: float
    wall_median_m: float | None
    wall_thin_m: float | None

    def to_dict(self) -> dict[str, Any]:
        """Return the measures as JSON values; `WallMeasures(**values)` takes them."""
        return asdict(self)

    def thickness(self) -> Mapping[str, float | None]:
        """Return `effective_m`, which only a closed surface has, `median_m` and `thin_m` by name."""
        effective = self.effective_m if self.closed else None
        return {"effective_m": effective, "median_m": self.median_m, "thin_m": self.thin_m}


def measure_walls(surface: Surface) -> WallMeasures:
    """Measure a cleaned surface with outward faces, along the normals at `RAYS` points drawn evenly by area.

    Examples
    --------
    >>> from trimesh.creation import box
    >>> plate = box((0.2, 0.1, 0.004))
    >>> measures = measure_walls(Surface(plate.vertices, plate.faces))
    >>> round(measures.wall_median_m, 6), round(measures.volume_m3, 6)
    (0.004, 8e-05)
    """
    topology = topology_of(surface.vertices, surface.faces)
    volume = solid_properties(surface.vertices, surface.faces).volume_m3
    closed = topology.watertight and topology.consistent and volume > 0
    if not closed:
        volume = enclosed_volume(surface, samples=8192)[0]
    extents = np.ptp(surface.bounds, axis=0)
    drawn = surface.sample(RAYS, 0)
    normals = surface.face_normals[drawn.face]
    start = 1e-6 * float(extents.max())
    hits = surface.ray_hits(drawn.points - start * normals, -normals)
    met = hits.face >= 0
    across = start + hits.distance[met]
    opposite = np.einsum("ij,ij->i", normals[met], surface.face_normals[hits.face[met]])
    walls = np.sort(across[(opposite < FACING_AWAY) & (across <= WALL_SHARE * np.sort(extents)[1])])
    thin, median = np.quantile(across, [0.05, 0.5]).tolist() if len(across) else (None, None)
    middles = drawn.points[met] - normals[met] * across[:, None] / 2
    thin_rays = round(THIN_SHARE * RAYS)
    return WallMeasures(
        closed=closed,
        longest_m=float(extents.max()),
        area_m2=surface.area,
        volume_m3=volume,
        effective_m=2 * volume / surface.area,
        median_m=median,
        thin_m=thin,
        bulk_m=_largest_ball(surface, middles, drawn.points),
        wall_share=len(walls) / RAYS,
        wall_median_m=float(np.median(walls)) if len(walls) else None,
        wall_thin_m=float(walls[thin_rays]) if len(walls) > thin_rays else None,
    )


def _largest_ball(surface: Surface, middles: np.ndarray, points: np.ndarray) -> float:
    """Diameter of about the largest ball inside at one of (n, 3) `middles`; `points` lie on the surface.

    The nearest of the points bounds each ball from above; distances to the surface are taken at the `BALLS`
    middles of the largest bounds.
    """
    if len(middles) == 0:
        return 0.0
    bound = cdist(middles, points).min(axis=1)
    widest = middles[np.argsort(-bound, kind="stable")[:BALLS]]
    return 2 * float(surface.sampled_distance.nearest(widest)[1].max())
