"""The TouchNets of ObjectFolder 1.0 and 2.0: from a press and a pixel to a colour, or to a deformation.

Published (papers and public inference code): 1.0 has the perceptron of (x, y, z, row, column), each scaled to
[-1, 1], positions by one range for all axes; colours scaled to [-1, 1]. One touch at each vertex, along its
normal, with one force: depth and tilt are no inputs. Their code takes the range of positions from the query
itself, so that an answer depends on what else is asked; here it is that of the training touches.

2.0 has the perceptron of (x, y, z, tilt, cos and sin of its azimuth, depth, column, row); positions scaled to
[0, 1] by one range, tilt by 0 .. 15 degrees, depth by 0.5 .. 2 mm, pixels from 0 to 1; one output scaled to
[0, 1] by a fixed range. Their renderer is Taxim with the table of a GelSight; here it is the sensor's own
shading, applied to the deformed gel with normals by differences between pixels, because a map of depths has
no others. Their output is the distance to the camera; here it is how far the gel is pushed in, which is the
same but for the undeformed gel.

Training is not published. Decided here: Adam at 5e-4, the rate of the papers' other networks; mean squared
error over pixels drawn evenly from all training touches; an output that starts at the targets' mean.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from torch import Tensor

from bench.rivals.published import Perceptrons, Training, fit, single
from objectfolder.errors import InputError
from objectfolder.products.store import Product
from objectfolder.touch.sensor.camera import ray_grid, to_bytes
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade

FIRST, SECOND = "ObjectFolder 1.0", "ObjectFolder 2.0"
RIVALS = (FIRST, SECOND)
RATE, BATCH_PIXELS = 5e-4, 1024
MOST_TILT_DEG = 15.0
DEPTHS_M = (0.0005, 0.002)
# The gel is convex towards the object and seen nearly along its axis: each step halves the error or better.
STEPS_ALONG_RAYS = 24
QUERY_FIELDS = ("points", "depth_m", "tilt_deg", "azimuth_deg")


@dataclass(frozen=True)
class TouchNetwork:
    """A fitted network.

    Attributes
    ----------
    name : of `RIVALS`
    sensor : whose images it answers
    lowest_m, extent_m : of the positions' range, metres
    deepest_m : deformation that the output 1 of 2.0 means, metres; 0 means none
    network, training : of a pixel's coordinates; and what the fit did
    """

    name: str
    sensor: Sensor
    lowest_m: float
    extent_m: float
    deepest_m: float
    network: Perceptrons
    training: Training

    @property
    def bytes(self) -> int:
        """Stored: weights in single precision and the ranges."""
        return 4 * self.network.weights + (16 if self.name == FIRST else 24)

    def deformation(
        self,
        points: np.ndarray,
        depth_m: float | np.ndarray = 0.001,
        tilt_deg: float | np.ndarray = 0.0,
        azimuth_deg: float | np.ndarray = 0.0,
    ) -> np.ndarray:
        """How far the gel is pushed in by 2.0, (n, height, width) metres; arguments as of `press`.

        Raises
        ------
        InputError
            Points of another shape or not finite.
        """
        values = self._values(points, depth_m, tilt_deg, azimuth_deg)
        deformed: np.ndarray = np.maximum(values[..., 0], 0.0) * self.deepest_m
        return deformed

    def render(
        self,
        points: np.ndarray,
        depth_m: float | np.ndarray = 0.001,
        tilt_deg: float | np.ndarray = 0.0,
        azimuth_deg: float | np.ndarray = 0.0,
    ) -> np.ndarray:
        """Images (n, height, width, 3) uint8; how the sensor is held has no effect in 1.0.

        Raises
        ------
        InputError
            Points of another shape or not finite.
        """
        if self.name == FIRST:
            values = self._values(points, depth_m, tilt_deg, azimuth_deg)
            return np.clip(np.rint((values + 1) / 2 * 255), 0, 255).astype(np.uint8)
        maps = self.deformation(points, depth_m, tilt_deg, azimuth_deg)
        images = [render_deformation(self.sensor, deformation) for deformation in maps]
        return np.stack(images) if images else np.zeros((*maps.shape, 3), dtype=np.uint8)

    def _values(self, points: np.ndarray, *holding: float | np.ndarray) -> np.ndarray:
        """Outputs (n, height, width, outputs) float32."""
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise InputError(
                "points", f"shape {points.shape} or values are not (n, 3) finite", "Give metres."
            )
        holding = np.broadcast_arrays(*holding, np.zeros(len(points)))[:3]
        shape = self.sensor.image_height, self.sensor.image_width
        rows, columns = (part.ravel() for part in np.indices(shape))
        scaled = (points - self.lowest_m) / self.extent_m
        images = []
        for press in zip(scaled, *holding, strict=True):
            of_pixels = (np.broadcast_to(part, (len(rows), *np.shape(part))) for part in press)
            coordinates = _coordinates(self.name, *of_pixels, rows, columns, shape)
            images.append(self.network.answers(coordinates)[:, 0].reshape(*shape, -1))
        outputs = 3 if self.name == FIRST else 1
        return np.stack(images) if images else np.zeros((0, *shape, outputs), dtype=np.float32)


def fit_touch_network(
    name: str, touches: Product, *, batch_pixels: int = BATCH_PIXELS, **options: Any
) -> TouchNetwork:
    """Fit a network of `RIVALS` to the touches that are not held out.

    Parameters
    ----------
    name
        ``"ObjectFolder 1.0"`` or ``"ObjectFolder 2.0"``.
    touches
        Product of `simulate_touches`.
    batch_pixels
        Pixels a step.
    options
        Of `fit`: `steps` or `budget_cpu_s`, and `seed`.

    Raises
    ------
    InputError
        A name that is not known, nothing to train on, or neither steps nor a budget.
    """
    if name not in RIVALS:
        raise InputError("touch network", f"unknown name {name!r}", f"Use one of {sorted(RIVALS)}.")
    rows = np.flatnonzero(~touches["held_out"])
    if len(rows) == 0:
        raise InputError("touches", "every touch is held out", "Simulate touches to train on.")
    points, *holding = (np.asarray(touches[key])[rows] for key in QUERY_FIELDS)
    lowest = float(points.min())
    extent = max(float(points.max()) - lowest, 1e-12)
    scaled = (points - lowest) / extent
    deepest = max(float(touches["depth"][rows].max()), 1e-9)
    if name == FIRST:
        images = touches["rgb"][rows].astype(np.float32) * (2 / 255) - 1
    else:
        images = touches["depth"][rows][..., None] / deepest
    shape = images.shape[1:3]

    def loss(network: Perceptrons, generator: np.random.Generator) -> Tensor:
        touch, row, column = (generator.integers(size, size=batch_pixels) for size in images.shape[:3])
        fields = (part[touch] for part in (scaled, *holding))
        coordinates = single(_coordinates(name, *fields, row, column, shape))
        return (network(coordinates)[:, 0] - single(images[touch, row, column])).square().mean()

    start = images.mean(axis=(0, 1, 2), dtype=np.float64)[None]
    dimensions = 5 if name == FIRST else 9
    network, training = fit(lambda: Perceptrons(dimensions, start), loss, lambda _: RATE, **options)
    sensor = Sensor.from_dict(touches.attributes["sensor"])
    return TouchNetwork(name, sensor, lowest, extent, deepest, network, training)


def _coordinates(
    name: str,
    scaled: np.ndarray,
    depth_m: np.ndarray,
    tilt_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
    shape: tuple[int, ...],
) -> np.ndarray:
    """Coordinates (n, 5 or 9) of pixels (n,) of presses at points (n, 3) scaled to [0, 1]."""
    down, across = row / (shape[0] - 1), column / (shape[1] - 1)
    if name == FIRST:
        return 2 * np.column_stack([scaled, down, across]) - 1
    azimuth = np.radians(azimuth_deg)
    depth = (depth_m - DEPTHS_M[0]) / (DEPTHS_M[1] - DEPTHS_M[0])
    return np.column_stack(
        [scaled, tilt_deg / MOST_TILT_DEG, np.cos(azimuth), np.sin(azimuth), depth, across, down]
    )


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
