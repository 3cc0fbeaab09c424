"""Which partial is which mode: the assignment of least squares in which any of both may stay alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

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
