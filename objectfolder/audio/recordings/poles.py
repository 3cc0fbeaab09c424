"""Damped exponentials in a band, by ESPRIT.

R. Roy and T. Kailath, ESPRIT - estimation of signal parameters via rotational invariance techniques (IEEE
Trans. ASSP 37, 1989). The vectors of samples at successive times span the same space as the exponentials, and
a sample later each of these is only multiplied by its pole. Two that beat are two dimensions of it, however
near their frequencies are: the noise limits that, and not the length of a window.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from objectfolder.audio.recordings.bands import Band, Complexes

Floats = NDArray[np.float64]
# The order is the number of eigenvalues of the covariance above this many times the largest that noise alone
# would have, and above this part of the largest: decays are not exponential to more than that.
ABOVE_NOISE, EIGENVALUE_SHARE = 2.0, 3e-4
HANKEL_ROWS = 330
LONGEST_WINDOW_S, FEWEST_SAMPLES = 1.0, 40
# A band is read while its power, over ten milliseconds, is this many times that of the noise.
HEARD, HEARD_S = 8.0, 0.01


def heard_samples(band: Band) -> int:
    """How many samples of a band's decay are above its noise."""
    span = max(round(HEARD_S * band.rate_hz), 1)
    power = np.convolve(np.abs(band.decay) ** 2, np.full(span, 1 / span), "same")
    silent = np.nonzero(power < HEARD * band.noise)[0]
    return int(silent[0]) if len(silent) else len(power)


def poles(channels: Sequence[Band], first: int) -> Floats:
    """Exponentials that recordings of one object have in common, from the sample `first` of each on.

    Each recording is a channel. Frequencies and decays are the object's, and the same in all; amplitudes are
    not. Of a pair that beats one strike moves mainly one mode and another strike the other, so that together
    they tell the two apart. A channel weighs as it stands above its noise.

    Parameters
    ----------
    channels
        The same band of each recording, of one rate.

    Returns
    -------
    (pole, 3) : frequency (Hz), decay rate (1/s) and largest energy over the noise's power, where noise is
        known, of those within the band
    """
    noises = [band.noise for band in channels if band.noise]
    noise = float(np.mean(noises)) if noises else 1.0
    decays = []
    for band in channels:
        last = min(heard_samples(band), first + round(LONGEST_WINDOW_S * band.rate_hz))
        if last - first >= FEWEST_SAMPLES:
            decays.append(band.decay[first:last] / np.sqrt(band.noise or noise))
    if not decays:
        return np.zeros((0, 3))
    rows = min(max(len(samples) for samples in decays) // 3, HANKEL_ROWS)
    decays = [samples for samples in decays if len(samples) > rows + rows // 2]
    spans = [linalg.hankel(samples[:rows], samples[rows - 1 :]) for samples in decays]
    hankel = np.concatenate(spans, axis=1)
    values, vectors = linalg.eigh(hankel @ hankel.conj().T)
    of_noise = bool(noises) * (np.sqrt(rows) + np.sqrt(hankel.shape[1])) ** 2
    order = int(np.count_nonzero(values > max(ABOVE_NOISE * of_noise, EIGENVALUE_SHARE * values[-1])))
    order = min(order, rows - 2)
    if order == 0:
        return np.zeros((0, 3))
    space = vectors[:, -order:]
    turned, *_ = linalg.lstsq(space[:-1], space[1:])
    roots: Complexes = np.asarray(linalg.eigvals(turned), dtype=np.complex128)
    roots = roots[(np.abs(roots) < 1) & (np.abs(roots) > 0)]
    offset_hz = np.angle(roots) * channels[0].rate_hz / (2 * np.pi)
    decay_rates = -np.log(np.abs(roots)) * channels[0].rate_hz
    inside = np.abs(offset_hz) <= channels[0].width_hz / 2
    energy = np.max([_energies(samples, roots) for samples in decays], axis=0)
    return np.column_stack([channels[0].centre_hz + offset_hz, decay_rates, energy])[inside]


def _energies(samples: Complexes, roots: Complexes) -> Floats:
    """Energies (pole,) of exponentials in samples."""
    powers = np.exp(np.outer(np.arange(len(samples)), np.log(roots)))
    amplitudes, *_ = linalg.lstsq(powers, samples)
    return np.asarray(np.abs(amplitudes) ** 2 * (np.abs(powers) ** 2).sum(axis=0))
