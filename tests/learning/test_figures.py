"""What networks reach on a small fixed draw, held from below and from above.

The draw has a mug, a bell, a bar and the bar's twin, which differs in sound alone: by sight and touch the
twins cannot be told apart, and a figure that says so has leaked. A figure has to lie within four standard
deviations of its mean, both measured over the seeds 0 to 7 of draws, splits and weights on one processor and
0 to 5 on another: torch rounds differently there, and one seed's figure moved by as much as seeds differ.
Those of the contrastive space, of averaged inputs and of shapes are of seeds 0 to 7 on one processor.
Sound is learnt worst with seed 0, so its own bounds are wide.
"""

import json
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
from tests.cache_key import cache_key
from tests.learning.conftest import PARAMETERS, at_root

GRASPS = 150
TASKS = ("encoders", "grasping.stability", "recognition", "reconstruction", "retrieval")
MODULES = ("tests.learning.test_figures", *(f"learning.{name}" for name in TASKS))
PACKAGES = ("numba", "numpy", "scikit-image", "scikit-learn", "scipy", "torch", "trimesh")
# Mean and standard deviation over seeds and processors.
MEASURED = {
    "vision": (0.726, 0.017),
    "audio": (0.895, 0.094),
    "touch": (0.590, 0.046),
    "all senses": (0.944, 0.055),
    "vision to audio, ours": (0.759, 0.026),
    "vision to audio, CCA": (0.783, 0.040),
    "vision to audio, PLS": (0.784, 0.026),
    "vision to audio, contrastive": (0.774, 0.022),
    "vision to audio, CCA of averaged inputs": (0.789, 0.021),
    "vision to audio, classify, then look up": (0.782, 0.026),
    "vision to audio, classify by neighbours too, then look up": (0.795, 0.039),
    "touch to audio, ours": (0.663, 0.048),
    "touch to audio, CCA": (0.697, 0.041),
    "touch to audio, PLS": (0.681, 0.037),
    "touch to audio, contrastive": (0.704, 0.031),
    "touch to audio, CCA of averaged inputs": (0.683, 0.035),
    "touch to audio, classify, then look up": (0.688, 0.033),
    "touch to audio, classify by neighbours too, then look up": (0.718, 0.036),
    "vision to touch, ours": (0.626, 0.044),
    "vision to touch, CCA": (0.629, 0.035),
    "vision to touch, PLS": (0.616, 0.041),
    "vision to touch, contrastive": (0.645, 0.060),
    "vision to touch, CCA of averaged inputs": (0.574, 0.028),
    "vision to touch, classify, then look up": (0.636, 0.039),
    "vision to touch, classify by neighbours too, then look up": (0.635, 0.037),
    "iou": (0.453, 0.046),
    "chamfer": (0.031, 0.014),
    "normal_consistency": (0.759, 0.023),
    "size error": (0.00775, 0.0019),
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
            "retrieval": Retrieval(dimensions=8, epochs=3, margin=0.2, temperature=0.1, end_to_end_folds=0),
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
        tests = [encoder.splits["test"] for encoder in pair]
        for method, similarity in similarities(pair, len(objects), settings.retrieval, seed).items():
            by_object = scores(similarity, *tests, seed).map
            values[f"{first} to {second}, {method}"] = np.mean(list(by_object.values()))
    closed = tuple(range(len(objects)))
    measures = Measures(occupancy.shapes_of(objects), settings.reconstruction)
    trial = Trial(objects, settings, measures, ("vision", "audio"), closed, closed, (), seed)
    reached = reconstruction.figures([trial])
    return {**values, **reached["ours"], "size error": reached["size_error_share"]}


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
    outcomes = grasps["held"][test]
    return {f"grasps by {senses}": np.mean(answer == outcomes) for senses, answer in answers.items()}


@pytest.fixture
def values(four, tiny, tmp_path, monkeypatch, make_once):
    """Figures by name, kept between runs until what they are of, or the code that reaches them, changes."""
    monkeypatch.setattr(runs, "RUNS", tmp_path)
    monkeypatch.setattr(encoders, "LOGS", tmp_path)
    monkeypatch.setattr(occupancy, "FAR_POINTS", 20_000)
    monkeypatch.setattr(occupancy, "NEAR_POINTS", 9000)
    monkeypatch.setattr(reconstruction, "volume_points", partial(volume_points, count=10_000))
    settings = at_root(sized(tiny), four)

    def reach(folder):
        objects = Objects(settings)
        reached = figures(objects, settings, 0) | grasping(objects, settings, 0)
        (folder / "figures.json").write_text(
            json.dumps({name: float(each) for name, each in reached.items()})
        )

    files = (PARAMETERS, *sorted((four / "data" / "object_files").iterdir()))
    folder = make_once("figures", reach, cache_key(MODULES, files, PACKAGES))
    return json.loads((folder / "figures.json").read_text())


@pytest.mark.slow
def test_figures_are_those_measured(values):
    assert values.keys() == MEASURED.keys()
    outside = {
        name: (value, *MEASURED[name])
        for name, value in values.items()
        if not _within(value, *MEASURED[name])
    }
    assert not outside, "value, mean, deviation"


def _within(value, mean, deviation):
    return abs(value - mean) <= 4 * deviation
