"""Contacts as they come, sound as blocks: the mode bank for a scene that goes on.

The modes are linear, so what has been struck rings as one: after its contact a voice is added to the motion
of the modes, and a block costs the same however many contacts came before. A mode falls silent when its
lifetime has passed since the latest contact, and is then no longer computed.
"""

import math
from bisect import insort
from dataclasses import dataclass
from operator import attrgetter, itemgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.bank import FLOOR_DB, checked_forces
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.audio.synthesis.pulses import ForceProfile, course_of
from objectfolder.audio.synthesis.resonators import Resonators
from objectfolder.errors import QueryError
from objectfolder.query_values import real_array, whole
from objectfolder.renaming import renamed_keywords

Floats = NDArray[np.float64]
MOST_BLOCK_SAMPLES = 1 << 26  # of a block
MOST_VOICES = 4096
MOST_ONSET_SAMPLES = 1 << 22
START = attrgetter("start")


@dataclass(eq=False)
class Voice:
    """A contact not yet over: `onset` (k,) from sample `start` on, then the state (2, modes)."""

    start: int
    onset: Floats
    state: Floats


class Voices:
    """A stream of sound; `Voices.of_modes` makes one.

    Parameters
    ----------
    oscillators
        Those that sound.
    weights
        (modes,) of displacement and of velocity in what is heard.
    columns
        (modes,) which of the amplitudes of a contact, `all_modes` of them, are theirs; all by default.

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

    def __init__(
        self,
        oscillators: Oscillators,
        weights: tuple[Floats, Floats],
        *,
        columns: NDArray[np.int64] | None = None,
        all_modes: int | None = None,
        floor_db: float = FLOOR_DB,
    ) -> None:
        columns = np.arange(len(oscillators)) if columns is None else columns
        self._mode_count = len(oscillators) if all_modes is None else all_modes
        self._bank = self._damped = Resonators.of(oscillators, weights, floor_db)
        self._columns = columns[self._bank.order]
        self._ends = -self._bank.lifetimes
        self._added: Floats | None = None
        self._ringing = np.zeros((1, 2, len(oscillators)))
        self._age = math.inf
        self._voices: list[Voice] = []  # the earliest first
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
        oscillators = Oscillators.checked(eigenvalues, dampings_per_s, sample_rate_hz)
        factors = np.ones(len(oscillators))
        if output_weights is not None:
            factors = np.asarray(output_weights, dtype=np.float64)
        if factors.shape != (len(oscillators),) or not np.isfinite(factors).all():
            raise QueryError("output_weights", f"shape {factors.shape}, or not finite", "Give one a mode.")
        columns = np.flatnonzero(oscillators.audible())
        sounding, factors = oscillators.take(columns), factors[columns]
        displacement, velocity = sounding.response_weights(response)
        weights = (displacement * factors, velocity * factors)
        return cls(sounding, weights, columns=columns, all_modes=len(oscillators), floor_db=floor_db)

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
        if gains.shape != (self._mode_count,):
            raise QueryError("amplitudes", f"shape {gains.shape}", f"Give ({self._mode_count},).")
        begin, ahead = self._beginning(at)
        course = course_of(pulse_s)
        self._make_room(course.duration_s * self._rate if course else 0)
        onset, states = self._bank.onset(gains[None, self._columns], course, ahead, MOST_ONSET_SAMPLES)
        insort(self._voices, Voice(begin, onset[0], states[0]), key=START)

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
        fields, pushes = checked_forces(gains, forces_n, self._mode_count)
        if len(fields) != 1:
            raise QueryError("gains", f"{len(fields)} contacts", "Add contacts one by one.")
        begin, ahead = self._beginning(at)
        if ahead:
            raise QueryError("at", f"{at}", "Sampled forces begin on a sample.")
        self._make_room(pushes.shape[1])
        onset, states = self._bank.drive(fields[0][:, self._columns], pushes[0], MOST_ONSET_SAMPLES)
        insort(self._voices, Voice(begin, onset[0], states[0]), key=START)

    def damp(self, added_per_s: Floats) -> None:
        """Let decay rates be larger from now on.

        Parameters
        ----------
        added_per_s
            Of the first of all modes, 0 of the others, instead of what was added before. Frequencies stay;
            what is forced meanwhile is damped as if its force came in the middle.
        """
        every = np.zeros(self._mode_count)
        every[: len(added_per_s)] = added_per_s
        self._added = every[self._columns] if every.any() else None
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
        sound, begin = np.zeros((1, samples)), 0
        for end, voice in self._ended(sound[0]):
            if end > begin:
                self._ring(sound[:, begin:end])
            self._ringing[0] += self._lost(voice.state, len(voice.onset) / 2)
            self._age, begin = 0.0, end
        self._ring(sound[:, begin:] if begin else sound)
        self.now += samples
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

    def _ended(self, sound: Floats) -> list[tuple[int, Voice]]:
        """Add contacts to `sound` (samples,); return those that end in it and where, the earliest first."""
        ended: list[tuple[int, Voice]] = []
        for voice in self._voices:
            begin = voice.start - self.now
            if begin >= len(sound):
                break
            heard = voice.onset[max(0, -begin) : len(sound) - begin]
            sound[max(0, begin) : max(0, begin) + len(heard)] += heard
            end = begin + len(voice.onset)
            if end < len(sound):
                ended.append((end, voice))
        for _, voice in ended:
            self._voices.remove(voice)
        return sorted(ended, key=itemgetter(0))

    def _lost(self, state: Floats, samples: float) -> Floats:
        """State (2, modes) without what added damping takes in some samples."""
        if self._added is None:
            return state
        return state * np.exp(-self._added * samples / self._rate)
