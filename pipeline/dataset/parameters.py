"""``params.yaml`` as frozen dataclasses: the parameters that decide the data, and nothing else."""

import dataclasses
import functools
import operator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, ValidationInfo
from pydantic.dataclasses import dataclass

from objectfolder.errors import InputError
from pipeline.dataset.validation import own_error, read_yaml, validated

PARAMETERS = "params.yaml"
NO_OTHER_KEYS = ConfigDict(extra="forbid")
# Of later versions: with this value tasks are given no such key, so that products of before stay current.
COMPATIBLE = {"renderer": "compiled"}


def _sensor(source: object, info: ValidationInfo) -> dict[str, Any]:
    """Return all of the sensor that a size names, by name or by a path from the folder of the file.

    So its content is what a product is made from, and a change of its file makes products anew.
    """
    from objectfolder.touch.sensor.sensor_file import read_sensor

    if not isinstance(source, str):
        raise ValueError("Give a name or the path of a file")
    try:
        return read_sensor(source, (info.context or {})["root"]).to_dict()
    except InputError as error:
        raise own_error(error) from error


def _renderer(name: str, info: ValidationInfo) -> str:
    """Check that a renderer is one that can draw the contact and the sensor."""
    from objectfolder.touch.sensor.sensor import Sensor
    from objectfolder.touch.truth.opengl import check_drawable

    if "sensor" in info.data and "contact" in info.data:  # else that mistake is named
        try:
            check_drawable(name, Sensor.from_dict(info.data["sensor"]), info.data["contact"])
        except InputError as error:
            raise own_error(error) from error
    return name


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class ObjectsParameters:
    """Which objects: a table (path from the root of the data set), and the ids to take (none: all)."""

    table: str
    only: tuple[str, ...]


@dataclass(frozen=True, config=NO_OTHER_KEYS)
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


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class AudioParameters:
    """Ground truth of audio; `accuracy_cents` is the wanted error of the first 50 frequencies."""

    max_frequency_hz: float
    max_modes: int
    accuracy_cents: float
    training_points: int
    held_out_points: int
    transfer: Literal["none", "multipole"] = "none"
    damping: Literal["loss_factor", "rayleigh"] = "loss_factor"


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class TouchParameters:
    """Ground truth of touch.

    `sensor` is all of the sensor that the file names, `contact` a contact model, and `renderer` what draws.
    """

    sensor: Annotated[dict[str, Any], BeforeValidator(_sensor)]
    contact: Literal["rigid", "elastic"]
    touches: int
    held_out_touches: int
    depth_m: tuple[float, float]
    tilt_deg: float
    at_vertices: bool
    renderer: Annotated[str, AfterValidator(_renderer)] = "compiled"


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class CollisionParameters:
    """Convex parts: the concavity that one may have, metres (none: what fits), and the largest number."""

    threshold_m: Annotated[float, Field(gt=0)] | None
    most_parts: Annotated[int, Field(ge=1)]


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class VisionNetParameters:
    """Effort of fitting VisionNet: steps of its optimiser, the finest features it may store, and whether it
    is fitted at all."""

    steps: int
    grid_corners: int = 100_000
    material: Literal["learned", "known"] = "learned"


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class AudioNetParameters:
    """Effort of fitting AudioNet: the gain error to reach, decibels, and the bytes not to exceed."""

    goal_db: float
    most_bytes: int


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class EncodeParameters:
    """Effort of the encoders; TouchNet has nothing to fit."""

    visionnet: VisionNetParameters
    audionet: AudioNetParameters


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class SizeParameters:
    """The parameters of a size."""

    vision: VisionParameters
    audio: AudioParameters
    touch: TouchParameters
    collision: CollisionParameters
    encode: EncodeParameters


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class CommonParameters:
    """The parameters that all sizes share."""

    size: str
    seed: int
    allow_failures: bool
    objects: ObjectsParameters


@dataclass(frozen=True)
class Parameters(SizeParameters, CommonParameters):
    """All parameters of a run, of the selected size."""

    def values_at(self, name: str) -> Any:
        """Return the value at a dotted name, sections as dictionaries."""
        return functools.reduce(operator.getitem, name.split("."), self._mappings)

    @functools.cached_property
    def _mappings(self) -> dict[str, Any]:
        return dataclasses.asdict(
            self, dict_factory=lambda items: dict(item for item in items if item not in COMPATIBLE.items())
        )


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class ParametersFile(CommonParameters):
    """``params.yaml`` as it is written: a mistake in a size not selected is a mistake all the same."""

    sizes: dict[str, SizeParameters]


def read_parameters(path: Path, size: str | None = None) -> Parameters:
    """Read ``params.yaml``: the common keys, and the sections of a size, by default the one it selects.

    Raises
    ------
    InputError
        A missing or unknown key, a value of a wrong type, a size that is not described.
    """
    file = validated(path.name, ParametersFile, read_yaml(path), {"root": path.parent})
    size = size or file.size
    if size not in file.sizes:
        known = ", ".join(file.sizes)
        raise InputError(path.name, f"size: {size!r} is not described", f"Known sizes are {known}.")
    shared = {name: getattr(file, name) for name in CommonParameters.__dataclass_fields__ if name != "size"}
    return Parameters(size=size, **shared, **vars(file.sizes[size]))
