"""The sensor of an Object File, checked field by field: a file from elsewhere may say anything of it."""

from collections.abc import Mapping
from typing import Any

from objectfolder.errors import FormatError
from objectfolder.products.stored_values import REMEDY, number, numbers, whole_number
from objectfolder.touch.sensor.marker_grid import MOST_MARKERS
from objectfolder.touch.sensor.sensor import Sensor

LARGEST_SENSOR_M = 10.0
MOST_LIGHTS = 64
MOST_SHADOWS = 8  # lamps that cast some
SENSOR_PIXELS = 1 << 14  # of a side
MOST_IMAGE_RAYS = 3 << 20  # of an image: 900 MB while it is rendered
# Lengths that are not 0, and other numbers with their ranges.
LENGTHS = (
    "near_m", "gel_width_m", "gel_height_m", "gel_radius_m", "contact_radius_m", "maximum_depth_m",
    "gel_thickness_m",
)  # fmt: skip
FIELD_RANGES = {
    **dict.fromkeys(LENGTHS, (1e-6, LARGEST_SENSOR_M)),
    "field_of_view_deg": (0.01, 179.0),
    "gel_sagitta_m": (0.0, LARGEST_SENSOR_M),
    "base_color": (0.0, 1.0),
    "metallic": (0.0, 1.0),
    "roughness": (0.0, 1.0),
    "display_gamma": (0.1, 10.0),
    "gel_youngs_modulus_pa": (1.0, 1e15),
    "gel_poisson_ratio": (0.0, 0.5),
    "noise_sigma_grey_levels": (0.0, 1e3),
    "background_gain": (-1e3, 1e3),
}
WHOLE_NUMBERS = {
    "image_height": (2, SENSOR_PIXELS),
    "image_width": (2, SENSOR_PIXELS),
    "background_blur_pixels": (1, 1001),
}
VECTOR_FIELDS = ("camera_position_m", "gel_apex_m", "housing_low_m", "housing_high_m")
LIGHT_RANGES = {"light_positions_m": LARGEST_SENSOR_M, "light_colors": 1e6}
# Of what a sensor need not have.
OPTIONAL_LAMPS = {"shadow_positions_m": LARGEST_SENSOR_M, "shadow_shares": 1.0}
OPTIONAL_RANGES = {
    "shadow_lamp_height_m": (0.0, LARGEST_SENSOR_M),
    "shadow_penumbra_m": (1e-6, LARGEST_SENSOR_M),
    "background_blur_m": (0.0, LARGEST_SENSOR_M),
}
MARKER_RANGES = {
    **dict.fromkeys(("row_pitch_m", "column_pitch_m", "dot_radius_m"), (1e-6, LARGEST_SENSOR_M)),
    **dict.fromkeys(("offset_down_m", "offset_right_m"), (-LARGEST_SENSOR_M, LARGEST_SENSOR_M)),
    "rotation_deg": (-360.0, 360.0),
}


def stored_sensor(values: Mapping[str, Any], samples: int) -> Sensor:
    """Return the sensor that `Sensor.to_dict` described.

    Parameters
    ----------
    samples
        Samples along each side of a pixel.

    Raises
    ------
    FormatError
        Fields that are missing, unknown, of another kind or out of range, or more than `MOST_IMAGE_RAYS`.
    """
    if not isinstance(values, dict) or not isinstance(values.get("name"), str):
        raise FormatError("touch.sensor", "it has no name", REMEDY)
    checked = dict(values)
    ranges = FIELD_RANGES | {name: limits for name, limits in OPTIONAL_RANGES.items() if name in values}
    lamps = LIGHT_RANGES | {name: limit for name, limit in OPTIONAL_LAMPS.items() if name in values}
    try:
        for name, (low, high) in ranges.items():
            checked[name] = number(f"touch.sensor.{name}", values[name], low, high)
        for name, (least, most) in WHOLE_NUMBERS.items():
            checked[name] = whole_number(f"touch.sensor.{name}", values[name], least, most)
        for name in VECTOR_FIELDS:
            checked[name] = numbers(f"touch.sensor.{name}", values[name], (3,), LARGEST_SENSOR_M).tolist()
        for name, limit in lamps.items():
            most = MOST_SHADOWS if name in OPTIONAL_LAMPS else MOST_LIGHTS
            count = whole_number(f"number of touch.sensor.{name}", len(values[name]), 0, most)
            checked[name] = numbers(f"touch.sensor.{name}", values[name], (count, 3), limit).tolist()
        if "marker_grid" in values:
            checked["marker_grid"] = _stored_markers(values["marker_grid"])
        sensor = Sensor.from_dict(checked)
    except KeyError as error:
        raise FormatError("touch.sensor", f"no field {error}", REMEDY) from error
    except (TypeError, ValueError) as error:
        raise FormatError("touch.sensor", str(error), REMEDY) from error
    rays = sensor.image_height * sensor.image_width * samples**2
    if rays > MOST_IMAGE_RAYS:
        raise FormatError("touch.sensor", f"{rays} rays an image, more than {MOST_IMAGE_RAYS}", REMEDY)
    return sensor


def _stored_markers(values: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a marker grid, checked; others stay as they are, for `MarkerGrid` refuses them."""
    where = "touch.sensor.marker_grid"
    if not isinstance(values, dict):
        raise FormatError(where, "holds no fields", REMEDY)
    counts = {
        name: whole_number(f"{where}.{name}", values[name], 1, MOST_MARKERS) for name in ("rows", "columns")
    }
    lengths = {
        name: number(f"{where}.{name}", values[name], low, high)
        for name, (low, high) in MARKER_RANGES.items()
    }
    return {**values, **counts, **lengths}
