"""The parameters of the tasks, read strictly."""

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt, ValidationError

from objectfolder.errors import InputError

Pixels = Annotated[int, Field(ge=16, le=512)]
# What gels show of a grasp.
GelParts = Annotated[tuple[Literal["depth", "force", "shear"], ...], Field(min_length=1)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Counts(_Strict):
    """Training samples of each sense: senses differ in what one sample says, and in what it costs."""

    vision: PositiveInt
    audio: PositiveInt
    touch: PositiveInt


class Sides(_Strict):
    """Pixels on the shorter side of what networks see of each sense."""

    vision: Pixels
    audio: Pixels
    touch: Pixels


class Data(_Strict):
    """What is drawn of each object; see ``params.yaml``."""

    root: str
    objects: tuple[str, ...]
    training: Counts
    validation: PositiveInt
    test: int = Field(ge=5)  # five samples are told together
    resolution: Sides
    regions: int = Field(ge=5, le=100)


class Encoder(_Strict):
    """Size and training of the network of a sense."""

    # With 2 or 4 channels the backward pass of torch 2.13 writes beyond its memory, on processors with AVX2.
    width: int = Field(ge=8, multiple_of=8)
    epochs: PositiveInt
    batch: PositiveInt
    learning_rate: PositiveFloat


class TouchAtVertices(_Strict):
    """Touches of ObjectFolder 1.0: at vertices, along their normals, all as deep."""

    training: PositiveInt
    epochs: PositiveInt
    batch: PositiveInt
    learning_rate: PositiveFloat
    depth_m: float = Field(gt=0, le=0.002)
    finer_resolution: Pixels | None
    sensor: str


class Retrieval(_Strict):
    """The common space of two senses."""

    dimensions: PositiveInt
    epochs: PositiveInt
    margin: PositiveFloat
    temperature: PositiveFloat
    end_to_end_folds: int = Field(ge=0)


class Reconstruction(_Strict):
    """The occupancy network and its evaluation."""

    steps: PositiveInt
    points: PositiveInt
    width: PositiveInt
    grid: int = Field(ge=16, le=256, multiple_of=4)
    tests: PositiveInt
    surface_points: PositiveInt
    folds: int = Field(ge=0, le=5)


class Grasping(_Strict):
    """Grasps of each object, and how many a network is trained on."""

    grasps: PositiveInt
    resolution: Pixels
    sizes: tuple[PositiveInt, ...] = Field(min_length=1)
    others: PositiveInt
    left_out: PositiveInt | None
    folds: int = Field(ge=2, le=20)


class Regrasping(_Strict):
    """Grasps by touch, and how a policy learns them."""

    seeds: tuple[int, ...] = Field(min_length=1)
    observation: GelParts
    ablation: tuple[GelParts, ...]
    force_share: PositiveFloat
    spread_m: PositiveFloat
    regrasps: PositiveInt
    charge: float = Field(ge=0, lt=1)
    rollouts: PositiveInt
    rollout_steps: PositiveInt
    fixed_episodes: PositiveInt
    episodes: PositiveInt
    folds: int | None = Field(ge=2, le=20)


class StandIn(_Strict):
    """What the detector of the truth sees, and shares of the queries that networks are trained on, too."""

    detector_resolution: Sides
    training_shares: tuple[Annotated[float, Field(gt=0, lt=1)], ...]


class Settings(_Strict):
    """All parameters."""

    data: Data
    seeds: tuple[int, ...] = Field(min_length=1)
    folds: int = Field(ge=2, le=20)
    encoder: Encoder
    touch_at_vertices: TouchAtVertices
    retrieval: Retrieval
    reconstruction: Reconstruction
    stand_in: StandIn
    grasping: Grasping
    regrasping: Regrasping

    def with_resolution(self, **pixels: int) -> "Settings":
        """Return the same with other pixels on the shorter side of some senses."""
        resolution = self.data.resolution.model_copy(update=pixels)
        data = self.data.model_copy(update={"resolution": resolution})
        return self.model_copy(update={"data": data})


def read_settings(path: Path) -> Settings:
    """Read ``params.yaml``.

    Raises
    ------
    InputError
        A key that is missing or unknown, or a value out of range, named by its path.
    """
    try:
        return Settings.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}, {where}", first["msg"].lower(), "Correct it") from error
