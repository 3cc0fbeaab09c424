"""Textbook tetrahedra: one order everywhere, the project's assembly and eigensolver.

What they differ in from the project's own answer is the discretisation alone.
"""

import numpy as np

from bench.record import Stopwatch
from bench.rivals.audio.outcome import MAX_FREQUENCY_HZ, Outcome
from objectfolder.audio.elements.elasticity import ElementMatrices
from objectfolder.audio.materials import Material
from objectfolder.audio.modes.eigen import count_below, lowest_elastic
from objectfolder.audio.modes.spectrum import pencil_of, space_on
from objectfolder.solid.solid import Solid

# Modes looked for at most where the limit is a frequency.
MAX_MODES = 256


def of_order(
    solid: Solid, material: Material, order: int, modes: int | None = None, *, bend: bool = False
) -> Outcome:
    """Every audible mode in all functions of an order, or the first `modes` of any frequency; counted.

    Elements are straight, or with `bend` follow the surface that the solid was made for.
    """
    watch = Stopwatch()
    length = float(np.ptp(solid.vertices, axis=0).max())
    radians = material.shear_speed_m_s / length
    audible = (2 * np.pi * MAX_FREQUENCY_HZ / radians) ** 2
    with watch.step("assembly"):
        space, _ = space_on(solid, order, length, bend=bend)
        every = np.ones(space.size, dtype=bool)
        pencil = pencil_of(ElementMatrices(space, material.poisson_ratio), solid.component, every)
    with watch.step("factorisation and eigenvectors"):
        pairs = lowest_elastic(
            pencil,
            below=audible if modes is None else np.inf,
            at_most=modes or MAX_MODES,
            shift=-min(0.05, audible / 4),
            tolerance=1e-7,
        )
        values = pairs.values
        kept = int(np.count_nonzero(values < audible)) if modes is None else modes
        limit = audible if modes is None else (values[kept - 1] + values[kept]) / 2
    with watch.step("certificate"):
        counted = count_below(pencil, limit)
    return Outcome(
        np.sqrt(values[:kept]) * radians / (2 * np.pi),
        pencil.size,
        watch.cpu_s,
        {"elements": len(solid.tetrahedra), "certificate_holds": counted == kept},
    )
