"""The modal sound of an object: from a surface and a material to frequencies, dampings and mode shapes."""

import os
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.air.radiation import radiate
from objectfolder.making.air.radiation_loss import dampings_of, radiation_dampings
from objectfolder.making.air.radiation_product import radiation_arrays
from objectfolder.making.damping import LOSS_FACTOR, damping_of, describe_damping
from objectfolder.making.elements.facing_target import rounding
from objectfolder.making.elements.sectors import Sectors, sectors_of
from objectfolder.making.elements.space import Space
from objectfolder.making.materials import Material
from objectfolder.making.modes.adaptive import Goal, adapt_spectrum
from objectfolder.making.modes.boundary import Boundary
from objectfolder.making.modes.canonical import canonical_rotation
from objectfolder.making.modes.equal_pairs import Axis, with_equal_pairs
from objectfolder.making.modes.limits import Limits
from objectfolder.making.modes.product_arrays import (
    Motion,
    Units,
    shape_arrays,
    spectrum_arrays,
    spectrum_attributes,
)
from objectfolder.making.modes.spectrum import Spectrum, space_on
from objectfolder.making.modes.waves_around import wave_spectrum
from objectfolder.making.solid.bending_waves import BendingWaves
from objectfolder.making.solid.comparison import shape_attributes, volume_error
from objectfolder.making.solid.filling import REVOLVED, Filling, fill
from objectfolder.making.solid.solid import Solid
from objectfolder.products.store import Array, Product
from objectfolder.surface.integrals import solid_properties
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Points at which repeated modes are told apart.
CANONICAL_POINTS = 2000
# Added to the seed for held-out points.
HELD_OUT = 1_000_003
NO_TRANSFER, MULTIPOLE = "none", "multipole"
SOLVED, SPHERE = "solved", "sphere"
# Of the band, unless others are asked for.
MAX_FREQUENCY_HZ, MAX_MODES = 20_000.0, 256
# How far a mode may be off, and what may be spent on it, unless others are asked for.
ACCURACY_CENTS, DEFAULT_ORDER, MAX_UNKNOWNS = 5.0, 5, 180_000
# The error is estimated by comparing with a lower order, of which 2 is the lowest.
ORDERS = range(3, DEFAULT_ORDER + 1)
TIME_LIMIT_S, MEMORY_LIMIT_GB = 600.0, 3.0


def simulate_modes(
    surface: Surface,
    material: Material,
    *,
    wall_m: float | None = None,
    shell_m: float | None = None,
    filling: Filling | None = None,
    name: str = "surface",
    max_frequency_hz: float = MAX_FREQUENCY_HZ,
    max_modes: int = MAX_MODES,
    training_points: int,
    held_out_points: int,
    seed: int = 0,
    accuracy_cents: float = ACCURACY_CENTS,
    highest_order: int = DEFAULT_ORDER,
    max_unknowns: int = MAX_UNKNOWNS,
    time_limit_s: float = TIME_LIMIT_S,
    memory_limit_gb: float = MEMORY_LIMIT_GB,
    transfer: str = NO_TRANSFER,
    damping: str = LOSS_FACTOR,
    radiation: str = SOLVED,
    seconds: dict[str, float] | None = None,
) -> Product:
    """Fill a surface and solve every elastic mode below a frequency.

    Parameters
    ----------
    surface
        Metres, faces outward; need not be closed.
    wall_m, shell_m
        As for `fill`.
    filling
        Resolution of the tetrahedra.
    name
        What errors call the surface.
    max_frequency_hz, max_modes, training_points, held_out_points, seed, accuracy_cents, highest_order
        As for `modes_of_solid`, and so is the product.
    max_unknowns, time_limit_s, memory_limit_gb, transfer, damping, radiation, seconds
        As for `modes_of_solid`.

    Raises
    ------
    ValueError
        `highest_order` is none of 3, 4 and 5, `damping` no law, or `radiation` none of the two.
    InputError
        A material that does not state what Rayleigh's law needs.
    SimulationError
        No solid came of the surface, or the modes found fail the count.

    Examples
    --------
    >>> from pathlib import Path
    >>> from objectfolder.making import read_materials
    >>> from objectfolder.making import load_mesh
    >>> bar, glass = load_mesh(Path("bar.obj")).surface, read_materials("materials.csv")["glass"]
    >>> modes = simulate_modes(bar, glass, max_frequency_hz=5000, training_points=10, held_out_points=2)
    >>> [round(float(hertz), -1) for hertz in modes["frequencies_hz"]]  # a slender beam: 2790
    [2750.0]
    """
    _check_choices(highest_order, radiation)
    damping_of(material, damping)  # refused before anything is filled
    started = _cpu_seconds()
    surface = Surface(surface.vertices, surface.faces)  # normals of a source are made to be seen by
    waves = waves_of(material, max_frequency_hz, max_modes)
    solid = fill(surface, filling, wall_m=wall_m, shell_m=shell_m, waves=waves, name=name)
    if seconds is not None:
        seconds["fill"] = _cpu_seconds() - started
    return modes_of_solid(
        surface, solid, material, max_frequency_hz=max_frequency_hz, max_modes=max_modes,
        training_points=training_points, held_out_points=held_out_points, seed=seed,
        accuracy_cents=accuracy_cents, highest_order=highest_order, max_unknowns=max_unknowns,
        time_limit_s=time_limit_s, memory_limit_gb=memory_limit_gb, transfer=transfer, damping=damping,
        radiation=radiation, seconds=seconds,
    )  # fmt: skip


def waves_of(
    material: Material, max_frequency_hz: float = MAX_FREQUENCY_HZ, max_modes: int = MAX_MODES
) -> BendingWaves:
    """Bending waves that a solid of a material has to carry in a band."""
    plate_speed_m_s = material.shear_speed_m_s * float(np.sqrt(2 / (1 - material.poisson_ratio)))
    return BendingWaves.up_to(max_frequency_hz, plate_speed_m_s, max_modes)


def modes_of_solid(
    surface: Surface,
    solid: Solid,
    material: Material,
    *,
    max_frequency_hz: float = MAX_FREQUENCY_HZ,
    max_modes: int = MAX_MODES,
    training_points: int,
    held_out_points: int,
    seed: int,
    accuracy_cents: float = ACCURACY_CENTS,
    highest_order: int = DEFAULT_ORDER,
    max_unknowns: int = MAX_UNKNOWNS,
    time_limit_s: float = TIME_LIMIT_S,
    memory_limit_gb: float = MEMORY_LIMIT_GB,
    transfer: str = NO_TRANSFER,
    damping: str = LOSS_FACTOR,
    radiation: str = SOLVED,
    seconds: dict[str, float] | None = None,
) -> Product:
    """Elastic modes of a solid, given at points of a surface.

    Parameters
    ----------
    max_frequency_hz
        Upper end of the band. Where more than `max_modes` modes lie in it, the band ends earlier, in a gap
        between two modes: attribute `stated_frequency_limit_hz`.
    training_points, held_out_points
        Points drawn uniformly by area at which the mode shapes are given.
    accuracy_cents
        Largest error allowed of the frequencies against the exact modes of the elements' shape. The functions
        of the elements are chosen by it, within orders 2 to `highest_order` (3 to 5) and `max_unknowns`; what
        was reached is estimated and stored. Order 5 is for less than 5 cents, and for bodies that have at
        most 8,000 functions.
    time_limit_s, memory_limit_gb
        Of solving: CPU seconds, after which it is given up, and 1e9 bytes, of which two thirds may be factors
        and a third blocks of vectors. Where there are many modes, fewer functions are taken to keep to it.
    transfer
        ``multipole``: the way of each mode through the air is solved as well, see
        `objectfolder.making.air.radiation`; ``none``.
    damping
        A law of `objectfolder.making.damping`: ``loss_factor``, or ``rayleigh`` as in the papers. A material
        without a loss factor is damped by Rayleigh's; attribute ``damping`` states the law.
    radiation
        ``solved``: what each mode loses to the air is in its decay, and in ``radiation_dampings_per_s``, see
        `objectfolder.making.air.radiation_loss`; ``sphere``: decays are the material's alone, and a listener
        hears a sphere of the same area.
    seconds
        Filled with the CPU seconds of each step, child processes included.

    Returns
    -------
    Product
        Arrays of `objectfolder.making.modes.product_arrays`. Without a mode below the limit all of
        (mode,) have length 0 and `audible` is false.

    Raises
    ------
    ValueError
        `highest_order` is none of 3, 4 and 5, `damping` no law, or `radiation` none of the two.
    InputError
        A material that does not state what Rayleigh's law needs.
    UnsolvableError
        It takes more memory, or more than `max_unknowns` of order 2, on any machine.
    SimulationError
        It takes more than `time_limit_s`.
    """
    _check_choices(highest_order, radiation)
    decay = damping_of(material, damping)
    started = _cpu_seconds()
    units = Units.of(solid, material)
    space, bent = space_on(solid, highest_order, units.length_m, bend=True)
    bend_s = _cpu_seconds() - started
    below = (2 * np.pi * max_frequency_hz / units.radians_per_s) ** 2
    limits = Limits.from_now(memory_limit_gb, time_limit_s)
    goal = Goal(below, accuracy_cents, max_modes, max_unknowns, seed, limits)
    sectors = _sectors(solid, space, units.length_m)
    if sectors is None:
        spectrum = adapt_spectrum(space, solid.component, material.poisson_ratio, goal)
    else:
        spectrum = wave_spectrum(sectors, material.poisson_ratio, goal)
    reading = _cpu_seconds()
    counts = training_points, held_out_points
    boundary = Boundary(solid, spectrum.space, units.length_m)
    spectrum, split_cents = _with_equal_pairs(spectrum, solid, boundary)
    vectors = _canonical(spectrum, boundary)
    air = _cpu_seconds()
    motion, transferred, described = _in_air(
        (boundary, vectors), units, Motion.of(spectrum, decay, units), transfer, radiation
    )
    air_s = _cpu_seconds() - air
    shapes = boundary, vectors
    arrays, attributes = _read(
        surface, solid, material, motion, spectrum, units, shapes, counts, seed, accuracy_cents
    )
    arrays.update(transferred)
    attributes["damping"] = describe_damping(decay)
    attributes["max_frequency_hz"] = float(max_frequency_hz)
    attributes["discretisation"].update(highest_order=highest_order, **bent)
    if split_cents:
        attributes["equal_pairs"] = {"pairs": len(split_cents), "split_cents_max": max(split_cents)}
    if described:
        attributes["transfer"] = described
    if seconds is not None:
        seconds.update({"bend": bend_s, **spectrum.seconds, "read_shapes": _cpu_seconds() - reading - air_s})
        seconds["air"] = air_s
    return Product(arrays, attributes)


def _check_choices(highest_order: int, radiation: str) -> None:
    if radiation not in (SOLVED, SPHERE):
        raise ValueError(f"radiation {radiation!r}: use {SOLVED} or {SPHERE}")
    if highest_order not in ORDERS:
        raise ValueError(
            f"highest order {highest_order}: an error is estimated with orders {ORDERS[0]} to {ORDERS[-1]}; "
            f"ask for one of them, or for none"
        )


def _read(
    surface: Surface,
    solid: Solid,
    material: Material,
    motion: Motion,
    spectrum: Spectrum,
    units: Units,
    shaped: tuple[Boundary, Floats],
    counts: tuple[int, int],
    seed: int,
    accuracy_cents: float,
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Arrays and attributes, shapes at as many training and held-out points of a surface as `counts` says."""
    samples = [
        surface.sample(count, seed + place) for count, place in zip(counts, (0, HELD_OUT), strict=True)
    ]
    points = np.concatenate([part.points for part in samples])
    normals = np.concatenate([part.normals for part in samples])
    boundary, vectors = shaped
    shapes, distance = boundary.evaluate(vectors, points, solid.report.get("epsilon_m") or 0.0)
    weights = boundary.normal_rms(vectors) / np.sqrt(units.mass_kg)
    volume_m3 = spectrum.volume * units.length_m**3
    wall_m = 2 * volume_m3 / boundary.surface.area
    shape = shape_attributes(solid, volume_m3, distance, wall_m, _rounding(solid))
    arrays = {
        **spectrum_arrays(spectrum, motion, weights),
        **shape_arrays(points, normals, shapes / np.sqrt(units.mass_kg), counts[0]),
    }
    attributes: dict[str, Any] = {
        **spectrum_attributes(spectrum, units, motion.frequencies_hz, accuracy_cents, shape),
        "discretisation": {
            "elements": len(solid.tetrahedra),
            "unknowns": spectrum.unknowns,
            "steps": spectrum.steps,
            **solid.report,
            **volume_error(solid, volume_m3),
        },
        "volume_m3": volume_m3,
        **_rigid(solid, material.density_kg_m3 * volume_m3),
        "effective_wall_thickness_m": wall_m,
        "transfer_distance_max_m": float(distance.max(initial=0.0)),
        "material": material.name,
    }
    return arrays, attributes


def _sectors(solid: Solid, space: Space, length_m: float) -> Sectors | None:
    """Equal sectors of a solid that was filled by turning; None of others."""
    if solid.report.get("way") != REVOLVED or solid.components > 1:
        return None
    axis, count = solid.report["axis"], solid.report["sectors"]
    straight, point = solid.vertices / length_m, np.array(axis["point_m"]) / length_m
    return sectors_of(space, straight, point, np.array(axis["direction"]), count)


def _with_equal_pairs(spectrum: Spectrum, solid: Solid, boundary: Boundary) -> tuple[Spectrum, list[float]]:
    """A spectrum with pairs of one frequency where the solid was filled by turning, and what split them."""
    if solid.report.get("way") != REVOLVED or len(spectrum.eta_squared) < 2:
        return spectrum, []
    axis = solid.report["axis"]
    return with_equal_pairs(spectrum, boundary, Axis(np.array(axis["point_m"]), np.array(axis["direction"])))


def _rounding(solid: Solid) -> tuple[float, float]:
    """Volume, m^3, and mean depth, m, that the triangles of a body of revolution cut off."""
    if solid.target is None or solid.report.get("way") != REVOLVED:
        return 0.0, 0.0
    return rounding(solid.target)


def _in_air(
    shaped: tuple[Boundary, Floats], units: Units, motion: Motion, transfer: str, radiation: str
) -> tuple[Motion, dict[str, Array], dict[str, Any]]:
    """Motion of the modes with what they lose to the air; of their transfer arrays and an attribute."""
    boundary, vectors = shaped
    scaled = vectors / np.sqrt(units.mass_kg)

    def shapes(face: Integers, place: Floats) -> Floats:
        return boundary.at(scaled, face, place)

    arrays: dict[str, Array] = {}
    described: dict[str, Any] = {}
    rates: Floats | None = None
    if transfer == MULTIPOLE:
        solved = radiate(boundary.surface, shapes, motion.frequencies_hz)
        arrays, rates = radiation_arrays(solved), dampings_of(solved)
        described = {"centre_m": solved.centre_m.tolist(), "radius_m": solved.radius_m}
    elif radiation == SOLVED:
        rates = radiation_dampings(boundary.surface, shapes, motion.frequencies_hz)
    if radiation == SOLVED:
        motion = replace(motion, radiation_dampings_per_s=rates)
    return motion, arrays, described


def _rigid(solid: Solid, mass_kg: float) -> dict[str, Any]:
    """Mass, centre and inertia about it of the solid; the latter two are those of straight elements."""
    straight = solid_properties(solid.vertices, solid.surface.faces)
    return {
        "mass_kg": mass_kg,
        "centre_of_mass_m": straight.centre_of_mass_m.tolist(),
        "inertia_kg_m2": (mass_kg / straight.volume_m3 * straight.inertia_per_density_m5).tolist(),
    }


def _cpu_seconds() -> float:
    """Of this process and of those it has ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _canonical(spectrum: Spectrum, boundary: Boundary) -> Floats:
    """Mode shapes (function, 3, modes) in the one basis of each repeated frequency."""
    if len(spectrum.eta_squared) == 0:
        return spectrum.vectors
    samples = boundary.surface.sample(CANONICAL_POINTS, 0)
    shapes = boundary.at(spectrum.vectors, samples.face, samples.barycentric)
    return np.asarray(spectrum.vectors @ canonical_rotation(spectrum.eta_squared, shapes, samples.points))
