"""Shadows that what indents the gel casts over it, from each lamp; a pass over a finished picture.

In the picture all lines through a lamp pass through one point, its image. One over the depth of a straight
ray, n, is linear along such a line. So a pixel is in the dark where the line from the lamp's image to it has
met a greater (n - n_lamp) / distance of the membrane. One running maximum a line serves all its pixels
(horizon mapping: Max 1988, The Visual Computer 4(2)).

Lines that run along the rows more than across them form a fan, which is swept column by column; the others
are swept row by row. Distances along a line may be counted in columns, or rows: only their ratios matter. So
one factor serves a whole column, and values are interpolated within it alone.

What faces away from a lamp is dark by its shading, and is left as it is here.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from objectfolder.jit import arrayless, inner, kernel
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.sensor import Sensor


@dataclass(frozen=True, eq=False)
class ShadowCaster:
    """What casting shadows takes of a sensor with lamps that cast them.

    Parameters
    ----------
    gel_depth
        (height, width) float32, metres: of the undeformed gel along the ray of each pixel's centre.
    fans
        (fans, 6) float64: index of a lamp, whether its lines are swept row by row (0) or column by column
        (1), in their order (1) or against it (-1), tangent of line 0 to the sweep, step of the tangent,
        with which lines are at most a pixel apart, and number of lines.
    lamps
        (lamps, 3) float64: row and column of its image, and one over its depth.
    shares
        (lamps, 3) float32: how much of a pixel's value goes where a lamp is hidden.
    softness
        (2,) float32, metres: height of a lamp, and of the least penumbra.
    """

    gel_depth: np.ndarray
    fans: np.ndarray
    lamps: np.ndarray
    shares: np.ndarray
    softness: np.ndarray

    def cast(self, rgb: np.ndarray, depth: np.ndarray) -> None:
        """Darken a picture by its shadows.

        Parameters
        ----------
        rgb
            (height, width, 3) uint8; changed.
        depth
            (height, width) float32, metres: how far the membrane is pressed in.
        """
        if (light := self._light(depth)) is not None:
            _darken(rgb, light)

    def light(self, depth: np.ndarray) -> np.ndarray:
        """Share (height, width, 3) float32 of each value that the shadows leave; `depth` as of `cast`."""
        light = self._light(depth)
        return np.ones((*depth.shape, 3), np.float32) if light is None else light.reshape(*depth.shape, 3)

    def _light(self, depth: np.ndarray) -> np.ndarray | None:
        """Share (height * width, 3) that the shadows leave of values; None where nothing is pressed in."""
        height, width = depth.shape
        rows, columns = np.flatnonzero(depth.max(axis=1) > 0), np.flatnonzero(depth.max(axis=0) > 0)
        if not len(rows):
            return None
        row_ends, column_ends = (int(rows[0]), int(rows[-1])), (int(columns[0]), int(columns[-1]))
        light = np.ones((height * width, 3), np.float32)
        nearness = np.float32(1) / (self.gel_depth - depth)
        by_axis = [(nearness, depth)]
        if self.fans[:, 1].any():
            by_axis.append((np.ascontiguousarray(nearness.T), np.ascontiguousarray(depth.T)))
        for index, axis, direction, tangent, step, count in self.fans.tolist():
            row, column, near = self.lamps[int(index)].tolist()
            if axis == 0:
                lamp, ends, beside, strides = (row, column, near), row_ends, column_ends, (width, 1)
            else:
                lamp, ends, beside, strides = (column, row, near), column_ends, row_ends, (1, width)
            first, number = _lines((direction, tangent, step, count), lamp, ends, beside)
            if number:
                swept = int(direction), tangent + first * step, step
                lines, share = Lines(*np.zeros((5, number + 2), np.float32)), self.shares[int(index)]
                target = light, *strides
                _sweep(by_axis[int(axis)], ends, swept, lamp, lines, share, self.softness, target)
        return light


class Lines(NamedTuple):
    """Of each line of a fan (n,) float32, with room for two more, as a sweep reaches a row.

    Parameters
    ----------
    horizons, tops
        The greatest slope from the lamp that the line has met, and how far from the lamp.
    nearness, slopes
        One over the depth in the row, and the slope from the lamp.
    dark
        How dark the line is.
    """

    horizons: np.ndarray
    tops: np.ndarray
    nearness: np.ndarray
    slopes: np.ndarray
    dark: np.ndarray


@lru_cache(maxsize=8)
def shadow_caster(sensor: Sensor) -> ShadowCaster | None:
    """Return how a sensor's shadows are cast; None where it has none."""
    if not sensor.shadow_positions_m:
        return None
    height, width = sensor.image_height, sensor.image_width
    pixels_a_slope = height / (2 * np.tan(np.radians(sensor.field_of_view_deg) / 2))
    lamps, fans = [], []
    for index, position in enumerate(sensor.shadow_positions_m):
        ahead, across, up = np.asarray(position) - np.asarray(sensor.camera_position_m)
        row = height / 2 - 0.5 - up / ahead * pixels_a_slope
        column = width / 2 - 0.5 - across / ahead * pixels_a_slope
        lamps.append((row, column, 1 / ahead))
        fans += [(index, *fan) for fan in _fans(row, column, height, width)]
    return ShadowCaster(
        ray_grid(sensor, 1).gel_depth.reshape(height, width).astype(np.float32),
        np.array(fans), np.array(lamps), np.array(sensor.shadow_shares, dtype=np.float32),
        np.array([sensor.shadow_lamp_height_m, sensor.shadow_penumbra_m], dtype=np.float32),
    )  # fmt: skip


def _fans(row: float, column: float, height: int, width: int) -> Iterator[tuple[float, ...]]:
    """Yield what `ShadowCaster.fans` holds of each fan of a lamp's image, but for the lamp."""
    down, right = np.mgrid[:height, :width] - np.array([row, column])[:, None, None]
    by_rows = np.abs(down) >= np.abs(right)
    for axis, along, beside, mine in ((0, down, right, by_rows), (1, right, down, ~by_rows)):
        for direction in (1, -1):
            fan = mine & (along * direction > 0)
            if fan.any():
                tangent, step = beside[fan] / np.abs(along[fan]), 1 / np.abs(along[fan]).max()
                yield axis, direction, tangent.min(), step, np.ceil(np.ptp(tangent) / step) + 1


def _lines(
    fan: tuple[float, ...], lamp: tuple[float, ...], ends: tuple[int, int], beside: tuple[int, int]
) -> tuple[int, int]:
    """First line of a fan that what is pressed in may meet, and how many there are.

    It lies in the rows `ends` and the columns `beside`, first and last.
    """
    direction, tangent, step, count = fan
    last = int(count) - 1
    if min((end - lamp[0]) * direction for end in ends) < 1:
        return 0, last + 1
    met = [((column - lamp[1]) / abs(row - lamp[0]) - tangent) / step for row in ends for column in beside]
    first = min(max(math.floor(min(met)) - 1, 0), last)
    return first, max(min(math.ceil(max(met)) + 1, last) - first + 1, 0)


@inner(arrayless(kernel))
def _follow(near, pressed, columns, span, inverse, lamp_nearness, lines):
    """Interpolate a row at lines first..last of a span: one over the depth, and the slope from the lamp.

    `columns` are that of line 0 and those between lines. Writes to `dark` 0 where what is pressed in faces
    away from the lamp, else 1.
    """
    (start, spacing), (low, high) = columns, span
    nearness, slopes, dark = lines.nearness, lines.slopes, lines.dark
    one, half, last = np.float32(1), np.float32(0.5), np.int32(len(near) - 2)
    for k in range(np.uint64(low), np.uint64(high + 1)):
        place = start + spacing * np.float32(np.int32(k))
        whole = np.int32(place)
        whole = whole if whole < last else last
        r, j = place - np.float32(whole), np.uint64(whole)
        n = (one - r) * near[j] + r * near[j + np.uint64(1)]
        slope = (n - lamp_nearness) * inverse
        away = (slope < slopes[k]) & (pressed[np.uint64(np.int32(place + half))] > 0)
        nearness[k], slopes[k] = n, slope
        dark[k] = np.float32(0) if away else one


@inner(arrayless(kernel))
def _advance(lines, span, distance, lamp_nearness, softness, past):
    """Write to `dark` how dark lines first..last of a span are in a row.

    From `past` on nothing is pressed in: a line ends where it sees the lamp again.
    """
    (low, high), lamp_height, least = span, softness[0], softness[1]
    nearness, horizons, tops, dark = lines.nearness, lines.horizons, lines.tops, lines.dark
    one, inverse = np.float32(1), np.float32(1) / distance
    open_end = np.float32(-np.inf)
    for k in range(np.uint64(low), np.uint64(high + 1)):
        n, horizon, top = nearness[k], horizons[k], tops[k]
        slope = (n - lamp_nearness) * inverse
        penumbra = lamp_height * (one - top * inverse) + least
        hidden = (horizon - slope) * top / (n * n * penumbra)
        behind = slope < horizon
        shade = (hidden if hidden < one else one) * dark[k]
        shade = shade if behind else np.float32(0)
        dark[k] = shade
        horizons[k] = horizon if behind else (open_end if past else slope)
        tops[k] = top if behind else distance


@inner(arrayless(kernel))
def _take(light, at, step, share, dark, first, pitch, span):
    """Take from pixels first..last of a span of a row of `light` what its lines are dark."""
    low, high = span
    one = np.float32(1)
    red, green, blue = share[0], share[1], share[2]
    for j in range(np.uint64(low), np.uint64(high + 1)):
        place = first + pitch * np.float32(np.int32(j))
        place = place if place > 0 else np.float32(0)
        whole = np.int32(place)
        r, k = place - np.float32(whole), np.uint64(whole)
        shade = (one - r) * dark[k] + r * dark[k + np.uint64(1)]
        pixel = at + step * j
        light[pixel, 0] *= one - red * shade
        light[pixel, 1] *= one - green * shade
        light[pixel, 2] *= one - blue * shade


@arrayless(kernel)
def _sweep(membrane, ends, fan, lamp, lines, share, softness, target):
    """Darken `target` by a fan that is swept row by row.

    Parameters
    ----------
    membrane
        (height, width) one over its depth, and how far it is pressed in.
    ends
        First and last row in which what is pressed in lies.
    fan
        Direction of the sweep, tangent of the first line, and step of the tangent.
    lamp, share, softness
        As of `ShadowCaster`.
    lines
        Working memory, of 0.
    target
        Light (pixels, 3), and how many pixels its rows and its columns are apart.
    """
    (nearness, depth), (direction, tangent, step), (light, stride, pixel) = membrane, fan, target
    height, width = nearness.shape
    horizons, slopes, dark = lines.horizons, lines.slopes, lines.dark
    lamp_nearness, count = np.float32(lamp[2]), len(dark) - 2
    start, past = (ends[0], ends[1]) if direction > 0 else (ends[1], ends[0])
    horizons[:] = -np.inf
    slopes[:] = -np.inf
    # Beside the outermost lines nothing is dark.
    row = start - direction
    if row < 0 or row >= height:
        row = start
    while 0 <= row < height:
        distance, over = (row - lamp[0]) * direction, (row - past) * direction > 0
        at = row
        row += direction
        if distance <= 0:
            continue
        # Column of the first line, and columns between lines.
        begin, spacing = lamp[1] + tangent * distance, step * distance
        least, most = np.ceil(-begin / spacing), np.floor((width - 1 - begin) / spacing)
        low = np.int64(least if least > 0 else 0.0)
        high = np.int64(most if most < count - 1 else count - 1.0)
        if low > high:
            continue
        dark[:] = 0
        far = np.float32(distance)
        columns = np.float32(begin), np.float32(spacing)
        inverse = np.float32(1) / far
        _follow(nearness[at], depth[at], columns, (low, high), inverse, lamp_nearness, lines)
        _advance(lines, (low, high), far, lamp_nearness, softness, over)
        darkest = np.float32(0)
        for k in range(low, high + 1):
            if dark[k] > darkest:
                darkest = dark[k]
        if darkest > 0:
            left, right = np.ceil(begin), np.floor(begin + count * spacing)
            nearest, farthest = np.ceil(lamp[1] - distance), np.floor(lamp[1] + distance)
            left = left if left > nearest else nearest
            right = right if right < farthest else farthest
            left, right = left if left > 0 else 0.0, right if right < width - 1 else width - 1.0
            _take(
                light, np.uint64(at * stride), np.uint64(pixel), share, dark, np.float32(-begin / spacing),
                np.float32(1 / spacing), (np.int64(left), np.int64(right)),
            )  # fmt: skip
        elif over:
            break


@arrayless(kernel)
def _darken(rgb, light):
    values, shares = rgb.reshape(-1), light.reshape(-1)
    for index in range(len(values)):
        values[index] = np.uint8(values[index] * shares[index] + np.float32(0.5))
