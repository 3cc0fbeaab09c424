"""Textbook tetrahedra: one order everywhere, the project's assembly and eigensolver.

What they differ in from the project's own answer is the discretisation alone.
"""

import numpy as np

from bench.record import Stopwatch
from bench.rivals.audio.outcome import MAX_FREQUENCY_HZ, Outcome
from objectfolder.audio.elements.elasticity import assemble
from objectfolder.audio.materials import Material
from objectfolder.audio.modes.eigen import count_below, lowest_elastic, rigid_motions
from objectfolder.audio.modes.spectrum import space_on
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
        stiffness, mass = assemble(space, material.poisson_ratio)
        component = np.empty(space.size, dtype=np.int64)
        component[space.numbers] = solid.component[space.tetrahedra[:, :1]]
        rigid = rigid_motions(space.geometry, component, space.vertex_count, mass)
    with watch.step("factorisation and eigenvectors"):
        pairs = lowest_elastic(
            stiffness,
            mass,
            rigid,
            below=audible if modes is None else np.inf,
            at_most=modes or MAX_MODES,
            shift=-min(0.05, audible / 4),
            tolerance=1e-7,
        )
        values = pairs.values
        kept = int(np.count_nonzero(values < audible)) if modes is None else modes
        limit = audible if modes is None else (values[kept - 1] + values[kept]) / 2
    with watch.step("certificate"):
        counted = count_below(stiffness, mass, limit) - rigid.shape[1]
    return Outcome(
        np.sqrt(values[:kept]) * radians / (2 * np.pi),
        stiffness.shape[0],
        watch.cpu_s,
        {"elements": len(solid.tetrahedra), "certificate_holds": counted == kept},
    )
