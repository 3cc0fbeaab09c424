"""Partials of recordings: exponentials that the decay shows from every moment at which it is read.

An exponential that fits noise, a beginning that is not free yet, or a decay that is not quite exponential,
changes with the moment from which the decay is read. A partial does not: this is the stabilisation diagram of
modal testing (D. J. Ewins, Modal Testing, 2000), over time in place of the order.

The exponentials of a band are found by ESPRIT (R. Roy and T. Kailath, Estimation of signal parameters via
rotational invariance techniques, IEEE Trans. ASSP 37, 1989). The vectors of samples at successive times
span the same space as the exponentials, and a sample later each of these is only multiplied by its pole.
Two that beat are two dimensions of it, however near their frequencies are: the noise limits that, and not
the length of a window.

Bands are narrow, moved to zero frequency, filtered and decimated: few partials lie in each.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal
from threadpoolctl import threadpool_limits

from objectfolder.making.recordings.decay_law import power_law
from objectfolder.making.recordings.recording import Recording

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


MAX_FREQUENCY_HZ = 20_000.0
# Seconds behind the strike from which the decay is read, and at how many of them a partial is found.
STARTS_S = (0.003, 0.006, 0.012, 0.024, 0.048, 0.096, 0.192, 0.384)
LEAST_STARTS = 3
# The first of these from which decays are taken, where two are: before it the striker may still touch.
FREE_START = 2
# What differs by less is one partial, of one recording or of several: cents, or part of its half width.
SAME_CENTS, SAME_WIDTH, SAME_DECAY = 1.0, 0.2, 1.5
SAME_DECAY_BETWEEN_RECORDINGS = 2.0
# A partial so much weaker than one so near is what the latter's decay lacks to be exponential.
SHADOW_DB, SHADOW_CENTS = 25.0, 20.0
# Of two so near, the one that dies this factor faster is what the striker or a hand still takes.
CONTACT_DECAY = 1.8
# A body's decays follow a power of frequency within such a factor, where it has enough of them to tell.
TREND_FACTOR, FEWEST_FOR_TREND = 2.5, 6
# A decay of fewer decibels within a recording is not measured.
LEAST_FALL_DB = 10.0
CENTS = 1200 / np.log(2)


@dataclass(frozen=True)
class Partials:
    """Partials by ascending frequency.

    Attributes
    ----------
    frequencies_hz, decays_per_s : (p,) float64, of the amplitude exp(-decay t)
    level_db : (p,) energy of each where it is strongest, over the noise or, where that is unknown, over 1
    fall_db : (p,) what the amplitude falls by in the longest decay recorded
    recordings : (p,) int64, in how many recordings it is found
    frequency_spread_hz, decay_spread_per_s : (p,) largest less smallest value of these; 0 where it is one
    """

    frequencies_hz: Floats
    decays_per_s: Floats
    level_db: Floats
    fall_db: Floats
    recordings: NDArray[np.int64]
    frequency_spread_hz: Floats
    decay_spread_per_s: Floats

    def __len__(self) -> int:
        return len(self.frequencies_hz)

    @property
    def decay_is_measured(self) -> NDArray[np.bool_]:
        """Whether enough of the decay is recorded."""
        return self.fall_db >= LEAST_FALL_DB


def partials_of(recording: Recording, max_frequency_hz: float = MAX_FREQUENCY_HZ) -> Partials:
    """Find the partials of one recording.

    Each band's decay is read from each of `STARTS_S`. A partial is found from `LEAST_STARTS` of these at
    least; its frequency and decay are the medians.
    """
    frequencies, decays, level, fall = _stable_poles([recording], max_frequency_hz).T
    count, zeros = np.ones(len(frequencies), dtype=np.int64), np.zeros(len(frequencies))
    return Partials(frequencies, decays, level, fall, count, zeros, zeros)


def partials_over(
    recordings: Sequence[Recording], own: Sequence[Partials], max_frequency_hz: float = MAX_FREQUENCY_HZ
) -> Partials:
    """Find the partials that several recordings of one object have in common; see `poles`.

    Parameters
    ----------
    own
        The partials of each recording alone, which tell in how many a partial is found, and their spread.
    """
    table = _stable_poles(recordings, max_frequency_hz)
    count = np.zeros(len(table), dtype=np.int64)
    low = np.full((len(table), 2), np.inf)
    high = -low
    for partials in own:
        rows = np.column_stack([partials.frequencies_hz, partials.decays_per_s])
        for index, row in enumerate(table):
            alike = rows[_alike(rows, row, SAME_DECAY_BETWEEN_RECORDINGS)]
            if len(alike):
                nearest = alike[np.abs(alike[:, 0] - row[0]).argmin()]
                low[index], high[index] = np.minimum(low[index], nearest), np.maximum(high[index], nearest)
                count[index] += 1
    spread = np.where(count[:, None] > 0, high - low, 0.0)
    # What only all recordings together show is in each of them.
    count[count == 0] = len(recordings)
    frequencies, decays, level, fall = table.T
    return Partials(frequencies, decays, level, fall, count, spread[:, 0], spread[:, 1])


def _stable_poles(recordings: Sequence[Recording], max_frequency_hz: float) -> Floats:
    """Frequency, decay, level and fall (p, 4) of what is found from several moments of all recordings."""
    rate_hz = min(recording.sample_rate_hz for recording in recordings)
    split = [
        bands(
            _at_rate(each.decay, each.sample_rate_hz, rate_hz),
            _at_rate(each.silence, each.sample_rate_hz, rate_hz),
            rate_hz,
            max_frequency_hz,
        )
        for each in recordings
    ]
    rows = []
    with threadpool_limits(1):  # matrices are small: more threads wait for one another
        for channels in zip(*split, strict=True):
            for number, seconds in enumerate(STARTS_S):
                rows += [(*pole, number) for pole in poles(channels, round(seconds * channels[0].rate_hz))]
    exponentials = np.array(rows).reshape(-1, 4)
    free, chosen = np.ones(len(exponentials), dtype=bool), []
    for index in np.argsort(-exponentials[:, 2]):
        if not free[index]:
            continue
        alike = free & _alike(exponentials, exponentials[index], SAME_DECAY)
        free &= ~alike
        if len(np.unique(exponentials[alike, 3])) >= LEAST_STARTS:
            own = exponentials[alike]
            frequency = np.median(own[:, 0])
            late = own[own[:, 3] >= FREE_START]
            decay = np.median(late[:, 1] if len(late) > 1 else own[:, 1])
            chosen.append((frequency, decay, 10 * np.log10(exponentials[index, 2])))
    partials = np.array(sorted(chosen)).reshape(-1, 3)
    partials = partials[partials[:, 0] <= max_frequency_hz]
    partials = partials[~_shadows(partials)]
    partials = partials[~_of_contact(partials)]
    if len(partials) >= FEWEST_FOR_TREND:
        off = np.log(partials[:, 1]) - np.log(_by_trend(partials[:, 0], partials[:, 1]))
        partials = partials[np.abs(off) < np.log(TREND_FACTOR)]
    seconds = max(len(recording.decay) / recording.sample_rate_hz for recording in recordings)
    return np.column_stack([partials, 20 / np.log(10) * partials[:, 1] * seconds])


def _at_rate(samples: Floats, own_hz: float, rate_hz: float) -> Floats:
    """Samples at a lower rate."""
    if own_hz == rate_hz or not len(samples):
        return samples
    return np.asarray(signal.resample_poly(samples, round(rate_hz), round(own_hz)))


def _by_trend(frequencies_hz: Floats, decays_per_s: Floats) -> Floats:
    """Decay rates (p,) of the power of frequency that is nearest to decay rates (p,)."""
    return power_law(frequencies_hz, decays_per_s).decay_rates((2 * np.pi * frequencies_hz) ** 2)


def _alike(rows: Floats, row: Floats, same_decay: float) -> NDArray[np.bool_]:
    """Which rows (n, 2 or more) of frequency and decay are one partial with a row."""
    near_hz = max(row[0] * SAME_CENTS / CENTS, SAME_WIDTH * row[1] / (2 * np.pi))
    near = np.abs(rows[:, 0] - row[0]) < near_hz
    alike: NDArray[np.bool_] = near & (np.abs(np.log(rows[:, 1] / row[1])) < np.log(same_decay))
    return alike


def _shadows(rows: Floats) -> NDArray[np.bool_]:
    """Which rows (n, 3) of frequency, decay and level stand beside one that is far stronger."""
    apart = np.abs(np.log(rows[:, None, 0] / rows[None, :, 0])) * CENTS
    weaker = rows[None, :, 2] - rows[:, None, 2]
    shadows: NDArray[np.bool_] = ((apart < SHADOW_CENTS) & (weaker > SHADOW_DB)).any(axis=1)
    return shadows


def _of_contact(rows: Floats) -> NDArray[np.bool_]:
    """Which rows (n, 3) of frequency, decay and level die far faster than one beside them."""
    apart = np.abs(np.log(rows[:, None, 0] / rows[None, :, 0])) * CENTS
    faster = np.log(rows[:, None, 1] / rows[None, :, 1])
    contact: NDArray[np.bool_] = ((apart < SHADOW_CENTS) & (faster > np.log(CONTACT_DECAY))).any(axis=1)
    return contact
