"""How large a sensor's camera sees its gel."""

from dataclasses import replace

import numpy as np

from objectfolder.errors import InputError
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.sensor import Sensor


def pixels_per_metre(sensor: Sensor) -> float:
    """Magnification of a sensor at the apex of its gel."""
    away = sensor.gel_apex_m[0] - sensor.camera_position_m[0]
    return float(sensor.image_height / (2 * away * np.tan(np.radians(sensor.field_of_view_deg) / 2)))


def at_magnification(sensor: Sensor, pixels_a_metre: float) -> Sensor:
    """Return a sensor whose camera sees the gel's apex with that magnification.

    Raises
    ------
    InputError
        One by which the camera sees past the gel's borders.
    """
    away = sensor.gel_apex_m[0] - sensor.camera_position_m[0]
    if not pixels_a_metre > 0:
        raise InputError("pixels-per-mm", f"{pixels_a_metre / 1e3:g}", "It must be above 0.")
    angle = float(np.degrees(2 * np.arctan(sensor.image_height / (2 * pixels_a_metre * away))))
    try:
        magnified = replace(sensor, field_of_view_deg=angle)
        ray_grid(magnified, 1)
    except ValueError as error:
        raise InputError("pixels-per-mm", str(error), "Give another sensor or magnification.") from error
    return magnified
