"""Modes as recursions of two terms, by which pages make them sound."""

import numpy as np

from objectfolder.audio.synthesis import mode_bank
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ


def recursions(eigenvalues: np.ndarray, dampings_per_s: np.ndarray) -> np.ndarray:
    """Return (modes, 4) float64: modes at 44100 Hz as recursions of two terms.

    A mode's samples are `s[n] = a s[n - 1] + b s[n - 2]`; its row is a, b, s[0] and s[1] of a unit amplitude.
    Modes that the rate does not carry are silent.
    """
    step = 1 / SAMPLE_RATE_HZ
    roots = np.sqrt(dampings_per_s**2 - eigenvalues + 0j)
    a = 2 * np.exp(-dampings_per_s * step) * np.cosh(roots * step).real
    starts = mode_bank(
        eigenvalues,
        dampings_per_s,
        np.eye(len(eigenvalues)),
        duration_s=2 * step,
        sample_rate_hz=SAMPLE_RATE_HZ,
    )
    return np.column_stack([a, -np.exp(-2 * dampings_per_s * step), starts])
