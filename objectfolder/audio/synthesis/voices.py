"""Contacts as they come, sound as blocks: the mode bank for a scene that goes on.

The modes are linear, so what has been struck rings as one: after its contact a voice is added to the motion
of the modes, and a block costs the same however many contacts came before. A mode falls silent when its
lifetime has passed since the latest contact, and is then no longer computed.
"""

import math
from bisect import insort
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.bank import checked_forces
from objectfolder.audio.synthesis.pulses import ForceProfile, course_of
from objectfolder.audio.synthesis.resonators import FLOOR_DB, Resonators
from objectfolder.errors import QueryError
from objectfolder.query_values import real_array, whole
from objectfolder.renaming import renamed_keywords

Floats = NDArray[np.float64]
MOST_BLOCK_SAMPLES = 1 << 26  # of a block
MOST_VOICES = 4096
MOST_ONSET_SAMPLES = 1 << 22
END = attrgetter("end")


@dataclass(eq=False)
class Voice:
    """A contact not yet over: `onset` (k,) from sample `begin` to `end`, then the state (2, modes)."""

    begin: int
    onset: Floats
    state: Floats

    @property
    def end(self) -> int:
        """Sample at which the state holds."""
        return self.begin + len(self.onset)


class Voices:
    """A stream of sound; `Voices.of_modes` makes one.

    Parameters
    ----------
    bank
        What sounds.

    Attributes
    ----------
    now : samples given so far, the index of the next one

    Examples
    --------
    >>> import numpy as np
    >>> voices = Voices.of_modes([(2 * np.pi * 440) ** 2], [3.0], 44100)
    >>> voices.strike([1.0])
    >>> float(voices.block(256)[0]), voices.now
    (1.0, 256)
    """

    def __init__(self, bank: Resonators) -> None:
        self._bank = self._damped = bank
        self._ends = -bank.lifetimes
        self._added: Floats | None = None
        self._ringing = np.zeros((1, 2, len(bank)))
        self._age = math.inf
        self._voices: list[Voice] = []  # those that end first, first
        self.now = 0

    @classmethod
    def of_modes(
        cls,
        eigenvalues: ArrayLike,
        dampings_per_s: ArrayLike,
        sample_rate_hz: float,
        *,
        response: str = "velocity",
        output_weights: ArrayLike | None = None,
        floor_db: float = FLOOR_DB,
    ) -> "Voices":
        """Return a silent stream.

        Parameters
        ----------
        eigenvalues, dampings_per_s, sample_rate_hz, response, floor_db
            As for `mode_bank`; modes that would alias are left out.
        output_weights
            (modes,) factors of what is heard of each mode; one by default.

        Raises
        ------
        QueryError
            As for `mode_bank`.
        """
        factors: Floats | float = 1.0
        if output_weights is not None:
            factors = real_array("output_weights", output_weights)
            if factors.shape != np.shape(eigenvalues):
                raise QueryError("output_weights", f"shape {factors.shape}", "Give one a mode.")
        return cls(
            Resonators.of_modes(eigenvalues, dampings_per_s, sample_rate_hz, response, floor_db, factors)
        )

    @property
    def waiting(self) -> int:
        """Voices whose contact has not begun or not ended."""
        return len(self._voices)

    @property
    def ringing_modes(self) -> int:
        """Modes that are still computed."""
        return int(self._ends.searchsorted(-self._age, side="left"))

    @property
    def silent(self) -> bool:
        """Whether nothing sounds and nothing waits."""
        return not self._voices and self.ringing_modes == 0

    def strike(
        self, amplitudes: ArrayLike, *, at: float | None = None, pulse_s: float | ForceProfile | None = None
    ) -> None:
        """Let an impulse or a half-sine pulse begin.

        Parameters
        ----------
        amplitudes
            (modes,) modal velocity that the whole impulse gives.
        at
            Sample at which it begins, `now` or later, whole or not; `now` if None.
        pulse_s
            Duration of the pulse, seconds, or the course of its force; an ideal impulse if None.

        Raises
        ------
        QueryError
            Values that are not finite, a time that has passed, or more than `MOST_VOICES` contacts or
            `MOST_ONSET_SAMPLES` samples of contact waiting.
        """
        gains = real_array("amplitudes", amplitudes).reshape(-1)
        if gains.shape != (self._bank.width,):
            raise QueryError("amplitudes", f"shape {gains.shape}", f"Give ({self._bank.width},).")
        begin, ahead = self._beginning(at)
        course = course_of(pulse_s)
        self._make_room(course.duration_s * self._rate if course else 0)
        onset, states = self._bank.onset(gains[None, self._bank.columns], course, ahead, MOST_ONSET_SAMPLES)
        insort(self._voices, Voice(begin, onset[0], states[0]), key=END)

    @renamed_keywords(forces="forces_n")
    def push(self, gains: ArrayLike, forces_n: ArrayLike, *, at: int | None = None) -> None:
        """Let a sampled force begin; see `driven_bank`.

        Parameters
        ----------
        gains
            (directions, modes) modal velocity an impulse of 1 N s gives.
        forces_n
            (k, directions) newtons.
        at
            Whole sample at which the first of them acts.
        """
        fields, pushes = checked_forces(gains, forces_n, self._bank.width)
        if len(fields) != 1:
            raise QueryError("gains", f"{len(fields)} contacts", "Add contacts one by one.")
        begin, ahead = self._beginning(at)
        if ahead:
            raise QueryError("at", f"{at}", "Sampled forces begin on a sample.")
        self._make_room(pushes.shape[1])
        onset, states = self._bank.drive(fields[0][:, self._bank.columns], pushes[0], MOST_ONSET_SAMPLES)
        insort(self._voices, Voice(begin, onset[0], states[0]), key=END)

    def damp(self, added_per_s: Floats) -> None:
        """Let decay rates be larger from now on.

        Parameters
        ----------
        added_per_s
            Of the first of all modes, 0 of the others, instead of what was added before. Frequencies stay;
            what is forced meanwhile is damped as if its force came in the middle.
        """
        every = np.zeros(self._bank.width)
        every[: len(added_per_s)] = added_per_s
        self._added = every[self._bank.columns] if every.any() else None
        self._damped = self._bank if self._added is None else self._bank.damped(self._added)

    @property
    def frequencies_hz(self) -> Floats:
        """Damped frequencies (modes,), in the order of `amplitudes`."""
        return self._bank.oscillators.frequencies_hz

    def amplitudes(self) -> Floats:
        """Envelopes (modes,) of what is heard of each ringing mode now, those that live longest first."""
        modes, weights, (q, v) = self._bank.oscillators, self._bank.weights, self._ringing[0]
        heard = weights[0] * q + weights[1] * v
        slope = weights[0] * v - weights[1] * (modes.eigenvalues * q + 2 * modes.dampings_per_s * v)
        across = (slope + modes.dampings_per_s * heard) / np.maximum(modes.roots_per_s, 1e-300)
        return np.hypot(heard, np.where(modes.discriminants > 0, across, 0.0))

    def block(self, samples: int) -> Floats:
        """Return the next samples (samples,) float64.

        Raises
        ------
        QueryError
            A number that is not positive.
        """
        samples = whole("samples", samples, 1, MOST_BLOCK_SAMPLES)
        sound, begin, until = np.zeros((1, samples)), self.now, self.now + samples
        for voice in self._voices:
            if voice.begin < until:
                first, last = max(voice.begin, self.now), min(voice.end, until)
                heard = voice.onset[first - voice.begin : last - voice.begin]
                sound[0, first - self.now : last - self.now] += heard
        while self._voices and self._voices[0].end < until:
            voice = self._voices.pop(0)
            if voice.end > begin:
                self._ring(sound[:, begin - self.now : voice.end - self.now])
            self._ringing[0] += self._lost(voice.state, len(voice.onset) / 2)
            self._age, begin = 0.0, voice.end
        self._ring(sound[:, begin - self.now :])
        self.now = until
        return sound[0]

    @property
    def _rate(self) -> float:
        return self._bank.oscillators.sample_rate_hz

    def _beginning(self, at: float | None) -> tuple[int, float]:
        """First sample at or after a time, and by how much it is after."""
        at = self.now if at is None else at
        if not (math.isfinite(at) and at >= self.now):
            raise QueryError("at", f"sample {at}, the next is {self.now}", "Give one to come.")
        return math.ceil(at), math.ceil(at) - at

    def _make_room(self, samples: float) -> None:
        """Refuse a contact whose number of samples would make the memory grow without bound."""
        waiting = sum(len(voice.onset) for voice in self._voices)
        if len(self._voices) >= MOST_VOICES or waiting + samples > MOST_ONSET_SAMPLES:
            finding = f"{len(self._voices)} contacts wait, {waiting} samples of them"
            raise QueryError("voices", finding, "Take blocks before adding more.")

    def _ring(self, sound: Floats) -> None:
        """Add to `sound` (1, samples) what rings, and move it to its end."""
        self._damped.ring(self._ringing, sound, age=self._age)
        self._age += sound.shape[1]

    def _lost(self, state: Floats, samples: float) -> Floats:
        """State (2, modes) without what added damping takes in some samples."""
        if self._added is None:
            return state
        return state * np.exp(-self._added * samples / self._rate)
