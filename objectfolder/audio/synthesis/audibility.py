"""Which of many tones are heard: the threshold in quiet, and what louder tones cover.

A tone covers others by as much as its level less an offset, falling on both sides along the Bark scale:
E. Zwicker and H. Fastl, "Psychoacoustics", 1990. Threshold and slopes are E. Terhardt's ("Calculating
virtual pitch", Hear. Res. 1, 1979; Terhardt, Stoll and Seewann, J. Acoust. Soc. Am. 71, 1982), the offset is
that of tonal maskers in MPEG-1 (ISO/IEC 11172-3, annex D). That such modes can be left out: K. van den Doel,
D. Knott and D. K. Pai, "Interactive simulation of complex audio-visual scenes", Presence 13, 2004.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
REFERENCE_PA = 2e-5
LOWEST_HZ, HIGHEST_HZ = 20.0, 20e3
BINS_A_BARK = 4
BARKS = 25
SLOPE_BELOW_DB = 27.0  # a Bark, towards lower frequencies
SILENCE_DB = -300.0


def bark(frequencies_hz: ArrayLike) -> Floats:
    """Return critical-band rates (n,) in Bark.

    13 atan(.76 f) + 3.5 atan((f / 7.5)^2), f in kHz (Zwicker and Terhardt, J. Acoust. Soc. Am. 68, 1980).

    Examples
    --------
    >>> float(bark(1000.0).round(2))
    8.51
    """
    kilohertz = np.asarray(frequencies_hz, dtype=np.float64) / 1e3
    return np.asarray(13 * np.arctan(0.76 * kilohertz) + 3.5 * np.arctan((kilohertz / 7.5) ** 2))


def quiet_threshold_db(frequencies_hz: ArrayLike) -> Floats:
    """Return sound pressure levels (n,) of tones just heard in quiet; inf outside of 20 Hz to 20 kHz.

    3.64 f^-.8 - 6.5 exp(-.6 (f - 3.3)^2) + 1e-3 f^4, f in kHz (Terhardt 1979).

    Examples
    --------
    >>> quiet_threshold_db([1000.0, 3300.0]).round(1).tolist()
    [3.4, -5.0]
    """
    frequencies = np.asarray(frequencies_hz, dtype=np.float64)
    f = np.clip(frequencies, LOWEST_HZ, HIGHEST_HZ) / 1e3
    level = 3.64 * f**-0.8 - 6.5 * np.exp(-0.6 * (f - 3.3) ** 2) + 1e-3 * f**4
    return np.where((frequencies >= LOWEST_HZ) & (frequencies <= HIGHEST_HZ), level, np.inf)


class Audibility:
    """Decides which of some tones are heard together.

    Parameters
    ----------
    frequencies_hz
        (tones,) of the tones.

    Examples
    --------
    >>> tones = Audibility([1000.0, 1050.0, 4000.0])
    >>> tones.heard([1e-1, 1e-4, 1e-4]).tolist()  # pascals: the second is covered by the first
    [True, False, True]
    """

    def __init__(self, frequencies_hz: ArrayLike) -> None:
        frequencies = np.asarray(frequencies_hz, dtype=np.float64)
        rates = bark(frequencies)
        self._quiet_db = quiet_threshold_db(frequencies)
        self._bin = np.minimum((rates * BINS_A_BARK).astype(np.int64), BARKS * BINS_A_BARK - 1)
        self._by_bin = np.argsort(self._bin, kind="stable")
        self._bins, self._first = np.unique(self._bin[self._by_bin], return_index=True)
        centres = (self._bins + 0.5) / BINS_A_BARK
        # How far (heard, covering) a bin lies above one that covers it.
        self._above = centres[:, None] - centres[None, :]
        kilohertz = np.interp(centres, bark(np.geomspace(20, 20e3, 200)), np.geomspace(0.02, 20, 200))
        self._slope_db = 24 + 0.23 / kilohertz
        self._offset_db = 1.525 + 0.275 * centres + 4.5
        self._band = self._bin // BINS_A_BARK

    def heard(self, amplitudes_pa: ArrayLike) -> NDArray[np.bool_]:
        """Return which tones (tones,) of peak pressures (tones,) are heard.

        A tone is covered by the loudest of each quarter of a Bark; the loudest of its own quarter is not by
        itself. In each Bark those are left out whose powers over their thresholds add up to no more than 1,
        from the least on: many that are covered one by one are heard together.
        """
        amplitudes = np.asarray(amplitudes_pa, dtype=np.float64)
        if not len(amplitudes):
            return np.zeros(0, dtype=bool)
        level = 20 * np.log10(np.maximum(np.abs(amplitudes) / (np.sqrt(2) * REFERENCE_PA), 1e-15))
        loudest = np.maximum.reduceat(level[self._by_bin], self._first)
        slope = np.where(self._above > 0, np.maximum(self._slope_db - 0.2 * loudest, 1.0), SLOPE_BELOW_DB)
        covered = (loudest - self._offset_db - slope * np.abs(self._above)).max(axis=1, initial=SILENCE_DB)
        of_tones = covered[np.searchsorted(self._bins, self._bin)]
        over = 10 ** (np.clip(level - np.maximum(of_tones, self._quiet_db), -300, 300) / 10)
        order = np.lexsort((over, self._band))
        return self._after_quietest(order, over)

    def _after_quietest(self, order: NDArray[np.int64], over: Floats) -> NDArray[np.bool_]:
        """Which tones remain of each band when the quietest are left out as long as they add up to 1."""
        total = np.cumsum(np.minimum(over[order], 2.0))
        band = self._band[order]
        starts = np.flatnonzero(np.diff(band, prepend=-1))
        before = np.repeat(np.append(0.0, total[starts[1:] - 1]), np.diff(np.append(starts, len(band))))
        heard = np.empty(len(over), dtype=bool)
        heard[order] = total - before > 1.0
        return heard
