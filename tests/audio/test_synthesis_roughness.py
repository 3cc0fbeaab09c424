"""A rough profile: the roughness it is given, the spectrum of its slopes, and what a wide contact feels."""

import numpy as np
import pytest
from scipy.signal import welch

from objectfolder.audio.synthesis.roughness import CUTOFF_M, LENGTH_M, STEP_M, RoughProfile


def test_its_roughness_is_one_without_waves_above_the_cutoff():
    """ISO 21920: the root mean square of what is left of a profile by its filter."""
    heights = RoughProfile(0)._heights[:-1]
    spectrum = np.fft.rfft(heights) / len(heights)
    wavenumber = np.fft.rfftfreq(len(heights), STEP_M)
    power = 2 * np.abs(spectrum[wavenumber >= 1 / CUTOFF_M]) ** 2
    assert np.sqrt(power.sum()) == pytest.approx(1.0, rel=0.05)


def test_slopes_are_white_up_to_the_width_of_the_contact():
    width_m, apart_m = 1e-4, 1e-5
    slopes = RoughProfile(1).slopes(np.arange(0, LENGTH_M, apart_m), width_m)
    wavenumber, power = welch(slopes, 1 / apart_m, nperseg=1024)
    inside = (wavenumber > 500) & (wavenumber < 0.8 / width_m)
    expected = (2 * np.pi) ** 2 / CUTOFF_M * np.sinc(wavenumber * width_m) ** 2
    assert power[inside].mean() == pytest.approx(expected[inside].mean(), rel=0.05)
    at_width = np.argmin(np.abs(wavenumber - 1 / width_m))
    assert power[at_width] < 0.05 * expected[1]


def test_twice_the_speed_is_the_same_force_in_half_the_time():
    profile, times = RoughProfile(2), np.arange(1000) / 44100
    np.testing.assert_array_equal(
        profile.slopes(0.2 * times, 1e-4)[::2], profile.slopes(0.4 * times[:500], 1e-4)
    )


def test_it_goes_on_without_a_step_at_its_end():
    places = LENGTH_M + np.linspace(-2e-5, 2e-5, 9)
    profile = RoughProfile(3)
    np.testing.assert_allclose(
        profile.slopes(places, 1e-4), profile.slopes(places % LENGTH_M, 1e-4), rtol=1e-9
    )
