"""Modes to a wanted accuracy: where in a body functions of higher order are needed, and what error is left.

From the modes of order 2 the gain of each function left out is estimated, elements where they matter are
raised to order 3, and so on upwards. The estimates leave out how functions act together; what a step gained
in truth over what was foretold sets that right for the next.

On a bowl order 3 everywhere takes 3.8 CPU-s for a worst error of 30 cents, this choice 9.2 for 3.4; on a
plate order 3 misses 3 of 82 modes. Order 4 everywhere takes 1.4 times the CPU seconds of this choice on a
scanned spoon and 0.9 to 1.2 times on a scanned mug, with 1.1 and 0.7 times the memory, and has the same worst
errors to two cents. On bodies of revolution it takes 1.0 to 1.3 times and is two to four times nearer.
"""

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import UnsolvableError
from objectfolder.making.elements.curving import GEOMETRY_ORDER
from objectfolder.making.elements.elasticity import ElementMatrices, gains_of_more_functions, most_useful
from objectfolder.making.elements.space import Space
from objectfolder.making.modes.eigen import Eigenpairs, Pencil, count_below, low_shift, lowest_elastic
from objectfolder.making.modes.inverse_iteration import improve
from objectfolder.making.modes.limits import NO_LIMITS, Limits
from objectfolder.making.modes.spectrum import Spectrum, pencil_of, solve_spectrum

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Chosen = NDArray[np.bool_]
# Modes at most that lead the choice: where there are more, this number of them, evenly spread over the band.
LEADING_MODES = 100
# A higher order than the usual one takes 1.5 times as long on thin walls. It is for bodies of few functions,
# and where more than the usual accuracy is asked for.
USUAL_ORDER, FEW_FUNCTIONS, USUAL_CENTS = 4, 8_000, 5.0
# It is also for bodies that gain more than these cents by the usual order, unless they have more functions of
# it than these. On elements of half a bending wave, as a solid has them by default, few bodies gain as much.
MUCH_GAINED_CENTS, MOST_FUNCTIONS = 50.0, 30_000
# What a group of functions gains together over the sum of what each would gain alone, before it is measured.
GROUP_GAIN_RATIO = 2.5
CENTS_PER_RELATIVE_EIGENVALUE = 600 / np.log(2)
# Modes of a step start from those of the last one; some beyond those wanted keep the last of them clean. They
# are looked for as far as `GUARD_BAND` times the limit: in thin walls eigenvalues of order 2 are too high,
# and a mode without a start takes several rounds of all. Later steps keep those below `START_BAND` times it.
GUARD_MODES, GUARD_SHARE, GUARD_BAND, START_BAND = 16, 0.1, 2.0, 1.3
# Modes of order 2, for a start only, need not be found more sharply than this (see `lowest_elastic`).
START_TOLERANCE = 1e-3
# Compact solids may have no mode below such a limit of eta^2 (a cube's first has 8.2) and are counted first.
# In the thinnest walls that one layer of elements carries, frequencies of order 2 were up to 50 % high,
# eigenvalues 2.25 times. Bodies without a mode of order 2 below twice that times the limit are silent. For
# others the first modes of orders 2 and 3 decide.
COMPACT_LIMIT, HEARD_BAND, FIRST_MODES = 9.0, 4.5, 4
# What sharp edges leave falls like p^-3 with the order p, the slowest fall seen. Where that would be more
# than these cents, a mode fell by its inside, of which the next orders take off nearly all: this share of the
# fall is left. Chosen on fourteen bodies, see `docs/modes.md`.
EDGE_RATE, EDGE_CENTS, INSIDE_SHARE = 3.0, 2.5, 0.07
# Share of the wanted error left to the functions of one order that are not taken.
SHARE_LEFT = 0.7
# Elements beside those of lower order gain less than among their like: seen on bars, plates and scans.
BESIDE_LOWER = 2.8


@dataclass(frozen=True)
class Goal:
    """What is asked of a spectrum.

    Attributes
    ----------
    below : limit of eta^2
    accuracy_cents : largest error of the frequencies
    max_modes : number of modes at most
    max_unknowns : of the last solution; where more would be needed, the most useful ones are taken
    seed : of random starts
    limits : of memory and time
    guard_modes : modes beyond those wanted that are taken along, at least
    """

    below: float
    accuracy_cents: float
    max_modes: int
    max_unknowns: int
    seed: int
    limits: Limits = NO_LIMITS
    guard_modes: int = GUARD_MODES

    def most_functions(self, modes: int) -> int:
        """Functions at most: of `max_unknowns`, and of four blocks of as many modes in memory."""
        return int(min(self.max_unknowns, self.limits.vector_values / (4 * modes))) // 3


@dataclass(frozen=True)
class Choice:
    """Functions chosen, and the way there.

    Attributes
    ----------
    matrices : elements of the space of the highest order in use
    chosen : (function,) bool, of that space
    order : highest order in use
    ladder : eigenvalues (k,) of each solution on the way by ascending order
    functions : number of functions of each of them
    pairs : the last of them in the chosen functions, some beyond those wanted; None where nothing was solved
    leading : (l,) the modes that functions were weighed for last, ascending
    foretold : (l,) their relative gains by the functions added last, each for itself
    omission_cents : (l,) their estimated gain by the functions that were weighed and left out
    together : what functions gained together over the sum of what each was to gain alone
    """

    matrices: ElementMatrices
    chosen: Chosen
    order: int
    ladder: list[Floats] = field(default_factory=list)
    functions: list[int] = field(default_factory=list)
    pairs: Eigenpairs | None = None
    leading: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    foretold: Floats = field(default_factory=lambda: np.zeros(0))
    omission_cents: Floats = field(default_factory=lambda: np.zeros(0))
    together: float = GROUP_GAIN_RATIO


def adapt_spectrum(space: Space, component: Integers, poisson_ratio: float, goal: Goal) -> Spectrum:
    """Elastic modes below a limit to an accuracy, in the functions of a space that this needs.

    Parameters
    ----------
    space
        Of the highest order to be used, bent or straight.
    component
        (v,) body of each vertex.
    goal
        What was reached of its accuracy stands in `error_cents`.

    Raises
    ------
    UnsolvableError
        More unknowns of order 2, or more memory, than the limits; or the inertia count and the modes found
        differ after a second search.
    SimulationError
        The time is over.
    """
    started = time.process_time()
    choice = _choose(space, component, poisson_ratio, goal)
    chose = time.process_time() - started
    spectrum = solve_spectrum(
        choice.matrices.space,
        component,
        poisson_ratio,
        below=goal.below,
        max_modes=goal.max_modes,
        seed=goal.seed,
        chosen=choice.chosen,
        matrices=choice.matrices,
        start=choice.pairs,
        limits=goal.limits,
    )
    return replace(
        spectrum,
        error_cents=remaining_cents(choice, spectrum.eta_squared),
        steps=[
            {"order": GEOMETRY_ORDER + index, "functions": count}
            for index, count in enumerate(choice.functions)
        ],
        seconds={"choose_functions": chose, **spectrum.seconds},
    )


def _choose(space: Space, component: Integers, poisson_ratio: float, goal: Goal) -> Choice:
    """Choose the functions of a space that modes need for an accuracy."""
    choice = first_choice(space, poisson_ratio, goal)
    if goal.below < COMPACT_LIMIT:
        pencil = pencil_of(choice.matrices, component, choice.chosen, goal.limits)
        if count_below(pencil, goal.below) == 0:
            if _is_silent(choice, pencil, _usual(space, goal)[0], component, goal):
                return choice
            largest = _largest(_up_to(space, min(USUAL_ORDER, space.order)), goal.max_unknowns // 3)
            matrices = ElementMatrices(largest, poisson_ratio)
            return Choice(matrices, np.ones(matrices.space.size, dtype=bool), matrices.space.order)
    return climb(solved(choice, component, goal), space, component, goal)


def first_choice(space: Space, poisson_ratio: float, goal: Goal) -> Choice:
    """All functions of order 2, nothing solved yet.

    Raises
    ------
    UnsolvableError
        They have more unknowns than there may be.
    """
    order = min(GEOMETRY_ORDER, space.order)
    refuse_many(space, order, goal)
    matrices = ElementMatrices(_up_to(space, order), poisson_ratio)
    chosen = matrices.space.orders <= order
    chosen |= np.any(matrices.space.geometry != 0, axis=1)  # else rotations would cost energy
    return Choice(matrices, chosen, order)


def _usual(space: Space, goal: Goal) -> tuple[Space, bool]:
    """The functions that are chosen from at first, and whether those of the highest order are few enough."""
    usual = _up_to(space, min(USUAL_ORDER, space.order))
    few = usual.size <= MOST_FUNCTIONS
    return (usual if space.size > FEW_FUNCTIONS and goal.accuracy_cents >= USUAL_CENTS else space), few


def climb(choice: Choice, space: Space, component: Integers, goal: Goal) -> Choice:
    """A choice that is solved, with functions of higher orders as far as modes need them."""
    highest, (space, few) = space, _usual(space, goal)
    while True:
        if choice.order == space.order or len(choice.ladder[-1]) == 0:
            return choice
        before, choice = choice.order, _enriched(choice, space, goal)
        gained_cents = CENTS_PER_RELATIVE_EIGENVALUE * choice.together * choice.foretold
        if choice.order == space.order and few and gained_cents.max(initial=0.0) > MUCH_GAINED_CENTS:
            space = highest
        if choice.order in (before, space.order):
            return choice
        choice = solved(choice, component, goal)


def refuse_many(space: Space, order: int, goal: Goal) -> None:
    """Raise `UnsolvableError` where the lowest order alone has more functions than there may be."""
    unknowns = 3 * int(np.count_nonzero(space.orders <= order))
    if unknowns > goal.max_unknowns:
        raise UnsolvableError(
            "modes",
            f"{len(space.tetrahedra)} elements have {unknowns} unknowns of order {order}, more than "
            f"max_unknowns {goal.max_unknowns}",
            "Simplify the surface, or leave out its small parts",
        )


def _is_silent(choice: Choice, pencil: Pencil, space: Space, component: Integers, goal: Goal) -> bool:
    """Whether no function of a higher order can bring a mode below the limit, where order 2 has none.

    The first eigenvalue of order 3 is farther above the limit than it fell from order 2: what higher orders
    take off is less than that, for the error of order 3 is at most half of that of order 2.
    """
    if count_below(pencil, HEARD_BAND * goal.below) == 0:
        return True
    shift = low_shift(goal.below)
    low = lowest_elastic(
        pencil, below=np.inf, at_most=FIRST_MODES, shift=shift, tolerance=START_TOLERANCE, seed=goal.seed
    )
    matrices = ElementMatrices(_up_to(space, choice.order + 1), choice.matrices.poisson_ratio)
    every = np.ones(matrices.space.size, dtype=bool)
    upper = pencil_of(matrices, component, every, goal.limits)
    start = widened(low.vectors, _among_more(choice.chosen, matrices.space))
    high = improve(upper, start, shift=shift)
    return bool(2 * high.values[0] - low.values[0] > goal.below)


def solved(choice: Choice, component: Integers, goal: Goal) -> Choice:
    """The choice with its modes: those below the limit and some beyond, nearly.

    From the vectors of fewer functions as many as these; else those looked for from scratch.
    """
    pencil = pencil_of(choice.matrices, component, choice.chosen, goal.limits)
    shift = low_shift(goal.below)
    if choice.pairs is not None:
        pairs = improve(pencil, choice.pairs.vectors, shift=shift)
        band = START_BAND
    else:
        band = GUARD_BAND
        pairs = lowest_elastic(
            pencil,
            below=GUARD_BAND * goal.below,
            at_most=goal.max_modes + _guard(goal.max_modes, goal),
            shift=shift,
            tolerance=START_TOLERANCE,
            seed=goal.seed,
        )
    inside = min(int(np.count_nonzero(pairs.values < band * goal.below)), goal.max_modes)
    pairs = pairs.first(min(len(pairs.values), inside + _guard(inside, goal)))
    together = choice.together
    if choice.ladder:
        together = _measured_together(choice, pairs.values, goal.below)
    return replace(
        choice,
        ladder=[*choice.ladder, pairs.values],
        functions=[*choice.functions, int(choice.chosen.sum())],
        pairs=pairs,
        together=together,
    )


def _enriched(choice: Choice, space: Space, goal: Goal) -> Choice:
    """The choice with the functions of the next order that audible modes need for the accuracy.

    The same functions where they need none.
    """
    eigenvalues, pairs = choice.ladder[-1], choice.pairs
    assert pairs is not None
    # Those above the limit too: with more functions they may come to lie below it.
    near = max(int(np.count_nonzero(eigenvalues < START_BAND * goal.below)), 1)
    leading = np.unique(np.linspace(0, near - 1, min(near, LEADING_MODES)).round().astype(np.int64))
    values = eigenvalues[leading]
    upper = ElementMatrices(_up_to(space, choice.order + 1), choice.matrices.poisson_ratio)
    before = _among_more(choice.chosen, upper.space)
    first = widened(pairs.vectors[:, leading], before).reshape(-1, 3, len(values))
    used = before.copy()
    gains = gains_of_more_functions(upper, used, first, values) / values
    heard = values * (1 - np.minimum(choice.together * gains.sum(axis=0), 0.9)) < goal.below
    cents = CENTS_PER_RELATIVE_EIGENVALUE * choice.together * BESIDE_LOWER
    additions = np.zeros(0, dtype=np.int64)
    if heard.any():
        room = goal.most_functions(pairs.vectors.shape[1]) - int(used.sum())
        allowed = SHARE_LEFT * goal.accuracy_cents / cents
        additions = most_useful(upper.space, gains[:, heard], used, allowed, room)
    foretold = gains[additions].sum(axis=0)
    omission_cents = cents * (gains.sum(axis=0) - foretold)
    choice = replace(choice, leading=leading, foretold=foretold, omission_cents=omission_cents)
    if len(additions) == 0:
        return choice
    used[additions] = True
    return replace(
        choice,
        matrices=upper,
        chosen=used,
        order=choice.order + 1,
        pairs=Eigenpairs(eigenvalues, widened(pairs.vectors, before[used])),
    )


def _measured_together(choice: Choice, after: Floats, below: float) -> float:
    """What functions gained together over what they were to gain alone, for modes below the limit."""
    before = choice.ladder[-1][choice.leading]
    shared = choice.leading < len(after)
    shared &= before < max(below, before[0] * (1 + 1e-9))
    gained = 1 - after[choice.leading[shared]] / before[shared]
    return float(np.clip(np.median(gained) / max(np.median(choice.foretold[shared]), 1e-300), 1.0, 10.0))


def _largest(space: Space, functions: int) -> Space:
    """All functions of the highest order that has at most a number of them; of order 2 at least."""
    order = space.order
    while order > GEOMETRY_ORDER and int(np.count_nonzero(space.orders <= order)) > functions:
        order -= 1
    return _up_to(space, order)


def _guard(modes: int, goal: Goal) -> int:
    """How many modes beyond those wanted are taken along."""
    return max(goal.guard_modes, int(GUARD_SHARE * modes))


def _up_to(space: Space, order: int) -> Space:
    """Space of a lower order, which still holds the shape of the elements."""
    lower = max(order, GEOMETRY_ORDER)
    return space if lower >= space.order else space.up_to(lower)


def _among_more(chosen: Chosen, space: Space) -> Chosen:
    """Functions chosen of the leading ones of a space, (function,) of all of them."""
    return np.concatenate([chosen, np.zeros(space.size - len(chosen), dtype=bool)])


def widened(vectors: Floats, among: Chosen) -> Floats:
    """Vectors (3 n, k) of the functions that are true `among` others (m,), zero in the others, (3 m, k)."""
    result = np.zeros((len(among), 3, vectors.shape[1]), vectors.dtype)
    result[among] = vectors.reshape(-1, 3, vectors.shape[1])
    return result.reshape(3 * len(among), -1)


def remaining_cents(choice: Choice, eta_squared: Floats) -> Floats:
    """Estimated frequency error of each mode, cents, (k,): what was left out or what is to come, if more.

    Each alone covers nearly all errors, and their sum is more than is needed. Of functions left out the
    larger of what the next leading modes on either side lack. Modes that the solution before had not are as
    wrong as the worst.
    """
    if not choice.ladder:
        return np.zeros(0)
    modes = np.arange(min(len(choice.ladder[-1]), len(eta_squared)))
    if len(modes) == 0:
        return np.zeros(0)
    omission_cents = np.zeros(len(modes))
    if len(choice.leading):
        above = np.minimum(np.searchsorted(choice.leading, modes), len(choice.leading) - 1)
        below = np.maximum(np.searchsorted(choice.leading, modes, side="right") - 1, 0)
        omission_cents = np.maximum(choice.omission_cents[above], choice.omission_cents[below])
    drops = np.maximum(choice.ladder[-1][modes] / eta_squared[modes] - 1, 0)
    to_come = what_is_to_come(CENTS_PER_RELATIVE_EIGENVALUE * drops, GEOMETRY_ORDER + len(choice.ladder))
    likely = np.maximum(omission_cents, to_come)
    cents = np.full(len(eta_squared), likely.max())
    cents[modes] = likely
    return cents


def what_is_to_come(drops_cents: Floats, order: int) -> Floats:
    """How many cents frequencies (k,) that fell by `drops_cents` with the last step to `order` are too high.

    Where edges are sharp the error falls as C p^-s with the order p (I. Babuska and M. Suri, SIAM Review 36,
    1994). The drop to order p is then C ((p - 1)^-s - p^-s), and C p^-s is to come. Small drops are of edges.
    Large ones are of bending inside the elements, where the error falls exponentially.
    """
    share = order**-EDGE_RATE / ((order - 1) ** -EDGE_RATE - order**-EDGE_RATE)
    return np.minimum(share * drops_cents, EDGE_CENTS + INSIDE_SHARE * drops_cents)
