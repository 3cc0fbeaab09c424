"""Rows of small integers in few bytes: range asymmetric numeral systems with an adaptive Laplacian model.

Every column is a lane with a state of its own (Duda, "Asymmetric numeral systems", 2013; Giesen,
"Interleaved entropy coders", 2014), so that one numpy step codes a whole row, and the lanes share one stream
of 16-bit words. What a value is expected to be comes from the values already known: the mean magnitude of
its column so far and of the columns beside it, in half octaves. Nothing of the model is stored.

Encoder and decoder must agree to the bit on every machine: expectations are integers, and the tables are
made of single additions, multiplications and square roots, which IEEE 754 fixes.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import FormatError

Integers = NDArray[np.int64]
States = NDArray[np.uint64]

PRECISION = 14  # bits of a probability
LOWEST_STATE = 16  # states lie in 2^16 .. 2^32
LARGEST = 24  # magnitudes above are escaped
ESCAPE = 2 * LARGEST + 1
CLASSES = 22
LEAST_MEAN = 2.0**-9  # of class 0; each class doubles its square
# Above the last class the low bits are as good as random and are coded as they are.
FRACTION_BITS = 12  # of an expected magnitude
FORGETTING = 12  # rows
HALF_OCTAVE = 0.7071067811865476
TAIL_SHARE = 0.06  # of a Laplacian four times as wide: the expectation may be wrong


def encode_integers(values: Integers) -> NDArray[np.uint8]:
    """Code integers.

    Parameters
    ----------
    values
        (rows, columns), magnitudes below 2^27; columns as alike as may be, rows in falling order of size.

    Returns
    -------
    ndarray
        (bytes,) uint8.

    Raises
    ------
    ValueError
        A magnitude of 2^27 or more.
    """
    values = np.asarray(values, dtype=np.int64)
    if np.abs(values).max(initial=0) >= 1 << (2 * PRECISION - 1):
        raise ValueError("integers to be coded must be below 2^27")
    rows, columns = values.shape
    steps: list[tuple[Integers, Integers, Integers]] = []  # lanes, starts, frequencies: in decoding order
    model = _Model(columns)
    frequency, start, _ = _tables()
    lanes = np.arange(columns)
    for row in range(rows):
        kind, shift = model.kinds()
        high = values[row] >> shift
        escaped = np.abs(high) > LARGEST
        symbol = np.where(escaped, ESCAPE, high + LARGEST)
        steps.append((lanes, start[kind, symbol], frequency[kind, symbol]))
        shifted = np.flatnonzero((shift > 0) & ~escaped)
        if len(shifted):
            low = values[row, shifted] & ((1 << shift[shifted]) - 1)
            steps.append((shifted, low << (PRECISION - shift[shifted]), 1 << (PRECISION - shift[shifted])))
        rare = np.flatnonzero(escaped)
        if len(rare):
            whole = _zigzag(values[row, rare])
            ones = np.ones_like(rare)
            steps.append((rare, whole & ((1 << PRECISION) - 1), ones))
            steps.append((rare, whole >> PRECISION, ones))
        model.learn(values[row])
    states = np.full(columns, 1 << LOWEST_STATE, dtype=np.uint64)
    words: list[NDArray[np.uint16]] = []
    for chosen, low, share in reversed(steps):
        x, f = states[chosen], share.astype(np.uint64)
        full = x >= f << np.uint64(2 * LOWEST_STATE - PRECISION)
        words.append((x[full] & np.uint64(0xFFFF)).astype(np.uint16))
        x = np.where(full, x >> np.uint64(16), x)
        states[chosen] = ((x // f) << np.uint64(PRECISION)) + x % f + low.astype(np.uint64)
    stream = np.concatenate([states.astype("<u4").view("<u2"), *reversed(words)])
    return stream.astype("<u2").view(np.uint8)


def decode_integers(stream: NDArray[np.uint8], rows: int, columns: int) -> Integers:
    """Decode what `encode_integers` returned, (rows, columns).

    Raises
    ------
    FormatError
        A stream that is too short, too long, or not of this origin.
    """
    if len(stream) % 2 or len(stream) < 4 * columns:
        raise FormatError("coded integers", f"{len(stream)} bytes for {columns} columns", "Make it again.")
    words = np.frombuffer(np.ascontiguousarray(stream).tobytes(), dtype="<u2")
    states = words[: 2 * columns].view("<u4").astype(np.uint64)
    words, position = words[2 * columns :].astype(np.uint64), 0
    frequency, start, lookup = _tables()
    model = _Model(columns)
    values = np.zeros((rows, columns), dtype=np.int64)
    mask = np.uint64((1 << PRECISION) - 1)

    def refill(chosen: Integers, x: States) -> None:
        nonlocal position
        empty = np.flatnonzero(x < np.uint64(1 << LOWEST_STATE))
        if position + len(empty) > len(words):
            raise FormatError("coded integers", "the stream ends early", "Make it again.")
        x[empty] = (x[empty] << np.uint64(16)) | words[position : position + len(empty)]
        position += len(empty)
        states[chosen] = x

    def raw(chosen: Integers, bits: Integers) -> Integers:
        """Uniform symbols of so many bits."""
        x = states[chosen]
        slot = x & mask
        rest = (np.uint64(PRECISION) - bits.astype(np.uint64)).astype(np.uint64)
        symbol = slot >> rest
        refill(chosen, ((x >> np.uint64(PRECISION)) << rest) + slot - (symbol << rest))
        return symbol.astype(np.int64)

    lanes = np.arange(columns)
    for row in range(rows):
        kind, shift = model.kinds()
        slot = (states & mask).astype(np.int64)
        symbol = lookup[kind, slot]
        share, low = frequency[kind, symbol], start[kind, symbol]
        x = share.astype(np.uint64) * (states >> np.uint64(PRECISION)) + (slot - low).astype(np.uint64)
        refill(lanes, x)
        value = (symbol - LARGEST) << shift
        shifted = np.flatnonzero((shift > 0) & (symbol != ESCAPE))
        if len(shifted):
            value[shifted] += raw(shifted, shift[shifted])
        rare = np.flatnonzero(symbol == ESCAPE)
        if len(rare):
            bits = np.full(len(rare), PRECISION)
            whole = raw(rare, bits)
            value[rare] = _unzigzag(whole | (raw(rare, bits) << PRECISION))
        values[row] = value
        model.learn(value)
    if position != len(words) or (states != 1 << LOWEST_STATE).any():
        raise FormatError("coded integers", "damaged", "Make it again.")
    return values


class _Model:
    """Expected magnitude of the next value of each column, fixed-point."""

    def __init__(self, columns: int) -> None:
        self._mean = np.full(columns, 64 << FRACTION_BITS, dtype=np.int64)
        self._known = 0

    def kinds(self) -> tuple[Integers, Integers]:
        """Class of the Laplacian (columns,) and number of low bits (columns,) coded as they are."""
        expected = 12 * self._mean
        expected[1:] += 2 * self._mean[:-1]
        expected[:-1] += 2 * self._mean[1:]
        expected[:1] += 2 * self._mean[:1]
        expected[-1:] += 2 * self._mean[-1:]
        expected >>= 4
        mantissa, exponent = np.frexp(expected.astype(np.float64) / (LEAST_MEAN * (1 << FRACTION_BITS)))
        kind = np.maximum(2 * (exponent.astype(np.int64) - 1) + (mantissa >= HALF_OCTAVE), 0)
        shift = np.minimum(np.maximum(kind - CLASSES + 2, 0) // 2, PRECISION - 1)
        return np.minimum(kind - 2 * shift, CLASSES - 1), shift

    def learn(self, values: Integers) -> None:
        self._known += 1
        difference = (np.abs(values) << FRACTION_BITS) - self._mean
        self._mean += difference // min(self._known, FORGETTING)


@cache
def _tables() -> tuple[Integers, Integers, Integers]:
    """Frequencies and starts (class, symbol) of 2^14, and the symbol (class, slot) of each slot."""
    total = 1 << PRECISION
    frequency = np.zeros((CLASSES, ESCAPE + 1), dtype=np.int64)
    mean = LEAST_MEAN * np.sqrt(np.sqrt(2.0))  # the middle of class 0
    for kind in range(CLASSES):
        shares = np.zeros(ESCAPE + 1)
        for weight, width in ((1 - TAIL_SHARE, mean), (TAIL_SHARE, 4 * mean)):
            # Two-sided geometric distribution of this mean magnitude: 2 r / (1 - r^2) = width.
            ratio = (np.sqrt(1 + width * width) - 1) / width
            powers = np.cumprod(np.full(LARGEST + 1, ratio)) / ratio
            side = weight * (1 - ratio) / (1 + ratio) * powers
            shares[:-1] += np.concatenate([side[:0:-1], side])
            shares[-1] += weight * 2 * powers[-1] * ratio / (1 + ratio)
        count = 1 + np.floor(shares / np.cumsum(shares)[-1] * (total - len(shares))).astype(np.int64)
        count[LARGEST] += total - count.sum()
        frequency[kind] = count
        mean *= np.sqrt(2.0)
    start = np.cumsum(frequency, axis=1) - frequency
    lookup = np.stack([np.repeat(np.arange(ESCAPE + 1), count) for count in frequency])
    return frequency, start, lookup


def _zigzag(values: Integers) -> Integers:
    return np.where(values >= 0, 2 * values, -2 * values - 1)


def _unzigzag(values: Integers) -> Integers:
    return np.where(values % 2 == 0, values // 2, -(values + 1) // 2)
