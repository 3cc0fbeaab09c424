"""Sounds as WAV files of 32-bit floats: values are written as they are, also above 1."""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from objectfolder.errors import QueryError
from objectfolder.products.atomic import atomic_write

FLOAT_FORMAT = 3  # WAVE_FORMAT_IEEE_FLOAT
LARGEST_BYTES = 2**32 - 64


def write_wav(path: Path | str, sound: ArrayLike, sample_rate_hz: int, *, gain: float = 1.0) -> None:
    """Write a sound, times an explicit gain.

    Parameters
    ----------
    sound
        (samples,) or (channels, samples), in whatever unit it has; nothing is normalised or clipped.
    sample_rate_hz
        A whole number.

    Raises
    ------
    QueryError
        Values that are not finite (as float32), a shape or rate that WAV cannot hold, or over 4 GB.
    """
    values = np.atleast_2d(np.asarray(sound, dtype=np.float64) * gain)
    with np.errstate(over="ignore"):
        frames = np.ascontiguousarray(values.T, dtype="<f4")
    if values.ndim != 2 or not 1 <= len(values) < 65536:
        raise QueryError("sound", f"shape {np.shape(sound)}", "Give (samples,) or (channels, samples).")
    if not np.isfinite(frames).all():
        raise QueryError("sound", "not finite as 32-bit floats", "Check the sound and the gain.")
    if sample_rate_hz != int(sample_rate_hz) or not 1 <= sample_rate_hz < 2**32:
        raise QueryError("sample_rate_hz", f"{sample_rate_hz}", "Give a whole number of hertz.")
    if frames.nbytes > LARGEST_BYTES:
        raise QueryError("sound", f"{frames.nbytes} bytes", "WAV holds 4 GB; write parts.")
    channels, rate = len(values), int(sample_rate_hz)
    width = 4 * channels
    described = struct.pack("<HHIIHHH", FLOAT_FORMAT, channels, rate, rate * width, width, 32, 0)
    chunks = (
        b"WAVE"
        + b"fmt "
        + struct.pack("<I", len(described))
        + described
        + b"fact"
        + struct.pack("<II", 4, len(frames))
        + b"data"
        + struct.pack("<I", frames.nbytes)
    )
    with atomic_write(path) as file:
        file.write(b"RIFF" + struct.pack("<I", len(chunks) + frames.nbytes) + chunks)
        file.write(frames.tobytes())
