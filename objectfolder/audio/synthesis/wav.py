"""Sounds as WAV files of 32-bit floats: at a level to listen to, or with a gain of 1 at true values."""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from objectfolder.errors import QueryError
from objectfolder.products.atomic import write_whole
from objectfolder.renaming import formerly_positional

FLOAT_FORMAT = 3  # WAVE_FORMAT_IEEE_FLOAT
LARGEST_BYTES = 2**32 - 64
SAMPLE_RATE_HZ = 44100.0
LISTENING_PEAK = 10 ** (-3 / 20)  # 3 dB below full scale, 1: what players clip is above that


def listening_gain(peak: float) -> float:
    """Return the factor that brings a peak to 3 dB below full scale; 1 for silence.

    Examples
    --------
    >>> round(listening_gain(200.0), 5), listening_gain(0.0)
    (0.00354, 1.0)
    """
    return LISTENING_PEAK / peak if peak > 0 else 1.0


@formerly_positional
def write_wav(
    path: Path | str, sound: ArrayLike, *, sample_rate_hz: float | None = None, gain: float | None = None
) -> float:
    """Write a sound times a gain, and return that gain; see `wav_bytes`.

    Parameters
    ----------
    sample_rate_hz
        A whole number. None takes that of a `Sound` that knows it, and 44,100 for others.

    Examples
    --------
    >>> gain = write_wav("tone.wav", [0.0, 2.0, -4.0], sample_rate_hz=44100)
    >>> round(4 * gain, 3)  # the peak, 3 dB below full scale
    0.708
    """
    if sample_rate_hz is None:
        sample_rate_hz = getattr(sound, "sample_rate_hz", None) or SAMPLE_RATE_HZ
    content, gain = wav_bytes(sound, sample_rate_hz, gain=gain)
    write_whole(path, content)
    return gain


def wav_bytes(sound: ArrayLike, sample_rate_hz: float, *, gain: float | None = None) -> tuple[bytes, float]:
    """Return a WAV file of a sound times a gain, and that gain.

    Parameters
    ----------
    sound
        (samples,) or (channels, samples), in whatever unit it has.
    sample_rate_hz
        A whole number.
    gain
        By default that of `listening_gain`; 1 writes the values as they are, also above full scale.

    Raises
    ------
    QueryError
        Values that are not finite (as float32), a shape or rate that WAV cannot hold, or over 4 GB.
    """
    values = np.atleast_2d(np.asarray(sound, dtype=np.float64))
    if gain is None:
        gain = listening_gain(float(np.abs(values).max(initial=0.0)))
    values = values * gain
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
    return b"RIFF" + struct.pack("<I", len(chunks) + frames.nbytes) + chunks + frames.tobytes(), gain
