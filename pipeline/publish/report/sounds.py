"""Strikes as an object's page makes them sound, and the sound of its tile."""

import base64
import io
import json
import wave

import numpy as np

from objectfolder.audio.synthesis import listening_gain
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ, stored_strike
from objectfolder.products.store import Product
from pipeline.publish.viewer.recursions import recursions

SHORT_S = 0.8
LOWEST_HZ, HIGHEST_HZ = 80.0, 20000.0
# Levels drawn in a spectrogram.
SHADES = 64


def short_sound(fidelity: Product) -> bytes:
    """Return a WAV of the first `SHORT_S` seconds of the first strike, at half the sample rate."""
    return wav_of(stored_strike(fidelity, 1, 0)[: int(SHORT_S * SAMPLE_RATE_HZ)], SAMPLE_RATE_HZ)


def wav_of(sound: np.ndarray, sample_rate_hz: float) -> bytes:
    """Return a WAV of (n,) samples at half their rate, as loud as 16 bits hold; it fades out."""
    length = len(sound) // 2
    samples = sound[: 2 * length].reshape(length, 2).mean(axis=1)
    samples[-length // 4 :] *= np.linspace(1, 0, len(samples[-length // 4 :]))
    levels = np.rint(samples * (32767 * listening_gain(float(np.abs(samples).max())))).astype("<i2")
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as file:
        file.setparams((1, 2, round(sample_rate_hz / 2), length, "NONE", ""))
        file.writeframes(levels.tobytes())
    return buffer.getvalue()


def strikes_script(fidelity: Product, points_m: np.ndarray) -> bytes:
    """Return a script that gives a page the held-out strikes, worst first: ``objectfolderStrikes``.

    Parameters
    ----------
    points_m
        (strikes, 3) where they were made; (0, 3) where it is not known.

    Returns
    -------
    bytes
        By name, base64 of little-endian arrays: `recursions` (2, modes, 4) float64, `palette` (`SHADES`, 3)
        uint8; `truth`, `difference` and `steps` as `objectfolder.fidelity.sound.strike_arrays` has them;
        `differences_db` (strikes,) and `points_mm` (strikes, 3) float32, `axes` (strikes,) uint8.

    Raises
    ------
    ValueError
        Arrays that are not of the same strikes and modes.
    """
    own = zip(fidelity["strike_eigenvalues"], fidelity["strike_dampings_per_s"], strict=True)
    differences_db = fidelity["strike_difference_db"]
    shape = len(differences_db), fidelity["strike_eigenvalues"].shape[1]
    for name in ("truth", "difference"):
        if fidelity[f"strike_{name}"].shape != shape:
            raise ValueError(f"strike_{name} is {fidelity[f'strike_{name}'].shape}, not {shape}")
    order = np.argsort(-differences_db, kind="stable")  # the silent ones last
    arrays = {
        "recursions": np.stack([recursions(*pair) for pair in own]).astype("<f8"),
        "palette": palette(),
        "truth": fidelity["strike_truth"][order].astype("<i2"),
        "difference": fidelity["strike_difference"][order].astype("i1"),
        "steps": fidelity["strike_steps"][:, order].astype("<f4"),
        "differences_db": differences_db[order].astype("<f4"),
        "points_mm": (1e3 * points_m[order] if len(points_m) else points_m).astype("<f4"),
        "axes": (order % 3).astype("u1"),
    }
    texts = {name: base64.b64encode(array.tobytes()).decode("ascii") for name, array in arrays.items()}
    return f"window.objectfolderStrikes = {json.dumps(texts)};\n".encode()


def spectrogram_share(frequency_hz: float) -> float:
    """Return the height of a frequency in a spectrogram, 0 at the bottom and 1 at the top."""
    return float(np.log(frequency_hz / LOWEST_HZ) / np.log(HIGHEST_HZ / LOWEST_HZ))


def palette() -> np.ndarray:
    """Return (`SHADES`, 3) colours from dark to bright with even steps of lightness."""
    import cv2

    places = np.linspace(0, 255, SHADES).astype(np.uint8)[:, None]
    return cv2.applyColorMap(places, cv2.COLORMAP_MAGMA)[:, 0, ::-1]
