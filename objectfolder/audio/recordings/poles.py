"""Damped exponentials in a band, by ESPRIT.

R. Roy and T. Kailath, ESPRIT - estimation of signal parameters via rotational invariance techniques (IEEE
Trans. ASSP 37, 1989). The vectors of samples at successive times span the same space as the exponentials, and
a sample later each of these is only multiplied by its pole. Two that beat are two dimensions of it, however
near their frequencies are: the noise limits that, and not the length of a window.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from objectfolder.audio.recordings.bands import Band, Complexes

Floats = NDArray[np.float64]
# The order is the number of eigenvalues of the covariance above this many times the largest that noise alone
# would have, and above this part of the largest: decays are not exponential to more than that.
ABOVE_NOISE, SHARE = 2.0, 3e-4
MOST_ROWS = 330
LONGEST_S, FEWEST_SAMPLES = 1.0, 40
# A band is read while its power, over ten milliseconds, is this many times that of the noise.
HEARD, HEARD_S = 8.0, 0.01


def heard_samples(band: Band) -> int:
    """How many samples of a band's decay are above its noise."""
    span = max(round(HEARD_S * band.rate_hz), 1)
    power = np.convolve(np.abs(band.decay) ** 2, np.full(span, 1 / span), "same")
    silent = np.nonzero(power < HEARD * band.noise)[0]
    return int(silent[0]) if len(silent) else len(power)


def poles(band: Band, first: int, last: int) -> Floats:
    """Exponentials in the samples `first` to `last` of a band's decay.

    Returns
    -------
    (pole, 3) : frequency (Hz), decay rate (1/s) and energy over the noise's power, where noise is known, of
        those within the band
    """
    samples = band.decay[first : min(last, first + round(LONGEST_S * band.rate_hz))]
    if len(samples) < FEWEST_SAMPLES:
        return np.zeros((0, 3))
    rows = min(len(samples) // 3, MOST_ROWS)
    hankel = linalg.hankel(samples[:rows], samples[rows - 1 :])
    values, vectors = linalg.eigh(hankel @ hankel.conj().T)
    of_noise = band.noise * (np.sqrt(rows) + np.sqrt(hankel.shape[1])) ** 2
    order = int(np.count_nonzero(values > max(ABOVE_NOISE * of_noise, SHARE * values[-1])))
    order = min(order, rows - 2)
    if order == 0:
        return np.zeros((0, 3))
    space = vectors[:, -order:]
    turned, *_ = linalg.lstsq(space[:-1], space[1:])
    roots: Complexes = np.asarray(linalg.eigvals(turned), dtype=np.complex128)
    roots = roots[(np.abs(roots) < 1) & (np.abs(roots) > 0)]
    offset_hz = np.angle(roots) * band.rate_hz / (2 * np.pi)
    powers = np.exp(np.outer(np.arange(len(samples)), np.log(roots)))
    amplitudes, *_ = linalg.lstsq(powers, samples)
    energy = np.abs(amplitudes) ** 2 * (np.abs(powers) ** 2).sum(axis=0)
    decays = -np.log(np.abs(roots)) * band.rate_hz
    inside = np.abs(offset_hz) <= band.width_hz / 2
    unit = band.noise or 1.0
    return np.column_stack([band.centre_hz + offset_hz, decays, energy / unit])[inside]
