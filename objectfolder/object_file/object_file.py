"""The Object File: one object's sight, sound and touch in one file, and the queries it answers.

One safetensors file holds the compressed surface once; vision is reflectance on it, sound is mode
shapes on it, touch is a sensor pressed into it. Queries are in the object frame: metres, newton
seconds, seconds.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.audionet.audionet import AudioNet
from objectfolder.errors import FormatError, QueryError
from objectfolder.object_file.html import NotebookCard
from objectfolder.products.stored_values import (
    check_body,
    check_fidelity,
    check_material,
    check_words,
    number,
    numbers,
)
from objectfolder.products.tensor_file import REMEDY, TensorFile, read_tensor_file, write_tensor_file
from objectfolder.query_values import LARGEST_SEED, MOST_SAMPLED, point_rows, whole
from objectfolder.renaming import renamed_keywords
from objectfolder.surface.codec import LARGEST_COORDINATE_M, decode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import ClosestPoints, Surface
from objectfolder.touch.touchnet import TouchNet
from objectfolder.touch.truth.touches import Press, Reach, Touches
from objectfolder.vision.network.sparse_grid import HALF_WIDTH
from objectfolder.vision.visionnet.visionnet import VisionNet

FORMAT = "objectfolder"
FORMAT_VERSION = 3
SURFACE_TOLERANCE_M = 1e-3
MOST_ATTEMPTS = 100
REQUIRED = (
    "object",
    "material",
    "body",
    "frame",
    "modes",
    "vision",
    "audio",
    "touch",
    "provenance",
    "fidelity",
)


class ObjectFile(NotebookCard):
    """What an object looks, sounds and feels like.

    Open one with `objectfolder.load`; an encoder makes one with `ObjectFile.of_encoders`.

    Attributes
    ----------
    surface
        The stored surface, metres.
    frame
        The unit frame of the data set's cameras and lights.
    vision, modes, touch
        The encoders of the three senses.
    description
        Everything the file says of itself: object, licence, material, frames, sensor, provenance and its
        own fidelity.
    surface_tolerance_m
        How far from the surface a contact may be given; it is projected onto the surface.
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
        self.vision = vision
        self.modes = modes
        self.touch = touch
        self.description = dict(description)
        self.surface_tolerance_m = SURFACE_TOLERANCE_M
        self._tensors = dict(tensors)

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
        >>> same = bar.of_encoders(surface, bar.frame, bar.vision, bar.modes, bar.touch, told)
        >>> same.bytes_by_part() == bar.bytes_by_part()
        True
        """
        tensors = {**surface_tensors, **vision.tensors(), **modes.tensors(), **touch.tensors()}
        said = {
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
        return cls.of_tensors(tensors, said)

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
        frame = _frame_around(surface, description["frame"])
        check_words(description["object"])
        check_fidelity(description["fidelity"])
        check_body(description["body"])
        check_material(description["material"])
        vision = VisionNet.from_tensors(tensors, description["vision"], surface, frame)
        modes = AudioNet.from_tensors(tensors, description["audio"], surface)
        touch = TouchNet.from_tensors(tensors, description["touch"], surface)
        return cls(surface, frame, vision, modes, touch, description, tensors)

    @classmethod
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
        where = str(path)
        if Path(path).is_dir():
            held = sorted(Path(path).glob("*.safetensors"))
            remedy = (
                f"Open a file in it, such as {held[0]}." if held else "Name an Object File (.safetensors)."
            )
            raise FormatError(where, "a folder, not an Object File", remedy)
        content = read_tensor_file(path)
        if content.metadata.get("format") != FORMAT:
            raise FormatError(where, "a safetensors file, but not an Object File", "Build one from a mesh.")
        version = content.metadata.get("format_version")
        if version != str(FORMAT_VERSION):
            raise FormatError(
                where,
                f"Object File of version {version}, this program reads {FORMAT_VERSION}",
                "Use the program that made it, or build it again.",
            )
        try:
            description = {key: json.loads(content.metadata[key]) for key in REQUIRED}
            return cls.of_tensors(content.tensors, description)
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
        described = {**self.description, **more}
        return ObjectFile(
            self.surface, self.frame, self.vision, self.modes, self.touch, described, self._tensors
        )

    def on(self, device: str = "cpu") -> "ObjectFile":
        """Return the same object, rendered on another device, `file.vision.device`; see `VisionNet.on`.

        Raises
        ------
        QueryError
            A device that is not at hand.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> str(bar.on("cpu").vision.device)
        'cpu'
        """
        seen = self.vision.on(device)
        return ObjectFile(
            self.surface, self.frame, seen, self.modes, self.touch, self.description, self._tensors
        )

    def content(self) -> TensorFile:
        """Return the file's tensors and metadata; equal objects give equal bytes.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> bar.content().metadata["format"], bar.content().metadata["format_version"]
        ('objectfolder', '3')
        """
        metadata: dict[str, Any] = {"format": FORMAT, "format_version": str(FORMAT_VERSION)}
        metadata.update({key: json.dumps(self.description.get(key), sort_keys=True) for key in REQUIRED})
        return TensorFile(self._tensors, metadata)

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
        """Return the bytes of the tensors of each part: surface, vision, audio, touch.

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
            parts[name.split(".")[0]] += tensor.nbytes
        return parts

    def press(
        self,
        points: np.ndarray,
        depth: float | np.ndarray | None = None,
        tilt: float | np.ndarray = 0.0,
        azimuth: float | np.ndarray = 0.0,
        *,
        roll: float | np.ndarray = 0.0,
        force: float | np.ndarray | None = None,
        contact: str | None = None,
        resolution: int | tuple[int, int] | None = None,
        background: np.ndarray | None = None,
        noise_seed: int | Sequence[int] | None = None,
    ) -> Touches:
        """Press the sensor along the surface normal.

        Parameters
        ----------
        points
            (3,) or (n, 3) contacts, metres, within `surface_tolerance_m` of the surface.
        depth
            How far into the gel, metres; a millimetre where neither a depth nor a force is given.
        tilt, azimuth
            Inclination of the sensor from the normal and its direction, degrees.
        roll
            Turn of the sensor about its own axis, degrees, the image's right towards its top; `reach` finds
            rolls at which it fits.
        force
            Instead of a depth: newtons along the sensor's axis, under the elastic model.
        contact
            ``"rigid"``, as TACTO, or ``"elastic"``; by default the file's own, and elastic with a force.
        resolution
            Height and width of the images in pixels, or one number for both; by default the sensor's.
        background
            (height, width, 3) uint8, a real sensor's untouched image to lay the touches over.
        noise_seed
            Seed of the sensor's noise, or (n,) one a touch, each then as it is alone; by default no noise.

        Raises
        ------
        QueryError
            A contact off the surface (with its distance), or a depth, force, size or model that the
            sensor cannot answer.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, _ = bar.sample_contacts(2, seed=0)
        >>> touches = bar.press(points, depth=0.001)
        >>> touches.rgb.shape, touches.penetration_m.tolist()
        ((2, 160, 120, 3), [0.001, 0.001])
        """
        return self.touch.press(
            self.project(points).points,
            Press(depth, force, tilt, azimuth, roll, contact, self.touch.samples),
            resolution=resolution,
            background=background,
            noise_seed=noise_seed,
        )

    def reach(
        self,
        points: np.ndarray,
        depth: float | np.ndarray | None = None,
        tilt: float | np.ndarray = 0.0,
        azimuth: float | np.ndarray = 0.0,
        *,
        roll: float | np.ndarray = 0.0,
        rolls: int = 24,
    ) -> Reach:
        """Find rolls of the sensor at which points can be pressed, under the rigid model and without images.

        Parameters
        ----------
        points, depth, tilt, azimuth, roll
            As for `press`; the roll is the first that is tried.
        rolls
            How many are tried, evenly round a turn, 1 to 360.

        Returns
        -------
        Reach
            ``reachable`` (n, rolls), ``at_some_roll`` (n,) and ``best_roll_deg`` (n,).

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> reach = bar.reach([[0.0, 0.0, 0.004]])
        >>> reach.at_some_roll.tolist(), reach.best_roll_deg.tolist()
        ([True], [0.0])
        """
        asked = Press(depth, None, tilt, azimuth, roll)
        return self.touch.reach(self.project(points).points, asked, rolls)

    def project(self, points: np.ndarray, *, name: str = "points") -> ClosestPoints:
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
        contacts = point_rows(points, name)
        closest = self.surface.closest_points(contacts)
        worst = int(np.argmax(closest.distance)) if len(contacts) else 0
        if len(contacts) and closest.distance[worst] > self.surface_tolerance_m:
            raise QueryError(
                f"{name}[{worst}]",
                f"{closest.distance[worst] * 1e3:.3g} mm off the surface",
                f"Contacts lie within {self.surface_tolerance_m * 1e3:.3g} mm, in metres, object frame; "
                "`sample_contacts` gives valid ones.",
            )
        return closest

    @renamed_keywords(count="n")
    def sample_contacts(
        self, n: int = 1, seed: int = 0, *, reachable: bool = True
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw contacts uniformly by area: points (n, 3) metres and outward unit normals (n, 3).

        Parameters
        ----------
        n, seed
            How many, and the seed of the draw.
        reachable
            Only contacts at which the sensor can be pressed a millimetre deep along the normal; each is
            tried. False draws anywhere on the surface, also where no sensor fits, as deep inside of a mug:
            `Touches.reachable` of a press says so.

        Raises
        ------
        QueryError
            Hardly any of the surface can be reached.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(20)
        >>> bool(bar.press(points).reachable.all())
        True
        >>> points, normals = bar.sample_contacts(1000, reachable=False)
        >>> points.shape, float(abs(points).max(axis=0)[0].round(2))
        ((1000, 3), 0.06)
        """
        count, seed = whole("n", n, 0, MOST_SAMPLED), whole("seed", seed, 0, LARGEST_SEED)
        samples = self.surface.sample(count, seed)
        if not reachable or not count:
            return samples.points, samples.normals
        points, normals = np.zeros((0, 3)), np.zeros((0, 3))
        for attempt in range(1, MOST_ATTEMPTS + 1):
            fits = self.reach(samples.points, rolls=1).at_some_roll
            points = np.concatenate([points, samples.points[fits]])
            normals = np.concatenate([normals, samples.normals[fits]])
            if len(points) >= count:
                return points[:count], normals[:count]
            again = np.random.SeedSequence([seed, attempt]).generate_state(1)
            samples = self.surface.sample(count, int(again[0]))
        finding = f"{len(points)} of {MOST_ATTEMPTS * count} contacts drawn can be reached"
        raise QueryError("reachable", finding, "Draw contacts anywhere, or ask for more of them.")


def _equal_tensors(some: Mapping[str, np.ndarray], others: Mapping[str, np.ndarray]) -> bool:
    return some.keys() == others.keys() and all(
        tensor.dtype == others[name].dtype and np.array_equal(tensor, others[name])
        for name, tensor in some.items()
    )


def _frame_around(surface: Surface, stored: Mapping[str, Any]) -> UnitFrame:
    """Return the stored unit frame, whose box is the surface's but for what compression moves.

    Raises
    ------
    FormatError
        Another box.
    """
    numbers("frame.centre", stored["centre"], (3,), LARGEST_COORDINATE_M)
    number("frame.scale", stored["scale"], 1 / LARGEST_COORDINATE_M, LARGEST_COORDINATE_M)
    frame = UnitFrame.from_dict(dict(stored))
    box = frame.to_unit(surface.bounds)
    if np.abs(box).max() > HALF_WIDTH or np.ptp(box, axis=0).max() < HALF_WIDTH:
        raise FormatError("frame", "it is not that of the surface", REMEDY)
    return frame
