"""The audible spectrum of a free solid: eigenpairs, certificate, and the error of the discretisation."""

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from objectfolder.audio.elements.curving import GEOMETRY_ORDER, curve
from objectfolder.audio.elements.elasticity import ElementMatrices, assemble
from objectfolder.audio.elements.space import Space
from objectfolder.audio.factorisation import SOLVER, Factorisation
from objectfolder.audio.modes.adaptive import choose, remaining_cents, summary
from objectfolder.audio.modes.eigen import DENSE, count_below, lowest_elastic, rigid_motions, shifted
from objectfolder.audio.modes.subspace import refine, weigh
from objectfolder.errors import SimulationError
from objectfolder.solid.solid import Solid
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Number of modes, the last of those wanted, among which a cut is looked for.
CUT_CHOICES = 16
# Eigenvalues have settled when a round of inverse iteration changes none by more. What is left is a fiftieth
# of that, about a thousandth of a cent.
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
    error_cents : (at most 100,) estimated errors of the first frequencies; empty where nothing is known
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
    steps: list[dict[str, Any]] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)


def space_on(solid: Solid, order: int, length: float, *, bend: bool = False) -> tuple[Space, dict[str, Any]]:
    """Finite-element space of an order on a solid, lengths in units of `length` metres, and how it was bent.

    With `bend`, elements follow the surface the solid was made for; without, or without one, they are
    straight.
    """
    space = Space.on(solid.vertices / length, solid.tetrahedra, order)
    if not bend or solid.target is None or order < GEOMETRY_ORDER:
        return space, {"curved_elements": 0}
    faces, _, _ = solid.boundary()
    normals = Surface(solid.vertices, faces).face_normals
    target = Surface(solid.target.vertices / length, solid.target.faces)
    return curve(space, faces, normals, target)


def bodies_of_functions(space: Space, component: Integers) -> Integers:
    """Body of each function, (function,), from the body of each vertex."""
    result = np.empty(space.size, dtype=np.int64)
    result[space.numbers] = component[space.tetrahedra[:, :1]]
    return result


def adapt_spectrum(
    space: Space,
    component: Integers,
    poisson_ratio: float,
    *,
    below: float,
    accuracy_cents: float,
    max_modes: int,
    max_unknowns: int,
    seed: int,
) -> Spectrum:
    """Elastic modes with eta^2 < `below` to an accuracy, in the functions of a space that this needs.

    Parameters
    ----------
    space
        Of the highest order to be used.
    component
        (v,) body of each vertex.
    accuracy_cents
        Wanted largest error of the first 100 frequencies. What was reached stands in `error_cents`.
    max_modes, seed
        As for `solve_spectrum`.
    max_unknowns
        Of the last solution.

    Raises
    ------
    SimulationError
        When the inertia count and the modes found differ after a second search.
    """
    started = time.process_time()
    choice = choose(
        space,
        bodies_of_functions(space, component),
        poisson_ratio,
        below=below,
        accuracy_cents=accuracy_cents,
        max_modes=max_modes,
        max_unknowns=max_unknowns,
        seed=seed,
    )
    chose = time.process_time() - started
    found = solve_spectrum(
        choice.matrices.space,
        component,
        poisson_ratio,
        below=below,
        max_modes=max_modes,
        seed=seed,
        chosen=choice.chosen,
        matrices=choice.matrices,
        start=choice.start,
        expected=choice.expected,
    )
    return Spectrum(
        **{
            **vars(found),
            "error_cents": remaining_cents(choice, found.eta_squared),
            "steps": summary(choice),
            "seconds": {"choose_functions": chose, **found.seconds},
        }
    )


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
    start: tuple[Floats, Floats] | None = None,
    expected: float = 0.0,
) -> Spectrum:
    """Elastic modes with eta^2 < `below`, or the lowest of them up to `max_modes`, cut in a gap.

    Parameters
    ----------
    component
        (v,) body of each vertex.
    chosen
        (function,) the functions to use; all by default.
    certify
        Count the modes by inertia, and refuse an incomplete set.
    cut
        Where more than `max_modes` modes are wanted, end in the widest gap among the last few of them,
        rather than at exactly that number.
    matrices
        Elements of the space, where a caller has them.
    start
        Eigenvalues (k,) and vectors (function, 3, k) of a solution in fewer functions. One factorisation at
        the limit then gives both the modes, by inverse iteration from these, and their count; should the two
        disagree, the modes are looked for from scratch.
    expected
        Relative amount by which the eigenvalues of `start` are expected to fall.

    Raises
    ------
    SimulationError
        When the inertia count and the modes found differ after a second search from scratch.
    """
    clock = [time.process_time()]
    if chosen is None:
        chosen = np.ones(space.size, dtype=bool)
    stiffness, mass = assemble(space, poisson_ratio, chosen, matrices)
    clock.append(time.process_time())
    of_function = bodies_of_functions(space, component)[chosen]
    rigid = rigid_motions(space.geometry[chosen], of_function, space.vertex_count, mass)
    stiff_rigid = stiffness @ rigid
    spent = {"assemble": clock[1] - clock[0], "eigenvalues": 0.0, "count": 0.0}
    tried = CUT_CHOICES if cut else 1
    found: _Found | None = None
    if start is not None and certify and stiffness.shape[0] > DENSE:
        before = time.process_time()
        near = start[1][chosen].reshape(stiffness.shape[0], -1)
        near_values = start[0] * (1 - expected)
        found = _from_near(stiffness, mass, rigid, near_values, near, below, max_modes, tried, seed)
        spent["eigenvalues"] += time.process_time() - before
    for attempt, tolerance in enumerate((1e-7, 1e-11)):
        if found is not None and found.counted == found.kept + rigid.shape[1]:
            break
        before = time.process_time()
        pairs = lowest_elastic(
            stiffness,
            mass,
            rigid,
            below=below,
            at_most=max_modes,
            shift=_low_shift(below),
            tolerance=tolerance,
            seed=seed + attempt,
        )
        spent["eigenvalues"] += time.process_time() - before
        kept, limit = _cut(pairs.values, below, max_modes, tried)
        before = time.process_time()
        counted = count_below(stiffness, mass, limit) if certify else kept + rigid.shape[1]
        spent["count"] += time.process_time() - before
        found = _Found(pairs.values, pairs.vectors, kept, limit, counted)
    if found is None or found.counted != found.kept + rigid.shape[1]:
        counted = 0 if found is None else found.counted
        raise SimulationError(
            "modes",
            f"inertia counts {counted - rigid.shape[1]} elastic modes, {kept} were found",
            "Change the frequency limit or the seed.",
        )
    kept, limit, counted = found.kept, found.limit, found.counted
    values, vectors = found.values[:kept], found.vectors[:, :kept]
    residuals = _residuals(stiffness, mass, values, vectors)
    largest = np.abs(vectors).argmax(axis=0)
    whole = np.zeros((space.size, 3, kept))
    whole[chosen] = (vectors * np.sign(vectors[largest, np.arange(kept)])).reshape(int(chosen.sum()), 3, kept)
    certificate = {
        "method": f"negative pivots of K - limit M (Sylvester), {SOLVER}" if certify else "none",
        "counted": int(counted),
        "rigid": int(rigid.shape[1]),
        "elastic_found": int(kept),
        "holds": bool(certify),
    }
    return Spectrum(
        space,
        values,
        whole,
        residuals,
        limit,
        certificate,
        float(np.abs(np.sum(rigid * stiff_rigid, axis=0)).max()),
        # Corner functions sum to one.
        float(mass[: space.vertex_count, : space.vertex_count].sum()),
        3 * int(chosen.sum()),
        seconds=spent,
    )


@dataclass(frozen=True)
class _Found:
    """Eigenvalues (k,) and vectors (3 n, k), how many are kept, the limit above them, and the count there."""

    values: Floats
    vectors: Floats
    kept: int
    limit: float
    counted: int


def _from_near(
    stiffness: sparse.csr_matrix,
    mass: sparse.csr_matrix,
    rigid: Floats,
    near_values: Floats,
    near: Floats,
    below: float,
    max_modes: int,
    tried: int,
    seed: int,
) -> _Found | None:
    """Modes by inverse iteration at the limit from near-by ones (3 n, k); None where that did not settle.

    The limit itself is a good shift: what the vectors lack is of far higher frequency, and no second
    factorisation is needed to count. The count comes first: modes that the fewer functions had above the
    limit start from random vectors, which such a shift draws to them at once. It damps least what lies a
    little above it, which weighs most in the residuals of the lowest modes; a round at a low shift takes
    that away.
    """
    if np.count_nonzero(near_values < below) > max_modes >= len(near_values):
        return None
    _, shift = _cut(near_values, below, max_modes, tried)
    if not np.isfinite(shift):
        return None
    factors = Factorisation(shifted(stiffness, mass, shift), definite=False)
    counted = factors.negative()
    lacking = counted - rigid.shape[1] + GUARDS - near.shape[1]
    if lacking > near.shape[1]:
        return None
    if lacking > 0:
        more = np.random.default_rng(seed).standard_normal((near.shape[0], lacking))
        near = np.concatenate([near, more], axis=1)
    try:
        values, vectors, change = refine(
            factors, shift, mass, rigid, near, below=shift, tolerance=SETTLED, rounds=MOST_ROUNDS
        )
    except np.linalg.LinAlgError:
        return None
    inside = int(np.count_nonzero(values < shift))
    if change > SETTLED or inside + rigid.shape[1] != counted:
        return None
    if np.count_nonzero(values < below) > max_modes >= len(values):
        return None
    values, vectors = _polished(stiffness, mass, rigid, values, vectors, below)
    kept, limit = _cut(values, below, max_modes, tried)
    if kept == inside:
        return _Found(values, vectors, kept, shift, counted)
    return _Found(values, vectors, kept, limit, count_below(stiffness, mass, limit))


def _polished(
    stiffness: sparse.csr_matrix,
    mass: sparse.csr_matrix,
    rigid: Floats,
    values: Floats,
    vectors: Floats,
    below: float,
) -> tuple[Floats, Floats]:
    """Eigenvalues (k,) and vectors (3 n, k) after what rounds at a low shift their residuals need."""
    factors: Factorisation | None = None
    shift = _low_shift(below)
    for _ in range(MOST_POLISHING):
        if _residuals(stiffness, mass, values, vectors)[values < below].max(initial=0.0) <= POLISHED:
            break
        if factors is None:
            factors = Factorisation(shifted(stiffness, mass, shift), definite=True)
        values, vectors, _ = refine(
            factors, shift, mass, rigid, vectors, below=below, tolerance=SETTLED, rounds=1
        )
    return values, vectors


def _low_shift(below: float) -> float:
    """Negative and small: what is far above it is damped most, and K - shift M is definite."""
    return -min(0.05, below / 4)


def _residuals(
    stiffness: sparse.csr_matrix, mass: sparse.csr_matrix, values: Floats, vectors: Floats
) -> Floats:
    """|K u - lambda M u| / |lambda M u|, (k,)."""
    inertia = weigh(mass, vectors) * values
    return np.asarray(np.linalg.norm(stiffness @ vectors - inertia, axis=0) / np.linalg.norm(inertia, axis=0))


def _cut(values: Floats, below: float, max_modes: int, tried: int) -> tuple[int, float]:
    """How many of the modes to keep, and a limit that separates them from the next."""
    inside = int(np.count_nonzero(values < below))
    max_modes = min(max_modes, len(values) - 1) if np.isinf(below) else max_modes
    if inside <= max_modes:
        return inside, below
    choices = np.arange(max(1, max_modes - tried + 1), max_modes + 1)
    ratio = values[choices] / values[choices - 1]
    kept = int(choices[int(ratio.argmax())])
    return kept, float(np.sqrt(values[kept - 1] * values[kept]))
