"""How light changes over a membrane by what is pressed into it elsewhere: shadows, and the gel's bulge.

Beyond a contact a photometric table alone shows the untouched gel. There a real membrane leans, and what
indents it hides it from the lamps. To first order the change is linear in the indentation: each cell of it
adds a pattern round itself, of a strength and colour that vary linearly over the picture. In the contact the
table has all of it, and nothing is added.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from objectfolder.touch.sensor.half_float_table import HalfFloatTable

CHANNELS, TERMS = 3, 3
# Square cells of the picture: so many a height.
ROWS = 40
LARGEST = 65  # cells of a side of a pattern
# Half the side of a pattern that is fitted, cells.
RESPONSE_REACH = 8
# Of the weight of a pattern's roughness: that of its size.
RIDGE = 0.1
# Of a cell: less of it beyond the contact says nothing.
LEAST_BEYOND = 0.5


@dataclass(frozen=True, eq=False)
class IndentationResponse(HalfFloatTable):
    """Patterns that an indented cell of the picture adds round itself.

    Parameters
    ----------
    coefficients
        (3, 3, n, n) float16: of red, green and blue, 0..1, a millimetre of a cell's mean indentation; for
        the terms 1, a, b of the cell's place, halves of the picture's width to the right and of its height
        down from its middle; and the pattern, rows down and columns to the right, the cell in its middle.

    Raises
    ------
    ValueError
        Another shape or type, or values that are not finite.
    """

    NAME: ClassVar[str] = "indentation response"
    LAYOUT: ClassVar[str] = f"({CHANNELS} channels, {TERMS} terms, n, n) with n odd and at most {LARGEST}"

    @classmethod
    def fits(cls, shape: tuple[int, ...]) -> bool:
        """Whether coefficients may have this shape."""
        return shape[:2] == (CHANNELS, TERMS) and len(shape) == 4 and _is_side(shape[2], shape[3])


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of a picture, of height / `ROWS` on a side, about its middle.

    Parameters
    ----------
    down, across
        (rows, height) and (columns, width) float32: means of pixels over cells, along each axis.
    up, back
        (height, rows) and (width, columns) float32: interpolation from the middles of cells to pixels.
    """

    down: np.ndarray
    across: np.ndarray
    up: np.ndarray
    back: np.ndarray

    @classmethod
    def of(cls, height: int, width: int) -> "Cells":
        """Return the cells of a picture of a size."""
        pitch = height / ROWS
        vertical, horizontal = _axis(height, pitch), _axis(width, pitch)
        return cls(vertical[0], horizontal[0], vertical[1], horizontal[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return len(self.down), len(self.across)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Means (rows, columns, ...) of pixels (height, width, ...) over the cells."""
        over = np.tensordot(self.down, values, (1, 0))
        return np.asarray(np.moveaxis(np.tensordot(self.across, over, (1, 1)), 0, 1))

    def terms(self) -> np.ndarray:
        """Terms (3, rows, columns) of the cells' places, as `IndentationResponse` has them."""
        b, a = np.meshgrid(*(_middles(count) for count in self.shape), indexing="ij")
        return np.stack([np.ones_like(a), a, b]).astype(np.float32)


class ResponseField:
    """Changes of pictures of a size by a response."""

    def __init__(self, response: IndentationResponse, height: int, width: int) -> None:
        self._cells = Cells.of(height, width)
        self._reach = response.coefficients.shape[-1] // 2
        self._shape = tuple(count + 2 * self._reach for count in self._cells.shape)
        self._terms = self._cells.terms()
        patterns = response.coefficients.astype(np.float32) * np.float32(1e3)
        self._spectra = np.fft.rfft2(patterns, self._shape)

    def change(self, depth: np.ndarray) -> np.ndarray:
        """Change (height, width, 3) float32 of values 0..1 by an indentation (height, width), metres."""
        rows, columns = self._cells.shape
        sources = np.fft.rfft2(self._cells.mean(depth) * self._terms, self._shape)
        fields = np.fft.irfft2(np.einsum("ctij,tij->cij", self._spectra, sources), self._shape)
        kept = fields[:, self._reach : self._reach + rows, self._reach : self._reach + columns]
        wide = self._cells.up @ kept.astype(np.float32) @ self._cells.back.T
        return np.ascontiguousarray(np.moveaxis(wide, 0, -1))


class ResponseFit:
    """Responses fitted to photographs of a ball by linear least squares.

    Parameters
    ----------
    changes
        Of each, (height, width, 3): the photograph less what the sensor shows untouched, grey levels.
    indentations_m
        Of each, (height, width): how far the ball presses the gel in.
    """

    def __init__(self, changes: Mapping[int, np.ndarray], indentations_m: Mapping[int, np.ndarray]) -> None:
        height, width = next(iter(changes.values())).shape[:2]
        self._cells = Cells.of(height, width)
        self._sums = {index: self._sum(changes[index], indentations_m[index]) for index in changes}

    def solve(self, chosen: Sequence[int], roughness: float, unevenness: float) -> IndentationResponse:
        """Return the response that explains best what changes beyond the contacts of those chosen.

        `roughness` is the weight of a pattern's squared second differences; its dependence on the place
        costs `unevenness` times as much.
        """
        from scipy.linalg import solve

        matrix, right = (np.sum([self._sums[index][part] for index in chosen], axis=0) for part in (0, 1))
        held = roughness * np.trace(matrix) / len(matrix) * _roughness(unevenness)
        unknowns = solve(matrix + held, right, assume_a="pos")
        side = 2 * RESPONSE_REACH + 1
        return IndentationResponse(unknowns.T.reshape(CHANNELS, TERMS, side, side).astype(np.float16))

    def _sum(self, change: np.ndarray, indentation_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations (k, k) and (k, 3) of the cells beyond a contact."""
        beyond = (indentation_m == 0).astype(np.float32)
        share = self._cells.mean(beyond)
        kept = share > LEAST_BEYOND
        means = self._cells.mean(change * beyond[..., None])[kept] / share[kept][:, None]
        sources = self._sources(indentation_m)[kept.ravel()].astype(np.float64)
        return sources.T @ sources, sources.T @ (means / 255)

    def _sources(self, indentation_m: np.ndarray) -> np.ndarray:
        """What cells take (cells, k) of the coefficients of a response."""
        weighted = 1e3 * self._cells.mean(indentation_m.astype(np.float32)) * self._cells.terms()
        padded = np.pad(
            weighted, ((0, 0), (RESPONSE_REACH, RESPONSE_REACH), (RESPONSE_REACH, RESPONSE_REACH))
        )
        side = 2 * RESPONSE_REACH + 1
        windows = np.lib.stride_tricks.sliding_window_view(padded, (TERMS, side, side))[0]
        return np.flip(windows, (-2, -1)).reshape(-1, TERMS * side * side)


def _is_side(rows: int, columns: int) -> bool:
    """Whether a pattern of so many cells has one in its middle, and is no larger than allowed."""
    return rows == columns <= LARGEST and rows % 2 == 1


def _middles(count: int) -> np.ndarray:
    return (np.arange(count) + 0.5) * (2 / count) - 1


def _axis(pixels: int, pitch: float) -> tuple[np.ndarray, np.ndarray]:
    """Means over cells (cells, pixels), and interpolation from their middles (pixels, cells)."""
    count = int(np.ceil(pixels / pitch - 1e-9))
    edge = (pixels - count * pitch) / 2 + np.arange(count + 1) * pitch
    low = np.maximum(edge[:-1, None], np.arange(pixels))
    high = np.minimum(edge[1:, None], np.arange(1, pixels + 1))
    place = np.clip((np.arange(pixels) + 0.5 - edge[0]) / pitch - 0.5, 0, count - 1)
    weights = np.maximum(1 - np.abs(place[:, None] - np.arange(count)), 0)
    return (np.maximum(high - low, 0) / pitch).astype(np.float32), weights.astype(np.float32)


def _roughness(unevenness: float) -> np.ndarray:
    """Squared second differences of patterns, and a little of their squares (unknowns, unknowns)."""
    side = 2 * RESPONSE_REACH + 1
    bend = np.eye(side, k=1) - 2 * np.eye(side) + np.eye(side, k=-1)
    laplacian = np.kron(bend, np.eye(side)) + np.kron(np.eye(side), bend)
    once = laplacian.T @ laplacian + RIDGE * np.eye(side * side)
    return np.kron(np.diag([1.0, unevenness, unevenness]), once)
