"""Touch of an Object File: its compressed surface through the sensor model.

A touch is local geometry seen by a known sensor. The geometry is in the Object File for all senses, so
touch needs no weights of its own: any point, depth, tilt and azimuth is answered by the one renderer
that also made the ground truth.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from objectfolder.geometry.surface import Surface
from objectfolder.touch.camera import no_contact_image
from objectfolder.touch.patch import FacePatches
from objectfolder.touch.press import Touches, press
from objectfolder.touch.sensor import Sensor


class TouchNet:
    """Answers touches on a surface.

    Parameters
    ----------
    surface
        The decoded surface, object frame, metres.
    sensor
        What is pressed; DIGIT by default.
    samples
        Samples along each side of a pixel, unless a query says otherwise.
    """

    def __init__(self, surface: Surface, sensor: Sensor | None = None, samples: int = 2) -> None:
        self.surface = surface
        self.sensor = Sensor() if sensor is None else sensor
        self.samples = samples

    @cached_property
    def _patches(self) -> FacePatches:
        return FacePatches(self.surface)

    @cached_property
    def no_contact(self) -> np.ndarray:
        """Image (height, width, 3) uint8 of the untouched gel."""
        return no_contact_image(self.sensor, self.samples)

    def press(
        self,
        points: np.ndarray,
        *,
        depth_m: float | np.ndarray = 0.001,
        tilt_deg: float | np.ndarray = 0.0,
        azimuth_deg: float | np.ndarray = 0.0,
        samples: int | None = None,
    ) -> Touches:
        """Press at points (n, 3), object frame, metres; see `objectfolder.touch.press.press`."""
        return press(
            self._patches,
            self.sensor,
            points,
            depth_m=depth_m,
            tilt_deg=tilt_deg,
            azimuth_deg=azimuth_deg,
            samples=self.samples if samples is None else samples,
        )

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays to store: none but the shared surface's."""
        return {}

    def metadata(self) -> dict[str, Any]:
        """Return the JSON to store."""
        return {"sensor": self.sensor.to_dict(), "samples": self.samples}

    @classmethod
    def from_tensors(
        cls, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, Any], surface: Surface
    ) -> "TouchNet":
        """Return the net that `tensors` and `metadata` described.

        Raises
        ------
        FormatError
            A sensor with unknown or missing fields.
        """
        return cls(surface, Sensor.from_dict(metadata["sensor"]), int(metadata["samples"]))
