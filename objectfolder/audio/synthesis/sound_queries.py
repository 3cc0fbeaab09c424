"""What an Object File answers when it is struck."""

import reprlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from objectfolder.audio.audionet.audionet import AudioNet
from objectfolder.audio.synthesis.bank import samples_of
from objectfolder.audio.synthesis.hertz import ContactBody
from objectfolder.audio.synthesis.object_stream import ObjectStream
from objectfolder.audio.synthesis.struck_body import Pulse, RigidBody, StruckBody
from objectfolder.errors import FormatError, QueryError
from objectfolder.products.tensor_file import REMEDY
from objectfolder.surface.points import point_rows
from objectfolder.surface.surface import ClosestPoints, Surface

# A rigid motion has 1 everywhere; the light tip of a heavy body has more, the starter set 15 at most.
LARGEST_SHAPE = 1e3
LARGEST_FORCE = 1e12
SHORTEST_PULSE_S = 1e-12
LEAST_KG = 1e-9  # of a body whose mass is not known


class SoundQueries(ABC):
    """The sound of contacts; a part of `ObjectFile`, which has the attributes named here."""

    surface: Surface
    modes: AudioNet
    description: dict[str, Any]

    @abstractmethod
    def project(self, points: np.ndarray) -> ClosestPoints:
        """Bring contacts onto the surface; see `ObjectFile.project`."""

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
            Number of the lowest modes to sound; all by default.
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
        FormatError
            A file whose gains no body of its mass has.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> import numpy as np
        >>> points, normals = bar.sample_contacts(1, seed=0)
        >>> sound = bar.strike(points, -normals, duration=1.0)
        >>> sound.shape, sound.dtype.name
        ((1, 44100), 'float32')
        >>> bool(np.allclose(bar.strike(points, -2 * normals, 1.0), 2 * sound))  # twice as hard
        True
        """
        contacts, pushes, ears = self._sound_query(points, forces, listener)
        duration, sample_rate = _real("duration", duration), _real("sample_rate", sample_rate)
        _check_pulse(pulse)
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
        """Sound any number of contacts in bounded memory: yield rows and what `strike` answers for them.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(100, seed=0)
        >>> sum(len(part) for rows, part in bar.strikes(points, -normals, duration=0.1))
        100
        """
        contacts, pushes, ears = self._sound_query(points, forces, listener)
        duration, sample_rate = _real("duration", duration), _real("sample_rate", sample_rate)
        _check_pulse(pulse)
        body = self._struck_body(modes)
        for rows, part in body.sounds(contacts, pushes, duration, sample_rate, pulse=pulse, listeners=ears):
            yield rows, part[:, 0] if listener is None or np.ndim(listener) < 2 else part

    def stream(self, sample_rate: float = 44100, *, listener: np.ndarray | None = None) -> ObjectStream:
        """Return a silent stream: contacts are added as they come, sound is taken in blocks.

        Parameters
        ----------
        listener
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
        ears = None if listener is None else point_rows(listener, "listener")
        return ObjectStream(self._struck_body(None), self._sound_query, sample_rate, ears)

    def _sound_query(
        self, points: np.ndarray, forces: np.ndarray, listener: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return contacts on the surface (n, 3), a force each, and listeners (channels, 3)."""
        contacts = self.project(points).points
        if np.ndim(forces) != 3:
            pushes = point_rows(forces, "forces")
        else:
            pushes = point_rows(np.reshape(forces, (-1, np.shape(forces)[2])), "forces")
            pushes = pushes.reshape(np.shape(forces))
        if not np.abs(pushes).max(initial=0.0) <= LARGEST_FORCE:
            raise QueryError("forces", f"above {LARGEST_FORCE:g}", "Give newton seconds, or newtons.")
        if len(pushes) not in (1, len(contacts)):
            raise QueryError("forces", f"{len(pushes)} for {len(contacts)} points", "Give one a point.")
        pushes = np.broadcast_to(pushes, (len(contacts), *pushes.shape[1:]))
        return contacts, pushes, None if listener is None else point_rows(listener, "listener")

    def _gains(self, points: np.ndarray) -> np.ndarray:
        """Return `AudioNet.gains`, but for those that no body of this mass has.

        Raises
        ------
        FormatError
            Such gains, or none.
        """
        body = self.description.get("body")
        mass_kg = float(body["filled_mass_kg"]) if body else LEAST_KG
        try:
            gains = self.modes.gains(points)
        except np.linalg.LinAlgError as error:
            raise FormatError("audio", f"its coefficients have no solution ({error})", REMEDY) from error
        largest = np.abs(gains).max(initial=0.0) * np.sqrt(mass_kg)
        radiating = self.modes.radiation_weights.max(initial=0.0) * np.sqrt(mass_kg)
        if not (largest <= LARGEST_SHAPE and radiating <= LARGEST_SHAPE):
            finding = f"gains of {largest:.3g} and {radiating:.3g} over the root of the mass"
            raise FormatError("audio", f"{finding}, above {LARGEST_SHAPE:g}", REMEDY)
        return gains

    def _struck_body(self, modes: int | None) -> StruckBody:
        """Modes and body as synthesis takes them."""
        if modes is not None and not isinstance(modes, int | np.integer):
            raise QueryError("modes", reprlib.repr(modes), "Give a whole number, or None for all.")
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
            self._gains,
            rigid,
            (material["youngs_modulus_pa"], material["poisson_ratio"]) if material else None,
        )


def _real(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise QueryError(name, reprlib.repr(value), "Give a number.") from error


def _check_pulse(pulse: Pulse) -> None:
    if pulse is None or isinstance(pulse, ContactBody):
        return
    try:
        durations = np.asarray(pulse, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise QueryError("pulse", reprlib.repr(pulse), "Give seconds.") from error
    if ((durations > 0) & (durations < SHORTEST_PULSE_S)).any():
        raise QueryError("pulse", f"shorter than {SHORTEST_PULSE_S:g} s", "Give None for an instant.")
