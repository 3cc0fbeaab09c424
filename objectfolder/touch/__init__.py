"""Touch: sensors as files, presses and what the sensor sees, the gel as an elastic layer."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.touch.elastic.contact_problem import Contact, force_depth_curve, solve_contact
    from objectfolder.touch.elastic.elastomer import Elastomer
    from objectfolder.touch.elastic.markers import Markers, moved_markers
    from objectfolder.touch.elastic.shear import Shear, solve_shear, unsheared
    from objectfolder.touch.picture_force import PictureForce, force_of
    from objectfolder.touch.presses.press import press
    from objectfolder.touch.presses.touches import Press, Touches
    from objectfolder.touch.sensor.marker_grid import MarkerGrid
    from objectfolder.touch.sensor.sensor import Sensor
    from objectfolder.touch.sensor.sensor_file import make_table, read_sensor
    from objectfolder.touch.touch_queries import TouchQueries
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "elastic.contact_problem": ["Contact", "force_depth_curve", "solve_contact"],
            "elastic.elastomer": ["Elastomer"],
            "elastic.markers": ["Markers", "moved_markers"],
            "elastic.shear": ["Shear", "solve_shear", "unsheared"],
            "picture_force": ["PictureForce", "force_of"],
            "sensor.marker_grid": ["MarkerGrid"],
            "sensor.sensor": ["Sensor"],
            "sensor.sensor_file": ["make_table", "read_sensor"],
            "touch_queries": ["TouchQueries"],
            "presses.press": ["press"],
            "presses.touches": ["Press", "Touches"],
        },
        {"objectfolder.making": ["OwnCalibration", "calibrate", "fit_table", "simulate_touches"]},
    )

__all__ = [
    "Contact",
    "Elastomer",
    "MarkerGrid",
    "Markers",
    "PictureForce",
    "Press",
    "Sensor",
    "Shear",
    "TouchQueries",
    "Touches",
    "force_depth_curve",
    "force_of",
    "make_table",
    "moved_markers",
    "press",
    "read_sensor",
    "solve_contact",
    "solve_shear",
    "unsheared",
]
