"""Sums and products of float64 with their rounding errors, and phases reduced without loss.

A phase of a million radians, kept as one float64, is wrong by 1e-10; as an unevaluated sum of two it is
right to the last bit of its remainder. Dekker, "A floating-point technique for extending the available
precision", 1971.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SPLITTER = 134217729.0  # 2^27 + 1
# 2 pi as a sum of three float64.
TURN = (6.283185307179586, 2.4492935982947064e-16, -5.989539619436679e-33)


def two_sum(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return a + b as float64 and its rounding error; their sum is exact."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def split(a: Floats) -> tuple[Floats, Floats]:
    """Return two halves of 26 bits that sum to a."""
    scaled = SPLITTER * a
    high = scaled - (scaled - a)
    return high, a - high


def two_product(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return a b as float64 and its rounding error; their sum is exact."""
    product = a * b
    a_high, a_low = split(a)
    b_high, b_low = split(b)
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


def difference_from_square(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return a - b^2 in two parts, right to 1e-31 of the larger term."""
    square, rest = two_product(b, b)
    high, low = two_sum(a, -square)
    return two_sum(high, low - rest)


def square_root(high: Floats, low: Floats) -> tuple[Floats, Floats]:
    """Return the square root of a two-part number >= 0, in two parts."""
    root = np.sqrt(high)
    square, rest = two_product(root, root)
    remainder = ((high - square) - rest) + low
    return root, remainder / (2 * np.where(root > 0, root, 1.0))


def quotient(high: Floats, low: Floats, divisor: float) -> tuple[Floats, Floats]:
    """Return a two-part number over a float64, in two parts."""
    ratio = high / divisor
    product, rest = two_product(ratio, np.asarray(divisor, dtype=np.float64))
    return ratio, (((high - product) - rest) + low) / divisor


def reduced_phase(high: Floats, low: Floats, count: Floats) -> Floats:
    """Return count (high + low) radians less whole turns, in [-pi, pi] to a few units of the last place.

    `count` up to 2^53 / 2 pi turns; arguments broadcast.
    """
    phase, rest = two_product(high, count)
    turns = np.rint(phase / TURN[0])
    whole, whole_rest = two_product(turns, np.asarray(TURN[0]))
    return ((phase - whole) - whole_rest) + (rest + low * count - turns * TURN[1])
