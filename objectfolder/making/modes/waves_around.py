"""Modes of a body of equal sectors, one wave around the axis after the other (`elements.sectors`).

Each wave has the unknowns of one sector, chooses its functions for itself, and has its modes counted. What
all have together is the spectrum of the whole body, in which the two modes of a pair have one eigenvalue.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.elements.elasticity import ElementMatrices
from objectfolder.making.elements.sectors import Sectors, SectorSpace
from objectfolder.making.elements.space import Space
from objectfolder.making.factorisation import SOLVER
from objectfolder.making.modes.adaptive import (
    CENTS_PER_RELATIVE_EIGENVALUE,
    MUCH_GAINED_CENTS,
    Choice,
    Goal,
    climb,
    first_choice,
    refuse_many,
    remaining_cents,
    solved,
    widened,
)
from objectfolder.making.modes.eigen import Eigenpairs
from objectfolder.making.modes.spectrum import CUT_CHOICES, GEOMETRY_ORDER, Band, Spectrum, solve_band

Floats = NDArray[np.float64]
# Share of the error allowed that functions are chosen by: they cost little here, so that more are taken.
# What those left out would gain is stated as so much more.
ACCURACY_SHARE = 0.5
WAVE_GUARD_MODES = 6  # as for `Goal`; a wave has some ten modes
# Functions are chosen for modes whose eigenvalue is below this multiple of the limit, since those of order 2
# were too high by up to this factor: a mode alone in its wave would else be left above the limit.
NEAR_LIMIT = 2.25
# The wave 0 is real and has few modes: it gets functions for this share of the error allowed to others.
AXISYMMETRIC_SHARE = 0.2
# Unknowns of the whole over those allowed: a wave takes little memory.
MORE_UNKNOWNS = 2


@dataclass(frozen=True)
class _Wave:
    """Modes of a wave: eigenvalues (k,), vectors (function, 3, k) of a sector, and what is known of them."""

    number: int
    choice: Choice
    pairs: Eigenpairs
    residuals: Floats
    error_cents: Floats
    beyond: Floats
    rigid: int
    rigid_value: float
    unknowns: int
    seconds: dict[str, float]


def wave_spectrum(sectors: Sectors, poisson_ratio: float, goal: Goal) -> Spectrum:
    """Elastic modes below a limit to an accuracy, of a body of equal sectors.

    Parameters
    ----------
    sectors
        Of the highest order to be used.
    goal
        As for `adapt_spectrum`.

    Raises
    ------
    UnsolvableError
        More unknowns of order 2, or more memory, than the limits; or the inertia count and the modes found
        differ after a second search.
    SimulationError
        The time is over.
    """
    started = time.process_time()
    refuse_many(sectors.whole, GEOMETRY_ORDER, goal)
    share = replace(
        goal,
        max_unknowns=_most_unknowns(goal) // sectors.count,
        accuracy_cents=ACCURACY_SHARE * goal.accuracy_cents,
        guard_modes=WAVE_GUARD_MODES,
    )
    component = np.zeros(len(sectors.representatives), dtype=np.int64)
    spaces = {wave: SectorSpace.of(sectors, wave) for wave in sectors.waves}
    near = replace(share, below=NEAR_LIMIT * goal.below)
    firsts = {
        wave: solved(first_choice(space, poisson_ratio, share), component, near)
        for wave, space in spaces.items()
    }
    share = replace(share, below=_limit(sectors, firsts, goal))
    seconds = {"choose_functions": time.process_time() - started}
    waves = [_solve(space, firsts[wave], share) for wave, space in spaces.items()]
    for wave in waves:
        for name, spent in wave.seconds.items():
            seconds[name] = seconds.get(name, 0.0) + spent
    return _together(sectors, waves, poisson_ratio, goal, share.below, seconds)


def _most_unknowns(goal: Goal) -> int:
    """Of the whole body: its modes in all functions are one block in memory."""
    return int(min(MORE_UNKNOWNS * goal.max_unknowns, goal.limits.vector_values / goal.max_modes))


def _limit(sectors: Sectors, firsts: dict[int, Choice], goal: Goal) -> float:
    """A limit with as many modes below as there may be; with more functions none comes to lie higher."""
    values = [
        np.repeat(choice.ladder[-1], 1 if sectors.is_real(wave) else 2) for wave, choice in firsts.items()
    ]
    every = np.sort(np.concatenate(values))
    return (
        min(goal.below, float(every[goal.max_modes]) * (1 + 1e-9))
        if len(every) > goal.max_modes
        else goal.below
    )


def _solve(space: SectorSpace, first: Choice, goal: Goal) -> _Wave:
    started = time.process_time()
    component = np.zeros(space.vertex_count, dtype=np.int64)
    share = AXISYMMETRIC_SHARE if space.wave == 0 else 1.0
    near = replace(goal, below=NEAR_LIMIT * goal.below, accuracy_cents=share * goal.accuracy_cents)
    choice = _filled(climb(first, space, component, near), space.order, goal)
    chose = time.process_time() - started
    band = Band(goal.below, goal.max_modes, CUT_CHOICES, True, goal.seed)
    pencil, modes, seconds = solve_band(
        choice.matrices, component, choice.chosen, band, choice.pairs, goal.limits
    )
    vectors = np.zeros((choice.matrices.space.size, 3, len(modes.pairs.values)), modes.pairs.vectors.dtype)
    vectors[choice.chosen] = modes.pairs.vectors.reshape(vectors[choice.chosen].shape)
    rigid = np.abs(np.sum(pencil.rigid.conj() * (pencil.stiffness @ pencil.rigid), axis=0))
    return _Wave(
        space.wave,
        choice,
        Eigenpairs(modes.pairs.values, vectors),
        pencil.residuals(modes.pairs),
        remaining_cents(choice, modes.pairs.values) / (1.0 if choice.chosen.all() else ACCURACY_SHARE),
        modes.beyond,
        pencil.rigid.shape[1],
        float(rigid.max(initial=0.0)),
        pencil.size,
        {"choose_functions": chose, **seconds},
    )


def _filled(choice: Choice, highest: int, goal: Goal) -> Choice:
    """The choice with all functions of the highest order, where it has some and the one before gained much.

    What single functions would gain says too little of the shortest waves along a thin rim.
    """
    size = choice.matrices.space.size
    if choice.order < highest or choice.pairs is None or len(choice.ladder) < 2:
        return choice
    before, after = choice.ladder[-2], choice.ladder[-1]
    heard = np.flatnonzero(after[: len(before)] < goal.below)
    gained_cents = CENTS_PER_RELATIVE_EIGENVALUE * (before[heard] / after[heard] - 1)
    if gained_cents.max(initial=0.0) <= MUCH_GAINED_CENTS:
        return choice
    if size > goal.most_functions(choice.pairs.vectors.shape[1]):
        return choice
    pairs = Eigenpairs(choice.pairs.values, widened(choice.pairs.vectors, choice.chosen))
    nothing = np.zeros_like(choice.omission_cents)
    return replace(choice, chosen=np.ones(size, dtype=bool), pairs=pairs, omission_cents=nothing)


def _together(
    sectors: Sectors,
    waves: list[_Wave],
    poisson_ratio: float,
    goal: Goal,
    below: float,
    seconds: dict[str, float],
) -> Spectrum:
    """The spectrum of the whole body."""
    many = [1 if sectors.is_real(wave.number) else 2 for wave in waves]

    def each(values: list[Floats]) -> Floats:
        return np.concatenate([np.repeat(part, times) for part, times in zip(values, many, strict=True)])

    values = each([wave.pairs.values for wave in waves])
    order = np.argsort(values, kind="stable")
    beyond = np.sort(each([wave.beyond for wave in waves]))
    band = Band(below, goal.max_modes, CUT_CHOICES, True, goal.seed)
    count, limit = band.cut(np.concatenate([values[order], beyond]))
    lowest = order[:count]
    highest = max(wave.choice.order for wave in waves)
    whole = sectors.whole.up_to(max(highest, GEOMETRY_ORDER))
    vectors = np.zeros((whole.size, 3, count))
    place = np.full(len(values), -1)
    place[lowest] = np.arange(count)
    start = 0
    for wave, times in zip(waves, many, strict=True):
        columns = place[start : start + times * len(wave.pairs.values)]
        start += len(columns)
        modes = sectors.expand(wave.number, wave.pairs.vectors, wave.choice.matrices.space.order)
        vectors[: len(modes), :, columns[columns >= 0]] = modes[:, :, columns >= 0]
    rigid = sum(times * wave.rigid for wave, times in zip(waves, many, strict=True))
    return Spectrum(
        whole,
        values[lowest],
        vectors,
        each([wave.residuals for wave in waves])[lowest],
        limit,
        {
            "method": f"negative pivots of K - limit M (Sylvester), {SOLVER}, for each wave around the axis",
            "counted": count + rigid,
            "rigid": rigid,
            "elastic_found": count,
            "holds": True,
        },
        max(wave.rigid_value for wave in waves),
        _volume(sectors, poisson_ratio),
        sectors.count * max(wave.unknowns for wave in waves),
        each([wave.error_cents for wave in waves])[lowest],
        np.concatenate([values[order[count:]], beyond]),
        _steps(sectors, waves),
        seconds,
    )


def _steps(sectors: Sectors, waves: list[_Wave]) -> list[dict[str, Any]]:
    """Orders on the way, and functions of the whole body of the wave that took most."""
    longest = max(len(wave.choice.functions) for wave in waves)
    return [
        {
            "order": GEOMETRY_ORDER + step,
            "functions": sectors.count
            * max(wave.choice.functions[step] for wave in waves if len(wave.choice.functions) > step),
        }
        for step in range(longest)
    ]


def _volume(sectors: Sectors, poisson_ratio: float) -> float:
    """Volume of the elements: corner functions sum to one."""
    space: Space = SectorSpace.of(sectors, 0).up_to(GEOMETRY_ORDER)
    masses = (weights for _, _, weights in ElementMatrices(space, poisson_ratio))
    return sectors.count * float(sum(part[:, :4, :4].sum() for part in masses))
