"""How far one modal sound is from another.

ObjectFolder 1.0 and 2.0 print an STFT and an ENV distance without formulas, and their repository has no code
that computes them. Code that the first author published elsewhere (the evaluation of "2.5D Visual Sound",
CVPR 2019; the sound metrics of the ObjectFolder Benchmark, 2023) takes, for sounds x and y of n samples,

    STFT = mean over bins, frames, real and imaginary parts of (X - Y)^2,
    ENV  = sqrt(mean over samples of (|x + i Hx| - |y + i Hy|)^2),      H the Hilbert transform,

with X of 512 bins, a Hann window of 400 samples that is not normalised, hop 160, frames centred. The printed
numbers are of this kind: a difference of mean square s^2 has STFT = s^2 sum(window^2) / 2 = 75 s^2 (Parseval)
and ENV near s, so STFT / ENV^2 is near 75. Printed are 4.94e-5 / (7.65e-4)^2 = 84 and
0.19e-5 / (1.29e-4)^2 = 114. A mean square of envelopes without the root, or an STFT whose window is
normalised, would be off by orders of magnitude.

How loud x is and how long it lasts, they do not say. Both distances grow with loudness and shrink with the
silence at the end, so the printed numbers can be compared with others only up to these. Here every pair is
divided by the peak of the truth, at any sample rate: `unscaled_stft_distance` and `envelope_distance` are the
two formulas above; `stft_distance` is the first with the window normalised, so that it does not grow with
its length. What the same formulas give for silence in place of y says how small they are.
"""

import numpy as np


def cents(frequencies_hz: np.ndarray, reference_hz: np.ndarray) -> np.ndarray:
    """Interval 1200 log2(f / f_ref) in cents (a semitone is 100; 1 % is 17.2)."""
    return 1200.0 * np.log2(np.asarray(frequencies_hz) / np.asarray(reference_hz))


def gain_error_db(truth: np.ndarray, answer: np.ndarray) -> float:
    """Relative rms error of modal gains, dB: 20 log10(|answer - truth| / |truth|) over all entries.

    Parameters
    ----------
    truth, answer
        (points, 3, modes) mass-normalised mode shapes. Each mode is weighted by its energy.
    """
    error, size = np.linalg.norm(answer - truth), np.linalg.norm(truth)
    return float(20 * np.log10(max(error, 1e-15 * size) / size)) if size > 0 else float("nan")


def gain_error_by_mode_db(truth: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """Relative rms error (modes,) of each mode's gains over points and directions, dB."""
    error = np.sqrt(np.sum((answer - truth) ** 2, axis=(0, 1)))
    size = np.sqrt(np.sum(truth**2, axis=(0, 1)))
    return 20 * np.log10(np.maximum(error, 1e-15 * size) / np.maximum(size, 1e-300))


def gain_error_by_point_db(truth: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """Relative rms error (points,) of the gains at each point over directions and modes, dB."""
    error = np.linalg.norm(answer - truth, axis=(1, 2))
    size = np.linalg.norm(truth, axis=(1, 2))
    return 20 * np.log10(np.maximum(error, 1e-15 * size) / np.maximum(size, 1e-300))


def stft_distance(truth: np.ndarray, answer: np.ndarray, sample_rate_hz: float) -> float:
    """Mean squared difference of complex short-time Fourier transforms.

    Both (n, samples) signals are divided by the peak of the truth, sound by sound; Hann window of 400
    samples, hop 160, 512 bins (the papers' settings at 16 kHz); the mean is over sounds, bins and
    frames of |difference|^2, with the transform scaled so that a sine of amplitude 1 peaks at 1/2.
    """
    from scipy.signal import stft

    scale = np.max(np.abs(truth), axis=1, keepdims=True)
    scale = np.where(scale > 0, scale, 1.0)
    difference = (answer - truth) / scale
    _, _, transform = stft(difference, sample_rate_hz, window="hann", nperseg=400, noverlap=240, nfft=512)
    return float(np.mean(np.abs(transform) ** 2))


def unscaled_stft_distance(truth: np.ndarray, answer: np.ndarray) -> float:
    """Mean square of real and imaginary parts of the difference of STFTs whose window is not normalised.

    As `stft_distance`, times half the squared sum of the window, (0.5 * 400)^2 / 2 = 20000.
    """
    return 20000.0 * stft_distance(truth, answer, 1.0)


def envelope_distance(truth: np.ndarray, answer: np.ndarray) -> float:
    """Root mean square difference of Hilbert envelopes, (n, samples) signals over the truth's peaks.

    Near the root mean square of the difference itself: at a relative error e of the gains it is about e times
    the rms of a sound over its peak, 0.02 to 0.1 for metal and ceramic in two seconds.
    """
    from scipy.signal import hilbert

    scale = np.max(np.abs(truth), axis=1, keepdims=True)
    scale = np.where(scale > 0, scale, 1.0)
    difference = np.abs(hilbert(truth / scale, axis=1)) - np.abs(hilbert(answer / scale, axis=1))
    return float(np.sqrt(np.mean(difference**2)))
