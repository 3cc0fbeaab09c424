"""The free response of damped oscillators in extended precision, written without regard to speed."""

import mpmath
import numpy as np

DIGITS = 40


def velocity(eigenvalue: float, damping: float, time: "mpmath.mpf") -> "mpmath.mpf":
    """Velocity at a time after an impulse that gave unit velocity, whatever the damping."""
    square, rate = mpmath.mpf(float(eigenvalue)), mpmath.mpf(float(damping))
    root = mpmath.sqrt(mpmath.mpc(square - rate * rate))
    if root == 0:
        return mpmath.exp(-rate * time) * (1 - rate * time)
    turn = mpmath.cos(root * time) - rate / root * mpmath.sin(root * time)
    return mpmath.exp(-rate * time) * turn.real


def sound_at(
    eigenvalues: np.ndarray, dampings: np.ndarray, amplitudes: np.ndarray, sample: int, rate: int
) -> float:
    """The velocity response at one sample."""
    with mpmath.workdps(DIGITS):
        time = mpmath.mpf(int(sample)) / mpmath.mpf(rate)
        parts = (
            mpmath.mpf(float(a)) * velocity(square, damping, time)
            for square, damping, a in zip(eigenvalues, dampings, amplitudes, strict=True)
        )
        return float(mpmath.fsum(parts))
