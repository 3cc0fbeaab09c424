"""What recordings of an object tell of its material: stiffness, Poisson's ratio, walls and loss factor.

Which partial is which mode is the assignment of least squares in which any of both may stay alone.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from objectfolder.errors import InputError
from objectfolder.making.recordings.body import SolvedBody
from objectfolder.making.recordings.decay_law import FittedLoss, power_law
from objectfolder.making.recordings.partials import Partials

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
CENTS = 1200 / np.log(2)
# What it costs to leave a partial alone: that of a mode off by these cents, before anything is fitted.
ALONE_CENTS = 25.0
# Modes so near one another are a pair, such as a round body has: a partial that is not split stands for both.
PAIR_CENTS = 6.0


@dataclass(frozen=True)
class Matching:
    """Partials with the modes that they are.

    Attributes
    ----------
    partials, modes : (n,) int64, ascending
    cents : (n,) float64, partial over mode; over the mean of a pair of which one partial is heard
    cost : sum over all partials, the weight of one that stays alone
    """

    partials: Integers
    modes: Integers
    cents: Floats
    cost: float

    @property
    def rms_cents(self) -> float:
        """Root mean square of what is left."""
        return float(np.sqrt(np.mean(self.cents**2))) if len(self.cents) else 0.0


def match(
    partials_hz: Floats, weights: Floats, modes_hz: Floats, alone_cents: float = ALONE_CENTS
) -> Matching:
    """Match partials (p,) with modes (m,), both ascending, in hertz.

    Of two partials that one mode could be, the one of more weight (p,) takes it.

    Squares keep the order within a pair. Modes that no partial is left for cost nothing: where an object is
    struck decides which of them sound.
    """
    cents = CENTS * np.log(partials_hz[:, None] / modes_hz[None, :])
    alone = np.repeat(weights[:, None], len(partials_hz), axis=1)
    near = (cents / alone_cents) ** 2
    cost = np.concatenate([np.where(near < 1, weights[:, None] * near, weights[:, None]), alone], axis=1)
    rows, columns = linear_sum_assignment(cost)
    chosen = cost[rows, columns] < weights[rows]
    total = float(cost[rows, columns].sum())
    # Weights may cross the two of a pair.
    rows, columns = np.sort(rows[chosen]), np.sort(columns[chosen])
    middle = cents[rows, columns].copy()
    for index, mode in enumerate(columns):
        for twin in (mode - 1, mode + 1):
            if 0 <= twin < len(modes_hz) and twin not in columns and _is_pair(modes_hz, mode, twin):
                middle[index] = (cents[rows[index], mode] + cents[rows[index], twin]) / 2
    return Matching(rows.astype(np.int64), columns.astype(np.int64), middle, total)


def _is_pair(modes_hz: Floats, mode: int, twin: int) -> bool:
    return bool(abs(CENTS * np.log(modes_hz[mode] / modes_hz[twin])) < PAIR_CENTS)


# Of all modes together, in which a fit is looked for, and the standard deviation of what is to be expected.
RANGE_CENTS, STEP_CENTS, EXPECTED_CENTS = 600.0, 2.0, 300.0
# Standard deviations of Poisson's ratio about the table's, and of walls about the mesh's, before a recording.
POISSON_SPREAD, WALL_SPREAD = 0.03, 0.02
# Cents that the shape leaves, beside the solver's error and the spread over recordings.
SHAPE_CENTS = 3.0
# Visible is what recordings narrow to this part of that spread, and move by this many of its deviations.
NARROWING, SIGNIFICANT = 0.5, 2.0
FIT_ROUNDS = 20
# A partial stays alone from this multiple of the rms of the others on, and not below these cents.
ALONE_RMS, LEAST_ALONE_CENTS = 3.0, 6.0
FEWEST_PARTIALS, FEWEST_SHARE = 3, 0.5
# Sets of partials drawn at random, of which none may match as well.
RANDOM_SETS = 40
# A partial this far below the strongest weighs nothing, but for the least weight.
WEIGHT_DB, LEAST_WEIGHT = 60.0, 0.1
# Share of a decay that radiation may have for the rest to tell the material's.
MOST_RADIATED = 0.5


@dataclass(frozen=True)
class Estimate:
    """A number, its standard deviation, and whether the recordings tell it from the one assumed before."""

    value: float
    deviation: float
    visible: bool


@dataclass(frozen=True)
class SoundFit:
    """A fit of a body to partials.

    Attributes
    ----------
    stiffness : E / rho over that of the material the body was solved with
    poisson_ratio : of the fit; that of the material where it is not visible
    wall : thickness of walls over the mesh's; 1 where it was held or is not visible
    matching : of partials and modes, with the cents that are left
    cents_before : (n,) of the same matches with the material as it was
    modes_hz : (m,) frequencies of the fit
    decays_per_s : (n,) of the matches; of a pair the mean of what is heard of it, weighted by amplitude
    decay : the law through the decays of matched partials less what their modes radiate; None where too few
        are measured
    chance : largest share of partials, by weight, that random ones match
    """

    stiffness: Estimate
    poisson_ratio: Estimate
    wall: Estimate
    matching: Matching
    cents_before: Floats
    modes_hz: Floats
    decays_per_s: Floats
    decay: FittedLoss | None
    chance: float


def fit_body(
    partials: Partials, body: SolvedBody, *, recordings: int, fit_wall: bool, seed: int = 0
) -> SoundFit:
    """Fit E / rho, Poisson's ratio and, where that is asked for, walls to partials.

    Frequencies move by the derivatives of `SolvedBody`, to first order. Weights of a Gaussian prior are
    `POISSON_SPREAD` and `WALL_SPREAD`; none holds E / rho. What is not visible stays as it was.

    Parameters
    ----------
    recordings
        Number of recordings: a partial that all have weighs more than one that one has.

    Raises
    ------
    InputError
        Too few partials, or partials that do not match better than random ones would: another object.
    """
    if len(partials) < FEWEST_PARTIALS:
        raise InputError(
            "recordings",
            f"{len(partials)} partials found, {FEWEST_PARTIALS} are needed",
            "Strike harder, or record nearer.",
        )
    if len(body.frequencies_hz) == 0:
        raise InputError("mesh", f"no mode below {body.limit_hz:.0f} Hz", "Raise --max-frequency.")
    weights = _weights(partials, recordings)
    start, cost = _search(partials.frequencies_hz, weights, body)
    chance = _chance(partials.frequencies_hz, weights, body, seed)
    names = ["poisson", "wall"] if fit_wall else ["poisson"]
    solution = _solve(partials, weights, body, start, names)
    while names:
        hidden = [name for name in names if not solution.is_visible(name)]
        if not hidden:
            break
        names.remove(min(hidden, key=solution.significance))
        solution = _solve(partials, weights, body, start, names)
    matching = solution.matching
    share = float(weights[matching.partials].sum() / weights.sum())
    agreement = float(1 - cost / weights.sum())
    if share < FEWEST_SHARE or agreement <= chance:
        raise InputError(
            "recordings",
            f"{len(matching.partials)} of {len(partials)} partials are within {ALONE_CENTS:.0f} cents of a "
            f"mode, {agreement:.0%} by weight and nearness, where random partials reach {chance:.0%}",
            "Is it the object of the mesh, at its true size?",
        )
    before = CENTS * np.log(partials.frequencies_hz[matching.partials] / body.frequencies_hz[matching.modes])
    law = _law_of_material(partials, matching, body.radiation_dampings_per_s)
    nu = body.material.poisson_ratio
    cents, spread = solution.value("stiffness"), solution.deviation("stiffness")
    factor = float(np.exp(2 * cents / CENTS))
    poisson = Estimate(nu + solution.value("poisson"), solution.deviation("poisson"), "poisson" in names)
    wall = Estimate(float(np.exp(solution.value("wall"))), solution.deviation("wall"), "wall" in names)
    return SoundFit(
        stiffness=Estimate(factor, 2 * spread / CENTS * factor, True),
        poisson_ratio=poisson,
        wall=wall,
        matching=matching,
        cents_before=before,
        modes_hz=solution.modes_hz,
        decays_per_s=_decays(partials, matching, body.frequencies_hz),
        decay=law,
        chance=chance,
    )


def partials_near_modes(partials: Partials, fit: SoundFit) -> int:
    """Number of partials within `LEAST_ALONE_CENTS` of a mode of a fit: few are of another object."""
    apart = CENTS * np.abs(np.log(partials.frequencies_hz[:, None] / fit.modes_hz)).min(axis=1)
    return int(np.count_nonzero(apart < LEAST_ALONE_CENTS))


def fitted_material(
    fit: SoundFit, body: SolvedBody, name: str, citation: str, mass_kg: float | None = None
) -> dict[str, str]:
    """Return the row of a table of materials: column to text.

    Parameters
    ----------
    citation
        Where the numbers come from.
    mass_kg
        Measured: gives the density. The table's density stays without it, and E with it: a recording knows
        their ratio alone.
    """
    material = body.material
    density = material.density_kg_m3
    if mass_kg is not None:
        density = mass_kg / (body.volume_m3 * fit.wall.value)
    modulus = material.youngs_modulus_pa / material.density_kg_m3 * fit.stiffness.value * density
    row = {
        "name": name,
        "density_kg_m3": f"{density:.6g}",
        "youngs_modulus_pa": f"{modulus:.6g}",
        "poisson_ratio": f"{fit.poisson_ratio.value:.4g}",
        "citation": citation,
    }
    if fit.decay is not None:
        row |= {
            "loss_factor": f"{fit.decay.loss_factor:.4g}",
            "loss_exponent": f"{fit.decay.loss_exponent:.3g}",
            "loss_citation": citation,
        }
    return {
        field.name: row.get(field.name, _text(getattr(material, field.name))) for field in fields(material)
    }


def _text(value: float | str | None) -> str:
    return "" if value is None else str(value)


@dataclass(frozen=True)
class _Solution:
    """Parameters by name with their covariance, and what they leave."""

    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    prior: dict[str, float]
    matching: Matching
    modes_hz: Floats

    def value(self, name: str) -> float:
        return float(self.values[self.names.index(name)]) if name in self.names else 0.0

    def deviation(self, name: str) -> float:
        if name not in self.names:
            return self.prior[name]
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def significance(self, name: str) -> float:
        return abs(self.value(name)) / self.deviation(name)

    def is_visible(self, name: str) -> bool:
        narrowed = self.deviation(name) < NARROWING * self.prior[name]
        return narrowed and self.significance(name) > SIGNIFICANT


PRIOR = {"poisson": POISSON_SPREAD, "wall": WALL_SPREAD}


def _solve(
    partials: Partials, weights: Floats, body: SolvedBody, start_cents: float, extra_names: list[str]
) -> _Solution:
    """Least squares of the cents of matches, matched anew until nothing changes."""
    names = ("stiffness", *extra_names)
    slopes = {
        "stiffness": np.ones(len(body.frequencies_hz)),
        "poisson": CENTS * body.by_poisson,
        "wall": CENTS * body.by_wall,
    }
    every = np.column_stack([slopes[name] for name in names])
    holding = np.diag([0.0, *(1 / PRIOR[name] for name in extra_names)])
    values = np.array([start_cents, *(0.0 for _ in extra_names)])
    spread = CENTS * partials.frequency_spread_hz / partials.frequencies_hz
    pairs, alone_cents = None, ALONE_CENTS
    for _ in range(FIT_ROUNDS):
        modes_hz = body.frequencies_hz * np.exp(every @ values / CENTS)
        matching = match(partials.frequencies_hz, weights, modes_hz, alone_cents)
        again = (matching.partials.tolist(), matching.modes.tolist())
        if not len(matching.modes):
            break
        if again == pairs:
            # Matched as well as the rest is: of two partials for one mode the nearer may be the weaker.
            left_cents = float(np.clip(ALONE_RMS * matching.rms_cents, LEAST_ALONE_CENTS, ALONE_CENTS))
            if left_cents >= alone_cents:
                break
            alone_cents = left_cents
            continue
        pairs = again
        error = np.sqrt(
            SHAPE_CENTS**2 + body.error_cents[matching.modes] ** 2 + spread[matching.partials] ** 2
        )
        design = np.vstack([every[matching.modes] / error[:, None], holding])
        aim = np.concatenate([matching.cents / error, -holding @ values])
        step, *_ = np.linalg.lstsq(design, aim, rcond=None)
        values = values + step
        residuals = (matching.cents - every[matching.modes] @ step) / error
        excess = max(1.0, float((residuals**2).sum()) / max(len(residuals) - len(names), 1))
        covariance = np.linalg.inv(design.T @ design) * excess
    modes_hz = body.frequencies_hz * np.exp(every @ values / CENTS)
    if pairs is None:
        covariance = np.full((len(names), len(names)), np.inf)
    final = match(partials.frequencies_hz, weights, modes_hz, alone_cents)
    return _Solution(names, values, covariance, PRIOR, final, modes_hz)


def _law_of_material(
    partials: Partials, matching: Matching, radiation_per_s: Floats | None
) -> FittedLoss | None:
    """Law through decays less what the air takes, of partials that lose most to something else."""
    decays = partials.decays_per_s[matching.partials]
    air = np.zeros(len(decays)) if radiation_per_s is None else radiation_per_s[matching.modes]
    usable = partials.decay_is_measured[matching.partials] & (air < MOST_RADIATED * decays)
    if np.count_nonzero(usable) < FEWEST_PARTIALS:
        return None
    return power_law(partials.frequencies_hz[matching.partials][usable], (decays - air)[usable])


def _decays(partials: Partials, matching: Matching, modes_hz: Floats) -> Floats:
    """Decays (n,) of matches: the two of a pair beat, and share one."""
    decays = np.log(partials.decays_per_s[matching.partials])
    amplitude = 10 ** ((partials.level_db - partials.level_db.max())[matching.partials] / 20)
    apart = CENTS * np.log(modes_hz[matching.modes][1:] / modes_hz[matching.modes][:-1])
    for first in np.nonzero(apart < PAIR_CENTS)[0]:
        pair = slice(first, first + 2)
        decays[pair] = np.average(decays[pair], weights=amplitude[pair])
    return np.asarray(np.exp(decays))


def _weights(partials: Partials, recordings: int) -> Floats:
    """Weights (p,) of partials: by level, and by the share of recordings that have them."""
    level = np.maximum(1 + (partials.level_db - partials.level_db.max()) / WEIGHT_DB, LEAST_WEIGHT)
    return np.asarray(level * partials.recordings / recordings)


def _search(partials_hz: Floats, weights: Floats, body: SolvedBody) -> tuple[float, float]:
    """Cents to move all modes by at which partials are nearest, and the cost there."""
    shifts = np.arange(-RANGE_CENTS, RANGE_CENTS + STEP_CENTS, STEP_CENTS)
    ratios = CENTS * np.log(partials_hz[:, None] / body.frequencies_hz[None, :])
    apart = np.abs(ratios[None] - shifts[:, None, None]).min(axis=2)
    # Above the last mode solved nothing is known: such a partial counts as half matched.
    covered = partials_hz[None] < body.limit_hz * np.exp(shifts[:, None] / CENTS)
    near = np.where(covered, np.minimum((apart / ALONE_CENTS) ** 2, 1.0), 0.5)
    total = near @ weights
    best = int((total + (shifts / EXPECTED_CENTS) ** 2 / 2).argmin())
    return float(shifts[best]), float(total[best])


def _chance(partials_hz: Floats, weights: Floats, body: SolvedBody, seed: int) -> float:
    """Largest share of weight and nearness that as many partials at random frequencies of the range reach."""
    generator = np.random.default_rng(seed)
    low, high = float(np.log(partials_hz.min())), float(np.log(partials_hz.max()))
    costs = [
        _search(np.exp(generator.uniform(low, high, len(partials_hz))), weights, body)[1]
        for _ in range(RANDOM_SETS)
    ]
    return float(1 - min(costs) / weights.sum())
