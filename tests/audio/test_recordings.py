"""A material fitted to recordings, of bodies whose truth is known."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile
from structured_solids import box, material

from objectfolder.errors import InputError
from objectfolder.making.recordings.body import SolvedBody, body_of_solid
from objectfolder.making.recordings.decay_law import power_law
from objectfolder.making.recordings.fitting import (
    SoundFit,
    fit_body,
    fitted_material,
    match,
    partials_near_modes,
)
from objectfolder.making.recordings.partials import Partials, partials_of, partials_over
from objectfolder.making.recordings.recording import Recording, read_recording, recording_of

SLOW_FIXTURES = ("body",)
RATE_HZ = 32000
BAR_M = np.array((0.20, 0.024, 0.010))
WALL_M = 2 * BAR_M.prod() / (2 * (BAR_M * np.roll(BAR_M, 1)).sum())
LIMIT_HZ = 12000.0
# What is to be found: E / rho, Poisson's ratio, walls and the loss factor at 1 kHz.
STIFFNESS, POISSON_RATIO, WALL, LOSS_FACTOR = 1.08, 0.22, 0.98, 1e-3
OUTLIER_HZ = 5000.0


def bar(poisson_ratio: float = 0.19, wall: float = 1.0) -> SolvedBody:
    sides = BAR_M + (wall - 1) * WALL_M
    return body_of_solid(box((6, 1, 1), sides), material(poisson_ratio), LIMIT_HZ)


@pytest.fixture(scope="module")
def body() -> SolvedBody:
    return bar()


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """Frequencies of the bar that is recorded; what the air takes of it is not asked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("objectfolder.making.recordings.body.radiation_dampings", lambda *_: None)
        second = bar(POISSON_RATIO, WALL).frequencies_hz
    # `bar` keeps E, and the shear speed with it falls as Poisson's ratio grows.
    return second * np.sqrt(STIFFNESS)


def strike(partials: list[tuple[float, float, float]], seed: int, seconds: float = 0.6) -> np.ndarray:
    """A recording (n,) of frequency (Hz), decay (1/s) and amplitude, struck after .1 s, noise 66 dB down."""
    generator = np.random.default_rng(seed)
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    ringing = sum(
        amplitude
        * np.exp(-decay * times)
        * np.sin(2 * np.pi * hertz * times + generator.uniform(0, 2 * np.pi))
        for hertz, decay, amplitude in partials
    )
    samples = np.concatenate([np.zeros(RATE_HZ // 10), ringing])
    samples *= 0.5 / np.abs(samples).max()
    return samples + 2.5e-4 * generator.normal(size=len(samples))


def bar_recording(truth: np.ndarray, radiation_per_s: np.ndarray, seed: int) -> Recording:
    """A recording of modes that lose to their material and to the air."""
    amplitudes = np.random.default_rng(seed).uniform(0.2, 1, len(truth))
    partials = list(zip(truth, np.pi * LOSS_FACTOR * truth + radiation_per_s, amplitudes, strict=True))
    return recording_of(strike([*partials, (OUTLIER_HZ, 20.0, 0.3)], seed), RATE_HZ)


@pytest.fixture(scope="module")
def partials(truth: np.ndarray, body: SolvedBody) -> Partials:
    recordings = [bar_recording(truth, body.radiation_dampings_per_s, seed) for seed in (1, 2)]
    return partials_over(recordings, [partials_of(each, LIMIT_HZ) for each in recordings], LIMIT_HZ)


@pytest.mark.slow
def test_partials_are_those_of_the_recording_with_a_beating_pair_and_no_others() -> None:
    true = [(700.0, 4.0, 1.0), (1800.0, 6.0, 1.0), (1803.0, 6.5, 0.7), (3210.0, 30.0, 0.5)]
    # What a striker takes before it leaves is no partial.
    touching = [(1810.0, 150.0, 1.0)]
    measurement = partials_of(recording_of(strike(true + touching, 0, 0.8), RATE_HZ), 3400.0)
    np.testing.assert_allclose(measurement.frequencies_hz, [hertz for hertz, _, _ in true], atol=0.05)
    np.testing.assert_allclose(measurement.decays_per_s, [decay for _, decay, _ in true], rtol=0.05)


def test_a_fit_finds_stiffness_poisson_ratio_walls_and_decay(body: SolvedBody, partials: Partials) -> None:
    fit = fit_body(partials, body, recordings=2, fit_wall=True)
    assert fit.stiffness.value == pytest.approx(STIFFNESS, abs=0.003)
    assert fit.poisson_ratio.visible
    assert fit.poisson_ratio.value == pytest.approx(POISSON_RATIO, abs=0.005)
    assert fit.wall.value == pytest.approx(WALL, abs=0.002)
    assert fit.matching.rms_cents < 1.5
    assert np.abs(fit.cents_before).max() > 50
    alone = np.delete(partials.frequencies_hz, fit.matching.partials)
    assert np.round(alone).tolist() == [OUTLIER_HZ]
    assert fit.decay is not None
    eigenvalue = (2 * np.pi * np.array([4000.0])) ** 2
    assert fit.decay.decay_rates(eigenvalue) == pytest.approx(np.pi * LOSS_FACTOR * 4000, rel=0.05)


def test_walls_that_are_held_stay_and_leave_more(body: SolvedBody, partials: Partials) -> None:
    unit_wall, fitted = (fit_body(partials, body, recordings=2, fit_wall=each) for each in (False, True))
    assert unit_wall.wall.value == 1
    assert unit_wall.matching.rms_cents > 3 * fitted.matching.rms_cents


def test_what_the_partials_do_not_tell_stays_as_it_was(body: SolvedBody) -> None:
    few = body.frequencies_hz[:3] * 1.01
    fit = fit_body(
        exact(few),
        replace(body, by_poisson=np.full(len(body.frequencies_hz), -0.4)),
        recordings=1,
        fit_wall=False,
    )
    assert not fit.poisson_ratio.visible
    assert fit.poisson_ratio.value == body.material.poisson_ratio
    assert fit.stiffness.value == pytest.approx(1.01**2, rel=1e-3)


def exact(frequencies_hz: np.ndarray) -> Partials:
    unit = np.ones(len(frequencies_hz))
    return Partials(
        frequencies_hz, 10 * unit, 60 * unit, 60 * unit, unit.astype(np.int64), 0 * unit, 0 * unit
    )


def test_another_object_is_named_with_what_random_partials_reach(body: SolvedBody) -> None:
    second = exact(np.sort(np.random.default_rng(3).uniform(600, LIMIT_HZ, 12)))
    with pytest.raises(InputError, match=r"of 12 partials .* random partials reach \d+%"):
        fit_body(second, body, recordings=1, fit_wall=True)


def test_partials_of_another_object_are_near_few_modes_of_a_fit(body: SolvedBody, partials: Partials) -> None:
    fit = fit_body(partials, body, recordings=2, fit_wall=True)
    second = exact(np.sort(np.random.default_rng(3).uniform(600, LIMIT_HZ, 12)))
    assert partials_near_modes(partials, fit) == len(partials) - 1
    assert partials_near_modes(second, fit) < 4


def test_one_partial_of_a_pair_stands_for_both() -> None:
    modes_hz = np.array([1000.0, 2000.0, 2002.0])
    matching = match(np.array([1000.0, 2001.0]), np.ones(2), modes_hz)
    np.testing.assert_allclose(matching.cents, 0, atol=0.01)
    both = match(np.array([2004.0, 2006.0]), np.ones(2), modes_hz)
    assert both.modes.tolist() == [1, 2]


def test_of_two_partials_for_one_mode_that_of_more_weight_takes_it() -> None:
    matching = match(np.array([1000.0, 1004.0]), np.array([0.2, 1.0]), np.array([1001.0, 3000.0]))
    assert matching.partials.tolist() == [1]


def test_a_law_passes_through_decays_and_by_an_outlier() -> None:
    hertz = np.geomspace(500, 8000, 9)
    decays = np.pi * 2e-3 * (hertz / 1000) ** -0.2 * hertz
    decays[4] *= 10
    law = power_law(hertz, decays)
    assert law.loss_factor == pytest.approx(2e-3, rel=0.15)
    assert law.loss_exponent == pytest.approx(-0.2, abs=0.1)


def test_a_measured_mass_gives_the_density(body: SolvedBody, partials: Partials) -> None:
    fit: SoundFit = fit_body(partials, body, recordings=2, fit_wall=True)
    mass_kg = 2000 * body.volume_m3 * fit.wall.value
    row = fitted_material(fit, body, "bar", "here", mass_kg)
    assert float(row["density_kg_m3"]) == pytest.approx(2000, rel=1e-4)
    assert float(row["youngs_modulus_pa"]) / 2000 == pytest.approx(STIFFNESS * 7.2e10 / 2700, rel=5e-3)


TONE = [(800.0, 8.0, 1.0), (1500.0, 8.0, 1.0)]
# Of so few samples a period that hardly two in a row are cut.
HISS = [(hertz, 30.0, 1.0) for hertz in (7100.0, 9300.0, 11900.0, 14700.0)]


@pytest.mark.parametrize(
    ("samples", "fault"),
    [
        (np.clip(2 * strike(TONE, 0), -0.5, 0.5), r"samples clip at 0.50 of full scale, the last \d"),
        (np.clip(4 * strike(HISS, 0), -0.5, 0.5), r"samples clip at 0.50 of full scale, the last \d"),
        (np.stack([strike(TONE, 0), 0.1 * strike(TONE, 1)], axis=1), r"2 channels, .* correlate by -?0"),
        (np.uint8(np.round(strike(TONE, 0) * 100) + 128), r"its peak is 50 steps \(8 bit\)"),
        (np.int16(np.round(strike(TONE, 0) * 100) * 256), r"its peak is 50 steps \(16 bit\)"),
        (np.tile(strike(TONE, 0), 2), r"struck again 0.[67]\d s after"),
    ],
    ids=["clipped", "clipped above 7 kHz", "stereo", "8 bits", "8 bits in 16", "struck twice"],
)  # fmt: skip
def test_a_fault_of_a_recording_is_named_with_its_figure(
    samples: np.ndarray, fault: str, tmp_path: Path
) -> None:
    wavfile.write(tmp_path / "strike.wav", RATE_HZ, samples)
    recording = read_recording(tmp_path / "strike.wav")
    assert len(recording.warnings) == 1
    assert re.search(fault, recording.warnings[0])
    assert 0.09 < recording.start / RATE_HZ < 0.35


@pytest.mark.parametrize("partials", [TONE, HISS, [(60.0, 2.0, 1.0), (800.0, 8.0, 0.3)]])
def test_no_whole_strike_is_said_to_clip(partials: list[tuple[float, float, float]], tmp_path: Path) -> None:
    for steps in (32767, 500):
        wavfile.write(tmp_path / "strike.wav", RATE_HZ, np.int16(np.round(2 * strike(partials, 0) * steps)))
        assert read_recording(tmp_path / "strike.wav").warnings == ()


@pytest.mark.parametrize(
    ("samples", "fault"),
    [
        (strike(TONE, 0, 0.02), r"1\d ms of free decay are left, 30 are needed"),
        (np.random.default_rng(0).normal(size=RATE_HZ), r"no strike: its level falls by -?0\.\d dB"),
        (np.zeros(RATE_HZ), r"1.000 s, peak 0: no strike"),
        (np.append(strike(TONE, 0), np.nan), r"1 samples are not finite"),
    ],
    ids=["short", "noise", "silence", "not finite"],
)
def test_a_recording_without_a_free_decay_is_refused(samples: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        recording_of(samples, RATE_HZ)


def test_a_file_that_is_no_wav_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "strike.wav").write_bytes(b"not a sound")
    with pytest.raises(InputError, match=r"strike\.wav: cannot be read"):
        read_recording(tmp_path / "strike.wav")


def test_decays_of_a_recording_that_ends_early_are_not_measured() -> None:
    measurement = partials_of(
        recording_of(strike([(800.0, 2.0, 1.0), (1500.0, 60.0, 1.0)], 0, 0.3), RATE_HZ), 2000.0
    )
    assert measurement.decay_is_measured.tolist() == [False, True]
