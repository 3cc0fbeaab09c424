"""An object's sound in blocks, for scenes that go on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.collision import Collider
from objectfolder.audio.synthesis.earlier_forces import earlier_forces
from objectfolder.audio.synthesis.hertz import ContactBody
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.audio.synthesis.pulses import ForceProfile
from objectfolder.audio.synthesis.resonators import Resonators
from objectfolder.audio.synthesis.sources import Motion, Source, along
from objectfolder.audio.synthesis.struck_body import Observed, Pulse, StruckBody, named_striker
from objectfolder.audio.synthesis.voices import Voices
from objectfolder.errors import QueryError
from objectfolder.forks import hold_forks
from objectfolder.query_values import point_rows, real
from objectfolder.surface.surface import ClosestPoints

Floats = NDArray[np.float64]
LATEST = 2.0**53  # sample: the last that a float64 counts to
ContactQuery = Callable[
    [ArrayLike | ClosestPoints, ArrayLike | None, ArrayLike | None], tuple[ClosestPoints, Floats]
]


class ObjectStream:
    """The sound of an object in a scene that goes on; `ObjectFile.stream` makes one.

    Parameters
    ----------
    body
        The struck object.
    contacts
        Checks points, impulses and forces, and brings the points onto the surface.
    sample_rate_hz
        Of the sound.
    observed
        Where the surface velocity is asked, see `StruckBody.sounds`.
    listeners
        (channels, 3) metres, or None for the surface velocity.

    Examples
    --------
    >>> import objectfolder
    >>> bar = objectfolder.load("bar.safetensors")
    >>> stream = bar.stream()
    >>> stream.strike([0, 0, 0.004], [0, 0, -0.1], at=100)
    >>> block = stream.block(256)
    >>> bool((block[0, :100] == 0).all()), bool(abs(block[0, 100]) > 0)
    (True, True)
    """

    def __init__(
        self,
        body: StruckBody,
        contacts: ContactQuery,
        sample_rate_hz: float,
        observed: Observed,
        listeners: Floats | None,
    ) -> None:
        self._body = body
        self._contacts = contacts
        self._rate = sample_rate_hz
        self._channels = [
            Channel.of(sources) for sources in body.channels(sample_rate_hz, observed, listeners)
        ]

    @property
    def now(self) -> int:
        """Samples given so far, the index of the next one."""
        return self._channels[0].voices.now

    @property
    def silent(self) -> bool:
        """Whether nothing sounds and nothing waits."""
        return all(channel.voices.silent for channel in self._channels)

    @earlier_forces("force", "impulse_n_s", "force_n", 2)
    @hold_forks
    def strike(
        self,
        point: ArrayLike | ClosestPoints,
        impulse_n_s: ArrayLike | None = None,
        *,
        force_n: ArrayLike | None = None,
        at: float | None = None,
        pulse: Pulse = None,
    ) -> None:
        """Let a contact begin; each listener hears it later by the way from the object.

        Parameters
        ----------
        point
            (3,) metres, within the tolerance of the surface; or a place of `Surface.closest_points`.
        impulse_n_s
            (3,) newton seconds; None, without a force, strikes with 1 N s inwards.
        force_n
            (k, 3) newtons at the samples, in place of an impulse (then `at` and the way are whole samples).
        at
            Sample at which it begins, `now` or later.
        pulse
            As for `ObjectFile.strike`.

        Raises
        ------
        QueryError
            As for `ObjectFile.strike`; a sample that has passed.
        """
        at = self.now if at is None else real("at", at, self.now, LATEST)
        place = point if isinstance(point, ClosestPoints) else point_rows(point, "point")
        places, forces = self._contacts(place, impulse_n_s, force_n)
        if len(forces) != 1:
            raise QueryError("point", f"{len(forces)} points", "Add contacts one by one.")
        pulse, motion = named_striker(pulse), self._body.motion(places)
        if isinstance(pulse, ContactBody):
            collisions = self._body.collisions(places.points, motion, forces, pulse)
            self.spend(motion, collisions.impulses_n_s[0], at, collisions.profiles[0])
        elif forces.ndim == 3:
            self._body.durations(1, forces, pulse)
            for channel in self._channels:
                field = channel.field(motion)
                channel.voices.push(field[0], forces[0], at=round(at) + channel.delay_samples)
        else:
            durations = self._body.durations(1, forces, pulse)
            pulse_s = None if durations is None else float(np.asarray(durations).reshape(-1)[0])
            self.spend(motion, forces[0], at, pulse_s)

    def spend(
        self, motion: Motion, impulse_n_s: Floats, at: float, pulse: float | ForceProfile | None
    ) -> None:
        """Let an impulse (3,) begin at a sample and a place, over half a sine, by a profile or at once."""
        for channel in self._channels:
            amplitudes = along(impulse_n_s[None], channel.field(motion))[0]
            channel.voices.strike(amplitudes, at=at + channel.delay_s * self._rate, pulse_s=pulse)

    def collider(self, motion: Motion, direction: Floats) -> Collider:
        """Return the object as another body meets it that pushes along a unit vector (3,)."""
        return Collider(self._body.modes, along(direction[None], motion.shapes)[0])

    def motion(self, place: ClosestPoints) -> Motion:
        """Return how the modes move at a place of the surface."""
        return self._body.motion(place)

    def motions(self, points: Floats) -> list[Motion]:
        """Return how the modes move at points (n, 3) of the surface, for `drive`."""
        return self._body.motion(point_rows(points, "points")).each()

    def drive(self, pushes: Sequence[tuple[Motion, Floats, Floats]], *, at: int) -> None:
        """Let sampled forces begin together.

        Parameters
        ----------
        pushes
            Of each its place, as `motions` knows it, a unit vector (3,) in the object frame, and newtons (k,)
            at the samples, linear between them.
        at
            Sample of the first, `now` or later.
        """
        forces = np.stack([force for _, _, force in pushes], axis=1)
        for channel in self._channels:
            fields = [along(direction[None], channel.field(motion))[0] for motion, direction, _ in pushes]
            channel.voices.push(np.stack(fields), forces, at=at + channel.delay_samples)

    def damp(self, added_per_s: Floats) -> None:
        """Let decay rates be larger from now on: by (modes,) 1/s, instead of what was added before."""
        for channel in self._channels:
            channel.voices.damp(added_per_s)

    def loudness(self) -> tuple[Floats, Floats]:
        """Frequencies in hertz and present amplitudes (n,) of what sounds in the first channel."""
        voices = self._channels[0].voices
        return voices.frequencies_hz, voices.amplitudes()

    def block(self, samples: int) -> Floats:
        """Return the next samples (channels, samples) float64, in the unit `ObjectFile.strike` answers in."""
        sounds = [channel.voices.block(samples) for channel in self._channels]
        return np.stack(sounds) if len(sounds) > 1 else sounds[0][None]


@dataclass(frozen=True)
class Channel:
    """What is heard at one place.

    Attributes
    ----------
    sources : what sounds, heard equally late
    voices : all of it
    """

    sources: list[Source]
    voices: Voices

    @classmethod
    def of(cls, sources: list[Source]) -> "Channel":
        """Return a silent channel."""
        banks = [source.bank for source in sources]
        begins = np.cumsum([0, *(bank.width for bank in banks)])
        oscillators = Oscillators(
            np.concatenate([bank.oscillators.eigenvalues for bank in banks]),
            np.concatenate([bank.oscillators.dampings_per_s for bank in banks]),
            banks[0].oscillators.sample_rate_hz,
        )
        of_displacement, of_velocity = np.concatenate([bank.weights for bank in banks], axis=1)
        columns = np.concatenate([bank.columns + begin for bank, begin in zip(banks, begins, strict=False)])
        bank = Resonators.of(oscillators, (of_displacement, of_velocity), columns, int(begins[-1]))
        return cls(sources, Voices(bank))

    def field(self, motion: Motion) -> Floats:
        """Gains (n, 3, all modes) of contacts."""
        return np.concatenate([source.field(motion) for source in self.sources], axis=2)

    @property
    def delay_s(self) -> float:
        """On the way to the listener."""
        return self.sources[0].delay_s

    @property
    def delay_samples(self) -> int:
        """Nearest whole number of samples."""
        return self.sources[0].delay_samples
