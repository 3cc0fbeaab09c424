"""``params.yaml`` as frozen dataclasses: what gives the data its meaning, and nothing else."""

import dataclasses
import difflib
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from objectfolder.errors import InputError

Section = TypeVar("Section")


@dataclass(frozen=True)
class ObjectsParameters:
    """Which objects: a table (path from the root of the data set), and the ids to take (none: all)."""

    table: str
    only: tuple[str, ...]


@dataclass(frozen=True)
class VisionParameters:
    """Ground truth of vision; distances in unit-frame lengths, angles in degrees."""

    resolution: int
    field_of_view_deg: float
    camera_radius: float
    training_views: int
    training_samples: int
    held_out_views: int
    held_out_samples: int
    light_power_w: float
    passes: bool


@dataclass(frozen=True)
class AudioParameters:
    """Ground truth of audio; `accuracy_cents` is the wanted error of the first 50 frequencies."""

    max_frequency_hz: float
    max_modes: int
    accuracy_cents: float
    training_points: int
    held_out_points: int


@dataclass(frozen=True)
class TouchParameters:
    """Ground truth of touch; `sensor` is all of the sensor that the file names, `contact` a contact model."""

    sensor: dict[str, Any]
    contact: typing.Literal["rigid", "elastic"]
    touches: int
    held_out_touches: int
    depth_m: tuple[float, float]
    tilt_deg: float
    at_vertices: bool


@dataclass(frozen=True)
class VisionNetParameters:
    """Effort of fitting VisionNet: steps of its optimiser."""

    steps: int


@dataclass(frozen=True)
class AudioNetParameters:
    """Effort of fitting AudioNet: the gain error to reach, decibels, and the bytes not to exceed."""

    goal_db: float
    most_bytes: int


@dataclass(frozen=True)
class EncodeParameters:
    """Effort of the encoders; TouchNet has nothing to fit."""

    visionnet: VisionNetParameters
    audionet: AudioNetParameters


@dataclass(frozen=True)
class Parameters:
    """All parameters of a run, of the selected size."""

    size: str
    seed: int
    allow_failures: bool
    objects: ObjectsParameters
    vision: VisionParameters
    audio: AudioParameters
    touch: TouchParameters
    encode: EncodeParameters


COMMON = ("size", "seed", "allow_failures", "objects")


def read_parameters(path: Path) -> Parameters:
    """Read ``params.yaml``: the common keys, and the sections of the size it selects.

    Raises
    ------
    InputError
        A missing or unknown key, a value of a wrong type, a size that is not described.
    """
    where = path.name
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise InputError(str(path), f"cannot be read ({error})", "It must be a YAML file.") from error
    if not isinstance(content, dict):
        raise InputError(where, "holds no keys", "Restore it from version control.")
    check_keys(where, "", content, (*COMMON, "sizes"))
    sizes = content["sizes"]
    if not isinstance(sizes, dict) or content["size"] not in sizes:
        known = ", ".join(map(str, sizes)) if isinstance(sizes, dict) else "none"
        raise InputError(where, f"size: {content['size']!r} is not described", f"Known sizes are {known}.")
    for name, described in sizes.items():
        if not isinstance(described, dict):
            raise InputError(where, f"sizes.{name}: holds no sections", "Restore it from version control.")
    common = {name: content[name] for name in COMMON}
    selected = ""
    for name, described in sizes.items():  # a mistake in a size not selected now is a mistake all the same
        prefix = f"sizes.{name}."
        check_keys(where, prefix, described, _sections())
        described = _with_sensor(where, prefix, described, path.parent)
        parsed = parse(where, "", Parameters, {**common, **described}, {key: prefix for key in described})
        if name == content["size"]:
            selected, result = name, parsed
    assert selected
    return result


def _with_sensor(where: str, prefix: str, described: Mapping[str, Any], root: Path) -> dict[str, Any]:
    """Put the sensor that a size names, by name or by a path from `root`, in place of its name.

    So its content is what a product is made from, and a change of its file makes products anew.
    """
    touch = described["touch"]
    if not isinstance(touch, dict) or "sensor" not in touch:
        return dict(described)
    source = touch["sensor"]
    if not isinstance(source, str):
        raise InputError(where, f"{prefix}touch.sensor is {source!r}", "Give a name or the path of a file.")
    from objectfolder.touch.sensor_file import read_sensor

    try:
        sensor = read_sensor(source, root).to_dict()
    except InputError as error:
        finding = f"{prefix}touch.sensor: {error.where}: {error.finding}"
        raise InputError(where, finding, error.remedy) from error
    return {**described, "touch": {**touch, "sensor": sensor}}


def check_keys(where: str, prefix: str, content: Mapping[str, Any], known: typing.Sequence[str]) -> None:
    """Raise `InputError` for an unknown key, naming the nearest known one, and for a missing key."""
    for key in content:
        if key not in known:
            nearest = difflib.get_close_matches(str(key), known, 1, 0.5)
            remedy = f"Did you mean {prefix}{nearest[0]}?" if nearest else f"Known are {', '.join(known)}."
            raise InputError(where, f"unknown key {prefix}{key}", remedy)
    for key in known:
        if key not in content:
            raise InputError(where, f"no key {prefix}{key}", "Add it; version control has the original.")


def parse(
    where: str,
    prefix: str,
    section: type[Section],
    content: Any,
    origins: Mapping[str, str] = types.MappingProxyType({}),
) -> Section:
    """Return `content` as the dataclass `section`, every value of the type it declares.

    Parameters
    ----------
    where
        File name for messages.
    prefix
        Dotted name of the section, with a dot at its end.
    origins
        Prefix of keys that do not come from `prefix`.
    """
    if not isinstance(content, dict):
        raise InputError(where, f"{prefix.rstrip('.')} is {content!r}", "It must be a section with keys.")
    kinds = typing.get_type_hints(section)
    check_keys(where, prefix, content, tuple(kinds))
    values = {key: _value(where, origins.get(key, prefix) + key, kinds[key], content[key]) for key in kinds}
    return section(**values)


def _value(where: str, name: str, kind: Any, value: Any) -> Any:
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        return parse(where, f"{name}.", kind, value)
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        repeated = len(kinds) == 2 and kinds[1] is Ellipsis
        if not isinstance(value, list) or not (repeated or len(value) == len(kinds)):
            count = "any number of" if repeated else str(len(kinds))
            raise InputError(where, f"{name} is {value!r}", f"It must be a list of {count} values.")
        each = [kinds[0]] * len(value) if repeated else kinds
        return tuple(
            _value(where, f"{name}[{index}]", one, entry)
            for index, (one, entry) in enumerate(zip(each, value, strict=True))
        )
    if typing.get_origin(kind) is typing.Literal:
        if value in typing.get_args(kind):
            return value
        raise InputError(where, f"{name} is {value!r}", f"It must be {' or '.join(typing.get_args(kind))}.")
    if typing.get_origin(kind) is dict and isinstance(value, dict):
        return value
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    # YAML reads 1e-3 as text: its numbers need a dot before the exponent.
    hint = " (write 1.0e-3, not 1e-3)" if kind is float and isinstance(value, str) else ""
    raise InputError(where, f"{name} is {value!r}", f"It must be a {kind.__name__}{hint}.")


def _sections() -> tuple[str, ...]:
    return tuple(entry.name for entry in dataclasses.fields(Parameters) if entry.name not in COMMON)
