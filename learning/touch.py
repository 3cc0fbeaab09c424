"""Which object is it, by touch alone? For many meshes at once: they need neither views nor modes.

Touches are at vertices, all as deep, as published. Test vertices are any, or those of regions where no vertex
is trained on.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learning.encoders import Encoded, Encoder, encoded
from learning.meshes import Meshes
from learning.metrics import means_by_object, share_interval
from learning.neighbours import with_neighbours
from learning.recognition import SEVERAL, accuracies, shares_of_several
from learning.settings import Settings
from learning.workers import Workers

PROTOCOLS = ("vertex", "vertex region")


def evaluate(meshes: Meshes, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return accuracies of one touch and of several, by protocol: of networks, and with neighbours."""
    units = [(protocol, seed) for protocol in PROTOCOLS for seed in settings.seeds]
    workers.gather([workers.submit(_trained, meshes, settings, *unit) for unit in units])
    result: dict[str, Any] = {
        "chance_percent": 100 / len(meshes),
        "tests_a_seed": settings.data.test * len(meshes),
    }
    for protocol in PROTOCOLS:
        encoders = [encoded(meshes, settings, "touch", protocol, seed) for seed in settings.seeds]
        result[protocol] = _row(encoders)
    return result


def _trained(meshes: Meshes, settings: Settings, protocol: str, seed: int) -> None:
    encoded(meshes, settings, "touch", protocol, seed)


def _row(encoders: Sequence[Encoder]) -> dict[str, Any]:
    counts = np.bincount(encoders[0].splits["training"].labels)
    tests = [encoder.splits["test"] for encoder in encoders]
    return {
        **_recognised(tests),
        "with_neighbours": _recognised([with_neighbours(encoder) for encoder in encoders]),
        "training_touches": [int(counts.min()), int(counts.max())],
        "nearest_training_place": float(np.mean([encoder.nearest_share for encoder in encoders])),
    }


def _recognised(tests: Sequence[Encoded]) -> dict[str, Any]:
    return {
        "T": accuracies([_shares(test) for test in tests]),
        "several": {str(count): _several(tests, count) for count in SEVERAL},
    }


def _shares(test: Encoded) -> NDArray[np.float64]:
    """Return the share (objects,) of each object's test touches that are named rightly."""
    right = (test.log_probabilities.argmax(axis=1) == test.labels).astype(np.float64)
    return np.array(list(means_by_object(right, test.labels).values()))


def _several(tests: Sequence[Encoded], count: int) -> dict[str, Any]:
    shares = [shares_of_several(test, count, seed) for seed, test in enumerate(tests)]
    low, high = share_interval(np.mean(shares, axis=0))
    return {"accuracy_percent": 100 * float(np.mean(shares)), "interval_percent": [100 * low, 100 * high]}
