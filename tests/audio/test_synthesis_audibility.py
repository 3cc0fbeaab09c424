"""What is left out of a sound is covered by the rest, band by band, and by the threshold in quiet."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.audio.synthesis.audibility import Audibility, bark, quiet_threshold_db

REFERENCE_PA = 2e-5


def level_db(amplitudes_pa):
    return 20 * np.log10(np.asarray(amplitudes_pa) / np.sqrt(2) / REFERENCE_PA)


def test_critical_bands_are_zwicker_s():
    """Upper edges of the bands in hertz (Zwicker 1961), to a tenth of a Bark."""
    edges = [100, 200, 510, 920, 1480, 2320, 3700, 6400, 9500]
    np.testing.assert_allclose(bark(edges), [1, 2, 5, 8, 11, 14, 17, 20, 22], atol=0.25)


def test_the_threshold_in_quiet_is_lowest_near_3_khz_and_ends_where_hearing_does():
    """Values of ISO 389-7 for the free field, which the formula keeps to 3 dB."""
    frequencies = np.array([125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0])
    standard = np.array([22.1, 11.4, 4.4, 2.4, -1.3, -5.4, 12.6])
    assert np.abs(quiet_threshold_db(frequencies) - standard).max() < 10
    assert np.abs(quiet_threshold_db(frequencies) - standard)[:6].max() < 3.5
    assert np.isinf(quiet_threshold_db([10.0, 30e3])).all()


def test_a_tone_alone_is_heard_down_to_its_threshold():
    for frequency in (300.0, 1000.0, 7000.0):
        just = np.sqrt(2) * REFERENCE_PA * 10 ** (quiet_threshold_db([frequency])[0] / 20)
        assert Audibility([frequency]).heard([1.01 * just]).all()
        assert not Audibility([frequency]).heard([0.99 * just]).any()


def test_covering_falls_faster_downwards_than_upwards():
    """A loud tone of 1 kHz covers one two Barks above it better than one two Barks below."""
    frequencies = [770.0, 1000.0, 1270.0]
    assert np.diff(bark(frequencies)) == pytest.approx([1.7, 1.6], abs=0.2)
    quiet_pa = np.sqrt(2) * REFERENCE_PA * 10 ** (45 / 20)
    loud_pa = np.sqrt(2) * REFERENCE_PA * 10 ** (90 / 20)
    assert Audibility(frequencies).heard([quiet_pa, loud_pa, quiet_pa]).tolist() == [True, True, False]


@given(st.integers(1, 400), st.integers(0, 1000), st.floats(1.0, 7.0))
def test_all_that_is_left_out_of_a_band_is_covered_together(tones, seed, decades):
    random = np.random.default_rng(seed)
    frequencies = np.exp(random.uniform(np.log(100), np.log(18e3), tones))
    amplitudes = 10 ** random.uniform(-decades, 0, tones)
    heard = Audibility(frequencies).heard(amplitudes)
    assert heard[np.argmax(level_db(amplitudes) - quiet_threshold_db(frequencies))]
    left_out = ~heard
    if not left_out.any():
        return
    rates, levels = bark(frequencies), level_db(amplitudes)
    for band in np.unique(rates[left_out].astype(int)):
        here = left_out & (rates.astype(int) == band)
        total_db = 10 * np.log10((10 ** (levels[here] / 10)).sum())
        # No tone covers another up to 6 dB below its own level, and 27 dB less a Bark is the steepest slope.
        nearest = rates[heard] - np.clip(rates[heard], band, band + 1)
        covering = levels[heard] - 6 - np.where(nearest > 0, 27 * nearest, 0.0)
        assert total_db <= max(covering.max(), quiet_threshold_db(frequencies[here]).max())


def test_many_that_are_covered_one_by_one_are_not_all_left_out():
    """A thousand tones 20 dB below one tone are louder than it together."""
    frequencies = np.full(1001, 1000.0)
    amplitudes = np.full(1001, 0.1)
    amplitudes[0] = 1.0
    heard = Audibility(frequencies).heard(amplitudes)
    left_out = 10 * np.log10((~heard).sum()) - 20
    assert heard[0]
    assert -12 < left_out < -6


def test_nothing_to_hear():
    assert Audibility([]).heard([]).shape == (0,)
    assert not Audibility([500.0, 900.0]).heard([0.0, 0.0]).any()
