"""Sounds as data URIs: struck object, truth and Object File, each with its spectrogram."""

import base64
import io
import itertools
import wave
from dataclasses import dataclass

import numpy as np

from pipeline.report.pictures import picture_uri

SAMPLE_RATE_HZ = 44100
LONGEST_S = 1.0
SHORTEST_S = 0.1
FADE_S = 0.01
PEAK = 0.9
WINDOW, HOP = 1024, 128
LOWEST_HZ, HIGHEST_HZ = 80.0, 20000.0
RANGE_DB = 80.0
SPECTROGRAM_S = 0.5
SPECTROGRAM_SIZE = (96, 192)
# Dark to bright with even steps of lightness.
COLOURS = np.array(
    [
        (0, 0, 4),
        (28, 16, 68),
        (80, 18, 123),
        (130, 37, 129),
        (183, 55, 121),
        (230, 82, 99),
        (252, 137, 97),
        (254, 196, 136),
        (252, 253, 191),
    ],
    dtype=np.float64,
)


@dataclass(frozen=True)
class SoundPair:
    """Two playable sounds of one held-out strike, scaled alike."""

    factor: float
    seconds: float
    truth: str
    answer: str
    truth_spectrogram: str
    answer_spectrogram: str
    difference_db: float | None


def sound_pair(truth: np.ndarray, answer: np.ndarray) -> SoundPair:
    """Return a pair, both sounds scaled by the one factor that brings the louder to nine tenths.

    Parameters
    ----------
    truth, answer
        (samples,) at 44100 Hz, true amplitude.
    """
    truth, answer = (np.asarray(sound, dtype=np.float64) for sound in (truth, answer))
    loudest = max(float(np.abs(truth).max(initial=0)), float(np.abs(answer).max(initial=0)))
    factor = PEAK / loudest if loudest > 0 else 1.0
    sounds = _faded(np.stack([truth, answer]) * factor)
    levels = np.round(sounds * 32767).astype("<i2")
    heard = np.flatnonzero(np.any(levels != 0, axis=0))
    length = max(
        int(heard[-1]) + 1 if heard.size else 0, min(int(SHORTEST_S * SAMPLE_RATE_HZ), levels.shape[1])
    )
    energy = float(np.sum(truth**2))
    error = float(np.sum((answer - truth) ** 2))
    reference = float(max(_spectrum(sound).max(initial=0.0) for sound in sounds))
    return SoundPair(
        factor,
        length / SAMPLE_RATE_HZ,
        wave_uri(levels[0, :length]),
        wave_uri(levels[1, :length]),
        spectrogram_uri(sounds[0], reference),
        spectrogram_uri(sounds[1], reference),
        10 * float(np.log10(error / energy)) if energy > 0 and error > 0 else None,
    )


def wave_uri(levels: np.ndarray) -> str:
    """Return (samples,) int16 as a mono WAV data URI."""
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(SAMPLE_RATE_HZ)
        file.writeframes(levels.astype("<i2").tobytes())
    return "data:audio/wav;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def spectrogram_uri(sound: np.ndarray, reference: float) -> str:
    """Return a picture of the first half second: frequency up on a log scale, level over 80 dB.

    Parameters
    ----------
    sound
        (samples,).
    reference
        Magnitude drawn brightest; one for both sounds of a pair.
    """
    magnitudes = _spectrum(sound)
    rows = np.geomspace(HIGHEST_HZ, LOWEST_HZ, SPECTROGRAM_SIZE[0]) * WINDOW / SAMPLE_RATE_HZ
    # A row takes the strongest bin it spans, so that a narrow partial stays visible between rows.
    edges = np.append(rows, rows[-1] * rows[-1] / rows[-2])
    picked = np.stack(
        [
            magnitudes[:, int(low) : max(int(np.ceil(high)), int(low) + 1)].max(axis=1)
            for high, low in itertools.pairwise(edges)
        ]
    )
    columns = np.linspace(0, picked.shape[1] - 1, SPECTROGRAM_SIZE[1]).round().astype(int)
    floor = 10 ** (-RANGE_DB / 20)
    level = 1 + 20 * np.log10(np.maximum(picked[:, columns] / (reference or 1.0), floor)) / RANGE_DB
    anchors = np.linspace(0, 1, len(COLOURS))
    shades = np.round(level * 63) / 63
    image = np.stack([np.interp(shades, anchors, COLOURS[:, channel]) for channel in range(3)], axis=-1)
    return picture_uri(image.round().astype(np.uint8))


def spectrogram_share(frequency_hz: float) -> float:
    """Return the height of a frequency in a spectrogram, 0 at the bottom and 1 at the top."""
    return float(np.log(frequency_hz / LOWEST_HZ) / np.log(HIGHEST_HZ / LOWEST_HZ))


def _spectrum(sound: np.ndarray) -> np.ndarray:
    """Return (frames, bins) magnitudes of Hann windows over the first half second."""
    padded = np.zeros(int(SPECTROGRAM_S * SAMPLE_RATE_HZ) + WINDOW)
    kept = sound[: padded.size]
    padded[: kept.size] = kept
    frames = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)[::HOP]
    return np.abs(np.fft.rfft(frames * np.hanning(WINDOW), axis=1))


def _faded(sounds: np.ndarray) -> np.ndarray:
    """Return (2, samples) cut to one second, with a short fade where something was cut off."""
    length = int(LONGEST_S * SAMPLE_RATE_HZ)
    if sounds.shape[1] <= length:
        return sounds
    fade = int(FADE_S * SAMPLE_RATE_HZ)
    cut = sounds[:, :length].copy()
    cut[:, -fade:] *= np.linspace(1, 0, fade)
    return cut
