"""A sound as an array that a notebook can play."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.wav import wav_bytes, write_wav
from objectfolder.errors import QueryError
from objectfolder.notebook import data_uri

MOST_PLAYED = 4


class StrikeEnergy(NamedTuple):
    """Where the energy of a striker went, joules, (n,) each.

    Attributes
    ----------
    striker : before
    rebound : of the striker after
    vibration : of the modes
    motion : of the object as a whole
    lost : to the contact and, while it lasted, to the damping of the modes
    """

    striker: NDArray[np.float64]
    rebound: NDArray[np.float64]
    vibration: NDArray[np.float64]
    motion: NDArray[np.float64]
    lost: NDArray[np.float64]

    @classmethod
    def of_all(cls, parts: "Sequence[StrikeEnergy | None]") -> "StrikeEnergy | None":
        """Return those of all contacts from those of some each; None where there are none."""
        energies = [part for part in parts if part is not None]
        return cls(*np.concatenate(energies, axis=1)) if energies else None


class Sound(np.ndarray):
    """What `strike` returns: (n, samples) or (n, channels, samples) float32 that a notebook plays.

    In all else it is a numpy array: what is computed from it is a plain one.

    Attributes
    ----------
    sample_rate_hz : None for anything but rows of a sound
    energy_j : of all strikes by a striker, where its energy went; None else
    """

    sample_rate_hz: float | None = None
    energy_j: StrikeEnergy | None = None

    @classmethod
    def of(cls, values: np.ndarray, sample_rate_hz: float, energy_j: StrikeEnergy | None = None) -> "Sound":
        """Return an array as a sound, without a copy."""
        sound = values.view(cls)
        sound.sample_rate_hz, sound.energy_j = sample_rate_hz, energy_j
        return sound

    def __array_finalize__(self, source: Any) -> None:
        """Keep the rate in copies and in rows."""
        if isinstance(source, Sound) and source.shape[-1:] == self.shape[-1:]:
            self.sample_rate_hz = source.sample_rate_hz

    def __array_wrap__(self, array: np.ndarray, context: Any = None, return_scalar: bool = False) -> Any:
        """Return the answer of a numpy function as a plain array or number."""
        return array[()] if array.ndim == 0 else np.asarray(array)

    def __repr__(self) -> str:
        if self.sample_rate_hz is None or self.size == 0:
            return repr(np.asarray(self))
        seconds, peak = self.shape[-1] / self.sample_rate_hz, float(np.abs(np.asarray(self)).max())
        return f"Sound({self.shape}, {seconds:.3g} s at {self.sample_rate_hz:g} Hz, peak {peak:.3g})"

    __str__ = __repr__

    def write(self, path: Path | str, *, gain: float | None = None) -> float:
        """Write one sound as a WAV file of 32-bit floats, and return the gain it was written with.

        Parameters
        ----------
        path
            The file.
        gain
            Factor of what is written. By default the loudest sample is 3 dB below full scale; 1 writes the
            values as they are.

        Raises
        ------
        QueryError
            Several sounds, or an array that is no longer a whole sound.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> sounds = bar.strike([[0.0, 0.0, 0.004], [0.05, 0.0, 0.004]])
        >>> sounds.shape, sounds[1].write("a.wav", gain=1.0)
        ((2, 88200), 1.0)
        """
        if self.sample_rate_hz is None:
            raise QueryError("write", "no whole sound: its sample rate is not known", "Use `write_wav`.")
        if self.ndim > 1 and len(self) != 1:
            remedy = "Write one at a time: `sound[:1].write(...)`, with all of its channels."
            raise QueryError("write", f"shape {self.shape} is not one sound", remedy)
        sound = np.asarray(self).reshape(self.shape[-2:] if self.ndim == 3 else (self.shape[-1],))
        return write_wav(path, sound, sample_rate_hz=round(self.sample_rate_hz), gain=gain)

    def _repr_html_(self) -> str | None:
        """Return players of the first rows at a level to listen to; None where this is not whole sounds."""
        if self.sample_rate_hz is None or self.size == 0:
            return None
        rows = self.reshape(-1, *self.shape[-2:]) if self.ndim == 3 else self.reshape(-1, 1, self.shape[-1])
        rate = round(self.sample_rate_hz)
        uris = (data_uri("audio/wav", wav_bytes(row[:2], rate)[0]) for row in rows[:MOST_PLAYED])
        players = "".join(f'<div><audio controls src="{uri}"></audio></div>' for uri in uris)
        surplus = len(rows) - MOST_PLAYED
        return players + (f"<div>and {surplus} more</div>" if surplus > 0 else "")
