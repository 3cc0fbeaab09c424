"""The tactile sensor as data: camera, gel, appearance, housing, noise; TACTO's DIGIT by default."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.stored_values import REMEDY, number, numbers, whole_number
from objectfolder.query_values import image_sides
from objectfolder.renaming import renamed_attribute, renamed_keywords
from objectfolder.touch.sensor.indentation_response import IndentationResponse
from objectfolder.touch.sensor.marker_grid import MOST_MARKERS, MarkerGrid
from objectfolder.touch.sensor.photometric_table import PhotometricTable

Vector = tuple[float, float, float]
# Keys of a stored sensor whose fields are spelt otherwise.
STORED_NAMES = {"light_colours": "light_colors", "base_colour": "base_color"}
# Stored only where they are not as by default, so that sensors without them are stored as ever.
OPTIONAL = (
    "shadow_positions_m",
    "shadow_shares",
    "shadow_lamp_height_m",
    "shadow_penumbra_m",
    "background_blur_m",
    "indentation_response",
    "marker_grid",
)

# Of a stored sensor: a file from elsewhere may say anything of it.
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


def _ring(x: float, radius: float, centre: Vector, angles_deg: tuple[float, ...]) -> tuple[Vector, ...]:
    """Points on a circle in the plane x, angles from +y towards +z."""
    angles = np.radians(angles_deg)
    return tuple(
        (x, float(centre[1] + radius * np.cos(angle)), float(centre[2] + radius * np.sin(angle)))
        for angle in angles
    )


@dataclass(frozen=True)
class Sensor:
    """A camera behind an elastic gel, TACTO's DIGIT by default (``"digit-tacto"``).

    The sensor frame is in metres: x points out of the sensor, at the object; image rows run along -z
    and columns along -y. The defaults are the DIGIT configuration of TACTO 0.0.3 (`config_digit.yml`;
    Wang et al. 2022, RA-L 7(2)) and the default material of its renderer, pyrender 0.1.45.

    Parameters
    ----------
    name
        What the sensor is called.
    image_height, image_width
        Pixels.
    field_of_view_deg
        Vertical, degrees.
    camera_position_m, near_m
        Camera, looking along +x, and its near plane.
    gel_apex_m, gel_width_m, gel_height_m
        Outermost point of the undeformed gel; its extent along y and along z.
    gel_radius_m, gel_sagitta_m
        The gel is a spherical cap of that radius, stretched along x until its corners lie
        `gel_sagitta_m` behind the apex: 0 for a flat gel.
    light_positions_m, light_colours
        Point lights and their linear RGB radiant intensity. TACTO writes its colours as integers, and
        its renderer divides integer colours by 255.
    base_colour, metallic, roughness
        Grey metallic-roughness material of gel and object.
    display_gamma
        Pixel value = radiance ** (1 / display_gamma).
    housing_low_m, housing_high_m
        Corners of the rigid box behind the gel: 34 x 27 x 32 mm, about a DIGIT's. TACTO has no
        housing; these figures are ours.
    contact_radius_m
        The contact normal is the surface's mean normal within this distance.
    maximum_depth_m
        Deepest indentation the gel allows (TACTO's `max_deformation`).
    gel_youngs_modulus_pa, gel_poisson_ratio, gel_thickness_m
        The elastomer, and how much of it lies under the apex before the rigid backing. A DIGIT's is
        Smooth-On Solaris (Lambeta et al. 2020, RA-L 5(3)) of Shore hardness A 15: 0.56 MPa by Gent's
        relation (1958, Rubber Chem. Technol. 31(4)). Silicone hardly changes its volume: 0.48. The
        published design states no thickness; 4 mm is ours.
    photometric_table
        How a painted membrane looks, in place of lights and material, which then count for nothing.
    noise_sigma_grey_levels
        Standard deviation of the camera's noise (`objectfolder.touch.sensor.reading`).
    shadow_positions_m, shadow_shares
        Lamps that cast shadows over the gel, under lights and table alike, and how much of the values of red,
        green and blue, 0..1, goes where what indents the gel hides them.
    shadow_lamp_height_m, shadow_penumbra_m
        How far such a lamp reaches along the sensor's axis, which softens a shadow the more the farther it
        falls, and the least height over which light fades.
    background_gain, background_blur_pixels
        How a touch is laid over a background (`objectfolder.touch.sensor.reading`): the factor of its
        difference from the untouched gel, and the odd width of the blur.
    background_blur_m
        Standard deviation of the blur on the gel, at any image size, in place of that width; 0: the width.
    indentation_response
        How light changes beyond a contact, added to every picture of a touch.
    marker_grid
        Dots printed on the gel. A press draws none: `objectfolder.touch.moved_markers` tells where they are.
    """

    name: str = "DIGIT"
    image_height: int = 160
    image_width: int = 120
    field_of_view_deg: float = 60.0
    camera_position_m: Vector = (0.0, 0.0, 0.015)
    near_m: float = 0.001
    gel_apex_m: Vector = (0.022, 0.0, 0.015)
    gel_width_m: float = 0.020
    gel_height_m: float = 0.030
    gel_radius_m: float = 0.100
    gel_sagitta_m: float = 0.005
    light_positions_m: tuple[Vector, ...] = _ring(0.005, 0.020, (0.005, 0.0, 0.015), (30.0, 150.0, 270.0))
    light_colours: tuple[Vector, ...] = ((1 / 255, 0.0, 0.0), (0.0, 1 / 255, 0.0), (0.0, 0.0, 1 / 255))
    base_colour: float = 0.3
    metallic: float = 0.2
    roughness: float = 0.8
    display_gamma: float = 2.2
    housing_low_m: Vector = (-0.019, -0.0135, -0.001)
    housing_high_m: Vector = (0.015, 0.0135, 0.031)
    contact_radius_m: float = 0.002
    maximum_depth_m: float = 0.005
    gel_youngs_modulus_pa: float = 5.6e5
    gel_poisson_ratio: float = 0.48
    gel_thickness_m: float = 0.004
    photometric_table: PhotometricTable | None = None
    shadow_positions_m: tuple[Vector, ...] = ()
    shadow_shares: tuple[Vector, ...] = ()
    shadow_lamp_height_m: float = 0.0
    shadow_penumbra_m: float = 1e-4
    noise_sigma_grey_levels: float = 7.0
    background_gain: float = 0.5
    background_blur_pixels: int = 7
    background_blur_m: float = 0.0
    indentation_response: IndentationResponse | None = None
    marker_grid: MarkerGrid | None = None

    light_colors = renamed_attribute("light_colours")
    base_color = renamed_attribute("base_colour")

    def __post_init__(self) -> None:
        corner = float(np.hypot(self.gel_width_m, self.gel_height_m)) / 2
        if not corner < self.gel_radius_m:
            raise ValueError(f"{self.name}: the gel's corners lie {corner} m out, beyond gel_radius_m")
        if min(self.image_height, self.image_width) < 2:
            raise ValueError(f"{self.name}: an image needs at least 2 x 2 pixels")
        if len(self.light_positions_m) != len(self.light_colours):
            raise ValueError(f"{self.name}: as many light_colours as light_positions_m are needed")
        self._check_shadows()
        if not (self.gel_youngs_modulus_pa > 0 and self.gel_thickness_m > 0):
            raise ValueError(f"{self.name}: the gel needs a Young's modulus and a thickness above 0")
        if not 0 <= self.gel_poisson_ratio < 0.5:
            raise ValueError(f"{self.name}: gel_poisson_ratio is {self.gel_poisson_ratio}, not in 0 .. 0.5")
        if self.noise_sigma_grey_levels < 0:
            raise ValueError(f"{self.name}: noise_sigma_grey_levels is below 0")
        if self.background_blur_m < 0:
            raise ValueError(f"{self.name}: background_blur_m is below 0")
        if self.background_blur_pixels < 1 or self.background_blur_pixels % 2 == 0:
            raise ValueError(f"{self.name}: background_blur_pixels is {self.background_blur_pixels}, not odd")

    def _check_shadows(self) -> None:
        if len(self.shadow_positions_m) != len(self.shadow_shares):
            raise ValueError(f"{self.name}: as many shadow_shares as shadow_positions_m are needed")
        if not all(0 <= part <= 1 for share in self.shadow_shares for part in share):
            raise ValueError(f"{self.name}: shadow_shares are not in 0 .. 1")
        slope = np.tan(np.radians(self.field_of_view_deg) / 2)
        for index, position in enumerate(self.shadow_positions_m):
            ahead, across, up = np.asarray(position) - np.asarray(self.camera_position_m)
            if not ahead > 0:
                raise ValueError(f"{self.name}: lamp {index} of the shadows stands behind the camera")
            if (
                abs(up) <= slope * ahead
                and abs(across) <= slope * ahead * self.image_width / self.image_height
            ):
                raise ValueError(f"{self.name}: lamp {index} of the shadows stands in the camera's view")
        if self.shadow_lamp_height_m < 0 or not self.shadow_penumbra_m > 0:
            raise ValueError(f"{self.name}: shadows need a lamp height of 0 or more and a penumbra above 0")

    def at_resolution(self, height: int, width: int) -> "Sensor":
        """Return the same sensor with images of `height` x `width` pixels, and its vertical field of view.

        Pixels are square, so that an image of other proportions sees more or less at its sides.

        Raises
        ------
        QueryError
            Not whole numbers of pixels, 2 at least.
        """
        height, width = image_sides((height, width), 2)
        return replace(self, image_height=height, image_width=width)

    @property
    def gel_stretch(self) -> float:
        """Factor along x that turns the spherical cap into the gel, its corners at the sagitta."""
        radius = self.gel_radius_m
        corner_squared = (self.gel_width_m**2 + self.gel_height_m**2) / 4
        return self.gel_sagitta_m / (radius - float(np.sqrt(radius**2 - corner_squared)))

    def to_dict(self) -> dict[str, Any]:
        """Return the sensor as JSON."""
        values = {
            STORED_NAMES.get(field.name, field.name): _as_list(getattr(self, field.name))
            for field in fields(self)
        }
        table = self.photometric_table
        for field in fields(self):
            if field.name in OPTIONAL and getattr(self, field.name) == field.default:
                del values[field.name]
        if self.indentation_response is not None:
            values["indentation_response"] = self.indentation_response.to_dict()
        if self.marker_grid is not None:
            values["marker_grid"] = self.marker_grid.to_dict()
        return {**values, "photometric_table": None if table is None else table.to_dict()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Sensor":
        """Return the sensor that `to_dict` described.

        Raises
        ------
        FormatError
            A key too many or too few, or a table, response or marker grid that is none.
        """
        names = {STORED_NAMES.get(field.name, field.name): field.name for field in fields(cls)}
        expected = set(names) - (set(OPTIONAL) - set(values))
        if expected != set(values):
            missing, unknown = sorted(expected - set(values)), sorted(set(values) - expected)
            raise FormatError("sensor", f"missing fields {missing}, unknown fields {unknown}")
        table = values["photometric_table"]
        read = {names[key]: _as_tuple(value) for key, value in values.items()}
        read["photometric_table"] = None if table is None else PhotometricTable.from_dict(table)
        if "indentation_response" in read:
            read["indentation_response"] = IndentationResponse.from_dict(values["indentation_response"])
        if "marker_grid" in read:
            read["marker_grid"] = MarkerGrid.from_dict(values["marker_grid"])
        return cls(**read)


Sensor.__init__ = renamed_keywords(  # type: ignore[method-assign]
    **{old: new for new, old in STORED_NAMES.items()}
)(Sensor.__init__)


def _as_list(value: Any) -> Any:
    return [_as_list(item) for item in value] if isinstance(value, tuple) else value


def _as_tuple(value: Any) -> Any:
    return tuple(_as_tuple(item) for item in value) if isinstance(value, list | tuple) else value


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
