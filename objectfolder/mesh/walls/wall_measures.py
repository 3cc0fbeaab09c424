"""What of a surface tells whether its walls are as the object's: thickness, bulk, sides, sections."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from objectfolder.mesh.solid_properties import solid_properties, topology_of
from objectfolder.mesh.walls.container_shape import ContainerShape, container_shape
from objectfolder.products.store import Product
from objectfolder.surface.sampled_distance import SampledDistance
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import WindingNumber, enclosed_volume

Floats = NDArray[np.float64]

RAYS = 2048
DIGITS = 5
SIDES = 512
"""Places at which the winding number is asked: it costs more than a ray."""

LEAST_DOUBT = 0.005
AT_ONCE = 64

LEVELS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
WALL_SHARE = 1 / 8
"""Of the middle one of an object's three sides: what is thicker is no wall of it."""

FACING_AWAY = -0.5
"""Cosine between the normals of the two sides of a wall: within 60 degrees of opposite."""


@dataclass(frozen=True)
class WallMeasures:
    """Measures of a cleaned surface, in metres.

    Parameters
    ----------
    closed
        Watertight, wound consistently, around a positive volume.
    boundary_edges, cavities, pieces
        Edges of one face; closed inner shells; connected pieces that are no cavity.
    extents_m
        Sides of the bounding box.
    area_m2, volume_m3
        Of an open surface the volume where the winding number is above a half, which is what sounds.
    effective_m
        2 V / A.
    bulk_m
        Diameter of about the largest ball inside: how thick the object is at its thickest.
    across_m
        Distance inwards along the normal to the other side, at the shares `LEVELS` of the area; empty where
        no ray meets another side.
    wall_share
        Of the area, what is wall: the other side faces away within 60 degrees, at most `WALL_SHARE` of the
        middle side away.
    wall_m
        Thickness of the walls alone at the shares `LEVELS` of their area; empty without walls.
    torn_share
        Of the area of a closed surface, what encloses nothing: the space just inside it is outside, because
        the two sides of a wall have passed through one another.
    overlapping_share
        Of the area, what has another part of the surface inside it: a way inwards enters that before it
        leaves.
    filled_share
        Volume over that of the convex hull; None for a surface without one.
    shape
        How far its sections are those of a can or a bottle; None for an open surface.
    """

    closed: bool
    boundary_edges: int
    cavities: int
    pieces: int
    extents_m: tuple[float, float, float]
    area_m2: float
    volume_m3: float
    effective_m: float
    bulk_m: float
    across_m: tuple[float, ...]
    wall_share: float
    wall_m: tuple[float, ...]
    torn_share: float
    overlapping_share: float
    filled_share: float | None
    shape: ContainerShape | None

    def walls_thinner_than(self, thickness_m: float) -> float:
        """Share of the whole area that is wall thinner than `thickness_m`."""
        return self.wall_share * _share_below(self.wall_m, thickness_m) if self.wall_m else 0.0

    def thicker_than(self, thickness_m: float) -> float:
        """Share of the area from which the other side is farther than `thickness_m` inwards."""
        return 1 - _share_below(self.across_m, thickness_m) if self.across_m else 0.0

    def usual_wall_m(self) -> float | None:
        """Median thickness over the area of walls; None without walls."""
        return self.wall_m[LEVELS.index(0.5)] if self.wall_m else None

    def to_dict(self) -> dict[str, Any]:
        """Return the measures as JSON values."""
        values = _with_lists(asdict(self))
        return values if self.shape is None else {**values, "shape": _with_lists(asdict(self.shape))}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> "WallMeasures":
        """Return what `to_dict` wrote."""
        shape = stored["shape"]
        return cls(
            **{
                **_with_tuples(stored),
                "shape": None if shape is None else ContainerShape(**_with_tuples(shape)),
            }
        )


def measure_walls(surface: Surface, *, cavities: int = 0) -> WallMeasures:
    """Measure a cleaned surface with outward faces; metres.

    Parameters
    ----------
    cavities
        Closed inner shells that cleaning found.
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
    is_wall = (opposite < FACING_AWAY) & (across <= WALL_SHARE * np.sort(extents)[1])
    entering = np.zeros(RAYS, dtype=bool)
    entering[met] = opposite > 0
    torn, overlapping = (
        _torn(surface, drawn.points - start * normals, ~met | entering) if closed else (0.0, 0.0)
    )
    middles = drawn.points[met] - normals[met] * across[:, None] / 2
    hull = _hull_volume(surface)
    measures = WallMeasures(
        closed=closed,
        boundary_edges=topology.boundary_edges,
        cavities=cavities,
        pieces=topology.components - cavities,
        extents_m=(float(extents[0]), float(extents[1]), float(extents[2])),
        area_m2=surface.area,
        volume_m3=volume,
        effective_m=2 * volume / surface.area,
        bulk_m=_bulk(surface, middles, drawn.points),
        across_m=_quantiles(across),
        wall_share=float(np.count_nonzero(is_wall)) / RAYS,
        wall_m=_quantiles(across[is_wall]),
        torn_share=torn,
        overlapping_share=overlapping if closed else float(entering.mean()),
        filled_share=None if hull is None else min(1.0, volume / hull),
        shape=container_shape(surface) if closed else None,
    )
    return WallMeasures.from_dict({name: _rounded(value) for name, value in measures.to_dict().items()})


def measures_of(product: Product) -> WallMeasures:
    """Return the measures of an objects product: those in its attributes, or taken now."""
    stored = product.attributes.get("walls")
    if isinstance(stored, Mapping):
        return WallMeasures.from_dict(stored)
    surface = Surface(product["vertices"], product["faces"])
    return measure_walls(surface, cavities=int(product.attributes["cleaning"]["cavities"]))


def _rounded(value: Any) -> Any:
    """Floats to `DIGITS` digits, wherever they are: the last bits differ between processors."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return {name: _rounded(item) for name, item in value.items()} if isinstance(value, dict) else value


def _with_lists(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def _with_tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def _quantiles(values: Floats) -> tuple[float, ...]:
    return tuple(float(value) for value in np.quantile(values, LEVELS)) if len(values) else ()


def _share_below(quantiles: tuple[float, ...], value: float) -> float:
    if value >= quantiles[-1]:
        return 1.0
    return float(np.interp(value, quantiles, LEVELS, left=0.0))


def _torn(surface: Surface, points: Floats, doubtful: NDArray[np.bool_]) -> tuple[float, float]:
    """Shares of points just inside a closed surface that are outside, and that are in several parts.

    Only where a way inwards does not end at the other side of a wall the winding number is asked.
    """
    share = float(doubtful.mean())
    if share < LEAST_DOUBT:
        return 0.0, 0.0
    inside = WindingNumber(surface)(points[doubtful][:SIDES])
    return share * float((inside < 0.5).mean()), share * float((inside >= 0.5).mean())


def _bulk(surface: Surface, middles: Floats, points: Floats) -> float:
    """Diameter of the largest ball inside about one of (n, 3) `middles`; `points` (m, 3) lie on the surface.

    The nearest of the points bounds each ball from above; exact distances, which are slow where much of a
    surface is equally near, are asked only where the bound leaves something to find.
    """
    bound = np.empty(len(middles))
    for start in range(0, len(middles), 256):
        away = middles[start : start + 256, None] - points
        bound[start : start + 256] = np.sqrt(np.einsum("ijk,ijk->ij", away, away).min(axis=1))
    order = np.argsort(-bound, kind="stable")
    distance, largest = SampledDistance(surface), 0.0
    for start in range(0, len(order), AT_ONCE):
        part = order[start : start + AT_ONCE]
        if bound[part[0]] <= largest:
            break
        largest = max(largest, float(distance.nearest(middles[part])[1].max()))
    return 2 * largest


def _hull_volume(surface: Surface) -> float | None:
    try:
        volume = float(ConvexHull(surface.vertices[np.unique(surface.faces)]).volume)
    except QhullError:
        return None
    return volume if volume > 0 else None
