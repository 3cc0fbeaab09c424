"""How a solid differs from the surface that it fills: doubts, and the error of frequencies that follows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.solid.redundant_vertices import SURFACE_TOLERANCE
from objectfolder.solid.solid import Solid

Floats = NDArray[np.float64]
# Share of the mean distance between surface and elements that moves a frequency as a thicker wall does: with
# it 95 % of the modes of bars, plates and bodies of revolution have no larger error than is stated.
OFF_SURFACE = 0.08
OPEN_SHARE = 0.05  # of a solid's outside, from which on openings of its surface are warned of


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


def volume_error(solid: Solid, volume_m3: float) -> dict[str, float]:
    """Errors of the volume of bent and of straight elements, against what the surface encloses."""
    straight = solid.report.get("volume_error")
    if straight is None:
        return {}
    return {
        "volume_error": (1 + straight) * volume_m3 / solid.volume_m3 - 1,
        "volume_error_of_straight_elements": straight,
    }


def geometry_error_cents(solid: Solid, volume_m3: float, distance: Floats, wall_m: float) -> float | None:
    """What walls of another thickness do to a bending mode, in cents; None without a volume.

    A plate's or a shell's bending frequencies are proportional to its thickness. Walls are thicker or thinner
    by the error of the volume, and here and there by the `distance` (n,) of points of the surface from the
    boundary of the elements, of which `OFF_SURFACE` does not average out. Both sides of a wall are known to
    `SURFACE_TOLERANCE` of the longest side: noise of that size is another body. `error_estimates_cents` know
    nothing of it: they are of the elements, whatever shape these were given.
    """
    error = volume_error(solid, volume_m3).get("volume_error")
    if error is None:
        return None
    uneven = OFF_SURFACE * float(distance.mean()) if len(distance) else 0.0
    noise = 2 * SURFACE_TOLERANCE * float(np.ptp(solid.vertices, axis=0).max())
    return float(1200 * (abs(np.log2(1 + error)) + np.log2(1 + (uneven + noise) / wall_m)))
