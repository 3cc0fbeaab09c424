"""Will the object be held? From an image, from both gels, and from both senses, before it is lifted.

Networks are `JoinedSenses`, of one sense or of both, which are trained as one: whether a force is enough
hangs on the object that an image shows, which no sense learns alone. Beside them stands what needs no sense:
the commoner answer, that of each object, and boosted trees that know force and pose.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import interpolate

from learning.grasping import world
from learning.grasping.worlds import Worlds
from learning.networks import Labelled, answers, fit_classifier
from learning.runs import Objects, kept
from learning.samples import pictures
from learning.settings import Settings
from learning.workers import Workers
from objectfolder.products.provenance import seed_from

VALIDATION_SHARE = 0.15
PART = 500  # grasps whose gels are made small, or that are told, at a time: as floats all would fill a memory
BATCH = 25  # grasps of an object that are made at a time
SENSES = ("V", "T", "VT")
Rows = NDArray[np.int64]
Grasps = dict[str, NDArray[Any]]


def grasps_of(objects: Objects, settings: Settings, workers: Workers) -> Grasps:
    """Return grasps of all objects with a mass as `attempts`, and ``object``, their positions (n,)."""
    worlds, ends = Worlds(objects), [*range(0, settings.grasping.grasps, BATCH), settings.grasping.grasps]
    units, labels = [], []
    for name in worlds:
        parted = workers.submit(worlds.part, name)
        for first, end in pairwise(ends):
            units.append(workers.submit(_batch, worlds, name, range(first, end), settings, parted))
            labels.append(np.full(end - first, objects.ids.index(name)))
    batches = workers.gather(units)
    columns = {name: np.concatenate([np.atleast_1d(batch[name]) for batch in batches]) for name in batches[0]}
    return {**columns, "object": np.concatenate(labels)}


def _batch(worlds: Worlds, name: str, which: range, settings: Settings, parted: None) -> Grasps:
    """Return grasps of an object whose parts are kept; a batch has its own seed."""
    seed = seed_from(settings.seeds[0], f"grasps from {which.start}", name)
    pixels = settings.grasping.resolution
    key = {
        "unit": "grasps", "object": name, "seed": seed, "count": len(which), "parts": world.PARTS,
        "resolution": pixels, "files": worlds.digests[name],
    }  # fmt: skip
    return kept(__name__, key, lambda: world.attempts(worlds[name], len(which), seed, pixels))


def inputs_of(grasps: Grasps, resolution: int) -> dict[str, torch.Tensor]:
    """Return what networks see, uint8: images (n, 3, h, w), and both gels side by side as (n, 6, h, w)."""
    gels = (
        pictures(part.permute(0, 1, 4, 2, 3).flatten(1, 2).float(), resolution).round().byte()
        for part in torch.from_numpy(grasps["touch"]).split(PART)
    )
    return {"V": torch.from_numpy(grasps["image"]).permute(0, 3, 1, 2), "T": torch.cat(list(gels))}


class Predictor:
    """What networks say of grasps, trained on some of them.

    Parameters
    ----------
    grasps
        Of `grasps_of`.
    """

    def __init__(self, objects: Objects, settings: Settings, grasps: Grasps) -> None:
        self._held, self._settings = grasps["held"], settings
        self._inputs = inputs_of(grasps, settings.grasping.resolution)
        self._key = {
            "unit": "stability", "files": objects.digests, "seed": settings.seeds[0], "parts": world.PARTS,
            "resolution": settings.grasping.resolution, "encoder": settings.encoder.model_dump(),
            "count": settings.grasping.grasps,
        }  # fmt: skip

    def of(self, training: Rows, test: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return whether the test's are held, by each sense and by both."""
        rows = {"training": training.tolist(), "test": test.tolist()}
        return kept(__name__, self._key | rows, lambda: self._trained(training, test))

    def _trained(self, training: Rows, test: Rows) -> dict[str, NDArray[np.bool_]]:
        labels, seed = torch.from_numpy(self._held.astype(np.int64)), self._settings.seeds[0]
        order = torch.from_numpy(np.random.default_rng(seed).permutation(training))
        checks = max(2, round(VALIDATION_SHARE * len(order)))
        predictions = {}
        for senses in SENSES:
            learnt, checked = (
                Labelled(self._seen(senses, rows), labels[rows]) for rows in (order[checks:], order[:checks])
            )
            channels = [self._inputs[sense].shape[1] for sense in senses]
            network = fit_classifier(learnt, checked, 2, self._settings.encoder, seed, senses=channels)
            parts = torch.from_numpy(test).split(PART)
            logs = torch.cat([answers(network, self._seen(senses, rows))[1] for rows in parts])
            predictions[senses] = logs.argmax(dim=1).numpy() == 1
        return predictions

    def _seen(self, senses: str, rows: torch.Tensor) -> torch.Tensor:
        """Return inputs of senses as channels one after another, all as large as the last."""
        size = self._inputs[senses[-1]].shape[2:]
        parts = [interpolate(self._inputs[sense][rows] / 255, size, mode="bilinear") for sense in senses]
        return torch.cat(parts, dim=1)


def without_senses(grasps: Grasps, training: Rows, test: Rows) -> dict[str, NDArray[np.bool_]]:
    """Return the commoner answer, the commoner of each object, and that of trees that know what was done."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    held, objects = grasps["held"], grasps["object"]
    common = held[training].mean() >= 0.5
    of_object = {
        label: held[training][objects[training] == label].mean() >= 0.5
        for label in np.unique(objects[training])
    }
    features = np.column_stack([grasps["grasp"], objects])
    trees = HistGradientBoostingClassifier(random_state=0)
    return {
        "majority": np.full(len(test), common),
        "majority of the object": np.array([of_object.get(label, common) for label in objects[test]]),
        "trees on force and pose": trees.fit(features[training], held[training]).predict(features[test]),
    }


def evaluate(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return accuracies by the number of grasps, and of objects that were left out of the training."""
    from sklearn.metrics import balanced_accuracy_score

    grasps = grasps_of(objects, settings, workers)
    held, predictor = grasps["held"], workers.share(Predictor(objects, settings, grasps))
    units: list[tuple[int | str, Rows, Rows]] = [
        *_by_size(grasps, settings),
        *_by_object(objects, grasps, settings),
    ]
    predictions = workers.gather(
        [workers.submit(_predicted, predictor, training, test) for _, training, test in units]
    )
    curve: dict[str, Any] = {}
    unseen: dict[str, dict[str, float]] = {}
    for (case, training, test), senses in zip(units, predictions, strict=True):
        for who, answer in (senses | without_senses(grasps, training, test)).items():
            if isinstance(case, int):
                share = float(np.mean(answer == held[test]))
                curve.setdefault(str(case), {}).setdefault(who, []).append(100 * share)
            else:
                right = float(balanced_accuracy_score(held[test], answer))
                unseen.setdefault(case, {})[who] = 100 * right
    return {
        "grasps": len(held),
        "held_percent": {
            objects.ids[label]: 100 * float(held[grasps["object"] == label].mean())
            for label in np.unique(grasps["object"])
        },
        "left_out_unseen": int(grasps["unseen"].sum()),
        "accuracy_percent": {size: _over(row, np.mean) for size, row in curve.items()},
        "sd_percent": {
            size: _over(row, lambda shares: np.std(shares, ddof=1)) for size, row in curve.items()
        },
        "unseen_object": unseen,
    }


def _predicted(predictor: Predictor, training: Rows, test: Rows) -> dict[str, NDArray[np.bool_]]:
    return predictor.of(training, test)


def _by_size(grasps: Grasps, settings: Settings) -> Iterator[tuple[int, Rows, Rows]]:
    """Yield how many grasps are trained on, which, and which are tested, by folds with equal shares held."""
    from sklearn.model_selection import StratifiedKFold

    folds = StratifiedKFold(settings.grasping.folds, shuffle=True, random_state=settings.seeds[0])
    split = list(folds.split(grasps["held"], grasps["held"]))
    most = min(len(training) for training, _ in split)  # folds differ by one, and are figured together
    for training, test in split:
        random = np.random.default_rng(len(test))
        for size in sorted({min(size, most) for size in settings.grasping.sizes}):
            yield size, random.permutation(training)[:size], test


def _by_object(objects: Objects, grasps: Grasps, settings: Settings) -> Iterator[tuple[str, Rows, Rows]]:
    """Yield the name of each object that is left out, grasps of the others, and its own.

    Where not each is, those that are lie evenly among all by name.
    """
    labels = np.unique(grasps["object"])
    count = min(settings.grasping.left_out or len(labels), len(labels))
    for label in labels[np.linspace(0, len(labels) - 1, count).round().astype(int)]:
        own = grasps["object"] == label
        others = np.random.default_rng(label).permutation(np.flatnonzero(~own))
        yield objects.ids[label], others[: settings.grasping.others], np.flatnonzero(own)


def _over(row: dict[str, list[float]], of: Callable[[Any], Any]) -> dict[str, float]:
    return {name: float(of(shares)) for name, shares in row.items()}
