"""``params.yaml`` as frozen dataclasses: the parameters that decide the data, and nothing else."""

import dataclasses
import functools
import operator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, ValidationInfo
from pydantic.dataclasses import dataclass

from objectfolder.errors import InputError
from objectfolder.products.provenance import Constant
from pipeline.dataset.bounds import Bounds
from pipeline.dataset.validation import own_error, read_yaml, validated

PARAMETERS = "params.yaml"
# Validators are built when they are used: most commands read the parameters once, some never.
NO_OTHER_KEYS = ConfigDict(extra="forbid", defer_build=True)
HIGHEST_SEED = 2**63 - 1  # as queries take (`objectfolder.query_values`, which imports NumPy)
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
    """Check that a renderer is one that can draw the contact and the sensor; the default draws all."""
    if name == COMPATIBLE["renderer"]:
        return name  # without the imports below, which take as long as many a command
    from objectfolder.making.touches.opengl import check_drawable
    from objectfolder.touch.sensor.sensor import Sensor

    if "sensor" in info.data and "contact" in info.data:  # else that mistake is named
        try:
            check_drawable(name, Sensor.from_dict(info.data["sensor"]), info.data["contact"])
        except InputError as error:
            raise own_error(error) from error
    return name


def _depths(depth_m: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
    """Check that the depths are in order, and within what the gel and the camera of the sensor allow."""
    from objectfolder.touch.presses.touches import saturation_depth_m
    from objectfolder.touch.sensor.sensor import Sensor

    least, most = depth_m
    if least > most:
        raise ValueError("The second must not be less than the first")
    if "sensor" in info.data and most > (limit := saturation_depth_m(Sensor.from_dict(info.data["sensor"]))):
        raise ValueError(f"The sensor allows {limit:g} metres at most")
    return depth_m


def _path(text: str) -> str:
    """Check that a text can be a path."""
    if not text.strip() or "\0" in text:
        raise ValueError("It must be a path")
    return text


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class ObjectsParameters:
    """Which objects are made."""

    table: Annotated[
        str,
        AfterValidator(_path),
        Field(description="table of objects, a path from the root of the data set"),
    ]
    meshes: Annotated[
        str,
        AfterValidator(lambda text: text and _path(text)),
        Field(description="folder of their meshes and textures, in which DVC looks for changes"),
    ] = ""


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class VisionParameters:
    """Ground truth of vision. In the unit frame the longest side of an object is 1, its centre the origin."""

    resolution: Annotated[int, Bounds(8, 4096, "pixels", "side of a view")]
    field_of_view_deg: Annotated[float, Bounds(1, 150, "degrees", "of the camera, across a view")]
    camera_radius: Annotated[float, Bounds(1, 100, "unit-frame lengths", "camera from the centre")]
    training_views: Annotated[int, Bounds(1, 100_000, "views", "besides those to verify on")]
    training_samples: Annotated[int, Bounds(1, 65_536, "paths a pixel", "of Cycles, in views to fit")]
    held_out_views: Annotated[int, Bounds(1, 100_000, "views", "to verify on")]
    held_out_samples: Annotated[int, Bounds(1, 65_536, "paths a pixel", "of Cycles, in views to verify on")]
    light_power_w: Annotated[float, Bounds(1e-6, 1e6, "watts", "of each light, in the unit frame")]
    passes: Annotated[bool, Field(description="depth, normal, base colour and mask beside each view")]
    condition_views: Annotated[
        int,
        Bounds(0, 100, "views", "to verify on at 256 and 512 pixels, of other lamps, in environments, each"),
    ] = 0


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class AudioParameters:
    """Ground truth of audio."""

    max_frequency_hz: Annotated[float, Bounds(20, 1e6, "hertz", "of a mode")]
    max_modes: Annotated[int, Bounds(1, 4096, "modes", "of an object; more are left out")]
    accuracy_cents: Annotated[float, Bounds(0.01, 1200, "cents", "error of the frequencies")]
    training_points: Annotated[int, Bounds(1, 10_000_000, "points", "with a mode shape to fit AudioNet to")]
    held_out_points: Annotated[int, Bounds(1, 10_000_000, "points", "to verify on")]
    transfer: Annotated[
        Literal["none", "multipole"], Field(description="the way of each mode through the air")
    ] = "none"
    damping: Annotated[Literal["loss_factor", "rayleigh"], Field(description="law by which modes decay")] = (
        "loss_factor"
    )
    radiation: Annotated[
        Literal["solved", "sphere"], Field(description="what modes lose to the air, and how loud they are")
    ] = "solved"


DEPTH = Bounds(1e-6, 0.05, "metres", "of touches into the gel, least and most")


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class TouchParameters:
    """Ground truth of touch; `sensor` is all of the sensor that the file names."""

    sensor: Annotated[
        dict[str, Any], BeforeValidator(_sensor), Field(description="name of a sensor, or path of its file")
    ]
    contact: Annotated[Literal["rigid", "elastic"], Field(description="model of contact")]
    touches: Annotated[int, Bounds(1, 1_000_000, "touches", "to fit TouchNet to")]
    held_out_touches: Annotated[int, Bounds(1, 1_000_000, "touches", "to verify on")]
    depth_m: Annotated[tuple[Annotated[float, DEPTH], Annotated[float, DEPTH]], AfterValidator(_depths)]
    tilt_deg: Annotated[float, Bounds(0, 45, "degrees", "of the sensor from the normal, most")]
    at_vertices: Annotated[bool, Field(description="press at vertices rather than spread by area")]
    renderer: Annotated[
        str, AfterValidator(_renderer), Field(description="what draws: compiled or pyrender")
    ] = "compiled"


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class CollisionParameters:
    """Convex parts of an object."""

    threshold_m: (
        Annotated[float, Bounds(1e-6, 1, "metres", "of concavity in a part; null: what fits the object")]
        | None
    )
    most_parts: Annotated[int, Bounds(1, 1000, "parts", "of an object")]


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class VisionNetParameters:
    """Effort of fitting VisionNet."""

    steps: Annotated[int, Bounds(1, 10_000_000, "steps", "of the optimiser")]
    grid_corners: Annotated[int, Bounds(1, 10_000_000, "corners", "of the finest grid of features")] = 100_000
    material: Annotated[
        Literal["known", "learned"],
        Field(description="light computed from what the source states, or fitted to the training views"),
    ] = "known"


@dataclass(frozen=True, config=NO_OTHER_KEYS)
class AudioNetParameters:
    """Effort of fitting AudioNet."""

    goal_db: Annotated[float, Bounds(-200, 0, "decibels", "gain error at which control points are enough")]
    most_bytes: Annotated[int, Bounds(1000, 1_000_000_000, "bytes", "that AudioNet stores")]


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

    size: Annotated[str, Field(description="which of `sizes` is made")]
    seed: Annotated[int, Bounds(0, HIGHEST_SEED, "", "of every random choice, with stage and object")]
    allow_failures: Annotated[bool, Field(description="go on with the objects that did not fail")]
    objects: ObjectsParameters


@dataclass(frozen=True)
class Parameters(SizeParameters, CommonParameters):
    """All parameters of a run, of the selected size."""

    def values_at(self, name: str) -> Any:
        """Return the value at a dotted name, sections as dictionaries."""
        return functools.reduce(operator.getitem, name.split("."), self._mappings)

    def values(self, names: tuple[str, ...]) -> Constant:
        """Return the values at dotted names, by name; the same object each time."""
        if names not in self._values:
            self._values[names] = Constant({name: self.values_at(name) for name in names})
        return self._values[names]

    @functools.cached_property
    def _values(self) -> dict[tuple[str, ...], Constant]:
        return {}

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
    content = read_yaml(path)
    objects = content.get("objects") if isinstance(content, dict) else None
    if isinstance(objects, dict) and "only" in objects:  # of earlier versions
        remedy = "Delete that line. `objectfolder select --only ID,ID` selects objects, for one checkout."
        raise InputError(path.name, "objects.only is no parameter any more", remedy)
    file = validated(path.name, ParametersFile, content, {"root": path.resolve().parent})
    size = size or file.size
    if size not in file.sizes:
        size_names = ", ".join(file.sizes)
        raise InputError(path.name, f"size: {size!r} is not described", f"Known sizes are {size_names}.")
    common = {name: getattr(file, name) for name in CommonParameters.__dataclass_fields__ if name != "size"}
    return Parameters(size=size, **common, **vars(file.sizes[size]))
