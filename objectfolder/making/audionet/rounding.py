"""Fields rounded to whole numbers with one step, as well as asked or in as few bytes as there are."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.audionet.corrections import Fields
from objectfolder.making.audionet.least_squares import Data
from objectfolder.products.integer_coding import pack_integers, zigzag
from objectfolder.products.matrix_coding import pack_matrix

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Rounding up from 0.6 rather than 0.5 saves more bytes than a finer step would cost for the same error.
ROUND_UP_FROM = 0.6
# Squared steps of error that are worth a bit: 2 ln 2 / 12 for a fine rounding, more for a coarse one.
WORTH_A_BIT = 0.25
# Bits of a vertex's number, of a value that is not zero (and two more for each doubling), and of a zero.
BITS_OF_VERTEX, BITS_OF_VALUE, BITS_OF_ZERO = 16.0, 4.0, 0.15
# Rounds of finding a step, and of finding one that fits.
TRIED, TRIED_TO_FIT = 4, 5


@dataclass(frozen=True)
class Rounded:
    """Whole numbers (controls + corrected vertices, columns), those vertices, and the steps (2,) of both."""

    numbers: Integers
    vertices: Integers
    steps: Floats

    def tensors(self) -> dict[str, np.ndarray]:
        """What is stored of it."""
        return {
            "coefficients": pack_matrix(self.numbers),
            "corrected": pack_integers(zigzag(np.diff(self.vertices, prepend=0))),
            "step": self.steps,
        }

    def bytes(self) -> int:
        """Of the tensors."""
        return sum(tensor.nbytes for tensor in self.tensors().values())

    def change(self, fields: Fields) -> Fields:
        """What rounding adds to `fields`."""
        count = len(fields.coefficients)
        coefficients = self.numbers[:count] * self.steps[0] - fields.coefficients
        if fields.corrections is None:
            return replace(fields, coefficients=coefficients)
        corrections = -fields.corrections
        corrections[self.vertices] += self.numbers[count:] * self.steps[1]
        return replace(fields, coefficients=coefficients, corrections=corrections)


def round_fields(fields: Fields, tested: Data, allowed: float, room: int) -> Rounded:
    """Whole numbers for a relative error allowed at the points tested, or more to fit into `room` bytes.

    Control points are not spread by area alone: what a step's error is on the surface is tried.

    Raises
    ------
    ValueError
        Bytes that do not hold them, however coarse.
    """
    largest = float(np.abs(fields.coefficients).max())
    step = _step(fields, allowed)
    for _ in range(TRIED if len(tested.values) else 0):
        error = float(np.linalg.norm(_round(fields, step).change(fields).at(tested)))
        goal = allowed * float(np.linalg.norm(tested.values))
        step *= min(max(goal / max(error, 1e-300), 0.1), 10.0)
    low = high = step
    while (rounded := _round(fields, high)).bytes() > room:
        if high > 4 * largest:
            raise ValueError(f"{room} bytes are too few for {fields.coefficients.shape[1]} columns")
        low, high = high, 2 * high
    for _ in range(TRIED_TO_FIT if high > step else 0):
        middle = float(np.sqrt(low * high))
        finer = _round(fields, middle)
        if finer.bytes() <= room:
            high, rounded = middle, finer
        else:
            low = middle
    return rounded


def bytes_rounded(fields: Fields, allowed: float) -> int:
    """Bytes of fields rounded to about the relative error allowed."""
    return _round(fields, _step(fields, allowed)).bytes()


def _step(fields: Fields, allowed: float) -> float:
    """Step whose rounding makes about the relative error allowed."""
    return allowed * float(np.sqrt(12 * np.mean(fields.coefficients**2)))


def _round(fields: Fields, step: float) -> Rounded:
    """Whole numbers for a step of the coefficients.

    The mean square over the surface of a hat function is half of a vertex's share of the area, that of a
    coefficient's function a control point's share: their steps make errors of one size.
    """
    numbers = _whole(fields.coefficients / step)
    if fields.corrections is None:
        return Rounded(numbers, np.zeros(0, dtype=np.int64), np.array([step, step]))
    coarse = step * float(np.sqrt(2 * len(fields.corrections) / len(numbers)))
    exact = np.abs(fields.corrections) / coarse
    whole = _whole(fields.corrections / coarse)
    size = np.abs(whole)
    gain = np.sum((2 * exact - size) * size, axis=1)
    bits = np.where(whole != 0, BITS_OF_VALUE + 2 * np.log2(np.maximum(size, 1)), BITS_OF_ZERO).sum(axis=1)
    vertices = np.flatnonzero(gain > WORTH_A_BIT * (BITS_OF_VERTEX + bits))
    return Rounded(np.concatenate([numbers, whole[vertices]]), vertices, np.array([step, coarse]))


def _whole(values: Floats) -> Integers:
    return (np.sign(values) * np.floor(np.abs(values) + (1 - ROUND_UP_FROM))).astype(np.int64)
