"""What an indentation changes beyond itself: a pass over a finished picture."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from functools import lru_cache

import numpy as np

from objectfolder.jit import kernel
from objectfolder.touch.rendering.shadows import ShadowCaster, shadow_caster
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.indentation_response import Cells, IndentationResponse
from objectfolder.touch.sensor.sensor import Sensor


class ResponseCaster:
    """Adds a sensor's response to an indentation to its pictures, beyond the contact."""

    def __init__(self, response: IndentationResponse, sensor: Sensor) -> None:
        self._cells = Cells.of(sensor.image_height, sensor.image_width)
        self._terms = self._cells.terms()
        # Grey levels of red, green and blue side by side, an indentation of a metre.
        patterns = response.coefficients.astype(np.float32) * np.float32(255e3)
        self._patterns = np.moveaxis(patterns, 0, -1).reshape(*patterns.shape[1:3], -1)
        self._nearest = _neighbours(self._cells.up), _neighbours(self._cells.back)
        self._untouched = no_contact_image(sensor)

    def cast(self, rgb: np.ndarray, depth: np.ndarray, touched: np.ndarray | None = None) -> None:
        """Add what an indentation changes; arguments as of `Surroundings.cast`."""
        if touched is not None:
            rgb[~touched] = self._untouched[~touched]
            depth = np.where(touched, depth, np.float32(0))
        means = self._cells.down @ depth @ self._cells.across.T
        if means.any():
            field = np.zeros((*means.shape, 3), np.float32)
            _spread(means, self._terms, self._patterns, field.reshape(len(field), -1))
            _add(rgb, depth, field, *self._nearest[0], *self._nearest[1])


def _neighbours(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first of the two cells between which pixels are interpolated, and the weight of the second."""
    first = np.minimum((weights > 0).argmax(axis=1), weights.shape[1] - 2)
    return first, weights[np.arange(len(weights)), first + 1]


@kernel
def _spread(means, terms, patterns, field):
    """Add to `field` (rows, 3 columns) the patterns (3, side, 3 side) of all indented cells."""
    rows, columns = means.shape
    side = patterns.shape[1]
    reach = side // 2
    for row in range(rows):
        for column in range(columns):
            indentation = means[row, column]
            if indentation == 0:
                continue
            a, b, c = (
                indentation * terms[0, row, column],
                indentation * terms[1, row, column],
                indentation * terms[2, row, column],
            )
            left, right = max(0, reach - column), min(side, columns + reach - column)
            start = 3 * (column + left - reach)
            for i in range(max(0, reach - row), min(side, rows + reach - row)):
                first, second, third = (
                    patterns[0, i, 3 * left : 3 * right],
                    patterns[1, i, 3 * left : 3 * right],
                    patterns[2, i, 3 * left : 3 * right],
                )
                into = field[row + i - reach, start : start + 3 * (right - left)]
                for k in range(len(into)):
                    into[k] += a * first[k] + b * second[k] + c * third[k]


@kernel
def _add(rgb, depth, field, above, lower, before, after):
    """Add a field between cells to the pixels of `rgb` beyond the contact, rounded to nearest."""
    height, width = depth.shape
    half, low, high = np.float32(0.5), np.float32(0), np.float32(255)
    line = np.empty(field.shape[1:], np.float32)
    for row in range(height):
        upper, down = above[row], lower[row]
        line[:] = field[upper] + down * (field[upper + 1] - field[upper])
        for column in range(width):
            if depth[row, column] != 0:
                continue
            first, along = before[column], after[column]
            for channel in range(3):
                base = line[first, channel]
                value = rgb[row, column, channel] + base + along * (line[first + 1, channel] - base)
                rgb[row, column, channel] = np.uint8(min(max(value, low), high) + half)


class Surroundings:
    """Shadows and response of a sensor, either of which it may lack."""

    def __init__(self, shadows: ShadowCaster | None, response: ResponseCaster | None) -> None:
        self.shadows, self.response = shadows, response

    def cast(self, rgb: np.ndarray, depth: np.ndarray, touched: np.ndarray | None = None) -> None:
        """Change a picture by what is pressed in.

        Parameters
        ----------
        rgb
            (height, width, 3) uint8; changed.
        depth
            (height, width) float32, metres: how far the membrane is pressed in.
        touched
            (height, width) bool, where a deformed gel is touched. A response holds the gel's bulge, which
            the picture then does not show once more.
        """
        if self.shadows is not None:
            self.shadows.cast(rgb, depth)
        if self.response is not None:
            self.response.cast(rgb, depth, touched)


@lru_cache(maxsize=8)
def surroundings(sensor: Sensor) -> Surroundings | None:
    """Return what a sensor's indentations change beyond themselves; None where it knows of nothing."""
    shadows, response = shadow_caster(sensor), sensor.indentation_response
    if shadows is None and response is None:
        return None
    return Surroundings(shadows, None if response is None else ResponseCaster(response, sensor))
