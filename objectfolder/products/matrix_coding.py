"""A matrix of integers in few bytes, where rows and columns differ in size: rANS by expected magnitude.

An entry is expected to be as large as its row's size times its column's, in half octaves; columns have a size
for each of a few bands of rows. Entries of one expected magnitude are a class with frequencies of its own.
Each column is a stream of rANS, and their words are interleaved (Duda, "Asymmetric numeral systems", 2013;
Giesen, "Interleaved entropy coders", 2014), so that numpy codes a row at a time. Signs, and the digits of
large entries below the leading one, are stored as they are.

A state begins at `LEAST_STATE` and must come back to it: damage is found.
"""

import numpy as np
from numpy.typing import NDArray

from objectfolder.products.integer_coding import pack_integers, unpack_integers, unzigzag, zigzag

Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

PRECISION = 12  # bits of a frequency
LEAST_STATE = 1 << 16  # states are below 2^32, and give and take words of 16 bits
BANDS = 8
SINGLE_SYMBOLS, SMALL_BITS = (
    16,
    4,
)  # smaller magnitudes have a symbol each, larger ones share those of as many bits
MOST_BITS = 40  # of a magnitude
SYMBOLS = SINGLE_SYMBOLS + MOST_BITS - SMALL_BITS
CLASSES, CLASS_OF_ONE = 40, 12  # in half octaves


def pack_matrix(values: Integers) -> Bytes:
    """Return a matrix (rows, columns) of integers between -2^40 and 2^40 as bytes.

    >>> matrix = np.array([[5, -700], [0, 1]])
    >>> unpack_matrix(pack_matrix(matrix), (2, 2)).tolist()
    [[5, -700], [0, 1]]
    """
    magnitude = np.abs(values)
    sizes = _sizes(magnitude)
    classes = _classes(*sizes)
    bits = np.frexp(magnitude.astype(np.float64))[1].astype(np.int64)
    large = magnitude >= SINGLE_SYMBOLS
    symbols = np.where(large, SINGLE_SYMBOLS + bits - 1 - SMALL_BITS, magnitude)
    frequencies = _frequencies(classes, symbols)
    words, states = _encode(classes, symbols, frequencies)
    digits = bits[large] - 1
    lower = np.repeat(magnitude[large], digits) >> _places(digits) & 1
    plain = np.packbits(np.concatenate([values[values != 0] < 0, lower > 0]))
    header = pack_integers(np.concatenate([*(zigzag(part.ravel()) for part in sizes), frequencies.ravel()]))
    lengths = np.array([len(header), len(words)], dtype="<u4")
    parts = lengths, header, states.astype("<u4"), words.astype("<u2"), plain
    return np.frombuffer(b"".join(part.tobytes() for part in parts), dtype=np.uint8)


def unpack_matrix(stream: Bytes, shape: tuple[int, int]) -> Integers:
    """Return the integers of a shape (rows, columns) that `pack_matrix` packed.

    Raises
    ------
    ValueError
        A stream that is damaged, or of another shape.
    """
    rows, columns = shape
    header, states, words, plain = _parted(stream, columns)
    expected = rows + BANDS * columns + CLASSES * SYMBOLS
    numbers = unpack_integers(header, expected)
    row_sizes, column_sizes, frequencies = np.split(numbers, [rows, rows + BANDS * columns])
    classes = _classes(unzigzag(row_sizes), unzigzag(column_sizes).reshape(BANDS, columns))
    symbols = _decode(classes, states, words, frequencies.reshape(CLASSES, SYMBOLS))
    return _with_plain_bits(symbols, plain)


def _parted(stream: Bytes, columns: int) -> tuple[Bytes, Integers, Integers, Bytes]:
    """Header, states, words and plain bits of a stream."""
    header, words = (int(length) for length in stream[:8].view("<u4")) if len(stream) >= 8 else (0, 0)
    ends = np.cumsum([8, header, 4 * columns, 2 * words])
    if len(stream) < ends[-1]:
        raise ValueError("a stream cut short")
    _, packed, states, interleaved, plain = np.split(stream, ends)
    return (
        packed,
        states.copy().view("<u4").astype(np.int64),
        interleaved.copy().view("<u2").astype(np.int64),
        plain,
    )


def _bands(rows: int) -> Integers:
    """Band (rows,) of each row: the first are the shortest."""
    ends = np.rint(np.linspace(0, np.sqrt(rows), BANDS + 1)[1:] ** 2)
    return np.searchsorted(ends, np.arange(rows), side="right").clip(0, BANDS - 1)


def _sizes(magnitude: Integers) -> tuple[Integers, Integers]:
    """Sizes of the rows (rows,) and of the columns (BANDS, columns) in half octaves."""
    rows, columns = magnitude.shape
    row_sizes = np.zeros(rows, dtype=np.int64)
    column_sizes = np.zeros((BANDS, columns), dtype=np.int64)
    bands = _bands(rows)
    for band in np.unique(bands) if columns else ():
        among = bands == band
        part = magnitude[among] + 0.01
        row = np.ones(len(part))
        for _ in range(6):
            column = (part / row[:, None]).mean(axis=0)
            row = (part / column).mean(axis=1)
        row_sizes[among] = np.rint(2 * np.log2(row))
        column_sizes[band] = np.rint(2 * np.log2(column))
    return row_sizes, column_sizes


def _classes(row_sizes: Integers, column_sizes: Integers) -> Integers:
    """Class (rows, columns) of each entry."""
    together = row_sizes[:, None] + column_sizes[_bands(len(row_sizes))]
    return (together + CLASS_OF_ONE).clip(0, CLASSES - 1)


def _frequencies(classes: Integers, symbols: Integers) -> Integers:
    """Frequencies (CLASSES, SYMBOLS) of sum 2^PRECISION; 0 for what does not occur."""
    counts = np.bincount((classes * SYMBOLS + symbols).ravel(), minlength=CLASSES * SYMBOLS)
    counts = counts.reshape(CLASSES, SYMBOLS)
    total = np.maximum(counts.sum(axis=1, keepdims=True), 1)
    result = np.where(counts > 0, np.maximum((counts << PRECISION) // total, 1), 0)
    used = np.flatnonzero(counts.any(axis=1))
    result[used, counts[used].argmax(axis=1)] += (1 << PRECISION) - result[used].sum(axis=1)
    return result


def _encode(classes: Integers, symbols: Integers, frequencies: Integers) -> tuple[Integers, Integers]:
    """Words and states (columns,), the last row first."""
    frequency = frequencies[classes, symbols]
    start = (np.cumsum(frequencies, axis=1) - frequencies)[classes, symbols]
    states = np.full(classes.shape[1], LEAST_STATE, dtype=np.int64)
    words = []
    for row in range(len(classes) - 1, -1, -1):
        full = states >= frequency[row] << (32 - PRECISION)
        words.append(states[full] & 0xFFFF)
        states[full] >>= 16
        whole, rest = np.divmod(states, frequency[row])
        states = (whole << PRECISION) + rest + start[row]
    return np.concatenate([*words[::-1], np.zeros(0, dtype=np.int64)]), states


def _decode(classes: Integers, states: Integers, words: Integers, frequencies: Integers) -> Integers:
    """Symbols (rows, columns)."""
    used = np.unique(classes)
    if (frequencies[used].sum(axis=1) != 1 << PRECISION).any() or frequencies.max() > 1 << PRECISION:
        raise ValueError("a stream with impossible frequencies")
    symbol = np.zeros((CLASSES, 1 << PRECISION), dtype=np.uint8)
    for row in used:
        symbol[row] = np.repeat(np.arange(SYMBOLS), frequencies[row])
    chosen = np.arange(CLASSES)[:, None], symbol
    frequency = frequencies[chosen].astype(np.int32).ravel()
    start = (np.cumsum(frequencies, axis=1) - frequencies)[chosen]
    offset = (np.arange(1 << PRECISION) - start).astype(np.int32).ravel()
    places = classes << PRECISION
    position = 0
    for place in places:
        place += states & ((1 << PRECISION) - 1)
        states = frequency[place] * (states >> PRECISION) + offset[place]
        short = np.flatnonzero(states < LEAST_STATE)
        if position + len(short) > len(words):
            raise ValueError("a stream cut short")
        states[short] = states[short] << 16 | words[position : position + len(short)]
        position += len(short)
    if position != len(words) or (states != LEAST_STATE).any():
        raise ValueError("a stream whose states do not end where they began")
    return symbol.ravel()[places].astype(np.int64)


def _with_plain_bits(symbols: Integers, plain: Bytes) -> Integers:
    """Integers of their symbols, signs and lower digits."""
    magnitude = symbols.copy()
    large = symbols >= SINGLE_SYMBOLS
    digits = symbols[large] - SINGLE_SYMBOLS + SMALL_BITS
    count = int(np.count_nonzero(symbols)), int(digits.sum())
    if len(plain) != (sum(count) + 7) // 8:
        raise ValueError("a stream of another number of signs and digits")
    signs, bits = np.split(np.unpackbits(plain)[: sum(count)].astype(np.int64), [count[0]])
    owner = np.repeat(np.arange(len(digits)), digits)
    low = np.zeros(len(digits), dtype=np.int64)
    np.add.at(low, owner, bits << _places(digits))
    magnitude[large] = (1 << digits) + low
    magnitude[symbols > 0] *= 1 - 2 * signs
    return magnitude


def _places(digits: Integers) -> Integers:
    """Place of each of the lower digits of large entries that have `digits` (n,) of them."""
    first = np.repeat(np.cumsum(digits) - digits, digits)
    return np.arange(int(digits.sum())) - first
