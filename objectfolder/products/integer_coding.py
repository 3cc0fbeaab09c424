"""Integers in few bytes: byte planes, compressed by LZMA."""

import lzma

import numpy as np
from numpy.typing import NDArray

from objectfolder.products.unpacking import unpack_lzma

Integers = NDArray[np.int64]
LZMA_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 1, "pb": 0}]
LARGEST_PLANES = 8


def pack_integers(values: Integers) -> NDArray[np.uint8]:
    """Return the number of byte planes of non-negative integers, and the planes, low first, compressed.

    >>> unpack_integers(pack_integers(np.array([[1, 300], [0, 7]])), 4)
    array([  1, 300,   0,   7])
    """
    values = values.ravel()
    planes = max(1, (int(values.max(initial=0)).bit_length() + 7) // 8)
    raw = np.stack([(values >> (8 * plane)) & 255 for plane in range(planes)]).astype(np.uint8)
    payload = lzma.compress(raw.tobytes(), format=lzma.FORMAT_RAW, filters=LZMA_FILTERS)
    return np.frombuffer(bytes([planes]) + payload, dtype=np.uint8)


def unpack_integers(stream: NDArray[np.uint8], count: int) -> Integers:
    """Return the integers (count,) that `pack_integers` packed.

    Raises
    ------
    ValueError
        A stream that is damaged, or of another count.
    """
    data = stream.tobytes()
    if not data or data[0] > LARGEST_PLANES:
        raise ValueError(f"a stream without planes, or of more than {LARGEST_PLANES}")
    raw = unpack_lzma(data[1:], LZMA_FILTERS, data[0] * count)
    parts = np.frombuffer(raw, dtype=np.uint8).reshape(data[0], count).astype(np.int64)
    return np.asarray(np.sum(parts << (8 * np.arange(data[0]))[:, None], axis=0))


def zigzag(values: Integers) -> Integers:
    """Return non-negative integers for signed ones: 0, -1, 1, -2 become 0, 1, 2, 3."""
    return np.where(values < 0, -2 * values - 1, 2 * values)


def unzigzag(values: Integers) -> Integers:
    """Invert `zigzag`."""
    return np.where(values & 1, -(values + 1) // 2, values // 2)
