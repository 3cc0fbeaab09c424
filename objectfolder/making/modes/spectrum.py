"""The audible spectrum of a free solid: eigenpairs, certificate, and the error of the discretisation."""

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import UnsolvableError
from objectfolder.making.elements.curving import GEOMETRY_ORDER, curve
from objectfolder.making.elements.elasticity import ElementMatrices, assemble
from objectfolder.making.elements.sectors import SectorSpace
from objectfolder.making.elements.space import Space
from objectfolder.making.factorisation import SOLVER, Factorisation
from objectfolder.making.modes.eigen import (
    Eigenpairs,
    Pencil,
    count_below,
    low_shift,
    lowest_elastic,
    orthonormalise,
    rigid_motions,
)
from objectfolder.making.modes.inverse_iteration import refine
from objectfolder.making.modes.limits import NO_LIMITS, Limits
from objectfolder.making.solid.solid import Solid
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Number of modes, the last of those wanted, among which a cut is looked for.
CUT_CHOICES = 16
# Eigenvalues have settled when a round of inverse iteration changes none by more: what is still wrong is a
# fiftieth of that, about a thousandth of a cent.
SETTLED, MOST_ROUNDS = 1e-4, 8
# Modes found at the limit have rounds of inverse iteration at a low shift until residuals are below this.
POLISHED, MOST_POLISHING = 1e-4, 4
# Vectors beyond the count at the limit, so that the last modes below it settle as fast as the others.
GUARDS = 8


@dataclass(frozen=True)
class Spectrum:
    """Elastic modes below a limit, dimensionless: lengths in L, eigenvalues eta^2 = (omega L / c_s)^2.

    Attributes
    ----------
    space : finite-element space, positions in units of L, of the highest order in use
    eta_squared : (k,) float64
    vectors : (function, 3, k) float64, of unit mass for density 1
    residuals : (k,) float64, |K u - eta^2 M u| / |eta^2 M u|
    limit : eta^2 below which every mode is here
    certificate : JSON-able
    rigid_eta_squared : largest |u^T K u| of the rigid motions, zero but for rounding
    volume : of the elements, units of L^3
    unknowns : three times the number of functions in use
    error_cents : (k,) estimated errors of the frequencies; empty where nothing is known
    beyond : eta^2 of some modes from the limit on, ascending
    steps : what was solved on the way, JSON-able
    seconds : CPU seconds by step
    """

    space: Space
    eta_squared: Floats
    vectors: Floats
    residuals: Floats
    limit: float
    certificate: dict[str, Any]
    rigid_eta_squared: float
    volume: float
    unknowns: int
    error_cents: Floats = field(default_factory=lambda: np.zeros(0))
    beyond: Floats = field(default_factory=lambda: np.zeros(0))
    steps: list[dict[str, Any]] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Band:
    """What is wanted: eta^2 below a limit, at most `max_modes` modes, cut at one of the last `choices`."""

    below: float
    max_modes: int
    choices: int
    certify: bool
    seed: int

    def cut(self, values: Floats) -> tuple[int, float]:
        """How many of the modes to keep, and a limit that separates them from the next."""
        inside = int(np.count_nonzero(values < self.below))
        most = min(self.max_modes, len(values) - 1) if np.isinf(self.below) else self.max_modes
        if inside <= most:
            return inside, self.below
        choices = np.arange(max(1, most - self.choices + 1), most + 1)
        count = int(choices[int((values[choices] / values[choices - 1]).argmax())])
        return count, float(np.sqrt(values[count - 1] * values[count]))


@dataclass(frozen=True)
class CutModes:
    """The modes kept, the limit below which there are no others, and eigenvalues of some beyond it."""

    pairs: Eigenpairs
    limit: float
    beyond: Floats

    @classmethod
    def of(cls, pairs: Eigenpairs, count: int, limit: float) -> "CutModes":
        """The first `count` of the pairs, and the eigenvalues of the rest."""
        return cls(pairs.first(count), limit, pairs.values[count:])


def space_on(solid: Solid, order: int, length: float, *, bend: bool = False) -> tuple[Space, dict[str, Any]]:
    """Finite-element space of an order on a solid, lengths in units of `length` metres, and how it was bent.

    With `bend`, elements follow the surface the solid was made for; without, or without one, they are
    straight.
    """
    space = Space.on(solid.vertices / length, solid.tetrahedra, order)
    if not bend or solid.target is None or order < GEOMETRY_ORDER:
        return space, {"curved_elements": 0}
    target = Surface(solid.target.vertices / length, solid.target.faces)
    return curve(space, solid.surface.faces, solid.surface.face_normals, target)


def solve_spectrum(
    space: Space,
    component: Integers,
    poisson_ratio: float,
    *,
    below: float,
    max_modes: int,
    seed: int,
    chosen: NDArray[np.bool_] | None = None,
    certify: bool = True,
    cut: bool = True,
    matrices: ElementMatrices | None = None,
    start: Eigenpairs | None = None,
    limits: Limits = NO_LIMITS,
) -> Spectrum:
    """Elastic modes with eta^2 < `below`, or the lowest of them up to `max_modes`, cut in a gap.

    Parameters
    ----------
    component
        (v,) body of each vertex.
    chosen
        (function,) the functions to use; all by default.
    certify, cut
        Count the modes by inertia, and refuse an incomplete set; end at the widest gap among the last few of
        `max_modes`, rather than at exactly that number.
    matrices
        Elements of the space, where a caller has them.
    start
        A solution in fewer functions, as vectors (3 n, k) of those chosen; they are overwritten. One
        factorisation at the limit then gives both the modes, by inverse iteration from these, and their
        count; should the two disagree, the modes are looked for from scratch.
    limits
        Of memory and time.

    Raises
    ------
    SimulationError
        When the inertia count and the modes found differ after a second search from scratch.
    """
    if chosen is None:
        chosen = np.ones(space.size, dtype=bool)
    band = Band(below, max_modes, CUT_CHOICES if cut else 1, certify, seed)
    matrices = matrices or ElementMatrices(space, poisson_ratio)
    pencil, modes, seconds = solve_band(matrices, component, chosen, band, start, limits)
    return _as_spectrum(space, pencil, chosen, modes, certify, seconds)


def solve_band(
    matrices: ElementMatrices,
    component: Integers,
    chosen: NDArray[np.bool_],
    band: "Band",
    start: Eigenpairs | None,
    limits: Limits,
) -> tuple[Pencil, "CutModes", dict[str, float]]:
    """The pencil of the chosen functions, its modes in a band, and CPU seconds; see `solve_spectrum`."""
    started = time.process_time()
    pencil = pencil_of(matrices, component, chosen, limits)
    assembled = time.process_time()
    modes: CutModes | None = None
    if start is not None and band.certify and not pencil.is_small:
        modes = _from_near(pencil, band, start)
    modes = modes or _from_scratch(pencil, band)
    return pencil, modes, {"assemble": assembled - started, "solve": time.process_time() - assembled}


def _as_spectrum(
    space: Space,
    pencil: Pencil,
    chosen: NDArray[np.bool_],
    modes: CutModes,
    certify: bool,
    seconds: dict[str, float],
) -> Spectrum:
    """Modes found in the chosen functions, as fields of the whole space, with what proves them."""
    count, rigid = len(modes.pairs.values), pencil.rigid.shape[1]
    vectors = np.zeros((space.size, 3, count))
    if count:
        vectors[chosen] = _signed(modes.pairs.vectors).reshape(-1, 3, count)
    return Spectrum(
        space,
        modes.pairs.values,
        vectors,
        pencil.residuals(modes.pairs),
        modes.limit,
        {
            "method": f"negative pivots of K - limit M (Sylvester), {SOLVER}" if certify else "none",
            "counted": count + rigid,
            "rigid": rigid,
            "elastic_found": count,
            "holds": certify,
        },
        float(np.abs(np.sum(pencil.rigid * (pencil.stiffness @ pencil.rigid), axis=0)).max()),
        # Corner functions sum to one.
        float(pencil.mass[: space.vertex_count, : space.vertex_count].sum()),
        pencil.size,
        beyond=modes.beyond,
        seconds=seconds,
    )


def _signed(vectors: Floats) -> Floats:
    """Vectors (n, k) of which the largest entry is positive."""
    largest = np.abs(vectors).argmax(axis=0)
    return np.asarray(vectors * np.sign(vectors[largest, np.arange(vectors.shape[1])]))


def pencil_of(
    matrices: ElementMatrices, component: Integers, chosen: NDArray[np.bool_], limits: Limits = NO_LIMITS
) -> Pencil:
    """Stiffness, mass and rigid motions in the chosen functions (function,) of a space.

    `component` (v,) is the body of each vertex.
    """
    space = matrices.space
    stiffness, mass = assemble(space, matrices.poisson_ratio, chosen, matrices)
    if isinstance(space, SectorSpace):
        motions = space.rigid_motions()[chosen]
        motions = motions.reshape(3 * len(motions), -1) if motions.size else np.zeros((3 * len(motions), 0))
        rigid = orthonormalise(motions, mass)[0] if motions.shape[1] else motions
        return Pencil(stiffness, mass, rigid, limits)
    body = np.empty(space.size, dtype=np.int64)
    body[space.numbers] = component[space.tetrahedra[:, :1]]
    rigid = rigid_motions(space.geometry[chosen], body[chosen], space.vertex_count, mass)
    return Pencil(stiffness, mass, rigid, limits)


def _from_near(pencil: Pencil, band: Band, near: Eigenpairs) -> CutModes | None:
    """Modes by inverse iteration at the limit from near-by ones; None where their number is not that counted.

    The limit itself is a good shift: what the vectors lack is of far higher frequency, and no second
    factorisation is needed to count. The count comes first: modes that the fewer functions had above the
    limit start from random vectors, which such a shift draws to them at once. It damps least what lies a
    little above it, which weighs most in the residuals of the lowest modes; a round at a low shift takes
    that away.
    """
    if np.count_nonzero(near.values < band.below) > band.max_modes >= len(near.values):
        return None
    _, shift = band.cut(near.values)
    factors = pencil.factorise(shift, definite=False)
    counted = factors.negative() - pencil.rigid.shape[1]
    lacking = max(counted + GUARDS - len(near.values), 0)
    if lacking > len(near.values) or not np.isfinite(shift):
        return None
    start = near.vectors
    if lacking:
        more = pencil.random(np.random.default_rng(band.seed), lacking)
        start = np.concatenate([start, more], axis=1)
    try:
        pairs, change = refine(
            pencil, factors, shift, start, below=shift, tolerance=SETTLED, rounds=MOST_ROUNDS
        )
    except np.linalg.LinAlgError:
        return None
    inside = int(np.count_nonzero(pairs.values < shift))
    if change > SETTLED or inside != counted:
        return None
    del factors  # their memory, before the next ones
    pairs = _polished(pencil, pairs, band.below)
    count, limit = band.cut(pairs.values)
    if count == inside:
        return CutModes.of(pairs, count, shift)
    return CutModes.of(pairs, count, limit) if count_below(pencil, limit) == count else None


def _polished(pencil: Pencil, pairs: Eigenpairs, below: float) -> Eigenpairs:
    """Pairs after what rounds at a low shift their residuals need.

    A round moves those that need it and those beyond the limit; the others are kept out of it as the rigid
    motions are. A few modes next to the limit need most of the rounds.
    """
    shift = low_shift(below)
    inside = int(np.count_nonzero(pairs.values < below))
    moved = np.ones(len(pairs.values), dtype=bool)
    moved[:inside] = pencil.residuals(pairs.first(inside)) > POLISHED
    factors: Factorisation | None = None
    for _ in range(MOST_POLISHING):
        if not np.any(moved & (pairs.values < below)):
            break
        factors = factors or pencil.factorise(shift, definite=True)
        # Written over the vectors: a copy of all of them is much of the memory.
        rest = replace(pencil, rigid=np.concatenate([pencil.rigid, pairs.vectors[:, ~moved]], axis=1))
        nearer, _ = refine(
            rest, factors, shift, pairs.vectors[:, moved], below=below, tolerance=SETTLED, rounds=1
        )
        del rest
        if len(nearer.values) < np.count_nonzero(moved):
            break  # some became dependent to rounding: a round more would not tell them apart
        values = pairs.values.copy()
        values[moved], pairs.vectors[:, moved] = nearer.values, nearer.vectors
        moved[moved] = (nearer.values >= below) | (pencil.residuals(nearer) > POLISHED)
        order = np.argsort(values, kind="stable")
        if np.any(np.diff(order) < 0):
            pairs.vectors[:], moved = pairs.vectors[:, order], moved[order]
        pairs = Eigenpairs(values[order], pairs.vectors)
    return pairs


def _from_scratch(pencil: Pencil, band: Band) -> CutModes:
    """Modes by Lanczos, sharper and from other vectors where their number is not that counted."""
    for attempt, tolerance in enumerate((1e-7, 1e-11)):
        pairs = lowest_elastic(
            pencil,
            below=band.below,
            at_most=band.max_modes,
            shift=low_shift(band.below),
            tolerance=tolerance,
            seed=band.seed + attempt,
        )
        count, limit = band.cut(pairs.values)
        counted = count_below(pencil, limit) if band.certify else count
        if counted == count:
            return CutModes.of(pairs, count, limit)
    raise UnsolvableError(
        "modes",
        f"inertia counts {counted} elastic modes, {count} were found",
        "Change the frequency limit or the seed.",
    )
