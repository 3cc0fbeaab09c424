"""What is stored of held-out strikes, against the sounds that it stands for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import objectfolder
from objectfolder.audio.synthesis import mode_bank
from objectfolder.audio.synthesis.struck_body import RMS
from objectfolder.fidelity.sound import (
    DURATION_S,
    SAMPLE_RATE_HZ,
    measure_sound,
    stored_strike,
    strike_arrays,
    strike_differences_db,
    struck,
    true_amplitudes,
)
from objectfolder.fidelity.sounds import gain_error_db
from objectfolder.products.store import Product, read_product

EIGENVALUES = (2 * np.pi * np.array([[440.0, 1250.0, 9000.0], [441.0, 1250.0, 9010.0]])) ** 2
DAMPINGS_PER_S = np.array([[3.0, 20.0, 150.0], [3.1, 20.0, 149.0]])


def test_differences_are_those_of_the_sounds() -> None:
    truth = np.random.default_rng(0).normal(size=(5, 3))
    amplitudes = np.stack([truth, truth + 0.03 * np.random.default_rng(1).normal(size=(5, 3))])
    sounds = [
        mode_bank(*own, duration_s=DURATION_S, sample_rate_hz=SAMPLE_RATE_HZ)
        for own in zip(EIGENVALUES, DAMPINGS_PER_S, amplitudes, strict=True)
    ]
    expected_db = [gain_error_db(*pair) for pair in zip(*sounds, strict=True)]
    differences_db = strike_differences_db(EIGENVALUES, DAMPINGS_PER_S, amplitudes)
    np.testing.assert_allclose(differences_db, expected_db, atol=1e-6)


def test_an_answer_that_is_a_tenth_too_loud_differs_by_20_db_and_one_of_silence_by_nothing_known() -> None:
    truth = np.array([[1.0, -2.0, 0.5], [0.0, 0.0, 0.0]])
    same = EIGENVALUES[[0, 0]], DAMPINGS_PER_S[[0, 0]]
    loud, silent = strike_differences_db(*same, np.stack([truth, 1.1 * truth]))
    assert loud == pytest.approx(-20, abs=1e-9)
    assert np.isnan(silent)
    assert strike_differences_db(*same, np.stack([truth, truth]))[0] < -140


@pytest.fixture(scope="module")
def modes(small_file: Path) -> Product:
    return read_product(small_file.with_name("modes.zarr.zip"))


def test_every_held_out_strike_is_stored_as_it_sounds(small_file: Path, modes: Product) -> None:
    file = objectfolder.load(small_file)
    stored = Product(strike_arrays(file, modes))
    points, impulses = struck(modes, None)
    assert len(points) == modes["held_out"].sum() == len(stored["strike_truth"])
    solved = modes["eigenvalues"], modes["dampings_per_s"], true_amplitudes(modes, None)
    truths = mode_bank(*solved, duration_s=DURATION_S, sample_rate_hz=SAMPLE_RATE_HZ)
    answers = file.strike(points, impulses, DURATION_S, SAMPLE_RATE_HZ, observed=RMS)
    for row, (truth, answer) in enumerate(zip(truths, answers, strict=True)):
        sounds = [stored_strike(stored, which, row) for which in (0, 1)]
        difference_db = gain_error_db(truth, answer)
        assert stored["strike_difference_db"][row] == pytest.approx(difference_db, abs=1e-3)
        assert gain_error_db(truth, sounds[0]) < -80, "steps of 16 bits"
        assert gain_error_db(answer, sounds[1]) < max(difference_db - 30, -80), "steps of 8 bits"


def test_points_that_do_not_move_are_stored_as_silent(small_file: Path, modes: Product) -> None:
    shapes = replace(modes.arrays["mode_shapes"], data=np.zeros_like(modes["mode_shapes"]))
    still = Product({**modes.arrays, "mode_shapes": shapes}, modes.attributes)
    stored = Product(strike_arrays(objectfolder.load(small_file), still))
    assert np.isposinf(stored["strike_difference_db"]).all(), "the file sounds"
    assert not stored["strike_steps"][0].any()
    assert not stored_strike(stored, 0, 0).any()


def test_a_mode_has_lost_60_db_after_its_t60(small_file: Path, modes: Product) -> None:
    table = measure_sound(objectfolder.load(small_file), modes)["modes_table"]
    amplitudes = [np.exp(-row["damping_per_s"] * row["t60_s"]) for row in table]
    np.testing.assert_allclose(20 * np.log10(amplitudes), -60)
