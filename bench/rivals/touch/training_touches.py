"""The touches that rivals are fitted to: those of a set that are not held out."""

from dataclasses import dataclass

import numpy as np

from objectfolder.errors import InputError
from objectfolder.products.store import Product
from objectfolder.touch.sensor.sensor import Sensor


@dataclass(frozen=True)
class TrainingTouches:
    """Touches and how they were asked for.

    Attributes
    ----------
    sensor : what was pressed
    rgb : (n, height, width, 3) uint8
    deformation : (n, height, width) float32 metres, how deep the object lies in the undeformed gel
    points : (n, 3) float64 metres, object frame
    depth_m, tilt_deg, azimuth_deg : (n,) float64
    """

    sensor: Sensor
    rgb: np.ndarray
    deformation: np.ndarray
    points: np.ndarray
    depth_m: np.ndarray
    tilt_deg: np.ndarray
    azimuth_deg: np.ndarray

    @classmethod
    def of(cls, touches: Product) -> "TrainingTouches":
        """Take those of a product of `touches.simulate_touches` that are not held out.

        Raises
        ------
        InputError
            None is left.
        """
        chosen = np.flatnonzero(~touches["held_out"])
        if len(chosen) == 0:
            raise InputError("touches", "every touch is held out", "Simulate touches to train on.")
        return cls(
            Sensor.from_dict(touches.attributes["sensor"]),
            *(
                np.asarray(touches[name])[chosen]
                for name in ("rgb", "depth", "points", "depth_m", "tilt_deg", "azimuth_deg")
            ),
        )

    def position_range(self) -> tuple[float, float]:
        """Lowest coordinate of any axis and extent of all, metres."""
        lowest = float(self.points.min())
        return lowest, max(float(self.points.max()) - lowest, 1e-12)


def checked_points(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) float64.

    Raises
    ------
    InputError
        Another shape, or coordinates that are not finite.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError("points", f"shape {points.shape} or values are not (n, 3) finite", "Give metres.")
    return points
