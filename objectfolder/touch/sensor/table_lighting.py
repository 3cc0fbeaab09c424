"""A membrane by its photometric table, point by point; as `objectfolder.touch.sensor.shading.look_up`."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from objectfolder.jit import inner, relaxed_kernel
from objectfolder.touch.sensor.photometric_table import PhotometricTable
from objectfolder.touch.sensor.sensor import Sensor

# Points looked up at once: their angles stay in the cache.
LOOKUP_POINTS = 512


@dataclass(frozen=True, eq=False)
class TableLighting:
    """What looking up takes of a sensor, in single precision.

    Parameters
    ----------
    nodes
        (slopes, directions, 18): coefficients, channels before terms.
    place
        (4,): y and z of the gel's apex, half its width and half its height, metres.
    """

    nodes: np.ndarray
    place: np.ndarray

    def shade(self, count: int, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Pixel values (3, count) float32 of the first of points (3, n) with normals (3, n), both float32."""
        return _look_up(count, positions, normals, self.nodes, self.place)


@lru_cache(maxsize=8)
def table_lighting(sensor: Sensor, table: PhotometricTable) -> TableLighting:
    """Return how a sensor with this table is shaded."""
    apex = sensor.gel_apex_m
    place = [apex[1], apex[2], sensor.gel_width_m / 2, sensor.gel_height_m / 2]
    shape = (*table.coefficients.shape[1:3], table.nodes.shape[1])
    return TableLighting(table.nodes.reshape(shape), np.array(place, dtype=np.float32))


@inner(relaxed_kernel)
def _angle(y, x):
    """Angle of (x, y), -pi to pi, within 1e-7: Abramowitz and Stegun 4.4.49, without a branch."""
    one, half_turn = np.float32(1), np.float32(np.pi)
    across, up = abs(x), abs(y)
    t = min(across, up) / max(max(across, up), np.float32(1e-30))
    s = t * t
    series = np.float32(-0.0161657367) + s * np.float32(0.0028662257)
    series = np.float32(0.0429096138) + s * series
    series = np.float32(-0.0752896400) + s * series
    series = np.float32(0.1065626393) + s * series
    series = np.float32(-0.1420889944) + s * series
    series = np.float32(0.1999355085) + s * series
    series = np.float32(-0.3333314528) + s * series
    angle = t * (one + s * series)
    angle = half_turn / 2 - angle if up > across else angle
    angle = half_turn - angle if x < 0 else angle
    return np.float32(-angle if y < 0 else angle)


@relaxed_kernel
def _look_up(count, positions, normals, nodes, place):
    slopes, directions = nodes.shape[0], nodes.shape[1]
    one, zero, round_turn = np.float32(1), np.float32(0), np.float32(directions)
    rows, columns = np.float32((slopes - 1) / (np.pi / 2)), np.float32(directions / (2 * np.pi))
    values = np.empty((3, count), dtype=np.float32)
    row, column = np.empty(LOOKUP_POINTS, dtype=np.float32), np.empty(LOOKUP_POINTS, dtype=np.float32)
    mixed = np.empty(18, dtype=np.float32)
    for start in range(0, count, LOOKUP_POINTS):
        length = min(LOOKUP_POINTS, count - start)
        for j in range(length):
            x, y, z = normals[0, start + j], normals[1, start + j], normals[2, start + j]
            row[j] = min(_angle(np.sqrt(y * y + z * z), -x) * rows, np.float32(slopes - 1))
            turned = _angle(z, -y) * columns
            column[j] = turned + round_turn if turned < zero else turned
        for j in range(length):
            i = start + j
            lower, left = min(int(row[j]), slopes - 2), int(column[j])
            down, along = row[j] - np.float32(lower), column[j] - np.float32(left)
            left = left % directions
            right = (left + 1) % directions
            first, second = (one - down) * (one - along), (one - down) * along
            third, fourth = down * (one - along), down * along
            for k in range(18):
                low = first * nodes[lower, left, k] + second * nodes[lower, right, k]
                mixed[k] = low + third * nodes[lower + 1, left, k] + fourth * nodes[lower + 1, right, k]
            a = (place[0] - positions[1, i]) / place[2]
            b = (positions[2, i] - place[1]) / place[3]
            for channel in range(3):
                k = 6 * channel
                value = mixed[k] + a * (mixed[k + 1] + a * mixed[k + 3] + b * mixed[k + 4])
                value += b * (mixed[k + 2] + b * mixed[k + 5])
                values[channel, i] = min(max(value, zero), one)
    return values
