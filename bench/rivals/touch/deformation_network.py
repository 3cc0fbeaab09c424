"""ObjectFolder 2.0's TouchNet: from a press and a pixel to the gel's deformation, then the sensor's renderer.

Published (paper and public inference code): the perceptron of (x, y, z, tilt, cos and sin of its azimuth,
depth, column, row); positions scaled to [0, 1] by one range, tilt by 0 .. 15 degrees, depth by 0.5 .. 2 mm,
pixels from 0 to 1; one output scaled to [0, 1] by a fixed range. Their renderer is Taxim with the table of a
GelSight; here it is the sensor's own shading, applied to the deformed gel with normals by differences
between pixels, because a map of depths has no others. Their output is the distance to the camera; here it
is how far the gel is pushed in, which is the same but for the undeformed gel.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.rivals.touch.perceptron import Perceptron, Training, fit_perceptron, pixel_grid
from bench.rivals.touch.training_touches import TrainingTouches, checked_points
from objectfolder.products.store import Product
from objectfolder.touch.sensor.camera import ray_grid, to_bytes
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade

NAME = "ObjectFolder 2.0"
MOST_TILT_DEG = 15.0
DEPTHS_M = (0.0005, 0.002)
# The gel is convex towards the object and seen nearly along its axis: each step halves the error or better.
STEPS_ALONG_RAYS = 24


@dataclass(frozen=True)
class DeformationNetwork:
    """A fitted network.

    Attributes
    ----------
    network : of nine coordinates, one output
    sensor : whose images it answers
    lowest_m, extent_m : of the positions' range, metres
    deepest_m : deformation that the output 1 means, metres; 0 means none
    training : what the fit did
    """

    network: Perceptron
    sensor: Sensor
    lowest_m: float
    extent_m: float
    deepest_m: float
    training: Training

    @property
    def bytes(self) -> int:
        """Stored: weights in single precision and the ranges."""
        return 4 * self.network.parameter_count + 24

    def deformation(
        self,
        points: np.ndarray,
        depth_m: float | np.ndarray = 0.001,
        tilt_deg: float | np.ndarray = 0.0,
        azimuth_deg: float | np.ndarray = 0.0,
    ) -> np.ndarray:
        """How far the gel is pushed in, (n, height, width) float32 metres; arguments as of `press`.

        Raises
        ------
        InputError
            Points of another shape or not finite.
        """
        points = checked_points(points)
        asked = np.broadcast_arrays(depth_m, tilt_deg, azimuth_deg, np.zeros(len(points)))[:3]
        presses = _presses((points - self.lowest_m) / self.extent_m, *asked)
        height, width = self.sensor.image_height, self.sensor.image_width
        rows, columns = pixel_grid(height, width, 0.0)
        coordinates = np.empty((height, width, 9), dtype=np.float32)
        coordinates[..., 7], coordinates[..., 8] = columns, rows[:, None]
        maps = np.empty((len(points), height, width), dtype=np.float32)
        for found, press in zip(maps, presses, strict=True):
            coordinates[..., :7] = press
            values = self.network.answers(coordinates.reshape(-1, 9))
            found[:] = np.maximum(values.reshape(height, width), 0.0) * self.deepest_m
        return maps

    def render(
        self,
        points: np.ndarray,
        depth_m: float | np.ndarray = 0.001,
        tilt_deg: float | np.ndarray = 0.0,
        azimuth_deg: float | np.ndarray = 0.0,
    ) -> np.ndarray:
        """Images (n, height, width, 3) uint8; as `deformation`."""
        maps = self.deformation(points, depth_m, tilt_deg, azimuth_deg)
        images = [render_deformation(self.sensor, deformation) for deformation in maps]
        return np.stack(images) if images else np.zeros((*maps.shape, 3), dtype=np.uint8)


def render_deformation(sensor: Sensor, deformation: np.ndarray) -> np.ndarray:
    """Image (height, width, 3) uint8 of a gel pushed in by (height, width) metres along the sensor's axis."""
    grid = ray_grid(sensor, 1)
    camera = np.asarray(sensor.camera_position_m)
    shape = (sensor.image_height, sensor.image_width)
    u, v = np.broadcast_to(grid.u, shape), np.broadcast_to(grid.v[:, None], shape)
    depth = grid.gel_depth.reshape(shape)
    for _ in range(STEPS_ALONG_RAYS):
        surface = gel_surface(sensor, camera[1] + depth * u, camera[2] + depth * v)
        depth = surface - deformation - camera[0]
    positions = camera[:, None, None] + depth * np.stack([np.ones(shape), u, v])
    down, across = np.gradient(positions, axis=(1, 2))
    normals = np.cross(down, across, axis=0)
    normals *= -np.sign(np.sum(normals * (positions - camera[:, None, None]), axis=0))
    values = shade(sensor, positions.reshape(3, -1), normals.reshape(3, -1))
    return to_bytes(values.reshape(*shape, 3))


def _presses(
    scaled: np.ndarray, depth_m: np.ndarray, tilt_deg: np.ndarray, azimuth_deg: np.ndarray
) -> np.ndarray:
    """Return the first seven coordinates (n, 7) of presses at scaled points (n, 3)."""
    azimuth = np.radians(azimuth_deg)
    depth = (depth_m - DEPTHS_M[0]) / (DEPTHS_M[1] - DEPTHS_M[0])
    more = np.stack([tilt_deg / MOST_TILT_DEG, np.cos(azimuth), np.sin(azimuth), depth], axis=1)
    return np.concatenate([scaled, more], axis=1)


def fit_deformation_network(touches: Product, **options: Any) -> DeformationNetwork:
    """Fit ObjectFolder 2.0's TouchNet to touches that are not held out; arguments as of `fit_image_network`.

    Raises
    ------
    InputError
        Nothing to train on, or neither steps nor a budget.
    """
    given = TrainingTouches.of(touches)
    lowest, extent = given.position_range()
    deepest = max(float(given.deformation.max()), 1e-9)
    height, width = given.deformation.shape[1:]
    rows, columns = pixel_grid(height, width, 0.0)
    presses = _presses((given.points - lowest) / extent, given.depth_m, given.tilt_deg, given.azimuth_deg)

    def draw(generator: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        touch, row, column = (generator.integers(size, size=count) for size in (len(presses), height, width))
        coordinates = np.concatenate([presses[touch], columns[column, None], rows[row, None]], axis=1)
        return coordinates, given.deformation[touch, row, column][:, None] / deepest

    start = np.array([given.deformation.mean(dtype=np.float64) / deepest])
    network, training = fit_perceptron(9, start, draw, **options)
    return DeformationNetwork(network, given.sensor, lowest, extent, deepest, training)
