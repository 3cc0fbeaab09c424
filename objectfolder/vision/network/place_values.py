"""Which places of a lattice on faces share a value: `face_lattice.FaceLattice.owner`, compiled."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math

import numpy as np

from objectfolder.jit import arrayless, kernel

# Bits of a number three places apart: those of three of them make a Morton code.
CELL_BITS = 11
CELL_SPREAD = np.sum([(np.arange(1 << CELL_BITS) >> bit & 1) << 3 * bit for bit in range(CELL_BITS)], axis=0)
# A key is the way that a face looks, above the Morton code of a cube. A pass sorts by `DIGIT_BITS` of it.
CODE_BITS, DIGIT_BITS, DIGITS = 3 * CELL_BITS, 12, 3

Grids = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def shared_values(
    triangles: np.ndarray, facing: np.ndarray, grids: Grids, count: int, pitch: float, half_side: float
) -> np.ndarray:
    """Return which value (p,) int64 is that of each place, in order of cubes along a Morton curve.

    Parameters
    ----------
    triangles, facing
        (F, 3, 3) corners in the unit frame, and the way (F,) that they look.
    grids
        As of `FaceLattice.grids`.
    count
        Places.
    pitch, half_side
        Side of a cube, and what is added to coordinates before cubes are counted.
    """
    keys = np.empty(count, dtype=np.int64)
    ways = facing.astype(np.int64) << CODE_BITS
    cubes = pitch, half_side, CELL_SPREAD
    _write_keys(np.ascontiguousarray(triangles), ways, grids, cubes, np.empty(3), keys)
    order, other = np.arange(count), np.empty(count, dtype=np.int64)
    for digit in range(DIGITS):
        starts = np.zeros((1 << DIGIT_BITS) + 1, dtype=np.int64)
        _sort_digit(keys, order, other, digit * DIGIT_BITS, starts)
        order, other = other, order
    _number(keys, order, other)
    return other


@arrayless(kernel)
def _write_keys(triangles, ways, grids, cubes, barycentric, keys):
    """Write the key of each place: rounded as `FaceLattice.places` without steps rounds.

    `ways` (F,) are the bits above the Morton code.
    """
    (corners, columns, rows, start), (pitch, half_side, spread) = grids, cubes
    cells = len(spread) - 1
    for f in range(len(triangles)):
        at = start[f]
        for j in range(rows[f] + 1):
            for i in range(columns[f] + 1):
                x, y = i / columns[f], j / rows[f]
                beyond = max(x + y, 1.0)
                x, y = x / beyond, y / beyond
                barycentric[corners[f, 0]] = min(max(1.0 - x - y, 0.0), 1.0)
                barycentric[corners[f, 1]] = min(max(x, 0.0), 1.0)
                barycentric[corners[f, 2]] = min(max(y, 0.0), 1.0)
                key = ways[f]
                for axis in range(3):
                    position = (
                        barycentric[0] * triangles[f, 0, axis]
                        + barycentric[1] * triangles[f, 1, axis]
                        + barycentric[2] * triangles[f, 2, axis]
                    )
                    cell = math.floor((position + half_side) / pitch)
                    key |= spread[cell & cells] << (2 - axis)
                keys[at] = key
                at += 1


@arrayless(kernel)
def _sort_digit(keys, order, sorted_order, shift, starts):
    """Write an order (p,) sorted by some bits of keys (p,), otherwise as it was."""
    mask = len(starts) - 2
    for place in order:
        starts[(keys[place] >> shift & mask) + 1] += 1
    for digit in range(1, len(starts)):
        starts[digit] += starts[digit - 1]
    for place in order:
        digit = keys[place] >> shift & mask
        sorted_order[starts[digit]] = place
        starts[digit] += 1


@arrayless(kernel)
def _number(keys, order, numbers):
    """Write for each place (p,) how many keys differ before its own in order."""
    number, last = -1, -1
    for place in order:
        if keys[place] != last:
            number += 1
            last = keys[place]
        numbers[place] = number
