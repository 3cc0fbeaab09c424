"""The loss factor of a material, a power of frequency, fitted to the decays of partials."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from objectfolder.making.damping import REFERENCE_HZ, LossFactor

Floats = NDArray[np.float64]
# What a decay may be off by, before it counts less: supports and air take more from some modes.
OUTLIER = 0.3
# What is known of the exponent before any decay is: the standard deviation about 0, a constant loss factor.
EXPONENT_SPREAD = 0.3
LARGEST_EXPONENT = 1.0


@dataclass(frozen=True)
class FittedLoss(LossFactor):
    """A law of loss, and the geometric rms factor by which the decays it was fitted to are off."""

    factor: float = 1.0


def power_law(frequencies_hz: Floats, decays_per_s: Floats) -> FittedLoss:
    """Fit the law to decays by least squares of logarithms in which outliers count less."""
    place = np.log(frequencies_hz / REFERENCE_HZ)
    logs = np.log(decays_per_s / (np.pi * frequencies_hz))

    def misfit(law: Floats) -> Floats:
        return np.asarray(np.append((logs - law[0] - law[1] * place) / OUTLIER, law[1] / EXPONENT_SPREAD))

    solution = least_squares(misfit, [float(np.median(logs)), 0.0], loss="soft_l1").x
    exponent = float(np.clip(solution[1], -LARGEST_EXPONENT, LARGEST_EXPONENT))
    factor = float(np.exp(np.sqrt(np.mean((logs - solution[0] - exponent * place) ** 2))))
    return FittedLoss(float(np.exp(solution[0])), exponent, factor)
