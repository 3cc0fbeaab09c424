"""The Object File: one object's sight, sound and touch in one file, and the queries it answers.

One safetensors file holds the compressed surface once; vision is reflectance on it, sound is mode
shapes on it, touch is a sensor pressed into it. Queries are in the object frame: metres, newton
seconds, seconds.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.audio.audionet import AudioNet
from objectfolder.audio.synthesis.bank import samples_of
from objectfolder.audio.synthesis.struck_body import BodyStream, Pulse, RigidBody, StruckBody
from objectfolder.errors import FormatError, QueryError
from objectfolder.geometry.frames import UnitFrame
from objectfolder.geometry.surface import ClosestPoints, Surface
from objectfolder.geometry.surface_codec import decode_surface
from objectfolder.tensor_file import TensorFile, read_tensor_file, write_tensor_file
from objectfolder.touch.press import Touches
from objectfolder.touch.touchnet import TouchNet
from objectfolder.vision.cameras import CAMERA_RADIUS, LIGHT_RADIUS, look_at, uniform_on_sphere
from objectfolder.vision.compositing import on_white
from objectfolder.vision.visionnet import VisionNet

FORMAT = "objectfolder"
FORMAT_VERSION = 1
SURFACE_TOLERANCE_M = 1e-3
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


class ObjectFile:
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
        """Build the object from stored tensors, checking every one of them."""
        surface = decode_surface(dict(tensors))
        frame = UnitFrame.from_dict(description["frame"])
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
            A truncated or foreign file, an unknown version, or a tensor of a wrong shape.
        FileNotFoundError
            No such file.
        """
        where = str(path)
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
            raise FormatError(where, str(error), "Fetch or build it again.") from error
        except (KeyError, ValueError, TypeError, IndexError) as error:
            raise FormatError(
                where, f"incomplete ({type(error).__name__}: {error})", "Fetch or build it again."
            ) from error

    def with_description(self, **more: Any) -> "ObjectFile":
        """Return the same object with parts of its description replaced."""
        described = {**self.description, **more}
        return ObjectFile(
            self.surface, self.frame, self.vision, self.modes, self.touch, described, self._tensors
        )

    def content(self) -> TensorFile:
        """Return the file's tensors and metadata; equal objects give equal bytes."""
        metadata: dict[str, Any] = {"format": FORMAT, "format_version": str(FORMAT_VERSION)}
        metadata.update({key: json.dumps(self.description.get(key), sort_keys=True) for key in REQUIRED})
        return TensorFile(self._tensors, metadata)

    def save(self, path: Path | str) -> None:
        """Write the file, atomically."""
        write_tensor_file(path, self.content())

    def bytes_by_part(self) -> dict[str, int]:
        """Return the bytes of the tensors of each part: surface, vision, audio, touch."""
        parts = dict.fromkeys(("surface", "vision", "audio", "touch"), 0)
        for name, tensor in self._tensors.items():
            parts[name.split(".")[0]] += tensor.nbytes
        return parts

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        resolution: int | tuple[int, int] = 256,
        field_of_view: float = 39.6,
        linear: bool = False,
        sub_rays: int | None = None,
    ) -> np.ndarray:
        """Render views under one point light each.

        Parameters
        ----------
        camera_to_world
            (4, 4) or (n, 4, 4) rigid poses in the object frame, metres; the camera looks along -z, +y is up.
        light_position
            (3,) or (n, 3) metres, object frame. The lamp's power is that of the data set, whose lights lie
            at one `frame.scale` from the centre.
        resolution
            Pixels of a side, or (height, width).
        field_of_view
            Of the width, degrees.
        linear
            Return premultiplied scene-linear RGBA instead of 8-bit sRGB on white.
        sub_rays
            Rays in a pixel where something ends (others get an eighth); the stored default, 64, if None. More
            is slower and closer to the truth.

        Returns
        -------
        ndarray
            (n, h, w, 3) uint8, or (n, h, w, 4) float32 if `linear`.

        Raises
        ------
        QueryError
            Poses that are not rigid, values that are not finite, numbers of poses and lights that differ.
        """
        cameras = np.asarray(camera_to_world, dtype=np.float64)
        lights = np.asarray(light_position, dtype=np.float64)
        if cameras.ndim == 2:
            cameras = cameras[None]
        if lights.ndim == 1:
            lights = np.broadcast_to(lights, (len(cameras), 3))
        if cameras.ndim != 3 or cameras.shape[1:] != (4, 4):
            raise QueryError("camera_to_world", f"shape {cameras.shape}", "Give (n, 4, 4) poses.")
        if lights.shape != (len(cameras), 3):
            raise QueryError("light_position", f"shape {lights.shape}", f"Give ({len(cameras)}, 3) points.")
        if not (np.isfinite(cameras).all() and np.isfinite(lights).all()):
            raise QueryError("camera_to_world, light_position", "not finite")
        rotation = cameras[:, :3, :3]
        if np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0) > 1e-4:
            raise QueryError(
                "camera_to_world",
                "not a rigid pose",
                "Give an orthonormal rotation and a translation in metres.",
            )
        if not 0 < field_of_view < 180:
            raise QueryError("field_of_view", f"{field_of_view}", "Give degrees between 0 and 180.")
        rgba = self.vision.render(
            self.frame.camera_to_unit(cameras),
            self.frame.to_unit(lights),
            resolution,
            field_of_view,
            **({} if sub_rays is None else {"sub_rays": sub_rays}),
        )
        return rgba if linear else on_white(rgba)

    def strike(
        self,
        points: np.ndarray,
        forces: np.ndarray,
        duration: float = 2.0,
        sample_rate: float = 44100,
        modes: int | None = None,
        *,
        pulse: Pulse = None,
        listener: np.ndarray | None = None,
    ) -> np.ndarray:
        """Sound the object under contacts.

        Parameters
        ----------
        points
            (3,) or (n, 3) contacts, metres, within `surface_tolerance_m` of the surface.
        forces
            (3,) or (n, 3) impulses, newton seconds (the papers' unit forces lasting one second); or (n, k, 3)
            newtons at the samples from t = 0 on, linear between them.
        duration
            Seconds.
        sample_rate
            Hertz; modes above 0.45 of it are left out, they would alias.
        modes
            Sound only so many of the lowest modes; all by default.
        pulse
            How an impulse is spent: None, at once; seconds, one or (n,), as half a sine of that length; or
            a `ContactBody` that strikes and parts again without loss, whose Hertz contact with the object
            (flat where it is struck) gives the length.
        listener
            (3,) or (channels, 3) metres, object frame, for instance two ears. The answer is then the pressure
            in free air of the modes and of the accelerating body (its click), later by the way from the
            object. The models are approximate and are described in `objectfolder.audio.synthesis.air`.

        Returns
        -------
        ndarray
            (n, samples) float32 at true amplitude: metres a second of rms surface velocity along the normal,
            linear in the force, zeros for an object without audible modes (`modes.frequencies_hz` is empty).
            With a listener pascals, and (n, channels, samples) for a listener (channels, 3).

        Raises
        ------
        QueryError
            A contact off the surface (with its distance), or values that are not finite; a listener to an
            object of unknown mass.
        """
        contacts, pushes, ears = self._sound_query(points, forces, listener)
        body = self._struck_body(modes)
        samples = samples_of(duration, sample_rate)
        sound = np.empty((len(contacts), 1 if ears is None else len(ears), samples), dtype=np.float32)
        for rows, part in body.sounds(contacts, pushes, duration, sample_rate, pulse=pulse, listeners=ears):
            sound[rows] = part
        return sound[:, 0] if listener is None or np.ndim(listener) < 2 else sound

    def strikes(
        self,
        points: np.ndarray,
        forces: np.ndarray,
        duration: float = 2.0,
        sample_rate: float = 44100,
        modes: int | None = None,
        *,
        pulse: Pulse = None,
        listener: np.ndarray | None = None,
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """Sound any number of contacts in bounded memory: yield rows and what `strike` answers for them."""
        contacts, pushes, ears = self._sound_query(points, forces, listener)
        body = self._struck_body(modes)
        for rows, part in body.sounds(contacts, pushes, duration, sample_rate, pulse=pulse, listeners=ears):
            yield rows, part[:, 0] if listener is None or np.ndim(listener) < 2 else part

    def stream(self, sample_rate: float = 44100, *, listener: np.ndarray | None = None) -> "ObjectStream":
        """Return a silent stream: contacts are added as they come, sound is taken in blocks.

        Parameters
        ----------
        listener
            As for `strike`.
        """
        ears = None if listener is None else _rows(listener, "listener")
        return ObjectStream(self, self._struck_body(None).stream(sample_rate, ears))

    def _sound_query(
        self, points: np.ndarray, forces: np.ndarray, listener: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return contacts on the surface (n, 3), a force each, and listeners (channels, 3)."""
        contacts = self.project(points).points
        pushes = np.asarray(forces, dtype=np.float64)
        if pushes.ndim != 3:
            pushes = _rows(pushes, "forces")
        elif pushes.shape[2] != 3 or not np.isfinite(pushes).all():
            raise QueryError("forces", f"shape {pushes.shape}, or not finite", "Give (n, k, 3) newtons.")
        if len(pushes) not in (1, len(contacts)):
            raise QueryError("forces", f"{len(pushes)} for {len(contacts)} points", "Give one a point.")
        pushes = np.broadcast_to(pushes, (len(contacts), *pushes.shape[1:]))
        return contacts, pushes, None if listener is None else _rows(listener, "listener")

    def _struck_body(self, modes: int | None) -> StruckBody:
        """Modes and body as synthesis takes them."""
        net, body, material = self.modes, self.description.get("body"), self.description.get("material")
        rigid = None
        if body:
            closed = body["inertia_kg_m2"] is not None
            # The solid that sounds may be lighter than the closed surface: a container with a stated wall.
            share = body["filled_mass_kg"] / body["mass_kg"] if closed else 1.0
            rigid = RigidBody(
                float(body["filled_mass_kg"]),
                np.asarray(body["centre_of_mass_m"]) if closed else self.surface.bounds.mean(axis=0),
                share * np.asarray(body["inertia_kg_m2"]) if closed else None,
                float(self.surface.area),
            )
        return StruckBody(
            net.eigenvalues[:modes],
            net.dampings_per_s[:modes],
            net.radiation_weights[:modes],
            net.gains,
            rigid,
            (material["youngs_modulus_pa"], material["poisson_ratio"]) if material else None,
        )

    def press(
        self,
        points: np.ndarray,
        depth: float | np.ndarray = 0.001,
        tilt: float | np.ndarray = 0.0,
        azimuth: float | np.ndarray = 0.0,
    ) -> Touches:
        """Press the sensor along the surface normal.

        Parameters
        ----------
        points
            (3,) or (n, 3) contacts, metres, within `surface_tolerance_m` of the surface.
        depth
            How far into the gel, metres.
        tilt, azimuth
            Inclination of the sensor from the normal and its direction, degrees.

        Raises
        ------
        QueryError
            A contact off the surface (with its distance), or a depth outside the sensor's range.
        """
        return self.touch.press(
            self.project(points).points, depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth
        )

    def project(self, points: np.ndarray) -> ClosestPoints:
        """Bring contacts onto the surface.

        Raises
        ------
        QueryError
            A contact farther than `surface_tolerance_m`, named with its distance.
        """
        contacts = _rows(points, "points")
        closest = self.surface.closest_points(contacts)
        worst = int(np.argmax(closest.distance)) if len(contacts) else 0
        if len(contacts) and closest.distance[worst] > self.surface_tolerance_m:
            raise QueryError(
                f"points[{worst}]",
                f"{closest.distance[worst] * 1e3:.3g} mm off the surface",
                f"Contacts lie within {self.surface_tolerance_m * 1e3:.3g} mm, in metres, object frame; "
                "`sample_contacts` gives valid ones.",
            )
        return closest

    def sample_views(
        self, count: int, seed: int, camera_radius: float = CAMERA_RADIUS
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw valid views: camera_to_world (n, 4, 4) and light_position (n, 3), object frame, metres.

        Distributed as the data set's: cameras uniform on the sphere of `camera_radius` (unit frame), lights
        on the unit sphere.
        """
        random = np.random.default_rng(seed)
        cameras = look_at(uniform_on_sphere(count, camera_radius, random))
        lights = uniform_on_sphere(count, LIGHT_RADIUS, random)
        return self.frame.camera_to_object(cameras), self.frame.to_object(lights)

    def sample_contacts(self, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Draw contacts uniformly by area: points (n, 3) metres and outward unit normals (n, 3)."""
        samples = self.surface.sample(count, seed)
        return samples.points, samples.normals


class ObjectStream:
    """The sound of an object in a scene that goes on; `ObjectFile.stream` makes one.

    Attributes
    ----------
    now : samples given so far, the index of the next one
    silent : whether nothing sounds and nothing waits
    """

    def __init__(self, file: ObjectFile, stream: BodyStream) -> None:
        self._file = file
        self._stream = stream

    @property
    def now(self) -> int:
        """Samples given so far."""
        return self._stream.now

    @property
    def silent(self) -> bool:
        """Whether nothing sounds and nothing waits."""
        return self._stream.silent

    def strike(
        self, point: np.ndarray, force: np.ndarray, *, at: float | None = None, pulse: Pulse = None
    ) -> None:
        """Let a contact begin.

        Parameters
        ----------
        point
            (3,) metres, within the tolerance of the surface.
        force
            (3,) newton seconds, or (k, 3) newtons at the samples.
        at
            Sample at which it begins, `now` or later.
        pulse
            As for `ObjectFile.strike`.

        Raises
        ------
        QueryError
            As for `ObjectFile.strike`; a sample that has passed.
        """
        pushed = np.asarray(force, dtype=np.float64)
        given = pushed[None] if pushed.ndim == 2 else pushed
        contacts, pushes, _ = self._file._sound_query(np.reshape(point, (1, 3)), given, None)
        self._stream.strike(contacts[0], pushes[0], at, pulse)

    def block(self, samples: int) -> np.ndarray:
        """Return the next samples (channels, samples) float64, in the unit `ObjectFile.strike` answers in."""
        return self._stream.block(samples)


def _rows(values: np.ndarray, name: str) -> np.ndarray:
    """Return (3,) or (n, 3) finite values as (n, 3)."""
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim == 1:
        rows = rows[None]
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise QueryError(name, f"shape {np.shape(values)}", "Give (n, 3).")
    if not np.isfinite(rows).all():
        raise QueryError(name, "not finite", "Give numbers.")
    return rows
