"""A sound as an array that a notebook can play."""

from typing import Any

import numpy as np

from objectfolder.audio.synthesis.wav import wav_bytes
from objectfolder.notebook import data_uri

MOST_PLAYED = 4


class Sound(np.ndarray):
    """What `strike` returns: (n, samples) or (n, channels, samples) float32 that a notebook plays.

    In all else it is a numpy array: what is computed from it is a plain one.

    Attributes
    ----------
    sample_rate_hz : None for anything but rows of a sound
    """

    sample_rate_hz: float | None = None

    @classmethod
    def of(cls, values: np.ndarray, sample_rate_hz: float) -> "Sound":
        """Return an array as a sound, without a copy."""
        sound = values.view(cls)
        sound.sample_rate_hz = sample_rate_hz
        return sound

    def __array_finalize__(self, source: Any) -> None:
        """Keep the rate in copies and in rows."""
        if isinstance(source, Sound) and source.shape[-1:] == self.shape[-1:]:
            self.sample_rate_hz = source.sample_rate_hz

    def __array_wrap__(self, array: np.ndarray, context: Any = None, return_scalar: bool = False) -> Any:
        """Return the answer of a numpy function as a plain array or number."""
        return array[()] if array.ndim == 0 else np.asarray(array)

    def _repr_html_(self) -> str | None:
        """Return players of the first rows at a level to listen to; None where this is not whole sounds."""
        if self.sample_rate_hz is None or self.size == 0:
            return None
        rows = self.reshape(-1, *self.shape[-2:]) if self.ndim == 3 else self.reshape(-1, 1, self.shape[-1])
        rate = round(self.sample_rate_hz)
        uris = (data_uri("audio/wav", wav_bytes(row[:2], rate)[0]) for row in rows[:MOST_PLAYED])
        players = "".join(f'<div><audio controls src="{uri}"></audio></div>' for uri in uris)
        left = len(rows) - MOST_PLAYED
        return players + (f"<div>and {left} more</div>" if left > 0 else "")
