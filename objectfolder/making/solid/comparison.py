"""How a solid differs from the surface that it fills: doubts, and the error of frequencies that follows."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.solid.bending_waves import BendingWaves
from objectfolder.making.solid.local_thickness import LocalThickness, distances_across, local_thickness
from objectfolder.making.solid.normal_form import NormalForm, normal_form
from objectfolder.making.solid.redundant_vertices import SURFACE_TOLERANCE
from objectfolder.making.solid.solid import SMALLEST_SHARE, Solid
from objectfolder.surface.connectivity import edge_table
from objectfolder.surface.openings import patches_of
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume, is_closed

Floats = NDArray[np.float64]
MOST_VOLUME_ERROR = 0.04
MOST_VOLUME_RATIO = 2.0  # from here on a solid is no solid of its surface
MOST_WALL_RATIO = 1.25
MOST_ELEMENTS = 36_000  # with order 2 they have about as many unknowns as are solved for
DOUBLED = 5e-4  # of the diagonal: where few places are thinner, they are sheets given twice, not walls
MOSTLY = 0.75
# Points along an edge, and of all edges, at which distance is taken; of those how many exactly at a time.
ALONG_EDGE, MOST_ON_EDGES, EXACT_AT_ONCE = 5, 10_000, 64
OPENING_DISTANCE = 0.01  # distance over the diagonal from which on the outside of a solid closes an opening
NEGLIGIBLE = 1e-7  # distance over the diagonal, that of single precision
# Share of the mean distance between surface and elements that moves a frequency as a thicker wall does: with
# it 95 % of the modes of bars, plates and bodies of revolution have no larger error than is stated.
OFF_SURFACE = 0.08
OPEN_SHARE = 0.05  # of a solid's outside, from which on openings of its surface are warned of


@dataclass(frozen=True)
class Measures:
    """The dimensionless surface that is filled, what is known of it, and the shortest wave to be carried."""

    form: NormalForm
    local: LocalThickness
    thin: float
    median: float
    closed: bool
    pieces: int
    volume: float
    volume_uncertainty: float
    wave: float = np.inf

    @property
    def wall(self) -> float:
        """The thickness that small lengths are measured by."""
        return min(1.5 * self.thin, self.median)


def measure(target: Surface, waves: BendingWaves | None = None) -> Measures:
    """Bring a surface, metres, to its normal form and measure it; without waves none is to be carried."""
    form = normal_form(target)
    local = local_thickness(form.surface)
    across = local.across[np.isfinite(local.across)]
    walls = across[across > DOUBLED]
    across = walls if len(walls) > MOSTLY * len(across) else across
    thin, median = np.quantile(across, [0.05, 0.5]) if len(across) else (0.02, 0.02)
    volume, uncertainty = enclosed_volume(form.surface)
    pieces = int(patches_of(form.surface.edges).max()) + 1
    closed = is_closed(form.surface)
    wave = np.inf
    if waves is not None:
        wave = waves.shortest_m(float(median) * form.diagonal_m, target.area) / form.diagonal_m
    return Measures(
        form,
        local,
        float(thin),
        float(median),
        closed,
        pieces,
        volume,
        uncertainty,
        wave,
    )


def is_another_body(measures: Measures, solid: Solid) -> bool:
    """Whether a solid has so little of its surface's volume, or so much more, that it is not its solid.

    Boards thinner than the cells of the grid that a surface is remeshed on are lost, for one.
    """
    least, most = measures.volume / MOST_VOLUME_RATIO, measures.volume * MOST_VOLUME_RATIO
    allowed = 3 * measures.volume_uncertainty
    return measures.volume > allowed and not least - allowed <= solid.volume_m3 <= most + allowed


def doubts_of(measures: Measures, solid: Solid) -> list[str]:
    """What is wrong with a solid as filled, by what its surface says."""
    doubts = []
    allowed = MOST_VOLUME_ERROR * abs(measures.volume) + 3 * measures.volume_uncertainty
    if abs(solid.volume_m3 - measures.volume) > allowed:
        doubts.append(f"the volume is {solid.volume_m3 / measures.volume - 1:+.1%} off")
    if len(solid.tetrahedra) > MOST_ELEMENTS:
        doubts.append(f"it takes {len(solid.tetrahedra)} elements, more than {MOST_ELEMENTS}")
    ratio = _wall_ratio(measures, solid)
    if measures.closed and not 1 / MOST_WALL_RATIO < ratio < MOST_WALL_RATIO:
        doubts.append(f"its median wall is {ratio:.2f} times the surface's")
    if solid.components > measures.pieces:
        doubts.append(f"{measures.pieces} pieces of the surface became {solid.components} bodies")
    if measures.closed and measures.pieces == 1:
        away = solid.surface.sampled_distance.nearest(measures.local.points)[1]
        lost = float(np.mean(away > np.maximum(measures.local.least, 0.01)))
        if lost > 0.01:
            doubts.append(f"{lost:.1%} of the surface is farther from it than its wall is thick")
    return doubts


def _wall_ratio(measures: Measures, solid: Solid) -> float:
    """Median wall thickness of a solid over that of its surface."""
    drawn = solid.surface.sample(2048, 0)
    across = distances_across(solid.surface, drawn.points, solid.surface.face_normals[drawn.face])
    finite = across[np.isfinite(across)]
    return float(np.median(finite) / measures.median) if len(finite) else 0.0


def _along_edges(surface: Surface) -> Floats:
    """Points of the edges of a surface, ends included: its farthest places are there, between any samples."""
    edges = edge_table(surface.faces).vertices
    step = max(1, len(edges) * ALONG_EDGE // MOST_ON_EDGES)
    first, last = surface.vertices[edges[::step, 0]], surface.vertices[edges[::step, 1]]
    share = np.linspace(0, 1, ALONG_EDGE)[:, None, None]
    return ((1 - share) * first + share * last).reshape(-1, 3)


def _largest_distance(surface: Surface, points: Floats) -> float:
    """Largest distance of points (n, 3) from a surface.

    `Surface.sampled_distance` is never too small; where it is large, the exact distance decides.
    """
    bound = surface.sampled_distance.nearest(points)[1]
    order = np.argsort(-bound, kind="stable")
    largest = 0.0
    for start in range(0, len(order), EXACT_AT_ONCE):
        part = order[start : start + EXACT_AT_ONCE]
        if bound[part[0]] <= largest + NEGLIGIBLE:
            break
        largest = max(largest, float(surface.closest_points(points[part]).distance.max()))
    return largest


def differences(solid: Solid, measures: Measures) -> dict[str, Any]:
    """How far a dimensionless solid is from its surface, both ways; lengths in metres."""
    scale = measures.form.diagonal_m
    points, surface, boundary = measures.local.points, measures.form.surface, solid.surface
    forth = boundary.sampled_distance.nearest(points)[1]
    back = surface.sampled_distance.nearest(boundary.sample(len(points), 1).points)[1]
    away = np.concatenate([forth, back]) * scale
    largest = max(
        _largest_distance(boundary, np.concatenate([points, _along_edges(surface)])),
        _largest_distance(surface, _along_edges(boundary)),
    )
    return {
        "wall_thin_m": measures.thin * scale,
        "wall_median_m": measures.median * scale,
        "volume_error": solid.volume_m3 / measures.volume - 1 if measures.volume > 0 else None,
        "volume_uncertainty": measures.volume_uncertainty / measures.volume if measures.volume > 0 else None,
        "wall_median_ratio": _wall_ratio(measures, solid),
        "surface_error_rms_m": float(np.sqrt(np.mean(away**2))),
        "surface_error_max_m": largest * scale,
        "smallest_body_share": SMALLEST_SHARE,
        "closing_share": 0.0 if measures.closed else float(np.mean(back > OPENING_DISTANCE)),
    }


def shape_warnings(report: dict[str, Any]) -> list[str]:
    """What is doubtful by the report of a solid."""
    doubts = [f"the solid that rings is doubtful: {doubt}" for doubt in report.get("doubts", ())]
    share = report.get("closing_share", 0.0)
    if share > OPEN_SHARE:
        doubts.append(
            f"{share:.0%} of the solid's outside closes openings of the surface: it rings as if it were "
            "filled. State wall_m if it is a sheet, shell_m if it is a container"
        )
    return doubts


def shape_attributes(
    solid: Solid, volume_m3: float, distance: Floats, wall_m: float, rounding: tuple[float, float]
) -> dict[str, Any]:
    """What a product of modes says of their shape: `geometry_error_cents`, and warnings."""
    return {
        "geometry_error_estimate_cents": geometry_error_cents(solid, volume_m3, distance, wall_m, rounding),
        "warnings": shape_warnings(solid.report),
    }


def volume_error(solid: Solid, volume_m3: float) -> dict[str, float]:
    """Errors of the volume of bent and of straight elements, against what the surface encloses."""
    straight = solid.report.get("volume_error")
    if straight is None:
        return {}
    return {
        "volume_error": (1 + straight) * volume_m3 / solid.volume_m3 - 1,
        "volume_error_of_straight_elements": straight,
    }


def geometry_error_cents(
    solid: Solid,
    volume_m3: float,
    distance: Floats,
    wall_m: float,
    rounding: tuple[float, float] = (0.0, 0.0),
) -> float | None:
    """What walls of another thickness do to a bending mode, in cents; None without a volume.

    A plate's or a shell's bending frequencies are proportional to its thickness. Walls are thicker or thinner
    by the error of the volume, and here and there by the `distance` (n,) of points of the surface from the
    boundary of the elements, of which `OFF_SURFACE` does not average out. Both sides of a wall are known to
    `SURFACE_TOLERANCE` of the longest side: noise of that size is another body. `error_estimates_cents` know
    nothing of it: they are of the elements, whatever shape these were given.

    `rounding` has what the triangles cut off of a body that is known to be round: the volume, m^3, and the
    mean depth, metres. The elements have it, and are no farther from the body for that.
    """
    error = volume_error(solid, volume_m3).get("volume_error")
    if error is None:
        return None
    error = (1 + error) / (1 + rounding[0] * (1 + error) / volume_m3) - 1
    uneven = OFF_SURFACE * max(float(distance.mean()) - rounding[1], 0.0) if len(distance) else 0.0
    noise = 2 * SURFACE_TOLERANCE * float(np.ptp(solid.vertices, axis=0).max())
    return float(1200 * (abs(np.log2(1 + error)) + np.log2(1 + (uneven + noise) / wall_m)))
