"""Recordings of a strike: read from WAV files, with the free decay and the faults of each."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.io import wavfile

from objectfolder.errors import InputError
from objectfolder.products.regular_file import open_regular

Floats = NDArray[np.float64]
# Rumble of rooms and hands below it hides where a strike begins.
HIGH_PASS_HZ = 500.0
BLOCK_S = 1e-3
# A strike is louder by this power ratio than every block from 50 to 3 ms before it. Beats rise more slowly.
RISE, BEFORE_BLOCKS, JUST_BEFORE_BLOCKS = 4.0, 50, 3
# Blows so near one another are one, which begins with the last of them.
BOUNCE_BLOCKS = 20
# Of the loudest block, below which nothing counts as a strike.
SILENCE_SHARE = 1e-3
# Samples at the largest value of a file that is clipped, at least; and what is just below it, of it.
CLIPPED_SAMPLES, BELOW_PEAK = 6, 0.95
# Steps between silence and the peak, in decibels, below which quantisation hides partials.
FEW_STEPS_DB = 48.0
LEAST_S = 0.03  # of free decay
LEAST_DECAY_DB = 1.0  # from its first fifth to its last; noise stays within .2
NOISE_S = 0.05  # of silence before a strike, at least, to know the noise from


@dataclass(frozen=True)
class Recording:
    """One strike and its free decay.

    Attributes
    ----------
    name : what messages call it
    samples : (n,) float64, full scale 1
    sample_rate_hz : samples a second
    start, end : samples between which the object rings freely
    silence : (m,) float64, what is recorded before the strike; empty where that is too short
    warnings : faults, each with the figure that shows it
    """

    name: str
    samples: Floats
    sample_rate_hz: float
    start: int
    end: int
    silence: Floats
    warnings: tuple[str, ...] = ()

    @property
    def decay(self) -> Floats:
        """The samples of the free decay."""
        return self.samples[self.start : self.end]


def read_recording(path: Path | str) -> Recording:
    """Read a WAV file of a strike.

    Of several channels the loudest is taken. What is clipped is left out: the decay behind it is not.

    Raises
    ------
    InputError
        A file that is no WAV file, holds no strike, or less of its decay than `LEAST_S`.
    """
    path = Path(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of notes and names
            with open_regular(path) as file:
                rate, stored = wavfile.read(file)
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"cannot be read ({error})", "Give a WAV file.") from error
    faults = []
    if stored.ndim == 2 and stored.shape[1] > 1:
        loudness = stored.astype(np.float64).std(axis=0)
        loudest = int(loudness.argmax())
        second = int(np.delete(np.arange(len(loudness)), loudest)[0])
        alike = np.corrcoef(stored[:, loudest].astype(np.float64), stored[:, second].astype(np.float64))[0, 1]
        faults.append(
            f"{stored.shape[1]} channels, {loudest + 1} and {second + 1} correlate by {alike:.2f}: "
            f"channel {loudest + 1}, the loudest, is taken alone"
        )
        stored = stored[:, loudest]
    stored = stored.reshape(len(stored))
    faults += _coarse_steps(stored)
    return recording_of(_full_scale(stored), float(rate), name=path.name, faults=tuple(faults))


def recording_of(
    samples: Floats, sample_rate_hz: float, *, name: str = "recording", faults: tuple[str, ...] = ()
) -> Recording:
    """Find the strike and the free decay in samples.

    Parameters
    ----------
    samples
        (n,), full scale 1.
    faults
        Faults known before.

    Raises
    ------
    InputError
        No strike, or less of its decay than `LEAST_S` or `LEAST_DECAY_DB`.
    """
    samples = np.asarray(samples, dtype=np.float64)
    if not np.isfinite(samples).all():
        raise InputError(
            name, f"{np.count_nonzero(~np.isfinite(samples))} samples are not finite", "Record it again."
        )
    strikes, loudest = _strikes(samples, sample_rate_hz, name)
    block = round(BLOCK_S * sample_rate_hz)
    later = strikes[strikes > loudest + BOUNCE_BLOCKS]
    start, end = loudest * block, int(later[0]) * block if len(later) else len(samples)
    messages = list(faults)
    if len(later):
        messages.append(
            f"struck again {(end - start) / sample_rate_hz:.2f} s after the loudest strike: read until there"
        )
    clipped = _clipped(samples)
    inside = clipped[(clipped >= start - BOUNCE_BLOCKS * block) & (clipped < end)]
    if len(inside):
        last = int(inside[-1]) + 1
        messages.append(
            f"{len(inside)} samples clip at {np.abs(samples).max():.2f} of full scale, the last "
            f"{max(last - start, 0) / sample_rate_hz * 1e3:.1f} ms after the strike: read from there on"
        )
        start = max(start, last)
    left_s = (end - start) / sample_rate_hz
    if left_s < LEAST_S:
        why = "; ".join(
            [f"{left_s * 1e3:.0f} ms of free decay are left, {LEAST_S * 1e3:.0f} are needed", *messages]
        )
        raise InputError(name, why, "Record a whole decay, at a lower level.")
    powers = [float((part**2).mean()) for part in np.array_split(samples[start:end], 5)]
    fall_db = 10 * np.log10(powers[0] / max(powers[-1], 1e-30))
    if fall_db < LEAST_DECAY_DB:
        raise InputError(
            name,
            f"no strike: its level falls by {fall_db:.1f} dB from first to last",
            "Record a whole decay.",
        )
    first = max(int(strikes[0]) - JUST_BEFORE_BLOCKS, 0) * block
    silence = samples[:first] if first >= NOISE_S * sample_rate_hz else samples[:0]
    return Recording(name, samples, sample_rate_hz, start, end, silence, tuple(messages))


def _strikes(samples: Floats, sample_rate_hz: float, name: str) -> tuple[NDArray[np.int64], int]:
    """Blocks in which a strike begins, and the one of the loudest strike.

    Raises
    ------
    InputError
        Nothing rises out of what is before it.
    """
    block = round(BLOCK_S * sample_rate_hz)
    count = len(samples) // block
    if count < LEAST_S / BLOCK_S or not samples.any():
        seconds = len(samples) / sample_rate_hz
        raise InputError(
            name,
            f"{seconds:.3f} s, peak {np.abs(samples).max(initial=0.0):.3g}: no strike in it",
            "Record one.",
        )
    filtered = signal.sosfilt(
        signal.butter(4, HIGH_PASS_HZ, "highpass", fs=sample_rate_hz, output="sos"), samples[: count * block]
    )
    power = (filtered.reshape(count, block) ** 2).mean(axis=1)
    # Before the file there is nothing: a strike may be its first sample.
    padded = np.concatenate([np.zeros(BEFORE_BLOCKS), power])
    span = BEFORE_BLOCKS - JUST_BEFORE_BLOCKS + 1
    before = np.lib.stride_tricks.sliding_window_view(padded, span)[:count].max(axis=1)
    rising = np.nonzero((power > RISE * before) & (power > SILENCE_SHARE * power.max()))[0]
    peak = int(power.argmax())
    near = rising[(rising <= peak) & (rising > peak - BOUNCE_BLOCKS)]
    group = int(near[-1]) if len(near) else peak
    return np.union1d(rising, [group]), max(group, peak)


def _clipped(samples: Floats) -> NDArray[np.int64]:
    """Samples at the largest or the least value, where more are than just below it, unlike in whole waves."""
    flat = np.zeros(len(samples), dtype=bool)
    for extreme in (samples.max(), samples.min()):
        at = samples == extreme
        below = (samples / extreme > BELOW_PEAK) & ~at if extreme else at
        if at.sum() > below.sum():
            flat |= at
    indices = np.nonzero(flat)[0]
    return indices if len(indices) >= CLIPPED_SAMPLES else indices[:0]


def _coarse_steps(stored: NDArray[np.generic]) -> list[str]:
    """What is wrong with the steps of whole numbers, by what they hold: 8 bits may stand in a file of 16."""
    if not np.issubdtype(stored.dtype, np.integer) or not len(stored):
        return []
    whole = stored.astype(np.int64) - (128 if stored.dtype == np.uint8 else 0)
    step, peak = int(np.gcd.reduce(np.abs(whole))), int(np.abs(whole).max())
    if not step:
        return []
    above_db = 20 * np.log10(peak / step)
    if above_db >= FEW_STEPS_DB:
        return []
    bits = stored.dtype.itemsize * 8
    return [f"its peak is {peak // step} steps ({bits} bit): partials {above_db:.0f} dB below it are lost"]


def _full_scale(stored: NDArray[np.generic]) -> Floats:
    """Samples with full scale 1."""
    if stored.dtype == np.uint8:
        return (stored.astype(np.float64) - 128) / 128
    if np.issubdtype(stored.dtype, np.integer):
        return stored.astype(np.float64) / 2.0 ** (8 * stored.dtype.itemsize - 1)
    return stored.astype(np.float64)
