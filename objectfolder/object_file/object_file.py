"""The Object File: one object's sight, sound and touch in one file, and the queries it answers.

One safetensors file holds the compressed surface once; vision is reflectance on it, sound is mode
shapes on it, touch is a sensor pressed into it. Queries are in the object frame: metres, newton
seconds, seconds.
"""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.audionet.audionet import AudioNet
from objectfolder.errors import FormatError
from objectfolder.forks import hold_forks
from objectfolder.object_file.container import (
    GLASS,
    KNOWN,
    LEARNED,
    check_description,
    make_container,
    parse_description,
    read_container,
)
from objectfolder.products.tensor_file import TensorFile, write_tensor_file
from objectfolder.signatures import ShortForm
from objectfolder.surface.codec import decode_surface
from objectfolder.surface.contact_surface import ContactSurface
from objectfolder.surface.convex_parts import ConvexParts, check_parts
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import ClosestPoints, Surface
from objectfolder.touch.touchnet import TouchNet
from objectfolder.vision.appearance import THIN
from objectfolder.vision.visionnet.visionnet import VisionNet

if TYPE_CHECKING:
    from objectfolder.audio.synthesis.sound_queries import SoundQueries
    from objectfolder.touch.touch_queries import TouchQueries
    from objectfolder.vision.visionnet.sight_queries import SightQueries

SURFACE_TOLERANCE_M = 1e-3


# An Object File opens without the queries of its senses, and so without numba, whose import takes 0.5 s.
def _sight_queries() -> "type[SightQueries]":
    from objectfolder.vision.visionnet.sight_queries import SightQueries

    return SightQueries


def _sound_queries() -> "type[SoundQueries]":
    from objectfolder.audio.synthesis.sound_queries import SoundQueries

    return SoundQueries


def _touch_queries() -> "type[TouchQueries]":
    from objectfolder.touch.touch_queries import TouchQueries

    return TouchQueries


class ObjectFile:
    """What an object looks, sounds and feels like.

    Open one with `objectfolder.load`; an encoder makes one with `ObjectFile.of_encoders`.

    Attributes
    ----------
    surface
        The stored surface, metres.
    frame
        The unit frame of the data set's cameras and lights.
    sight, sound, touch
        The queries of each sense; `render`, `strike`, `press` and the others are short for theirs. Each has
        its encoder as `net`.
    description
        Everything the file says of itself: object, licence, material, frames, sensor, provenance and its
        own fidelity.
    """

    def __init__(
        self,
        surface: Surface,
        frame: UnitFrame,
        vision: VisionNet,
        modes: AudioNet,
        touch: TouchNet,
        description: Mapping[str, Any],
        tensors: Mapping[str, np.ndarray],
    ) -> None:
        self.surface = surface
        self.frame = frame
        self.description = dict(description)
        self._nets = vision, modes, touch
        self._contacts = ContactSurface(surface, SURFACE_TOLERANCE_M)
        self._tensors = dict(tensors)
        self._collision: ConvexParts | None = None  # built when it is asked for
        if self.description.get("collision") is not None:
            check_parts(self._tensors, self.description["collision"])

    def __repr__(self) -> str:
        sides_cm = 100 * np.ptp(self.bounds_m, axis=0)
        size_cm = " x ".join(f"{side:.1f}" if side >= 1 else f"{side:.2g}" for side in sides_cm)
        mass = "unknown mass" if self.mass_kg is None else f"{self.mass_kg:.3g} kg"
        modes = f"{len(self.modes.frequencies_hz)} modes"
        return (
            f"ObjectFile({self.name!r}, {self.material or 'unknown material'}, {mass}, {size_cm} cm, {modes})"
        )

    def __eq__(self, other: object) -> bool:
        """Return whether another Object File has the same tensors and the same description."""
        if not isinstance(other, ObjectFile):
            return NotImplemented
        mine, theirs = self.content(), other.content()
        return mine.metadata == theirs.metadata and _equal_tensors(mine.tensors, theirs.tensors)

    def __hash__(self) -> int:
        # Of what equal files share and nobody edits; the description is a dictionary, which may change.
        return hash(frozenset((name, tensor.shape) for name, tensor in self._tensors.items()))

    @cached_property
    @hold_forks
    def sight(self) -> "SightQueries":
        """The queries of sight."""
        return _sight_queries()(self.surface, self.frame, self._nets[0])

    @cached_property
    @hold_forks
    def sound(self) -> "SoundQueries":
        """The queries of sound."""
        return _sound_queries()(self._nets[1], self._contacts, self.description)

    @cached_property
    @hold_forks
    def touch(self) -> "TouchQueries":
        """The queries of touch."""
        return _touch_queries()(self._nets[2], self._contacts)

    @property
    def vision(self) -> VisionNet:
        """The encoder of sight."""
        return self.sight.net

    @property
    def modes(self) -> AudioNet:
        """The encoder of sound."""
        # What is asked for its modes alone, as by `repr`, needs no queries of sound, and so no numba.
        return self.sound.net if "sound" in vars(self) else self._nets[1]

    @property
    def surface_tolerance_m(self) -> float:
        """How far from the surface a contact may be given; it is projected onto the surface."""
        return self._contacts.tolerance_m

    @surface_tolerance_m.setter
    def surface_tolerance_m(self, tolerance_m: float) -> None:
        self._contacts.tolerance_m = tolerance_m

    @property
    def name(self) -> str:
        """Name in words."""
        described = self.description["object"]
        return str(described.get("name") or described["id"])

    @property
    def material(self) -> str | None:
        """Name of the material; None where it is not known."""
        material = self.description["material"]
        return None if material is None else str(material["name"])

    @property
    def mass_kg(self) -> float | None:
        """Mass of the solid that sounds; None where it is not known."""
        body = self.description["body"]
        return None if body is None or body["filled_mass_kg"] is None else float(body["filled_mass_kg"])

    @property
    def bounds_m(self) -> NDArray[np.float64]:
        """(2, 3) lowest and highest coordinates of the surface, object frame."""
        return np.asarray(self.surface.bounds, dtype=np.float64)

    @property
    def length_m(self) -> float:
        """Longest side of the bounding box."""
        return float(np.ptp(self.bounds_m, axis=0).max())

    @property
    def collision(self) -> ConvexParts | None:
        """Convex hulls that stand for the solid in simulators; None in a file that has none."""
        measures = self.description.get("collision")
        if self._collision is None and measures is not None:
            self._collision = ConvexParts.from_tensors(self._tensors, measures)
        return self._collision

    @property
    def fidelity(self) -> dict[str, Any] | None:
        """What the file measured of itself on held-out queries, by sense; None where nothing was measured."""
        measured: dict[str, Any] | None = self.description["fidelity"]
        return measured

    @classmethod
    def of_encoders(
        cls,
        surface_tensors: Mapping[str, np.ndarray],
        frame: UnitFrame,
        vision: VisionNet,
        modes: AudioNet,
        touch: TouchNet,
        description: Mapping[str, Any],
    ) -> "ObjectFile":
        """Put the parts together as they will be read back from a file.

        Frequencies and dampings are in the description, too, for readers of nothing but the header.

        Parameters
        ----------
        surface_tensors
            What `encode_surface` returned; the encoders were fitted on its decoded form.
        description
            Keys ``object``, ``material``, ``body``, ``provenance`` and ``fidelity``; None
            for what is not known yet.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> from objectfolder.surface.codec import encode_surface
        >>> surface = encode_surface(bar.surface)
        >>> told = bar.description
        >>> same = bar.of_encoders(surface, bar.frame, bar.vision, bar.modes, bar.touch.net, told)
        >>> same.bytes_by_part() == bar.bytes_by_part()
        True
        """
        tensors = {**surface_tensors, **vision.tensors(), **modes.tensors(), **touch.tensors()}
        content = {
            **description,
            "frame": frame.to_dict(),
            "modes": {
                "frequencies_hz": modes.frequencies_hz.tolist(),
                "dampings_per_s": modes.dampings_per_s.tolist(),
            },
            "vision": vision.metadata(),
            "audio": modes.metadata(),
            "touch": touch.metadata(),
        }
        return cls.of_tensors(tensors, content)

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, np.ndarray], description: Mapping[str, Any]) -> "ObjectFile":
        """Build the object from stored tensors, checking every one of them.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> same = bar.of_tensors(bar.content().tensors, bar.description)
        >>> same.content().tensors.keys() == bar.content().tensors.keys()
        True
        """
        surface = decode_surface(dict(tensors))
        frame = check_description(description, surface)
        vision = VisionNet.from_tensors(tensors, description["vision"], surface, frame)
        modes = AudioNet.from_tensors(tensors, description["audio"], surface)
        touch = TouchNet.from_tensors(tensors, description["touch"], surface)
        return cls(surface, frame, vision, modes, touch, description, tensors)

    @classmethod
    @hold_forks
    def load(cls, path: Path | str) -> "ObjectFile":
        """Open an Object File.

        Raises
        ------
        FormatError
            A truncated or foreign file or a folder, an unknown version, or a tensor of a wrong shape.
        FileNotFoundError
            No such file.

        Examples
        --------
        >>> from objectfolder.object_file import ObjectFile
        >>> ObjectFile.load("materials.csv")
        Traceback (most recent call last):
        objectfolder.errors.FormatError: materials.csv: ...
        """
        where, content = str(path), read_container(path)
        try:
            return cls.of_tensors(content.tensors, parse_description(content.metadata))
        except FormatError as error:
            raise FormatError(where, f"{error.where}: {error.finding}", "Fetch or build it again.") from error
        except (LookupError, ValueError, TypeError, ArithmeticError, AttributeError, RecursionError) as error:
            raise FormatError(
                where, f"incomplete ({type(error).__name__}: {error})", "Fetch or build it again."
            ) from error

    def with_description(self, **more: Any) -> "ObjectFile":
        """Return the same object with parts of its description replaced.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> bar.with_description(fidelity=None).description["fidelity"] is None
        True
        """
        return self._with({**self.description, **more}, self._tensors)

    def with_collision(self, parts: ConvexParts) -> "ObjectFile":
        """Return the same object with convex parts for simulators, in place of those that it has.

        Examples
        --------
        >>> import objectfolder
        >>> from objectfolder.surface.convex_parts import ConvexParts, convex_hull
        >>> bar = objectfolder.load("bar.safetensors")
        >>> parted = bar.with_collision(ConvexParts((convex_hull(bar.surface.vertices),), 1.0, 0.0, 0.0))
        >>> len(parted.collision.hulls), parted.bytes_by_part()["collision"]
        (1, 200)
        """
        description = {**self.description, "collision": parts.to_dict()}
        return self._with(description, {**self._tensors, **parts.tensors()})

    def _with(self, description: Mapping[str, Any], tensors: Mapping[str, np.ndarray]) -> "ObjectFile":
        parts = self.surface, self.frame, self.vision, self.modes, self.touch.net
        return ObjectFile(*parts, description, tensors)

    def content(self) -> TensorFile:
        """Return the file's tensors and metadata; equal objects give equal bytes.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> bar.content().metadata["format"], bar.content().metadata["format_version"]
        ('objectfolder', '3')
        """
        version = KNOWN if self.vision.computed else LEARNED
        if self.vision.glass == THIN:
            version = GLASS  # programs that know nothing of it would draw it opaque
        return make_container(self._tensors, self.description, version)

    def save(self, path: Path | str) -> None:
        """Write the file, atomically.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> bar.save("copy.safetensors")
        >>> objectfolder.load("copy.safetensors").bytes_by_part() == bar.bytes_by_part()
        True
        """
        write_tensor_file(path, self.content())

    def bytes_by_part(self) -> dict[str, int]:
        """Return the bytes of the tensors of each part: surface, vision, audio, touch, and what else it has.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> parts = bar.bytes_by_part()
        >>> max(parts, key=parts.get), parts["touch"]
        ('vision', 0)
        """
        parts = dict.fromkeys(("surface", "vision", "audio", "touch"), 0)
        for name, tensor in self._tensors.items():
            part = name.split(".")[0]
            parts[part] = parts.get(part, 0) + tensor.nbytes
        return parts

    @hold_forks
    def project(self, points: ArrayLike, *, name: str = "points") -> ClosestPoints:
        """Bring contacts onto the surface.

        Parameters
        ----------
        points
            (3,) or (n, 3) metres.
        name
            What an error calls them.

        Raises
        ------
        QueryError
            A contact farther than `surface_tolerance_m`, named with its distance.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> top = bar.project([0.0, 0.0, 0.0045])  # the bar is 8 mm thick: this is 0.5 mm above it
        >>> top.points.round(4).tolist(), top.distance.round(4).tolist()
        ([[0.0, 0.0, 0.004]], [0.0005])
        """
        return self._contacts.project(points, name=name)

    # The queries of each sense, in short.
    render = ShortForm("sight", lambda: _sight_queries().render)
    render_linear = ShortForm("sight", lambda: _sight_queries().render_linear)
    render_passes = ShortForm("sight", lambda: _sight_queries().render_passes)
    radiance = ShortForm("sight", lambda: _sight_queries().radiance)
    pictures = ShortForm("sight", lambda: _sight_queries().pictures)
    sample_views = ShortForm("sight", lambda: _sight_queries().sample_views)
    strike = ShortForm("sound", lambda: _sound_queries().strike)
    strikes = ShortForm("sound", lambda: _sound_queries().strikes)
    stream = ShortForm("sound", lambda: _sound_queries().stream)
    rms_velocity = ShortForm("sound", lambda: _sound_queries().rms_velocity)
    mode_velocities = ShortForm("sound", lambda: _sound_queries().mode_velocities)
    press = ShortForm("touch", lambda: _touch_queries().press)
    reach = ShortForm("touch", lambda: _touch_queries().reach)
    sample_contacts = ShortForm("touch", lambda: _touch_queries().sample_contacts)

    def _repr_html_(self) -> str:
        """Return what a notebook shows; see `notebook_card`."""
        from objectfolder.object_file.html import notebook_card

        return notebook_card(self.sight, self.sound, self.description)


def _equal_tensors(first: Mapping[str, np.ndarray], second: Mapping[str, np.ndarray]) -> bool:
    return first.keys() == second.keys() and all(
        tensor.dtype == second[name].dtype and np.array_equal(tensor, second[name])
        for name, tensor in first.items()
    )
