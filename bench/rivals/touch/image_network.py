"""ObjectFolder 1.0's TouchNet: from a point of the surface and a pixel to the pixel's colour.

Published (paper and public inference code): the perceptron of (x, y, z, row, column), each scaled to
[-1, 1], positions by one range for all axes; colours scaled to [-1, 1]. One touch at each vertex, along its
normal, with one force: depth and tilt are no inputs. Their code takes the range of positions from the query
itself, so that an answer depends on what else is asked; here it is that of the training touches.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.rivals.touch.perceptron import Perceptron, Training, fit_perceptron, pixel_grid
from bench.rivals.touch.training_touches import TrainingTouches, checked_points
from objectfolder.products.store import Product
from objectfolder.touch.sensor.sensor import Sensor

NAME = "ObjectFolder 1.0"


@dataclass(frozen=True)
class ImageNetwork:
    """A fitted network.

    Attributes
    ----------
    network : of five coordinates, three outputs
    sensor : whose images it answers
    lowest_m, extent_m : of the positions' range, metres
    training : what the fit did
    """

    network: Perceptron
    sensor: Sensor
    lowest_m: float
    extent_m: float
    training: Training

    @property
    def bytes(self) -> int:
        """Stored: weights in single precision and the range."""
        return 4 * self.network.parameter_count + 16

    def render(
        self,
        points: np.ndarray,
        depth_m: float | np.ndarray = 0.001,
        tilt_deg: float | np.ndarray = 0.0,
        azimuth_deg: float | np.ndarray = 0.0,
    ) -> np.ndarray:
        """Images (n, height, width, 3) uint8 at points (n, 3), metres; how the sensor is held has no effect.

        Raises
        ------
        InputError
            Points of another shape or not finite.
        """
        points = self._scaled(checked_points(points))
        height, width = self.sensor.image_height, self.sensor.image_width
        coordinates = np.empty((height, width, 5), dtype=np.float32)
        rows, columns = pixel_grid(height, width, -1.0)
        coordinates[..., 3], coordinates[..., 4] = rows[:, None], columns
        images = np.empty((len(points), height, width, 3), dtype=np.uint8)
        for image, point in zip(images, points, strict=True):
            coordinates[..., :3] = point
            values = self.network.answers(coordinates.reshape(-1, 5)).reshape(image.shape)
            image[:] = np.clip(np.rint((values + 1) / 2 * 255), 0, 255)
        return images

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        return 2 * (points - self.lowest_m) / self.extent_m - 1


def fit_image_network(touches: Product, **options: Any) -> ImageNetwork:
    """Fit ObjectFolder 1.0's TouchNet to touches that are not held out.

    Parameters
    ----------
    touches
        Product of `touches.simulate_touches`.
    options
        Of `fit_perceptron`: `steps` or `budget_cpu_s`, and `batch_pixels`, `seed`, `device`.

    Raises
    ------
    InputError
        Nothing to train on, or neither steps nor a budget.
    """
    given = TrainingTouches.of(touches)
    lowest, extent = given.position_range()
    height, width = given.rgb.shape[1:3]
    rows, columns = pixel_grid(height, width, -1.0)
    scaled = 2 * (given.points - lowest) / extent - 1

    def draw(generator: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        touch, row, column = (generator.integers(size, size=count) for size in (len(scaled), height, width))
        coordinates = np.concatenate([scaled[touch], rows[row, None], columns[column, None]], axis=1)
        return coordinates, given.rgb[touch, row, column] * (2 / 255) - 1

    start = given.rgb.mean(axis=(0, 1, 2), dtype=np.float64) * (2 / 255) - 1
    network, training = fit_perceptron(5, start, draw, **options)
    return ImageNetwork(network, given.sensor, lowest, extent, training)
