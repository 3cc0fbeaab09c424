"""What an Object File answers when it is struck."""

import math
import reprlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from objectfolder.audio.audionet.audionet import AudioNet
from objectfolder.audio.synthesis.bank import samples_of
from objectfolder.audio.synthesis.object_stream import ObjectStream
from objectfolder.audio.synthesis.sound import Sound
from objectfolder.audio.synthesis.struck_body import (
    CONTACT,
    RMS,
    Observed,
    Pulse,
    RigidBody,
    StruckBody,
    along,
)
from objectfolder.audio.synthesis.support import Support
from objectfolder.errors import FormatError, QueryError
from objectfolder.products.tensor_file import REMEDY
from objectfolder.query_values import point_rows, real, real_array, require_room, whole
from objectfolder.surface.surface import ClosestPoints, Surface

# A rigid motion has 1 everywhere; the light tip of a heavy body has more, the starter set 15 at most.
LARGEST_SHAPE = 1e3
LARGEST_FORCE = 1e12
SAMPLE_RATES_HZ = (1.0, 1e8)
LONGEST_S = 1e6
MOST_MODES = 10**9  # that a query may name: more than there are stands for all
LEAST_KG = 1e-9  # of a body whose mass is not known


class SoundQueries(ABC):
    """The sound of contacts; a part of `ObjectFile`, which has the attributes named here."""

    surface: Surface
    modes: AudioNet
    description: dict[str, Any]

    @abstractmethod
    def project(self, points: np.ndarray, *, name: str = "points") -> ClosestPoints:
        """Bring contacts onto the surface; see `ObjectFile.project`."""

    def strike(
        self,
        points: np.ndarray,
        forces: np.ndarray | None = None,
        duration: float = 2.0,
        sample_rate: float = 44100,
        modes: int | None = None,
        *,
        pulse: Pulse = None,
        observed: str | np.ndarray = CONTACT,
        listener: np.ndarray | None = None,
        support: Support | None = None,
    ) -> Sound:
        """Sound the object under contacts.

        Parameters
        ----------
        points
            (3,) or (n, 3) contacts, metres, within `surface_tolerance_m` of the surface.
        forces
            (3,) or (n, 3) impulses, newton seconds (the papers' unit forces lasting one second); or (n, k, 3)
            newtons at the samples from t = 0 on, linear between them. None strikes each point with 1 N s
            inwards, against the surface's normal.
        duration
            Seconds.
        sample_rate
            Hertz; modes above 0.45 of it are left out, they would alias.
        modes
            Number of the lowest modes to sound; all by default.
        pulse
            How an impulse is spent: None, at once; seconds, one or (n,), as half a sine of that length; or
            a `ContactBody` that strikes and parts again without loss, whose Hertz contact with the object
            (flat where it is struck) gives the length.
        observed
            Where the velocity of the surface along its outward normal is asked, without a listener:
            ``"contact"``, at the struck point itself (on an edge, of one of its faces); (3,) or (channels, 3)
            points of the surface; or ``"rms"``, the sum over modes of modal velocity times the rms over the
            surface of the mode's normal component. The last depends on the signs of mode shapes, which are
            arbitrary: fidelity compares sounds so, as the papers do.
        listener
            (3,) or (channels, 3) metres, object frame, for instance two ears. The answer is then the pressure
            in free air of the modes and of the accelerating body (its click), later by the way from the
            object. Where the file has each mode's transfer (`modes.transfer`), a mode is heard through it, in
            every direction as it radiates there; places are then outside of the sphere round the object.
            Without it, and for the click, models are used, described in `objectfolder.audio.synthesis.air`.
        support
            What holds or carries the object; None, nothing: it is free.

        Returns
        -------
        Sound
            An array (n, samples) float32 that notebooks play, at true amplitude: metres a second, linear in
            the force, zeros for an object without audible modes (`modes.frequencies_hz` is empty). With a
            listener pascals. (n, channels, samples) for points or listeners (channels, 3).

        Raises
        ------
        QueryError
            A contact off the surface (with its distance), or values that are not finite; a listener to an
            object of unknown mass.
        FormatError
            A file whose gains no body of its mass has.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> import numpy as np
        >>> points, normals = bar.sample_contacts()
        >>> sound = bar.strike(points, duration=1.0)  # 1 N s inwards
        >>> sound.shape, sound.dtype.name
        ((1, 44100), 'float32')
        >>> bool(np.allclose(bar.strike(points, -2 * normals, 1.0), 2 * sound))  # twice as hard
        True
        """
        shape, single, parts = self._struck(
            points, forces, duration, sample_rate, modes, pulse, observed, listener, support
        )
        remedy = "Use `strikes`, which answers in parts, or ask for less at a time."
        require_room("points, duration", 4 * math.prod(shape), remedy)
        sound = np.empty(shape, dtype=np.float32)
        for rows, part in parts:
            sound[rows] = part
        return Sound.of(sound[:, 0] if single else sound, sample_rate)

    def strikes(
        self,
        points: np.ndarray,
        forces: np.ndarray | None = None,
        duration: float = 2.0,
        sample_rate: float = 44100,
        modes: int | None = None,
        *,
        pulse: Pulse = None,
        observed: str | np.ndarray = CONTACT,
        listener: np.ndarray | None = None,
        support: Support | None = None,
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """Sound any number of contacts in bounded memory: yield rows and what `strike` answers for them.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(100, seed=0)
        >>> sum(len(part) for rows, part in bar.strikes(points, -normals, duration=0.1))
        100
        """
        _, single, parts = self._struck(
            points, forces, duration, sample_rate, modes, pulse, observed, listener, support
        )
        for rows, part in parts:
            yield rows, part[:, 0] if single else part

    def rms_velocity(
        self, points: np.ndarray, impulses: np.ndarray, times: np.ndarray, modes: int | None = None
    ) -> np.ndarray:
        """Return how fast the whole surface moves after impulses: (n, times) metres a second.

        It is the rms over the surface of the velocity along the normal, with the modes' powers added up and
        each taken in the mean over its period: `sqrt(sum_i (r_i a_i exp(-c_i t))^2 / 2)`, `a_i` the modal
        velocity that the impulse gives and `r_i` the rms of the mode's normal component. Modes that do not
        ring are left out.

        Parameters
        ----------
        points, impulses, modes
            (n, 3) as for `strike`, newton seconds.
        times
            (times,) seconds after the impulse.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(1, seed=0)
        >>> level = bar.rms_velocity(points, -normals, [0.0, 0.1])
        >>> level.shape, bool(level[0, 1] < level[0, 0])
        ((1, 2), True)
        """
        seconds = real_array("times", times).reshape(-1)
        if not (seconds >= 0).all():
            raise QueryError("times", reprlib.repr(seconds.tolist()), "Give seconds after the impulse.")
        contacts, pushes = self._impulses(points, impulses)
        body = self._struck_body(modes)
        numbers = len(seconds) * (len(contacts) + len(body.eigenvalues))
        require_room("points, times", 8 * numbers, "Ask for fewer times, or fewer contacts.")
        return body.rms_velocity(contacts, pushes, seconds)

    def mode_velocities(
        self, points: np.ndarray, impulses: np.ndarray, modes: int | None = None
    ) -> np.ndarray:
        """Return what each mode adds to `strike` at first: (n, modes) metres a second.

        It is the velocity along the normal at the struck point that an impulse gives each mode.

        Parameters
        ----------
        points, impulses, modes
            As for `rms_velocity`.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(2, seed=0)
        >>> velocities = bar.mode_velocities(points, -normals)
        >>> velocities.shape == (2, len(bar.modes.frequencies_hz)), bool((velocities <= 0).all())
        (True, True)
        """
        contacts, pushes = self._impulses(points, impulses)
        motion = self._struck_body(modes).motion(contacts)
        return along(pushes, motion.shapes) * motion.normal

    def _impulses(self, points: np.ndarray, impulses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return contacts on the surface and impulses, (n, 3) each."""
        places, pushes, _ = self._sound_query(points, impulses, None)
        if pushes.ndim != 2:
            raise QueryError("impulses", f"shape {pushes.shape}", "Give (n, 3), newton seconds.")
        return places.points, pushes

    def stream(
        self,
        sample_rate: float = 44100,
        *,
        observed: str | np.ndarray = CONTACT,
        listener: np.ndarray | None = None,
        support: Support | None = None,
    ) -> ObjectStream:
        """Return a silent stream: contacts are added as they come, sound is taken in blocks.

        Parameters
        ----------
        observed, listener, support
            As for `strike`.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> stream = bar.stream()
        >>> stream.strike([0, 0, 0.004], [0, 0, -0.1])
        >>> block = stream.block(512)
        >>> block.shape, stream.now, stream.silent
        ((1, 512), 512, False)
        """
        ears = self._listeners(listener)
        places = self._places(observed)
        sample_rate = real("sample_rate", sample_rate, *SAMPLE_RATES_HZ, " Hz")
        return ObjectStream(self._struck_body(None, support), self._sound_query, sample_rate, places, ears)

    def _struck(
        self,
        points: np.ndarray,
        forces: np.ndarray | None,
        duration: float,
        sample_rate: float,
        modes: int | None,
        pulse: Pulse,
        observed: str | np.ndarray,
        listener: np.ndarray | None,
        support: Support | None,
    ) -> tuple[tuple[int, int, int], bool, Iterator[tuple[slice, np.ndarray]]]:
        """Return the shape (n, channels, samples), whether there is one channel by name, and its parts."""
        at, pushes, ears = self._sound_query(points, forces, listener)
        contacts = at.points
        sample_rate = real("sample_rate", sample_rate, *SAMPLE_RATES_HZ, " Hz")
        duration = real("duration", duration, 1 / sample_rate, LONGEST_S, " s")
        places = self._places(observed)
        heard = places if listener is None else ears
        body = self._struck_body(modes, support)
        channels = len(heard) if isinstance(heard, np.ndarray) else 1
        samples = samples_of(duration, sample_rate)
        remedy = "Ask for less time at once, or a lower rate."
        require_room("duration, sample_rate", 4 * channels * samples, remedy)
        parts = body.sounds(
            contacts, pushes, duration, sample_rate, pulse=pulse, observed=places, listeners=ears
        )
        single = np.ndim(observed if listener is None else listener) < 2
        return (len(contacts), channels, samples), single, parts

    def _places(self, observed: str | np.ndarray) -> Observed:
        """Return a name, or points (channels, 3) on the surface."""
        if not isinstance(observed, str):
            return self.project(point_rows(observed, "observed", 1), name="observed").points
        if observed not in (CONTACT, RMS):
            raise QueryError(
                "observed", f"{observed!r}", f"Use {CONTACT!r}, {RMS!r} or points of the surface."
            )
        return observed

    def _normals(self, points: np.ndarray | ClosestPoints) -> np.ndarray:
        places = points if isinstance(points, ClosestPoints) else self.surface.closest_points(points)
        return self.surface.normals_at(places.face, places.barycentric)

    def _sound_query(
        self, points: np.ndarray | ClosestPoints, forces: np.ndarray | None, listener: np.ndarray | None
    ) -> tuple[ClosestPoints, np.ndarray, np.ndarray | None]:
        """Return n contacts on the surface, a force each, and listeners (channels, 3)."""
        places = points if isinstance(points, ClosestPoints) else self.project(points)
        count = len(places.points)
        remedy = "Give (n, 3) newton seconds, or (n, k, 3) newtons at the samples."
        pushes = -self._normals(places) if forces is None else real_array("forces", forces, remedy)
        pushes = pushes[None] if pushes.ndim == 1 else pushes
        if pushes.ndim not in (2, 3) or pushes.shape[-1] != 3 or 0 in pushes.shape[1:]:
            raise QueryError("forces", f"shape {pushes.shape}", remedy)
        if not np.abs(pushes).max(initial=0.0) <= LARGEST_FORCE:
            raise QueryError("forces", f"above {LARGEST_FORCE:g}", "Give newton seconds, or newtons.")
        if len(pushes) not in (1, count):
            raise QueryError("forces", f"{len(pushes)} for {count} points", "Give one a point.")
        pushes = np.broadcast_to(pushes, (count, *pushes.shape[1:]))
        return places, pushes, self._listeners(listener)

    def _listeners(self, listener: np.ndarray | None) -> np.ndarray | None:
        return None if listener is None else point_rows(listener, "listener", 1)

    def _gains(self, points: np.ndarray | ClosestPoints) -> np.ndarray:
        """Return `AudioNet.gains`, but for those that no body of this mass has.

        Raises
        ------
        FormatError
            Such gains, or none.
        """
        body = self.description.get("body")
        mass_kg = float(body["filled_mass_kg"]) if body else LEAST_KG
        try:
            if isinstance(points, ClosestPoints):
                gains = self.modes.gains_at(points)
            else:
                gains = self.modes.gains(points)
        except np.linalg.LinAlgError as error:
            raise FormatError("audio", f"its coefficients have no solution ({error})", REMEDY) from error
        largest = np.abs(gains).max(initial=0.0) * np.sqrt(mass_kg)
        radiating = self.modes.radiation_weights.max(initial=0.0) * np.sqrt(mass_kg)
        if not (largest <= LARGEST_SHAPE and radiating <= LARGEST_SHAPE):
            finding = f"gains of {largest:.3g} and {radiating:.3g} over the root of the mass"
            raise FormatError("audio", f"{finding}, above {LARGEST_SHAPE:g}", REMEDY)
        return gains

    def _struck_body(self, modes: int | None, support: Support | None = None) -> StruckBody:
        """Modes, as a support changes them, and body as synthesis takes them.

        Raises
        ------
        QueryError
            The object has no sound: with the reason.
        """
        if self.modes.absent is not None:
            finding = f"the object has no sound: {self.modes.absent}"
            raise QueryError("audio", finding, "It can be seen and felt.")
        modes = None if modes is None else whole("modes", modes, 0, MOST_MODES)
        if not isinstance(support, Support | None):
            raise QueryError("support", reprlib.repr(support), "Give a `Support`, or None.")
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
        eigenvalues, dampings = net.eigenvalues[:modes], net.dampings_per_s[:modes]
        if support is not None:
            held = self._gains(self.project(support.points, name="support").points)[:, :, : len(eigenvalues)]
            stiffer, faster = support.added(held)
            eigenvalues, dampings = eigenvalues + stiffer, dampings + faster
        return StruckBody(
            eigenvalues,
            dampings,
            net.radiation_weights[:modes],
            self._gains,
            self._normals,
            rigid,
            (material["youngs_modulus_pa"], material["poisson_ratio"]) if material else None,
            net.transfer,
        )
