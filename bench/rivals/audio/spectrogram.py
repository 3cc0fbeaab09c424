"""The complex spectrogram of ObjectFolder 1.0, and the sound back from it."""

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

SAMPLE_RATE_HZ = 16000.0
SAMPLES = 32000
TRANSFORM, WINDOW, HOP = 512, 400, 160
BINS, FRAMES = TRANSFORM // 2 + 1, SAMPLES // HOP + 1


def spectrogram(sounds: ArrayLike) -> NDArray[np.complex128]:
    """Short-time Fourier transform (n, 257, 201) of sounds (n, 32000), 2 s at 16 kHz.

    Periodic Hann window of 400 samples in the middle of 512, hop 160, frames centred on multiples of the
    hop, silence before and after.
    """
    given = torch.as_tensor(np.array(sounds, dtype=np.float64).reshape(-1, SAMPLES))
    transform = torch.stft(
        given,
        TRANSFORM,
        hop_length=HOP,
        win_length=WINDOW,
        window=torch.hann_window(WINDOW, dtype=torch.float64),
        center=True,
        pad_mode="constant",
        return_complex=True,
    )
    return np.asarray(transform.numpy())


def inverse_spectrogram(transform: ArrayLike) -> NDArray[np.float64]:
    """Sounds (n, 32000) whose spectrogram is nearest in squares to `transform` (n, 257, 201)."""
    given = torch.as_tensor(np.array(transform, dtype=np.complex128).reshape(-1, BINS, FRAMES))
    sounds = torch.istft(
        given,
        TRANSFORM,
        hop_length=HOP,
        win_length=WINDOW,
        window=torch.hann_window(WINDOW, dtype=torch.float64),
        center=True,
        length=SAMPLES,
    )
    return np.asarray(sounds.numpy())
