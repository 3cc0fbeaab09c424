"""Decay of partials as a power of frequency: a loss factor eta = eta_1 (f / 1 kHz)^p, decay c = pi eta f."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Floats = NDArray[np.float64]
REFERENCE_HZ = 1000.0
# What a decay may be off by, before it counts less: supports and air take more from some modes.
OUTLIER = 0.3
# What is known of the exponent before any decay is: the standard deviation about 0, a constant loss factor.
EXPONENT_SPREAD = 0.3
LARGEST_EXPONENT = 1.0


@dataclass(frozen=True)
class DecayLaw:
    """A loss factor at 1 kHz and its exponent.

    Attributes
    ----------
    loss_factor : at 1 kHz
    exponent : of frequency over 1 kHz
    factor : geometric rms of what decays are off by
    """

    loss_factor: float
    exponent: float
    factor: float = 1.0

    def __call__(self, frequencies_hz: Floats) -> Floats:
        """Decay rates of the amplitude, 1/s."""
        return np.asarray(
            np.pi * self.loss_factor * frequencies_hz * (frequencies_hz / REFERENCE_HZ) ** self.exponent
        )


def power_law(frequencies_hz: Floats, decays_per_s: Floats) -> DecayLaw:
    """Fit the law to decays by least squares of logarithms in which outliers count less."""
    place = np.log(frequencies_hz / REFERENCE_HZ)
    logs = np.log(decays_per_s / (np.pi * frequencies_hz))

    def misfit(law: Floats) -> Floats:
        return np.asarray(np.append((logs - law[0] - law[1] * place) / OUTLIER, law[1] / EXPONENT_SPREAD))

    found = least_squares(misfit, [float(np.median(logs)), 0.0], loss="soft_l1").x
    exponent = float(np.clip(found[1], -LARGEST_EXPONENT, LARGEST_EXPONENT))
    factor = float(np.exp(np.sqrt(np.mean((logs - found[0] - exponent * place) ** 2))))
    return DecayLaw(float(np.exp(found[0])), exponent, factor)
