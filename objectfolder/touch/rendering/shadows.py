"""Shadows that what indents the gel casts over it, from each lamp; a pass over a finished picture.

In the picture all lines through a lamp pass through one point, its image. One over the depth of a straight
ray, n, is linear along such a line. So a pixel is in the dark where the line from the lamp's image to it has
met a greater (n - n_lamp) / distance of the membrane. One running maximum a line serves all its pixels
(horizon mapping: Max 1988, The Visual Computer 4(2)).

What faces away from a lamp is dark by its shading, and is left as it is here.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

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
    line, distance
        (lamps, height, width) float32: on which line through the image of a lamp a pixel lies, and how many
        pixels from that image. Lines are less than a pixel apart.
    lamps
        (lamps, 5) float64: row and column of its image, one over its depth, angle of line 0, angle between
        lines.
    shares
        (lamps, 3) float32: how much of a pixel's value goes where a lamp is hidden.
    softness
        (2,) float64, metres: height of a lamp, and of the least penumbra.
    """

    gel_depth: np.ndarray
    line: np.ndarray
    distance: np.ndarray
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
        _darken(rgb, *self._remaining(depth))

    def light(self, depth: np.ndarray) -> np.ndarray:
        """Share (height, width, 3) float32 of each value that the shadows leave; `depth` as of `cast`."""
        return np.asarray(self._remaining(depth)[0])

    def _remaining(self, depth: np.ndarray) -> tuple[np.ndarray, tuple[int, int, int, int]]:
        maps = self.gel_depth, self.line, self.distance
        return _remaining(depth, *maps, self.lamps, self.shares, self.softness)


@lru_cache(maxsize=8)
def shadow_caster(sensor: Sensor) -> ShadowCaster | None:
    """Return how a sensor's shadows are cast; None where it has none."""
    if not sensor.shadow_positions_m:
        return None
    height, width = sensor.image_height, sensor.image_width
    gel_depth = ray_grid(sensor, 1).gel_depth.reshape(height, width)
    pixels_a_slope = height / (2 * np.tan(np.radians(sensor.field_of_view_deg) / 2))
    rows, columns = np.mgrid[:height, :width].astype(np.float64)
    line, distance = (np.empty((len(sensor.shadow_positions_m), height, width), np.float32) for _ in range(2))
    lamps = np.empty((len(line), 5))
    for index, position in enumerate(sensor.shadow_positions_m):
        ahead, across, up = np.asarray(position) - np.asarray(sensor.camera_position_m)
        row = height / 2 - 0.5 - up / ahead * pixels_a_slope
        column = width / 2 - 0.5 - across / ahead * pixels_a_slope
        middle = np.arctan2(height / 2 - row, width / 2 - column)
        turned = np.arctan2(rows - row, columns - column) - middle
        angle = (turned + np.pi) % (2 * np.pi) - np.pi
        far = np.hypot(rows - row, columns - column)
        lamps[index] = row, column, 1 / ahead, middle + angle.min(), 1 / far.max()
        line[index], distance[index] = (angle - angle.min()) * far.max(), far
    return ShadowCaster(
        gel_depth.astype(np.float32), line, distance, lamps,
        np.array(sensor.shadow_shares, dtype=np.float32),
        np.array([sensor.shadow_lamp_height_m, sensor.shadow_penumbra_m]),
    )  # fmt: skip


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
def _span(values, box):
    """Least and greatest of values over a box of pixels."""
    least, most = values[box[0], box[2]], values[box[0], box[2]]
    for i in range(box[0], box[1] + 1):
        for j in range(box[2], box[3] + 1):
            least, most = min(least, values[i, j]), max(most, values[i, j])
    return least, most


@kernel
def _march(nearness, depth, lamp, softness, angle, start, past, dark):
    """Write how dark the steps of a line are; return the last that is, or -1.

    Steps are a pixel long from `start` on; from `past` on nothing is pressed in.
    """
    down, right = np.sin(angle), np.cos(angle)
    horizon, top, before, last = -np.inf, 0.0, -np.inf, -1
    for step in range(len(dark)):
        distance = start + step
        row, column = lamp[0] + distance * down, lamp[1] + distance * right
        i, j = int(np.floor(row)), int(np.floor(column))
        if i < 0 or j < 0 or i > nearness.shape[0] - 2 or j > nearness.shape[1] - 2:
            if distance > past:
                break
            continue
        b, r = row - i, column - j
        near = (1 - b) * ((1 - r) * nearness[i, j] + r * nearness[i, j + 1])
        near += b * ((1 - r) * nearness[i + 1, j] + r * nearness[i + 1, j + 1])
        slope = (near - lamp[2]) / distance
        if slope >= horizon:
            horizon, top = slope, distance
            if distance > past:
                break
        else:
            away = slope < before and depth[i + int(b + 0.5), j + int(r + 0.5)] > 0
            hidden = (horizon - slope) * top / (near * near)
            penumbra = softness[0] * (distance - top) / distance + softness[1]
            if not away:
                dark[step] = min(hidden / penumbra, 1.0)
                last = step
        before = slope
    return last


@kernel
def _remaining(depth, gel_depth, line, distance, lamps, shares, softness):
    """Share of each value that the shadows leave, and first and last row and column where it is not 1."""
    height, width = depth.shape
    light = np.ones((height, width, 3), np.float32)
    low_row, high_row, low_column, high_column = height, -1, width, -1
    box = _extent(depth)
    if box[1] < 0:
        return light, (low_row, high_row, low_column, high_column)
    nearness = 1 / gel_depth
    for i in range(box[0], box[1] + 1):
        for j in range(box[2], box[3] + 1):
            nearness[i, j] = 1 / (gel_depth[i, j] - depth[i, j])
    one = np.float32(1)
    for index in range(len(lamps)):
        lamp, share = lamps[index], shares[index]
        first, last = _span(line[index], box)
        start, past = _span(distance[index], box)
        first_line, begin = int(first) - 1, np.floor(float(start)) - 1
        count = int(last) + 3 - first_line
        # As far as the picture reaches.
        steps = int(1 / lamp[4] - begin) + 2
        dark = np.zeros((count, steps), np.float32)
        top, bottom, left, right = height, -1, width, -1
        for k in range(count):
            angle = lamp[3] + (first_line + k) * lamp[4]
            end = _march(nearness, depth, lamp, softness, angle, begin, past, dark[k])
            if end < 0:
                continue
            for far in (begin, begin + end):
                row, column = int(lamp[0] + far * np.sin(angle)), int(lamp[1] + far * np.cos(angle))
                top, bottom = min(top, row - 1), max(bottom, row + 2)
                left, right = min(left, column - 1), max(right, column + 2)
        top, bottom, left, right = max(top, 0), min(bottom, height - 1), max(left, 0), min(right, width - 1)
        low_row, high_row = min(low_row, top), max(high_row, bottom)
        low_column, high_column = min(low_column, left), max(high_column, right)
        for i in range(top, bottom + 1):
            for j in range(left, right + 1):
                a, d = line[index, i, j] - first_line, distance[index, i, j] - begin
                k, step = int(a), int(d)
                if a < 0 or d < 0 or k > count - 2 or step > steps - 2:
                    continue
                b, f = a - np.float32(k), d - np.float32(step)
                shade = (one - b) * ((one - f) * dark[k, step] + f * dark[k, step + 1])
                shade += b * ((one - f) * dark[k + 1, step] + f * dark[k + 1, step + 1])
                for channel in range(3):
                    light[i, j, channel] *= one - share[channel] * shade
    return light, (low_row, high_row, low_column, high_column)


@kernel
def _darken(rgb, light, box):
    for i in range(box[0], box[1] + 1):
        for j in range(box[2], box[3] + 1):
            for channel in range(3):
                rgb[i, j, channel] = np.uint8(rgb[i, j, channel] * light[i, j, channel] + np.float32(0.5))
