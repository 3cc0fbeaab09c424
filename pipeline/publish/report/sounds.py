"""Sounds as data URIs, truth and Object File, with spectrograms of both and of their difference."""

import base64
import io
import wave
from functools import cache
from typing import NamedTuple

import numpy as np

from objectfolder.fidelity.sound import SAMPLE_RATE_HZ
from pipeline.publish.report.pictures import indexed_uri

LONGEST_S = 1.0
SHORT_S = 0.8
SHORTEST_S = 0.1
FADE_S = 0.01
PEAK = 0.9
WINDOW, HOP = 1024, 128
LOWEST_HZ, HIGHEST_HZ = 80.0, 20000.0
RANGE_DB = 80.0
SPECTROGRAM_S = 0.5
HANN = np.hanning(WINDOW).astype(np.float32)
SPECTROGRAM_SIZE = (96, 96)
# Levels drawn, from `RANGE_DB` below the reference up to it.
SHADES = 64


class SoundPair(NamedTuple):
    """Two playable sounds of one held-out strike, scaled alike, and pictures of them and their difference."""

    factor: float
    seconds: float
    truth: str
    answer: str
    spectrograms: list[str]
    difference_db: float | None


def short_sound(sound: np.ndarray) -> bytes:
    """Return a WAV of the first `SHORT_S` seconds of a sound (samples,), at half the sample rate."""
    length = min(int(SHORT_S * SAMPLE_RATE_HZ), len(sound)) // 2
    kept = sound[: 2 * length].reshape(length, 2).mean(axis=1)
    kept[-length // 4 :] *= np.linspace(1, 0, len(kept[-length // 4 :]))
    loudest = float(np.abs(kept).max(initial=0.0))
    levels = np.rint(kept * (PEAK * 32767 / loudest if loudest > 0 else 0.0)).astype("<i2")
    return _wav(levels, round(SAMPLE_RATE_HZ / 2))


def sound_pair(truth: np.ndarray, answer: np.ndarray) -> SoundPair:
    """Return a pair, both sounds scaled by the one factor that brings the louder to nine tenths.

    Parameters
    ----------
    truth, answer
        (samples,) at 44100 Hz, true amplitude.
    """
    pair = np.stack([truth, answer]).astype(np.float32)
    loudest = float(np.abs(pair).max(initial=0))
    factor = PEAK / loudest if loudest > 0 else 1.0
    sounds = _faded(pair * np.float32(factor))
    levels = np.rint(sounds * np.float32(32767)).astype("<i2")
    heard = np.flatnonzero(levels.any(axis=0))
    shortest = min(int(SHORTEST_S * SAMPLE_RATE_HZ), levels.shape[1])
    length = max(int(heard[-1]) + 1 if heard.size else 0, shortest)
    energy = float(np.sum(np.square(pair[0], dtype=np.float64)))
    error = float(np.sum(np.square(pair[1] - pair[0], dtype=np.float64)))
    files = [_wav(sound[:length], round(SAMPLE_RATE_HZ)) for sound in levels]
    uris = ["data:audio/wav;base64," + base64.b64encode(file).decode("ascii") for file in files]
    pictures = [indexed_uri(picture, _palette()) for picture in spectrograms(sounds)]
    difference_db = 10 * float(np.log10(error / energy)) if energy > 0 and error > 0 else None
    return SoundPair(factor, length / SAMPLE_RATE_HZ, uris[0], uris[1], pictures, difference_db)


def spectrograms(sounds: np.ndarray) -> np.ndarray:
    """Return (3, rows, columns) uint8 levels of the first half second of two sounds and their difference.

    Frequency goes up on a log scale. The loudest place of all three has the highest level, `SHADES` - 1;
    `RANGE_DB` below it and less has 0.

    Parameters
    ----------
    sounds
        (2, samples) at 44100 Hz.
    """
    from scipy.fft import rfft  # in single precision, as numpy's is not; not every report draws one

    padded = np.zeros((len(sounds), int(SPECTROGRAM_S * SAMPLE_RATE_HZ) + WINDOW), np.float32)
    kept = sounds[:, : padded.shape[1]]
    padded[:, : kept.shape[1]] = kept
    frames = np.lib.stride_tricks.sliding_window_view(padded, WINDOW, axis=1)[:, ::HOP]
    chosen = np.linspace(0, frames.shape[1] - 1, SPECTROGRAM_SIZE[1]).round().astype(int)
    edges = np.geomspace(LOWEST_HZ, HIGHEST_HZ, SPECTROGRAM_SIZE[0] + 1) * WINDOW / SAMPLE_RATE_HZ
    spectrum = rfft(frames[:, chosen] * HANN, axis=-1)
    first, second = spectrum[..., : int(np.ceil(edges[-1])) + 1]
    magnitudes = np.ascontiguousarray(np.moveaxis(np.abs([first, second, second - first]), -1, 0))
    # A row takes the strongest bin it spans, so that a narrow partial stays visible between rows.
    low = edges[:-1].astype(int)
    high = np.maximum(np.ceil(edges[1:]).astype(int), low + 1)
    picked = np.maximum.reduceat(magnitudes, np.stack([low, high], axis=1).ravel(), axis=0)[::2]
    reference = float(picked.max(initial=0.0)) or 1.0
    level = 1 + 20 * np.log10(np.maximum(picked / reference, 10 ** (-RANGE_DB / 20))) / RANGE_DB
    return np.round(level * (SHADES - 1)).astype(np.uint8).transpose(1, 0, 2)[:, ::-1]


def spectrogram_share(frequency_hz: float) -> float:
    """Return the height of a frequency in a spectrogram, 0 at the bottom and 1 at the top."""
    return float(np.log(frequency_hz / LOWEST_HZ) / np.log(HIGHEST_HZ / LOWEST_HZ))


@cache
def _palette() -> np.ndarray:
    """Return (`SHADES`, 3) colours from dark to bright with even steps of lightness."""
    import cv2

    places = np.linspace(0, 255, SHADES).astype(np.uint8)[:, None]
    return cv2.applyColorMap(places, cv2.COLORMAP_MAGMA)[:, 0, ::-1]


def _wav(levels: np.ndarray, sample_rate_hz: int) -> bytes:
    """Return a WAV of (samples,) int16."""
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as file:
        file.setparams((1, 2, sample_rate_hz, len(levels), "NONE", ""))
        file.writeframes(levels.tobytes())
    return buffer.getvalue()


def _faded(sounds: np.ndarray) -> np.ndarray:
    """Return (2, samples) cut to one second, with a short fade where something was cut off."""
    length = int(LONGEST_S * SAMPLE_RATE_HZ)
    if sounds.shape[1] <= length:
        return sounds
    fade = int(FADE_S * SAMPLE_RATE_HZ)
    cut = sounds[:, :length].copy()
    cut[:, -fade:] *= np.linspace(1, 0, fade)
    return cut
