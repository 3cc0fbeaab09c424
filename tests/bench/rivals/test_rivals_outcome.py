import numpy as np
import pytest

from bench.senses.vision_outcome import at_equal_error, mean_over_objects, seconds_at


def row(name: str, ours_db: float) -> dict:
    """Cycles gains 3 dB a doubling from 30 dB in 0.1 s on; alone it takes 2 s more."""
    cycles = [
        {
            "way": "Cycles",
            "setting": 2**k,
            "psnr_db": 30 + 3 * k,
            "cpu_s": 0.1 * 2**k,
            "cpu_s_alone": 2 + 0.1 * 2**k,
        }
        for k in range(7)
    ]
    ours = {"way": "VisionNet, reference", "setting": 16, "psnr_db": ours_db, "cpu_s": 0.05, "ssim": None}
    return {"object": name, "size": 128, "ways": [*reversed(cycles), ours]}


def test_seconds_to_the_same_error_are_interpolated_between_sample_counts():
    # Halfway between two sample counts the seconds are their geometric mean: 0.1 * 2^1.5 = 0.283.
    (found,) = at_equal_error([row("a", 34.5), row("b", 36.0), row("c", 60.0), row("d", 10.0)])
    assert found["times_faster"]["a"] == pytest.approx(0.1 * 2**1.5 / 0.05)
    assert found["times_faster"]["b"] == pytest.approx(0.4 / 0.05)
    assert found["times_faster_alone"]["b"] == pytest.approx(2.4 / 0.05)
    assert found["median_times_faster"] == pytest.approx(np.median([0.1 * 2**1.5, 0.4]) / 0.05)


def test_beyond_cycles_sample_counts_there_is_no_figure():
    (found,) = at_equal_error([row("best", 60.0), row("worst", 10.0)])
    assert found["times_faster"] == {}
    assert found["median_times_faster"] is None
    assert found["better_than_all_samples"] == ["best"]
    assert found["worse_than_one_sample"] == ["worst"]


def test_means_are_over_the_objects_that_have_a_measure():
    rows = [row("a", 40.0), row("b", 42.0)]
    rows[0]["ways"].append({"way": "network", "setting": None, "psnr_db": 20.0, "ssim": None, "cpu_s": 70.0})
    means = {(mean["way"], mean["setting"]): mean for mean in mean_over_objects(rows)}
    assert means["VisionNet, reference", 16]["psnr_db"] == 41.0
    assert means["VisionNet, reference", 16]["objects"] == 2
    assert means["VisionNet, reference", 16]["ssim"] is None
    assert means["network", None]["objects"] == 1
    assert means["network", None]["bytes"] is None


def test_the_cheapest_setting_that_reaches_an_error_is_found():
    # Cycles has 42 dB from 16 samples on, in 1.6 s.
    found = seconds_at([row("a", 43.0), row("b", 41.0)], 42.0)
    assert found["Cycles"]["objects"] == {"a": pytest.approx(1.6), "b": pytest.approx(1.6)}
    assert found["VisionNet, reference"]["objects"] == {"a": 0.05, "b": None}
    assert found["VisionNet, reference"]["mean"] == 0.05
    assert found["VisionNet, reference"]["not_reached"] == ["b"]
