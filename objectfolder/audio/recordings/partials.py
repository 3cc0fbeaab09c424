"""Partials of recordings: exponentials that the decay shows from every moment at which it is read.

An exponential that fits noise, a beginning that is not free yet, or a decay that is not quite exponential,
changes with the moment from which the decay is read. A partial does not: this is the stabilisation diagram of
modal testing (D. J. Ewins, Modal Testing, 2000), over time in place of the order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from threadpoolctl import threadpool_limits

from objectfolder.audio.recordings.bands import bands
from objectfolder.audio.recordings.decay_law import power_law
from objectfolder.audio.recordings.poles import poles
from objectfolder.audio.recordings.recording import Recording

Floats = NDArray[np.float64]
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
