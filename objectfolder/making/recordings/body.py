"""A solved body, and how each of its frequencies would move with what a recording may tell of it."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.air.radiation_loss import radiation_dampings
from objectfolder.making.elements.elasticity import chunks, element_integrals, element_stiffness
from objectfolder.making.elements.space import Space
from objectfolder.making.materials import Material
from objectfolder.making.modes.adaptive import Goal, adapt_spectrum
from objectfolder.making.modes.boundary import Boundary
from objectfolder.making.modes.limits import Limits
from objectfolder.making.modes.modes import (
    ACCURACY_CENTS,
    DEFAULT_ORDER,
    MAX_MODES,
    MAX_UNKNOWNS,
    MEMORY_LIMIT_GB,
    TIME_LIMIT_S,
    waves_of,
)
from objectfolder.making.modes.spectrum import Spectrum, space_on
from objectfolder.making.solid.filling import fill
from objectfolder.making.solid.solid import Solid
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
# Of the mean wall, by which the boundary is moved to either side for the derivative by it.
WALL_STEP = 0.005
# Of the normals at a vertex, how far one must be from another to count as a second side.
EDGE_SHARPNESS = 1e-3


@dataclass(frozen=True)
class SolvedBody:
    """Frequencies of a body of a material, and their derivatives.

    Attributes
    ----------
    material : it was solved with
    frequencies_hz : (m,) ascending, undamped
    error_cents : (m,) estimated errors of the solver
    by_poisson : (m,) d ln f / d nu at a constant E / rho
    by_wall : (m,) d ln f / d ln w: the whole boundary moves outward by half of what the mean wall w gains
    limit_hz : below which every mode is here
    volume_m3, wall_m : of the solid; its mean wall is twice its volume over its surface
    solve_s, derivatives_s : CPU seconds
    radiation_dampings_per_s : (m,) decay rates by what each mode radiates; None where they are not known
    """

    material: Material
    frequencies_hz: Floats
    error_cents: Floats
    by_poisson: Floats
    by_wall: Floats
    limit_hz: float
    volume_m3: float
    wall_m: float
    solve_s: float = 0.0
    derivatives_s: float = 0.0
    radiation_dampings_per_s: Floats | None = None


def solve_body(
    surface: Surface,
    material: Material,
    max_frequency_hz: float,
    *,
    wall_m: float | None = None,
    shell_m: float | None = None,
    accuracy_cents: float = ACCURACY_CENTS,
    max_modes: int = MAX_MODES,
    seed: int = 0,
    name: str = "surface",
) -> SolvedBody:
    """Solve the modes of a surface as `objectfolder.making.simulate_modes` does, with derivatives.

    Raises
    ------
    SimulationError
        No solid came of the surface, or its modes were not found.
    """
    started = time.process_time()
    surface = Surface(surface.vertices, surface.faces)
    waves = waves_of(material, max_frequency_hz, max_modes)
    solid = fill(surface, None, wall_m=wall_m, shell_m=shell_m, waves=waves, name=name)
    return body_of_solid(
        solid, material, max_frequency_hz, accuracy_cents=accuracy_cents, max_modes=max_modes, seed=seed,
        started_s=started,
    )  # fmt: skip


def body_of_solid(
    solid: Solid,
    material: Material,
    max_frequency_hz: float,
    *,
    accuracy_cents: float = ACCURACY_CENTS,
    max_modes: int = MAX_MODES,
    seed: int = 0,
    started_s: float | None = None,
) -> SolvedBody:
    """Solve the modes of a solid, with derivatives."""
    started = time.process_time() if started_s is None else started_s
    length = float(np.ptp(solid.vertices, axis=0).max())
    to_hz = material.shear_speed_m_s / length / (2 * np.pi)
    space, _ = space_on(solid, DEFAULT_ORDER, length, bend=True)
    limits = Limits.from_now(MEMORY_LIMIT_GB, TIME_LIMIT_S)
    below = (max_frequency_hz / to_hz) ** 2
    request = Goal(below, accuracy_cents, max_modes, MAX_UNKNOWNS, seed, limits)
    spectrum = adapt_spectrum(space, solid.component, material.poisson_ratio, request)
    solved = time.process_time()
    wall = 2 * spectrum.volume / (solid.surface.area / length**2)
    errors = spectrum.error_cents if len(spectrum.error_cents) else np.zeros(len(spectrum.eta_squared))
    by_poisson = _by_poisson(spectrum, material.poisson_ratio)
    by_wall = _by_wall(spectrum, material.poisson_ratio, solid.surface, wall)
    frequencies = np.sqrt(spectrum.eta_squared) * to_hz
    outside = Boundary(solid, spectrum.space, length)
    shapes = spectrum.vectors / np.sqrt(material.density_kg_m3 * length**3)
    rates = radiation_dampings(
        outside.surface, lambda face, place: outside.at(shapes, face, place), frequencies
    )
    return SolvedBody(
        material=material,
        frequencies_hz=frequencies,
        error_cents=errors,
        by_poisson=by_poisson,
        by_wall=by_wall,
        limit_hz=float(np.sqrt(spectrum.limit) * to_hz),
        volume_m3=spectrum.volume * length**3,
        wall_m=wall * length,
        solve_s=solved - started,
        derivatives_s=time.process_time() - solved,
        radiation_dampings_per_s=rates,
    )


def _by_poisson(spectrum: Spectrum, poisson_ratio: float) -> Floats:
    """d ln f / d nu at a constant E / rho, from the modes' energies.

    With eta^2 = u^T (lambda' A + B) u for unit mass the derivative by lambda' = 2 nu / (1 - 2 nu) is u^T A u,
    and the square of the shear speed is E / (2 (1 + nu) rho). Two Poisson ratios give A.
    """
    second_ratio = poisson_ratio - 0.05
    lame = [2 * ratio / (1 - 2 * ratio) for ratio in (poisson_ratio, second_ratio)]
    energies = _quotients(spectrum.space, spectrum.vectors, (poisson_ratio, second_ratio))
    by_lame = (energies[0] - energies[1]) / (lame[0] - lame[1])
    return np.asarray(
        0.5 * (by_lame / spectrum.eta_squared * 2 / (1 - 2 * poisson_ratio) ** 2 - 1 / (1 + poisson_ratio))
    )


def _by_wall(spectrum: Spectrum, poisson_ratio: float, boundary: Surface, wall: float) -> Floats:
    """d ln f / d ln wall, from Rayleigh quotients of the same fields on bodies with moved boundaries.

    A quotient is stationary at a mode: that the mode changes too is of second order. `wall` is in units
    of the space.
    """
    space = spectrum.space
    outward = np.zeros((space.size, 3))
    outward[: len(boundary.vertices)] = _offsets(boundary)
    step = WALL_STEP * wall / 2
    thick, thin = (
        _quotients(space.shaped(space.geometry + side * step * outward), spectrum.vectors, (poisson_ratio,))[
            0
        ]
        for side in (1, -1)
    )
    return np.asarray((thick - thin) / (4 * WALL_STEP * spectrum.eta_squared))


def _offsets(boundary: Surface) -> Floats:
    """Motions (v, 3) of vertices that move every face outward by 1, at edges too: the nearest to it."""
    normals = boundary.face_normals
    outer = boundary.face_areas[:, None, None] * normals[:, :, None] * normals[:, None, :]
    sides, aims = np.zeros((len(boundary.vertices), 3, 3)), np.zeros((len(boundary.vertices), 3))
    for corner in range(3):
        np.add.at(sides, boundary.faces[:, corner], outer)
        np.add.at(aims, boundary.faces[:, corner], boundary.face_areas[:, None] * normals)
    size = np.trace(sides, axis1=1, axis2=2)
    sides += (EDGE_SHARPNESS * size + (size == 0))[:, None, None] * np.eye(3)  # inner vertices stay
    return np.asarray(np.linalg.solve(sides, aims[:, :, None])[:, :, 0])


def _quotients(space: Space, vectors: Floats, poisson_ratios: tuple[float, ...]) -> list[Floats]:
    """Rayleigh quotients (k,) of fields (function, 3, k) for each of some Poisson ratios."""
    count = vectors.shape[-1]
    energy, mass = np.zeros((len(poisson_ratios), count)), np.zeros(count)
    for elements in chunks(space):
        cross, masses = element_integrals(space, elements)
        own = vectors[space.numbers[elements]]
        flat = own.reshape(len(elements), -1, count)
        for row, ratio in enumerate(poisson_ratios):
            blocks = element_stiffness(cross, ratio).transpose(0, 1, 3, 2, 4)
            energy[row] += (flat * (blocks.reshape(*flat.shape[:2], -1) @ flat)).sum(axis=(0, 1))
        wide = own.reshape(*own.shape[:2], -1)
        mass += (wide * (masses @ wide)).reshape(*own.shape).sum(axis=(0, 1, 2))
    return list(energy / mass)
