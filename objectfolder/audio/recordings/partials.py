"""Partials of recordings: exponentials that the decay shows from every moment at which it is read.

An exponential that fits noise, a beginning that is not free yet, or a decay that is not quite exponential,
changes with the moment from which the decay is read. A partial does not: this is the stabilisation diagram of
modal testing (D. J. Ewins, Modal Testing, 2000), over time in place of the order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from objectfolder.audio.recordings.bands import bands
from objectfolder.audio.recordings.decay_law import power_law
from objectfolder.audio.recordings.poles import heard_samples, poles
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
    rows = []
    with threadpool_limits(1):  # matrices are small: more threads wait for one another
        for band in bands(recording.decay, recording.silence, recording.sample_rate_hz, max_frequency_hz):
            last = heard_samples(band)
            for number, seconds in enumerate(STARTS_S):
                rows += [(*pole, number) for pole in poles(band, round(seconds * band.rate_hz), last)]
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
    frequencies, decays, level = partials.T
    seconds = len(recording.decay) / recording.sample_rate_hz
    zeros = np.zeros(len(partials))
    fall = 20 / np.log(10) * decays * seconds
    return Partials(frequencies, decays, level, fall, np.ones(len(partials), dtype=np.int64), zeros, zeros)


def partials_over(recordings: Sequence[Partials]) -> Partials:
    """Join the partials of several recordings of one object.

    The strongest of all is joined with the nearest like it of each other recording, then the next. Means are
    weighted by amplitude: the recording in which a partial is strongest knows it best.
    """
    every = np.concatenate(
        [
            np.column_stack(
                [each.frequencies_hz, each.decays_per_s, each.level_db, each.fall_db, np.full(len(each), i)]
            )
            for i, each in enumerate(recordings)
        ]
    )
    free, joined = np.ones(len(every), dtype=bool), []
    for index in np.argsort(-every[:, 2]):
        if not free[index]:
            continue
        alike = np.nonzero(free & _alike(every, every[index], SAME_DECAY_BETWEEN_RECORDINGS))[0]
        nearest = alike[np.argsort(np.abs(every[alike, 0] - every[index, 0]))]
        own = nearest[np.unique(every[nearest, 4], return_index=True)[1]]
        free[own] = False
        group = every[own]
        weight = 10 ** ((group[:, 2] - group[:, 2].max()) / 20)
        frequency = float(np.average(group[:, 0], weights=weight))
        decay = float(np.exp(np.average(np.log(group[:, 1]), weights=weight)))
        spread = np.ptp(group[:, :2], axis=0)
        joined.append((frequency, decay, group[:, 2].max(), group[:, 3].max(), len(own), *spread))
    table = np.array(sorted(joined)).reshape(-1, 7)
    if len(table) >= FEWEST_FOR_TREND:
        off = np.log(table[:, 1]) - np.log(_by_trend(table[:, 0], table[:, 1]))
        table = table[np.abs(off) < np.log(TREND_FACTOR)]
    frequencies, decays, level, fall, count, apart, spread_of_decay = table.T
    return Partials(frequencies, decays, level, fall, count.astype(np.int64), apart, spread_of_decay)


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
