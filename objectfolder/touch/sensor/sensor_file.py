"""Sensors as YAML files: those that come with the package, by name, and a user's own, by path.

The name may also be that of a plugin's sensor, which is none of the package's (docs/extending.md).

Reading one needs PyYAML; an Object File holds its sensor itself, and needs nothing of this.
"""

import dataclasses
import difflib
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.plugins import SENSORS, find_plugin, plugin_names
from objectfolder.products.atomic import write_whole
from objectfolder.products.regular_file import read_regular
from objectfolder.renaming import REMOVED_IN
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.illumination import Illumination, photometric_table
from objectfolder.touch.sensor.indentation_response import IndentationResponse
from objectfolder.touch.sensor.marker_grid import MarkerGrid
from objectfolder.touch.sensor.photometric_table import PhotometricTable
from objectfolder.touch.sensor.sensor import Sensor

FOLDER = Path(__file__).parent / "sensors"

# Section and key of a file to field of `Sensor`, and the kind of its value.
CAMERA = {
    "image_height": ("image_height", "whole"),
    "image_width": ("image_width", "whole"),
    "field_of_view_deg": ("field_of_view_deg", "number"),
    "position_m": ("camera_position_m", "vector"),
    "near_m": ("near_m", "number"),
}
GEL = {
    "apex_m": ("gel_apex_m", "vector"),
    "width_m": ("gel_width_m", "number"),
    "height_m": ("gel_height_m", "number"),
    "radius_m": ("gel_radius_m", "number"),
    "sagitta_m": ("gel_sagitta_m", "number"),
    "contact_radius_m": ("contact_radius_m", "number"),
    "maximum_depth_m": ("maximum_depth_m", "number"),
    "youngs_modulus_pa": ("gel_youngs_modulus_pa", "number"),
    "poisson_ratio": ("gel_poisson_ratio", "number"),
    "thickness_m": ("gel_thickness_m", "number"),
}
MATERIAL = {
    "base_colour": ("base_colour", "number"),
    "metallic": ("metallic", "number"),
    "roughness": ("roughness", "number"),
    "display_gamma": ("display_gamma", "number"),
}
HOUSING = {"low_m": ("housing_low_m", "vector"), "high_m": ("housing_high_m", "vector")}
NOISE_FIELDS = {"sigma_grey_levels": ("noise_sigma_grey_levels", "number")}
BACKGROUND = {
    "gain": ("background_gain", "number"),
    "blur_pixels": ("background_blur_pixels", "whole"),
}
# In place of the last key of the background.
BLUR_M = ("background_blur_m", "number")
# Keys as they were spelt before.
OLD_KEYS = {"base_color": "base_colour", "color": "colour"}
SECTIONS = {"camera": CAMERA, "gel": GEL, "housing": HOUSING, "noise": NOISE_FIELDS, "background": BACKGROUND}
LIGHT_FIELDS = {"position_m": ("position_m", "vector"), "colour": ("colour", "vector")}
SHADOWS = {
    "lamp_height_m": ("shadow_lamp_height_m", "number"),
    "penumbra_m": ("shadow_penumbra_m", "number"),
}
SHADOW_LAMP = {"position_m": ("position_m", "vector"), "share": ("share", "vector")}
MARKERS = {
    field.name: (field.name, "whole" if field.type is int else "number")
    for field in dataclasses.fields(MarkerGrid)
}
STRIP = {"colour": ("colour", "vector"), "points": ("points", "whole")}
MADE_FROM = {
    "ambient": ("ambient", "number"),
    "centre_value": ("centre_value", "number"),
    "display_gamma": ("display_gamma", "number"),
    "slopes": ("slopes", "whole"),
    "directions": ("directions", "whole"),
}


def sensor_names() -> tuple[str, ...]:
    """Names of the sensors that come with the package."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))


def sensor_path(source: Path | str, root: Path | None = None) -> Path:
    """Path of a sensor's file: of a known name, or a path (relative ones from `root`, if given).

    Raises
    ------
    InputError
        Neither a known name nor a file.
    """
    if str(source) in sensor_names():
        return FOLDER / f"{source}.yaml"
    path = Path(source) if root is None else root / source
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        known = ", ".join([*sensor_names(), *plugin_names(SENSORS)])
        raise InputError(
            "sensor", f"{str(source)[:80]!r} is no known sensor and no YAML file", f"Known: {known}."
        )
    return path


def read_sensor(source: Path | str, root: Path | None = None) -> Sensor:
    """Read a sensor by its name or from its file.

    Parameters
    ----------
    source
        A name of `sensor_names`, the name of a plugin's sensor, or a path of a file as they are.
    root
        Where relative paths start; the working directory if None.

    Raises
    ------
    InputError
        A file that is not there or not YAML, a missing or unknown key, a value of a wrong kind, or a
        sensor that cannot be; it names the file and the field. A plugin that brings no `Sensor`.

    Examples
    --------
    >>> digit = read_sensor("digit")
    >>> (digit.image_height, digit.image_width), digit.gel_youngs_modulus_pa
    ((160, 120), 560000.0)
    """
    plugin = find_plugin(SENSORS, str(source), sensor_names())
    if plugin is not None:
        if not isinstance(plugin.part, Sensor):
            finding = f"is of type {type(plugin.part).__name__}, and no Sensor of objectfolder"
            raise plugin.error(finding, "Let its entry point name one.")
        return plugin.part
    path = sensor_path(source, root)
    content = _yaml(path)
    return _sensor(path, content, _photometry(_Reader(path.name), path, content.get("photometry")))


def write_sensor(path: Path, sensor: Sensor, comment: str) -> None:
    """Write a sensor with a photometric table as a file that `read_sensor` reads, and its table beside it.

    Parameters
    ----------
    path
        Of the YAML file; the table has its name and the suffix ``.npy``, the indentation response, if it has
        one, ``-response.npy``.
    comment
        Lines at its head.

    Raises
    ------
    InputError
        A sensor without a photometric table; nothing is written.
    """
    with needs_extra("factory"):
        import yaml
    if sensor.photometric_table is None:
        raise InputError(sensor.name, "has no photometric table to write", "Compute one (`make_table`).")
    table = path.with_suffix(".npy")
    content: dict[str, Any] = {"name": sensor.name}
    for section, keys in SECTIONS.items():
        content[section] = {key: _plain(getattr(sensor, field)) for key, (field, _) in keys.items()}
    if sensor.background_blur_m:
        content["background"] = {"gain": sensor.background_gain, "blur_m": sensor.background_blur_m}
    if sensor.shadow_positions_m:
        lamps = zip(sensor.shadow_positions_m, sensor.shadow_shares, strict=True)
        content["shadows"] = {
            **{key: getattr(sensor, field) for key, (field, _) in SHADOWS.items()},
            "lamps": [{"position_m": list(position), "share": list(share)} for position, share in lamps],
        }
    if sensor.marker_grid is not None:
        content["markers"] = sensor.marker_grid.to_dict()
    content["photometry"] = {"model": "table", "table": table.name}
    if sensor.indentation_response is not None:
        response = path.with_name(f"{path.stem}-response.npy")
        content["photometry"]["response"] = response.name
        np.save(response, sensor.indentation_response.coefficients)
    head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    np.save(table, sensor.photometric_table.coefficients)
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)
    write_whole(path, f"{head}{text}")


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def make_table(source: Path | str) -> PhotometricTable:
    """Compute the table of a sensor's file from its section ``photometry.made_from``.

    Raises
    ------
    InputError
        As `read_sensor`, but for the table, which need not be there yet; no such section; or a curved gel.

    Examples
    --------
    >>> make_table("gelsight").coefficients.shape  # channels, slopes, directions, terms
    (3, 13, 24, 6)
    """
    path = sensor_path(source)
    illumination = read_illumination(path)
    try:
        return photometric_table(_sensor(path, _yaml(path), {}), illumination)
    except ValueError as error:
        raise InputError(path.name, str(error), "Correct it there.") from error


def _sensor(path: Path, content: dict[str, Any], photometry: dict[str, Any]) -> Sensor:
    """The sensor of a file's sections and of the fields of its photometry."""
    fields = _Reader(path.name)
    content = dict(content)
    shadows, markers = content.pop("shadows", None), content.pop("markers", None)
    fields.check_keys("", content, ("name", *SECTIONS, "photometry"))
    values: dict[str, Any] = {"name": fields.value("name", content["name"], "text"), **photometry}
    if shadows is not None:
        values.update(_shadows(fields, shadows))
    for section, keys in SECTIONS.items():
        if section == "background" and isinstance(content[section], dict) and "blur_m" in content[section]:
            keys = {"gain": BACKGROUND["gain"], "blur_m": BLUR_M}
        values.update(fields.section(section, content[section], keys))
    grid = None if markers is None else fields.section("markers", markers, MARKERS)
    try:
        if grid is not None:
            values["marker_grid"] = MarkerGrid(**grid)
        sensor = Sensor(**values)
        ray_grid(sensor, 1)
    except ValueError as error:
        raise InputError(path.name, str(error), "Correct it there.") from error
    return sensor


def _shadows(fields: "_Reader", content: Any) -> dict[str, Any]:
    """Fields of `Sensor` from the section ``shadows``, which a file may have."""
    fields.check_keys("shadows.", content, ("lamps", *SHADOWS))
    rest = {key: value for key, value in content.items() if key != "lamps"}
    lamps = [
        fields.section(f"shadows.lamps[{index}]", lamp, SHADOW_LAMP)
        for index, lamp in enumerate(fields.items("shadows.lamps", content["lamps"]))
    ]
    return {
        **fields.section("shadows", rest, SHADOWS),
        "shadow_positions_m": tuple(lamp["position_m"] for lamp in lamps),
        "shadow_shares": tuple(lamp["share"] for lamp in lamps),
    }


def read_illumination(source: Path | str) -> Illumination:
    """Read what a sensor's photometric table is said to be made from; see `illumination.photometric_table`.

    Raises
    ------
    InputError
        A sensor without a section ``photometry.made_from``, or a wrong one.
    """
    path = sensor_path(source)
    fields = _Reader(path.name)
    photometry = _yaml(path).get("photometry")
    made_from = photometry.get("made_from") if isinstance(photometry, dict) else None
    if made_from is None:
        raise InputError(path.name, "no section photometry.made_from", "gelsight.yaml has one.")
    where = "photometry.made_from"
    fields.check_keys(f"{where}.", made_from, ("strips", *MADE_FROM))
    strips = []
    for index, strip in enumerate(fields.items(f"{where}.strips", made_from["strips"])):
        name = f"{where}.strips[{index}]"
        fields.check_keys(f"{name}.", strip, ("ends_m", *STRIP))
        ends = fields.items(f"{name}.ends_m", strip["ends_m"])
        if len(ends) != 2:
            raise InputError(path.name, f"{name}.ends_m holds {len(ends)} points", "Give two.")
        ends = [fields.value(f"{name}.ends_m[{end}]", value, "vector") for end, value in enumerate(ends)]
        rest = {key: value for key, value in strip.items() if key != "ends_m"}
        strips.append({**fields.section(name, rest, STRIP), "ends_m": ends})
    rest = {key: value for key, value in made_from.items() if key != "strips"}
    return Illumination.from_dict({**fields.section(where, rest, MADE_FROM), "strips": strips})


def _photometry(fields: "_Reader", path: Path, content: Any) -> dict[str, Any]:
    """Fields of `Sensor` from the section ``photometry``."""
    if not isinstance(content, dict) or "model" not in content:
        raise InputError(path.name, "no key photometry.model", "It is cook_torrance or table.")
    model = content["model"]
    rest = {key: value for key, value in content.items() if key != "model"}
    if model == "cook_torrance":
        fields.check_keys("photometry.", rest, ("lights", *MATERIAL))
        material = {key: value for key, value in rest.items() if key != "lights"}
        lights = [
            fields.section(f"photometry.lights[{index}]", light, LIGHT_FIELDS)
            for index, light in enumerate(fields.items("photometry.lights", rest["lights"]))
        ]
        return {
            **fields.section("photometry", material, MATERIAL),
            "light_positions_m": tuple(light["position_m"] for light in lights),
            "light_colours": tuple(light["colour"] for light in lights),
        }
    if model == "table":
        rest.pop("made_from", None)
        response = rest.pop("response", None)
        fields.check_keys("photometry.", rest, ("table",))
        name = fields.value("photometry.table", rest["table"], "text")
        values: dict[str, Any] = {"photometric_table": PhotometricTable.read(path.parent / name)}
        if response is not None:
            beside = path.parent / fields.value("photometry.response", response, "text")
            values["indentation_response"] = IndentationResponse.read(beside)
        return {"light_positions_m": (), "light_colours": (), **values}
    raise InputError(path.name, f"photometry.model is {model!r}", "It is cook_torrance or table.")


def _yaml(path: Path) -> dict[str, Any]:
    with needs_extra("factory"):
        import yaml
    # Safe all the same, and ten times as fast where it is built.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        content = loader(read_regular(path).decode()).get_single_data()
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(str(path), f"cannot be read ({error})", "It must be a YAML file.") from error
    if not isinstance(content, dict):
        raise InputError(path.name, "holds no keys", "digit.yaml shows what a sensor needs.")
    return {
        key: _with_new_keys(path, value) if key == "photometry" else value for key, value in content.items()
    }


def _with_new_keys(path: Path, content: Any) -> Any:
    """Return a section of a file whose keys that were spelt otherwise are as they are now, with a warning."""
    if isinstance(content, list):
        return [_with_new_keys(path, item) for item in content]
    if not isinstance(content, dict):
        return content
    renamed: dict[Any, Any] = {}
    for key, value in content.items():
        new = OLD_KEYS.get(key, key) if isinstance(key, str) else key
        if new != key:
            message = f"{path.name}: the key `{key}` is now `{new}`; the old name goes with {REMOVED_IN}"
            warnings.warn(message, FutureWarning, stacklevel=2)  # who wrote the file sees it
        renamed[new] = _with_new_keys(path, value)
    return renamed


@dataclasses.dataclass(frozen=True)
class _Reader:
    """Values of one file, checked; errors name it."""

    file: str

    def section(self, name: str, content: Any, keys: Mapping[str, tuple[str, str]]) -> dict[str, Any]:
        """Values of a section under the names of their fields."""
        self.check_keys(f"{name}.", content, tuple(keys))
        return {field: self.value(f"{name}.{key}", content[key], kind) for key, (field, kind) in keys.items()}

    def check_keys(self, prefix: str, content: Any, known: tuple[str, ...]) -> None:
        """Raise `InputError` for what is no section, and for unknown and missing keys."""
        if not isinstance(content, dict):
            raise InputError(self.file, f"{prefix.rstrip('.')} is {content!r}", "It must hold keys.")
        for key in content:
            if key not in known:
                nearest = difflib.get_close_matches(str(key), known, 1, 0.5)
                remedy = f"Did you mean {prefix}{nearest[0]}?" if nearest else f"Known: {', '.join(known)}."
                raise InputError(self.file, f"unknown key {prefix}{key}", remedy)
        for key in known:
            if key not in content:
                raise InputError(self.file, f"no key {prefix}{key}", "Add it; digit.yaml shows how.")

    def items(self, name: str, content: Any) -> list[Any]:
        """The items of a list that holds some."""
        if not isinstance(content, list) or not content:
            raise InputError(self.file, f"{name} is {content!r}", "It must be a list.")
        return content

    def value(self, name: str, content: Any, kind: str) -> Any:
        """A value of a kind: text, whole, number or vector (three numbers, as a tuple)."""
        if kind == "vector":
            if not isinstance(content, list) or len(content) != 3:
                raise InputError(self.file, f"{name} is {content!r}", "It must be a list of three numbers.")
            return tuple(self.value(f"{name}[{axis}]", part, "number") for axis, part in enumerate(content))
        if kind == "text" and isinstance(content, str):
            return content
        if kind == "whole" and isinstance(content, int) and not isinstance(content, bool):
            return content
        number = isinstance(content, int | float) and not isinstance(content, bool)
        if kind == "number" and number and math.isfinite(content):
            return float(content)
        # YAML reads 1e-3 as text: its numbers need a dot before the exponent.
        hint = " (write 1.0e-3, not 1e-3)" if kind == "number" and isinstance(content, str) else ""
        kinds = {"text": "a text", "whole": "a whole number", "number": "a finite number"}
        raise InputError(self.file, f"{name} is {content!r}", f"It must be {kinds[kind]}{hint}.")
