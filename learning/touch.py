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
from learning.recognition import SEVERAL, accuracies, shares_of_several, worst_object
from learning.settings import Settings
from learning.vertices import touched_vertices
from learning.workers import Workers
from objectfolder.errors import InputError

PROTOCOLS = ("vertex", "vertex region")


def evaluate(meshes: Meshes, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return accuracies of one touch and of several, by protocol: of networks, and with neighbours.

    Meshes that cannot be touched are left out, and the result says why.
    """
    meshes, left_out = touchable(meshes, settings, workers)
    units = [(protocol, seed) for protocol in PROTOCOLS for seed in settings.seeds]
    workers.gather([workers.submit(_trained, meshes, settings, *unit) for unit in units])
    result: dict[str, Any] = {
        "chance_percent": 100 / len(meshes),
        "tests_a_seed": settings.data.test * len(meshes),
        "objects": len(meshes),
        "left_out": left_out,
    }
    for protocol in PROTOCOLS:
        encoders = [encoded(meshes, settings, "touch", protocol, seed) for seed in settings.seeds]
        result[protocol] = _row(encoders, meshes.ids)
    return result


def touchable(meshes: Meshes, settings: Settings, workers: Workers) -> tuple[Meshes, dict[str, str]]:
    """Touch all meshes, and return those that can be touched as both protocols ask, and what hinders others.

    Raises
    ------
    InputError
        Too few can be touched.
    """
    draws = [workers.submit(_hindrance, meshes, settings, name) for name in meshes.ids]
    hindrances = zip(meshes.ids, workers.gather(draws), strict=True)
    left_out = {name: hindrance for name, hindrance in hindrances if hindrance is not None}
    for name, hindrance in left_out.items():
        print(f"  left out: {name}: {hindrance}", flush=True)
    return meshes.without(left_out), left_out


def _hindrance(meshes: Meshes, settings: Settings, name: str) -> str | None:
    try:
        for protocol in PROTOCOLS:
            for seed in settings.seeds:
                file, digest = meshes.files[name], meshes.digests[name]
                touched_vertices(file, name, digest, settings, protocol, seed, ("test",))
    except InputError as error:
        return error.finding
    return None


def _trained(meshes: Meshes, settings: Settings, protocol: str, seed: int) -> None:
    encoded(meshes, settings, "touch", protocol, seed)


def _row(encoders: Sequence[Encoder], ids: Sequence[str]) -> dict[str, Any]:
    counts = np.bincount(encoders[0].splits["training"].labels)
    tests = [encoder.splits["test"] for encoder in encoders]
    return {
        **_recognised(tests, ids),
        "with_neighbours": _recognised(
            [with_neighbours(encoder).splits["test"] for encoder in encoders], ids
        ),
        "training_touches": [int(counts.min()), int(counts.max())],
        "nearest_training_place": float(np.mean([encoder.nearest_share for encoder in encoders])),
    }


def _recognised(tests: Sequence[Encoded], ids: Sequence[str]) -> dict[str, Any]:
    shares = [_shares(test) for test in tests]
    return {
        "T": accuracies(shares),
        "worst": worst_object(shares, ids),
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
