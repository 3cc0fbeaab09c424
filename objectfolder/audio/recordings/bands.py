"""Narrow bands of a sound, moved to zero frequency, filtered and decimated: few partials lie in each."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
WIDTH_HZ = 300.0
# Samples a second of a band over its width: the filter passes one width to each side and stops at three.
OVERSAMPLING = 4
STOP_DB = 80.0
LOWEST_BAND_HZ = 60.0
NYQUIST_SHARE = 0.47  # of the sample rate, above which recorders filter


@dataclass(frozen=True)
class Band:
    """A part of the spectrum.

    Attributes
    ----------
    centre_hz, width_hz : partials within half the width of the centre belong to it
    rate_hz : samples a second
    decay : (n,) complex128, the free decay
    noise : power of a sample of noise alone; 0 where it is not known
    """

    centre_hz: float
    width_hz: float
    rate_hz: float
    decay: Complexes
    noise: float


def bands(decay: Floats, silence: Floats, sample_rate_hz: float, max_frequency_hz: float) -> Iterator[Band]:
    """Yield the bands of a free decay, ascending.

    Filtering keeps damped exponentials what they are, with the same rates, for nothing but the decay passes
    the filter: it begins when the filter is full.

    Parameters
    ----------
    decay, silence
        Samples of the decay and of noise; `silence` may be empty.
    """
    step = max(int(sample_rate_hz // (OVERSAMPLING * WIDTH_HZ)), 1)
    rate = sample_rate_hz / step
    taps, beta = signal.kaiserord(STOP_DB, (rate - 2 * WIDTH_HZ) / (sample_rate_hz / 2))
    window = signal.firwin(taps | 1, rate / 2, window=("kaiser", beta), fs=sample_rate_hz)
    highest = min(max_frequency_hz, NYQUIST_SHARE * sample_rate_hz)

    def narrowed(samples: Floats, centre_hz: float) -> Complexes:
        if len(samples) < len(window):
            return np.zeros(0, dtype=np.complex128)
        turned = samples * np.exp(-2j * np.pi * centre_hz / sample_rate_hz * np.arange(len(samples)))
        return np.asarray(signal.oaconvolve(turned, window, "valid")[::step])

    for centre in np.arange(LOWEST_BAND_HZ, highest, WIDTH_HZ) + WIDTH_HZ / 2:
        quiet = narrowed(silence, centre)
        noise = float((np.abs(quiet) ** 2).mean()) if len(quiet) else 0.0
        yield Band(float(centre), WIDTH_HZ, rate, narrowed(decay, centre), noise)
