import numpy as np
import pytest

from bench.senses.vision_outcome import at_foreground, mean_over_objects


def row(name: str, *ours: tuple[float, float]) -> dict:
    """Cycles gains 3 dB a doubling from 34 dB in 0.1 s on; our settings have errors in seconds."""
    cycles = [
        {"way": "Cycles", "setting": 2**k, "psnr_foreground_db": 34 + 3 * k, "cpu_s": 0.1 * 2**k}
        for k in range(7)
    ]
    settings = [
        {"way": "VisionNet, compiled", "setting": k, "psnr_foreground_db": db, "cpu_s": s, "ssim": None}
        for k, (db, s) in enumerate(ours)
    ]
    return {"object": name, "size": 128, "ways": [*reversed(cycles), *settings]}


def test_seconds_to_the_same_error_are_interpolated_between_sample_counts():
    points = at_foreground([row("a", (39.0, 0.01), (48.0, 0.05), (60.0, 0.2)), row("b", (44.0, 0.02))])
    # Cycles has 40 dB by 4 samples, in 0.4 s.
    assert points["40"]["times_faster"] == {
        "a": pytest.approx(0.1 * 2**2 / 0.05),
        "b": pytest.approx(0.1 * 2**2 / 0.02),
    }
    assert points["40"]["median_times_faster"] == pytest.approx(np.median([8.0, 20.0]))
    # 45 dB lie between 43 and 46: seconds are interpolated by their logarithm.
    assert points["45"]["times_faster"] == {"a": pytest.approx(0.1 * 2 ** (11 / 3) / 0.05)}
    assert points["45"]["not_reached"] == ["b"]


def test_beyond_cycles_sample_counts_there_is_no_figure():
    case = row("a", (60.0, 0.05))
    case["ways"] = [way for way in case["ways"] if way["way"] != "Cycles" or way["setting"] <= 4]
    points = at_foreground([case])
    assert set(points["40"]["times_faster"]) == {"a"}
    assert points["45"] == {"times_faster": {}, "median_times_faster": None, "not_reached": []}


def test_means_are_over_the_objects_that_have_a_measure():
    rows = [row("a", (40.0, 0.05)), row("b", (42.0, 0.05))]
    network = {"way": "network", "setting": None, "psnr_foreground_db": 20.0, "ssim": None, "cpu_s": 70.0}
    rows[0]["ways"].append(network)
    means = {(mean["way"], mean["setting"]): mean for mean in mean_over_objects(rows)}
    assert means["VisionNet, compiled", 0]["psnr_foreground_db"] == 41.0
    assert means["VisionNet, compiled", 0]["objects"] == 2
    assert means["VisionNet, compiled", 0]["ssim"] is None
    assert means["network", None]["objects"] == 1
    assert means["network", None]["bytes"] is None
