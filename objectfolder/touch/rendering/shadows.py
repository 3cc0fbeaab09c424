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

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from objectfolder.jit import kernel
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
        _darken(rgb, self._light(depth))

    def light(self, depth: np.ndarray) -> np.ndarray:
        """Share (height, width, 3) float32 of each value that the shadows leave; `depth` as of `cast`."""
        return self._light(depth).reshape(*depth.shape, 3)

    def _light(self, depth: np.ndarray) -> np.ndarray:
        return np.asarray(_light(depth, self.gel_depth, self.fans, self.lamps, self.shares, self.softness))


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


@kernel
def _extent(depth):
    """First and last row and column of what is pressed in; the last before the first where nothing is."""
    top, bottom, left, right = depth.shape[0], -1, depth.shape[1], -1
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            if depth[i, j] > 0:
                top, bottom = min(top, i), max(bottom, i)
                left, right = min(left, j), max(right, j)
    return top, bottom, left, right


@kernel
def _lines(fan, lamp, box):
    """First line of a fan that what is pressed in may meet, and how many there are."""
    last = int(fan[5]) - 1
    nearest = min((box[0] - lamp[0]) * fan[2], (box[1] - lamp[0]) * fan[2])
    if nearest < 1:
        return 0, last + 1
    least, most = np.inf, -np.inf
    for row in (box[0], box[1]):
        for column in (box[2], box[3]):
            line = ((column - lamp[1]) / abs(row - lamp[0]) - fan[3]) / fan[4]
            least, most = min(least, line), max(most, line)
    first = min(max(int(np.floor(least)) - 1, 0), last)
    return first, max(min(int(np.ceil(most)) + 1, last) - first + 1, 0)


@kernel
def _follow(near, pressed, start, spacing, low, high, inverse, lamp_nearness, nearness, slopes, dark):
    """Interpolate a row at lines low..high: one over the depth, and the slope from the lamp.

    Writes to `dark` 0 where what is pressed in faces away from the lamp, else 1.
    """
    one, half, last = np.float32(1), np.float32(0.5), np.int32(len(near) - 2)
    for k in range(np.uint64(low), np.uint64(high + 1)):
        place = start + spacing * np.float32(np.int32(k))
        whole = min(np.int32(place), last)
        r, j = place - np.float32(whole), np.uint64(whole)
        n = (one - r) * near[j] + r * near[j + np.uint64(1)]
        slope = (n - lamp_nearness) * inverse
        away = (slope < slopes[k]) & (pressed[np.uint64(np.int32(place + half))] > 0)
        nearness[k], slopes[k] = n, slope
        dark[k] = np.float32(0) if away else one


@kernel
def _advance(nearness, horizons, tops, dark, low, high, distance, lamp_nearness, softness, least, past):
    """Write to `dark` how dark lines low..high are in a row.

    `horizons` and `tops` are the greatest slope that a line has met, and where. From `past` on nothing is
    pressed in: a line ends where it sees the lamp again.
    """
    one, inverse = np.float32(1), np.float32(1) / distance
    open_end = np.float32(-np.inf)
    for k in range(np.uint64(low), np.uint64(high + 1)):
        n, horizon, top = nearness[k], horizons[k], tops[k]
        slope = (n - lamp_nearness) * inverse
        penumbra = softness * (one - top * inverse) + least
        hidden = (horizon - slope) * top / (n * n * penumbra)
        behind = slope < horizon
        shade = (hidden if hidden < one else one) * dark[k]
        shade = shade if behind else np.float32(0)
        dark[k] = shade
        horizons[k] = horizon if behind else (open_end if past else slope)
        tops[k] = top if behind else distance


@kernel
def _take(light, at, step, share, dark, first, pitch, low, high):
    """Take from pixels low..high of a row of `light` what its lines are dark."""
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


@kernel
def _sweep(nearness, depth, box, fan, lamp, share, softness, light, stride, step):
    """Darken `light` (pixels, 3) by a fan that is swept row by row.

    Of `light`, rows are `stride` pixels apart and columns `step`.
    """
    height, width = nearness.shape
    first, count = _lines(fan, lamp, box)
    direction, lamp_nearness = int(fan[2]), np.float32(lamp[2])
    start, past = (box[0], box[1]) if direction > 0 else (box[1], box[0])
    horizons, slopes = np.full(count, -np.inf, np.float32), np.full(count, -np.inf, np.float32)
    tops, along = np.zeros(count, np.float32), np.zeros(count, np.float32)
    # Beside the outermost lines nothing is dark.
    dark = np.zeros(count + 2, np.float32)
    row = min(max(start - direction, 0), height - 1)
    while 0 <= row < height:
        distance, over = (row - lamp[0]) * direction, (row - past) * direction > 0
        at = row
        row += direction
        if distance <= 0:
            continue
        # Column of the first line, and columns between lines.
        begin, spacing = lamp[1] + (fan[3] + first * fan[4]) * distance, fan[4] * distance
        low = max(int(np.ceil(-begin / spacing)), 0)
        high = min(int(np.floor((width - 1 - begin) / spacing)), count - 1)
        if low > high:
            continue
        dark[:] = 0
        far = np.float32(distance)
        _follow(
            nearness[at], depth[at], np.float32(begin), np.float32(spacing), low, high,
            np.float32(1) / far, lamp_nearness, along, slopes, dark,
        )  # fmt: skip
        _advance(
            along, horizons, tops, dark, low, high, far, lamp_nearness, softness[0], softness[1], over
        )  # fmt: skip
        if dark.max() > 0:
            left = max(np.ceil(begin), np.ceil(lamp[1] - distance), 0.0)
            right = min(np.floor(begin + count * spacing), np.floor(lamp[1] + distance), width - 1.0)
            _take(
                light, np.uint64(at * stride), np.uint64(step), share, dark, np.float32(-begin / spacing),
                np.float32(1 / spacing), int(left), int(right),
            )  # fmt: skip
        elif over:
            break


@kernel
def _light(depth, gel_depth, fans, lamps, shares, softness):
    """Share (height * width, 3) of each value that the shadows leave."""
    height, width = depth.shape
    light = np.ones((height * width, 3), np.float32)
    box = _extent(depth)
    if box[1] < 0:
        return light
    nearness = np.float32(1) / (gel_depth - depth)
    across, deep = nearness, depth
    if fans[:, 1].max() > 0:
        across, deep = nearness.T.copy(), depth.T.copy()
    for fan in fans:
        index = int(fan[0])
        row, column, near = lamps[index]
        if fan[1] == 0:
            lamp = row, column, near
            _sweep(nearness, depth, box, fan, lamp, shares[index], softness, light, width, 1)
        else:
            lamp, sides = (column, row, near), (box[2], box[3], box[0], box[1])
            _sweep(across, deep, sides, fan, lamp, shares[index], softness, light, 1, width)
    return light


@kernel
def _darken(rgb, light):
    values, shares = rgb.reshape(-1), light.reshape(-1)
    for index in range(len(values)):
        values[index] = np.uint8(values[index] * shares[index] + np.float32(0.5))
