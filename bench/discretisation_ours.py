"""This project's own answer, as any caller gets it: a surface filled and solved to an accuracy."""

from typing import Any

import numpy as np

from bench.discretisation_outcome import MAX_FREQUENCY_HZ, Outcome, Stopwatch
from objectfolder.audio.materials import Material
from objectfolder.audio.modes.modes import modes_of_solid
from objectfolder.solid.filling import Filling, fill
from objectfolder.surface.surface import Surface

MAX_MODES = 256
POINTS = {"training_points": 1000, "held_out_points": 100}


def ours(
    surface: Surface, material: Material, name: str, filling: Filling | None = None, **accuracy: Any
) -> Outcome:
    """Every audible mode of a surface; `accuracy` as `modes_of_solid` takes it."""
    watch = Stopwatch()
    with watch.step("meshing"):
        solid = fill(surface, filling, name=name)
    with watch.step("solving"):
        product = modes_of_solid(
            surface,
            solid,
            material,
            max_frequency_hz=MAX_FREQUENCY_HZ,
            max_modes=MAX_MODES,
            seed=0,
            **POINTS,
            **accuracy,
        )
    attributes = product.attributes
    return Outcome(
        np.sqrt(product["eigenvalues"]) / (2 * np.pi),
        int(attributes["discretisation"]["unknowns"]),
        watch.cpu_s,
        {
            "error_estimate_cents": attributes["error_estimate_cents"],
            "geometry_error_estimate_cents": attributes["geometry_error_estimate_cents"],
            "certificate_holds": attributes["count_certificate"]["holds"],
            "elements": len(solid.tetrahedra),
            "stated_frequency_limit_hz": attributes["stated_frequency_limit_hz"],
        },
    )
