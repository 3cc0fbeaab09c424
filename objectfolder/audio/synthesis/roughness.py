"""Rough surfaces as forces: what a contact feels of a profile as it runs along it.

Where a profile h(s) rises, the force N that presses two bodies together leans back by its slope: N dh/ds
pushes along the way. The profile is stored over the distance s, so that speed changes pitch and duration
(K. van den Doel, P. G. Kry and D. K. Pai, "FoleyAutomatic", SIGGRAPH 2001, section 5; Z. Ren, H. Yeh and
M. C. Lin, "Synthesizing contact sounds between textured models", IEEE VR 2010). Its spectrum is the -2nd
power of the wavenumber, as of most surfaces (R. S. Sayles and T. R. Thomas, "Surface topography as a
nonstationary random process", Nature 271, 1978): slopes are white noise, which the contact averages over its
own width.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.query_values import generator

Floats = NDArray[np.float64]
STEP_M, ROUGHNESS_STEPS = 5e-6, 1 << 18
LENGTH_M = STEP_M * ROUGHNESS_STEPS  # of a stored profile, which then begins again
# Roughness is measured without waves longer than this (ISO 21920-3, for roughness of 0.1 to 2 micrometres).
CUTOFF_M = 0.8e-3


class RoughProfile:
    """The profile of a surface of unit roughness, the same for a seed.

    Parameters
    ----------
    seed
        0 or more.

    Examples
    --------
    >>> profile = RoughProfile(seed=0)
    >>> slopes = profile.slopes(np.linspace(0, 1, 100_000), 1e-4)
    >>> white = np.sqrt(2 * np.pi**2 / CUTOFF_M / 1e-4)  # averaged over 0.1 mm
    >>> round(float(slopes.std() / white), 1)
    1.0
    """

    def __init__(self, seed: int) -> None:
        # Slopes have the one-sided spectrum (2 pi)^2 / cutoff, half of it on either side of 0.
        deviation = 2 * math.pi * math.sqrt(STEP_M / (2 * CUTOFF_M))
        rises = deviation * generator(seed).standard_normal(ROUGHNESS_STEPS)
        self._heights = np.concatenate([[0.0], np.cumsum(rises - rises.mean())])

    def slopes(self, places_m: ArrayLike, width_m: float) -> Floats:
        """Return slopes (n,) averaged over a width about places (n,) of the profile, for a roughness of 1 m.

        The average of a slope is the difference in height over the width.
        """
        places = np.asarray(places_m, dtype=np.float64)
        ahead, behind = self._height(places + width_m / 2), self._height(places - width_m / 2)
        return (ahead - behind) / width_m

    def _height(self, places_m: Floats) -> Floats:
        steps = (places_m / STEP_M) % ROUGHNESS_STEPS
        before = np.minimum(steps.astype(np.int64), ROUGHNESS_STEPS - 1)
        share = steps - before
        return (1 - share) * self._heights[before] + share * self._heights[before + 1]
