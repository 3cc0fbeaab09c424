"""What networks reach on a small fixed draw, held from below and from above.

The draw has a mug, a bell, a bar and the bar's twin, which differs in sound alone: by sight and touch the
twins cannot be told apart, and a figure that says so has leaked. A figure has to lie within four standard
deviations of its mean, both measured over the seeds 0 to 7 of draws, splits and weights. Sound is learnt
worst with seed 0, so its own bounds are wide.
"""

from functools import partial

import numpy as np
import pytest

from learning import encoders, occupancy, reconstruction, runs
from learning.encoders import encoded
from learning.grasping.stability import Predictor
from learning.recognition import fused
from learning.reconstruction import Measures, Trial
from learning.retrieval import scores, similarities
from learning.runs import Objects
from learning.samples import SENSES
from learning.settings import Counts, Encoder, Retrieval
from learning.shapes import volume_points
from tests.learning.conftest import at_root

GRASPS = 150
# Mean and standard deviation over seeds.
MEASURED = {
    "vision": (0.723, 0.018),
    "audio": (0.898, 0.098),
    "touch": (0.575, 0.055),
    "all senses": (0.951, 0.061),
    "vision to audio, ours": (0.761, 0.033),
    "vision to audio, CCA": (0.792, 0.029),
    "vision to audio, PLS": (0.785, 0.031),
    "vision to audio, classify, then look up": (0.782, 0.028),
    "touch to audio, ours": (0.642, 0.049),
    "touch to audio, CCA": (0.689, 0.039),
    "touch to audio, PLS": (0.671, 0.043),
    "touch to audio, classify, then look up": (0.675, 0.039),
    "vision to touch, ours": (0.613, 0.046),
    "vision to touch, CCA": (0.631, 0.037),
    "vision to touch, PLS": (0.606, 0.044),
    "vision to touch, classify, then look up": (0.63, 0.038),
    "iou": (0.443, 0.052),
    "chamfer": (0.0331, 0.014),
    "normal_consistency": (0.756, 0.024),
    "size error": (0.00755, 0.0018),
    "grasps by V": (0.495, 0.074),
    "grasps by T": (0.97, 0.04),
    "grasps by VT": (0.972, 0.043),
}


def sized(tiny):
    """Settings of the draw."""
    data = {"validation": 10, "test": 20, "training": Counts(vision=30, audio=15, touch=60)}
    shapes = {"steps": 60, "points": 512, "width": 16, "grid": 32, "surface_points": 1000}
    return tiny.model_copy(
        update={
            "data": tiny.data.model_copy(update=data),
            "encoder": Encoder(width=8, epochs=6, batch=16, learning_rate=5e-3),
            "retrieval": Retrieval(dimensions=8, epochs=3, margin=0.2),
            "reconstruction": tiny.reconstruction.model_copy(update=shapes),
        }
    )


def figures(objects, settings, seed):
    """Figures of recognition, retrieval and reconstruction by name."""
    networks = {sense: encoded(objects, settings, sense, "sample", seed) for sense in SENSES}
    values = {sense: fused([network], seed).mean() for sense, network in networks.items()}
    values["all senses"] = fused(list(networks.values()), seed).mean()
    for first, second in (("vision", "audio"), ("touch", "audio"), ("vision", "touch")):
        pair = networks[first], networks[second]
        tests = [one.splits["test"] for one in pair]
        for method, similarity in similarities(pair, len(objects), settings.retrieval, seed).items():
            values[f"{first} to {second}, {method}"] = scores(similarity, *tests, seed)["map"]
    closed = tuple(range(len(objects)))
    measures = Measures(occupancy.shapes_of(objects), settings.reconstruction)
    trial = Trial(objects, settings, measures, ("vision", "audio"), closed, closed, (), seed).figures()
    return {**values, **trial["ours"], "size error": trial["size_error_share"]}


def grasping(objects, settings, seed):
    """Accuracies of what is said of grasps, by sense: the gels show the force, which decides."""
    random = np.random.default_rng(seed)
    force = random.uniform(0.5, 1.5, GRASPS)
    touch = random.normal(128, 8, (GRASPS, 2, 32, 24, 3))
    touch[:, :, 8:24, 6:18] += 60 * force[:, None, None, None, None]
    grasps = {
        "image": random.integers(0, 256, (GRASPS, 16, 16, 3), dtype=np.uint8),
        "touch": touch.clip(0, 255).astype(np.uint8),
        "held": force > 1,
    }
    training, test = np.split(np.arange(GRASPS), [2 * GRASPS // 3])
    answers = Predictor(objects, settings, grasps).of(training, test)
    held = grasps["held"][test]
    return {f"grasps by {senses}": np.mean(answer == held) for senses, answer in answers.items()}


@pytest.mark.slow
def test_figures_are_those_measured(four, tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "RUNS", tmp_path)
    monkeypatch.setattr(encoders, "LOGS", tmp_path)
    monkeypatch.setattr(occupancy, "FAR_POINTS", 20_000)
    monkeypatch.setattr(occupancy, "NEAR_POINTS", 9000)
    monkeypatch.setattr(reconstruction, "volume_points", partial(volume_points, count=10_000))
    settings = at_root(sized(tiny), four)
    objects = Objects(settings)
    values = figures(objects, settings, 0) | grasping(objects, settings, 0)
    assert values.keys() == MEASURED.keys()
    outside = {
        name: (value, *MEASURED[name])
        for name, value in values.items()
        if not _within(value, *MEASURED[name])
    }
    assert not outside, "value, mean, deviation"


def _within(value, mean, deviation):
    return abs(value - mean) <= 4 * deviation
