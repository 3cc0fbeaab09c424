"""Where in a body functions of higher order are needed for a wanted accuracy.

From the modes of order 2 the gain of each function left out is estimated, elements where they matter are
raised to order 3, and so on upwards. The estimates leave out how functions act together; what a step gained
in truth over what was foretold sets that right for the next.

On a bowl order 3 everywhere takes 3.8 CPU-s for a worst error of 30 cents, this choice 9.2 for 3.4; on a
plate order 3 misses 3 of 82 modes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.elements.curving import GEOMETRY_ORDER
from objectfolder.audio.elements.elasticity import ElementMatrices, assemble, gains_of_more_functions
from objectfolder.audio.elements.space import Space
from objectfolder.audio.modes.eigen import count_below, improve, lowest_elastic, rigid_motions

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Number of the lowest modes that lead the choice and have their error estimated.
ESTIMATED_MODES = 100
# What a group of functions gains together over the sum of what each would gain alone, before it is measured.
TOGETHER = 2.5
CENTS_PER_RELATIVE_EIGENVALUE = 600 / np.log(2)
# Modes of a step start from those of the last one; some beyond those wanted keep the last of them clean. They
# are looked for as far as so many times the limit, and taken along beyond those that order 2 has lower than
# `START_BAND` times the limit: in thin walls its eigenvalues are too high.
GUARD_MODES, GUARD_SHARE, GUARD_BAND, START_BAND = 16, 0.1, 2.0, 1.3
# Modes of order 2, for a start only, need not be found more sharply than this (see `lowest_elastic`).
START_TOLERANCE = 1e-3
# Compact solids may have no mode below such a limit of eta^2 (a cube's first has 8.2) and are counted first.
# In the thinnest walls that one layer of elements carries, frequencies of order 2 were up to 50 % high,
# eigenvalues 2.25 times. Bodies without a mode of order 2 below twice that times the limit are silent. Those
# that have one there, but none below the limit, are solved in all functions: locking hides from the estimate
# what higher orders gain.
SMALL, HEARD_BAND = 9.0, 4.5
# Exponent with which the error falls with the order at least: plates and bodies of revolution fall faster.
RATE = 3.0
# Share of the wanted error left to the functions of one order that are not taken.
SHARE_LEFT = 0.5
# Elements beside those of lower order gain less than among their like: seen on plates and scans.
BESIDE_LOWER = 2.0


@dataclass(frozen=True)
class Step:
    """One step of the choice.

    Attributes
    ----------
    order : highest order in use
    functions : number of functions
    eta_squared : (k,) eigenvalues found
    """

    order: int
    functions: int
    eta_squared: Floats


@dataclass(frozen=True)
class Choice:
    """Functions chosen, and what is known of the error that is left.

    Attributes
    ----------
    matrices : elements of the space of the highest order in use
    chosen : (function,) bool, of that space
    steps : the solutions on the way, the last one not on `chosen` but before
    start : eigenvalues (k,) and vectors (function, 3, k) of the last of them, some beyond those wanted; None
        where nothing was solved
    expected : relative amount by which the functions added are expected to lower the eigenvalues
    left_cents : (k,) estimated gain of the functions that were weighed and left out
    """

    matrices: ElementMatrices
    chosen: NDArray[np.bool_]
    steps: list[Step]
    start: tuple[Floats, Floats] | None
    expected: float
    left_cents: Floats


def choose(
    space: Space,
    of_function: Integers,
    poisson_ratio: float,
    *,
    below: float,
    accuracy_cents: float,
    max_modes: int,
    max_unknowns: int,
    seed: int,
) -> Choice:
    """Choose the functions of a space that the first modes need for an accuracy.

    Parameters
    ----------
    space
        Of the highest order to be used, bent or straight.
    of_function
        (function,) body of each function.
    below
        Limit of eta^2; modes above it need no accuracy.
    accuracy_cents
        Wanted largest frequency error of the first modes.
    max_unknowns
        Where more would be needed, the most useful ones are taken.
    """
    wanted = min(max_modes, ESTIMATED_MODES)
    order = min(2, space.order)
    matrices = ElementMatrices(_up_to(space, order), poisson_ratio)
    chosen = matrices.space.orders <= 2
    chosen |= np.any(matrices.space.geometry != 0, axis=1)  # else rotations would cost energy
    if below < SMALL:
        stiffness, mass = assemble(matrices.space, poisson_ratio, chosen, matrices)
        rigid = 6 * (int(of_function.max()) + 1)
        if count_below(stiffness, mass, below) == rigid:
            if count_below(stiffness, mass, HEARD_BAND * below) > rigid:
                matrices = ElementMatrices(_largest(space, max_unknowns // 3), poisson_ratio)
                chosen = np.ones(matrices.space.size, dtype=bool)
            return Choice(matrices, chosen, [], None, 0.0, np.zeros(0))
    steps: list[Step] = []
    together = TOGETHER
    richer: _Richer | None = None
    left = np.zeros(0)
    vectors: Floats | None = None
    while True:
        found, vectors = _solve(
            matrices, of_function, chosen, below=below, max_modes=max_modes, seed=seed, start=vectors
        )
        values = found[: min(max(int(np.count_nonzero(found < below)), 1), wanted)]
        steps.append(Step(order, int(chosen.sum()), found[:wanted]))
        if richer is not None:
            together = _measured_together(richer.foretold, steps[-2].eta_squared, values)
        richer = None
        if order == space.order or len(values) == 0:
            break
        upper = ElementMatrices(_up_to(space, order + 1), poisson_ratio)
        used = _continued(chosen, upper.space)
        first = _continued(vectors[:, :, : len(values)], upper.space)
        gains = gains_of_more_functions(upper, used, first, values) / values
        allowed = SHARE_LEFT * accuracy_cents / (CENTS_PER_RELATIVE_EIGENVALUE * together * BESIDE_LOWER)
        heard = values * (1 - np.minimum(together * gains.sum(axis=0), 0.9)) < below
        richer = _enrich(upper.space, used, gains, heard, allowed, max_unknowns // 3)
        left = CENTS_PER_RELATIVE_EIGENVALUE * together * BESIDE_LOWER * richer.left
        if not richer.added:
            break
        matrices, chosen, order = upper, richer.chosen, order + 1
        vectors = _continued(vectors, matrices.space)
        if order == space.order:
            break
    expected = 0.0 if richer is None else min(together * float(np.median(richer.foretold)), 0.5)
    return Choice(matrices, chosen, steps, (found, vectors), expected, left)


@dataclass(frozen=True)
class _Richer:
    """Functions in use and those of the next order: (function,) bool, how many are new, and relative gains
    (k,) of the new ones and of those left out, each for itself."""

    chosen: NDArray[np.bool_]
    added: int
    foretold: Floats
    left: Floats


def _enrich(
    space: Space, used: NDArray[np.bool_], gains: Floats, heard: NDArray[np.bool_], allowed: float, most: int
) -> _Richer:
    """Add the functions that modes `heard` need for `allowed`, up to `most` in all."""
    none = np.zeros(0, dtype=np.int64)
    room = most - int(used.sum())
    taken = _most_useful(space, gains[:, heard], used, allowed, room) if heard.any() else none
    foretold = gains[taken].sum(axis=0)
    chosen = used.copy()
    chosen[taken] = True
    return _Richer(chosen, len(taken), foretold, gains.sum(axis=0) - foretold)


def _measured_together(foretold: Floats, before: Floats, after: Floats) -> float:
    """What functions gained together over the sum of what each was to gain alone."""
    both = min(len(after), len(foretold))
    gained = 1 - after[:both] / before[:both]
    return float(np.clip(np.median(gained) / max(np.median(foretold[:both]), 1e-300), 1.0, 10.0))


def _largest(space: Space, functions: int) -> Space:
    """All functions of the highest order that has at most a number of them; of order 2 at least."""
    order = space.order
    while order > GEOMETRY_ORDER and int(np.count_nonzero(space.orders <= order)) > functions:
        order -= 1
    return _up_to(space, order)


def _solve(
    matrices: ElementMatrices,
    of_function: Integers,
    chosen: NDArray[np.bool_],
    *,
    below: float,
    max_modes: int,
    seed: int,
    start: Floats | None,
) -> tuple[Floats, Floats]:
    """Eigenvalues (k,) below the limit and some beyond, nearly, and vectors (function, 3, k) in the chosen
    functions; from `start` (function, 3, k), those of fewer functions, as many as that has."""
    stiffness, mass = assemble(matrices.space, matrices.poisson_ratio, chosen, matrices)
    space = matrices.space
    body = of_function[: space.size][chosen]
    rigid = rigid_motions(space.geometry[chosen], body, space.vertex_count, mass)
    shift = -min(0.05, below / 4)
    if start is not None:
        pairs = improve(stiffness, mass, rigid, start[chosen].reshape(stiffness.shape[0], -1), shift=shift)
        kept = len(pairs.values)
    else:
        pairs = lowest_elastic(
            stiffness,
            mass,
            rigid,
            below=GUARD_BAND * below,
            at_most=max_modes + _guard(max_modes),
            shift=shift,
            tolerance=START_TOLERANCE,
            seed=seed,
        )
        inside = min(int(np.count_nonzero(pairs.values < START_BAND * below)), max_modes)
        kept = min(len(pairs.values), inside + _guard(inside))
    vectors = np.zeros((space.size, 3, kept))
    vectors[chosen] = pairs.vectors[:, :kept].reshape(-1, 3, kept)
    return pairs.values[:kept], vectors


def _guard(modes: int) -> int:
    """How many modes beyond so many are taken along."""
    return max(GUARD_MODES, int(GUARD_SHARE * modes))


def _up_to(space: Space, order: int) -> Space:
    """Space of a lower order, which still holds the shape of the elements."""
    lower = max(order, GEOMETRY_ORDER)
    return space if lower >= space.order else space.up_to(lower)


def _continued(of_function: NDArray[Any], space: Space) -> NDArray[Any]:
    """Values (function, ...) of the leading functions of a space, and zero for the others."""
    result = np.zeros((space.size, *of_function.shape[1:]), dtype=of_function.dtype)
    result[: len(of_function)] = of_function
    return result


def _most_useful(
    space: Space, gains: Floats, chosen: NDArray[np.bool_], allowed: float, at_most: int
) -> Integers:
    """All functions of the fewest elements such that what is left gains no mode more than `allowed`.

    Elements are taken whole: in a thin one, functions that gain next to nothing alone let others bend freely.

    Parameters
    ----------
    gains
        (function, modes) of a space of the next order.
    chosen
        (function,) those that are in use.
    at_most
        Number of functions that may be added.
    """
    if np.all(gains.sum(axis=0) <= allowed):
        return np.zeros(0, dtype=np.int64)
    sharing = np.bincount(space.numbers.ravel(), minlength=space.size)[:, None]
    of_element = (gains / sharing)[space.numbers].sum(axis=1)
    # Rounded: elements that are alike must not change places by the last bit.
    score = np.round(np.log(of_element.max(axis=1) + 1e-300), 3)
    order = np.argsort(-score, kind="stable")
    # First element, in this order, that brings each function in.
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    first = np.full(space.size, len(order))
    np.minimum.at(first, space.numbers.ravel(), np.repeat(rank, space.numbers.shape[1]))
    arriving = np.zeros((len(order), gains.shape[1]))
    np.add.at(arriving, first, gains)
    left = gains.sum(axis=0) - np.cumsum(arriving, axis=0)
    new = np.cumsum(np.bincount(first[~chosen], minlength=len(order))[: len(order)])
    enough = np.flatnonzero(np.all(left <= allowed, axis=1))
    elements = min(
        int(enough[0]) + 1 if len(enough) else len(order), int(np.searchsorted(new, at_most, "right"))
    )
    return np.flatnonzero(~chosen & (first < elements))


def remaining_cents(choice: Choice, eta_squared: Floats) -> Floats:
    """Estimated frequency error of the first modes, cents, (k,).

    What was weighed and left out, and what higher orders would bring. The error falls as p^-s with the order
    p where edges are sharp (I. Babuska and M. Suri, SIAM Review 36, 1994); s is taken as `RATE`, so that at
    least 95 % of the errors of plates and bodies of revolution are below what is stated here with the
    geometry's. In smooth bodies it falls faster and is overestimated.
    """
    ladder = [step.eta_squared for step in choice.steps] + [eta_squared]
    count = min(len(values) for values in ladder)
    if count == 0 or len(ladder) == 1:
        return np.zeros(0)
    relative = [values[:count] / eta_squared[:count] for values in ladder[-2:]]
    drop = np.maximum(relative[-2] - relative[-1], 0)
    last = choice.steps[-1].order + 1
    left = np.full(count, choice.left_cents.max(initial=0.0))
    weighed = min(count, len(choice.left_cents))
    left[:weighed] = choice.left_cents[:weighed]
    return left + CENTS_PER_RELATIVE_EIGENVALUE * what_is_to_come(drop, last)


def what_is_to_come(drop: Floats, order: int) -> Floats:
    """How far quantities (k,) that fell by `drop` from `order` - 1 to `order` are still from their limit.

    With an error C p^-s the drop to order p is C ((p - 1)^-s - p^-s), and C p^-s is to come.
    """
    return np.asarray(drop / ((order / (order - 1)) ** RATE - 1))


def summary(choice: Choice) -> list[dict[str, Any]]:
    """Steps of the choice, JSON-able."""
    return [{"order": step.order, "functions": step.functions} for step in choice.steps]
