"""Will the object be held? From an image, from both gels, and from both senses, before it is lifted.

Networks are those of `recognition`, one a sense, joined on their features. Beside them stands what needs no
sense: the commoner answer, that of each object, and boosted trees that know force and pose.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import balanced_accuracy_score
from sklearn.model_selection import StratifiedKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from learning.grasping import world
from learning.networks import Labelled, answers, fit_classifier
from learning.runs import Objects, digest, kept
from learning.samples import pictures
from learning.settings import Settings
from objectfolder.object_file import ObjectFile
from objectfolder.products.provenance import seed_from

VALIDATION_SHARE = 0.15
FUSION_STRENGTH = 0.01  # of the linear layer that joins the senses, inverse of its penalty
Rows = NDArray[np.int64]
Grasps = dict[str, NDArray[Any]]


def grasps_of(objects: Objects, settings: Settings) -> Grasps:
    """Return grasps of all objects with a mass as `world.attempts`, and ``object``, their positions (n,)."""
    asked, made = settings.grasping, []
    for label, (object_id, file) in enumerate(objects.files.items()):
        if file.description["body"] is None:
            continue
        seed = seed_from(settings.seeds[0], "grasps", object_id)
        key = {
            "unit": "grasps", "object": object_id, "seed": seed, "count": asked.grasps, "parts": world.PARTS,
            "resolution": settings.data.resolution, "files": objects.digests[object_id], "code": _code(),
        }  # fmt: skip
        attempt = partial(_attempted, file, asked.grasps, seed, settings.data.resolution)
        made.append({**kept(key, attempt), "object": np.full(asked.grasps, label)})
    return {name: np.concatenate([np.atleast_1d(one[name]) for one in made]) for name in made[0]}


def _attempted(file: ObjectFile, count: int, seed: int, pixels: int) -> Grasps:
    return world.attempts(world.world_of(file), file, count, seed, pixels)


def _code() -> list[str]:
    """Return digests of the code that grasps and predicts."""
    return [digest(Path(module)) for module in (world.__file__, __file__)]


def inputs_of(grasps: Grasps, resolution: int) -> dict[str, torch.Tensor]:
    """Return what networks see: images (n, 3, h, w), and both gels side by side as (n, 6, h, w)."""
    image = torch.from_numpy(grasps["image"]).permute(0, 3, 1, 2).float() / 255
    left, right = (torch.from_numpy(grasps["touch"][:, side]).permute(0, 3, 1, 2) for side in (0, 1))
    touch = torch.cat([pictures(gel.float() / 255, resolution) for gel in (left, right)], dim=1)
    return {"V": image, "T": touch}


class Predictor:
    """What networks say of grasps, trained on some of them.

    Parameters
    ----------
    grasps
        Of `grasps_of`.
    """

    def __init__(self, objects: Objects, settings: Settings, grasps: Grasps) -> None:
        self._held, self._settings = grasps["held"], settings
        self._inputs = inputs_of(grasps, settings.data.resolution)
        self._key = {
            "unit": "stability", "files": objects.digests, "seed": settings.seeds[0], "parts": world.PARTS,
            "resolution": settings.data.resolution, "encoder": settings.encoder.model_dump(),
            "count": settings.grasping.grasps, "code": _code(),
        }  # fmt: skip

    def of(self, training: Rows, test: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return whether the test's are held, by each sense and by both."""
        rows = {"training": training.tolist(), "test": test.tolist()}
        return kept(self._key | rows, lambda: self._trained(training, test))

    def _trained(self, training: Rows, test: Rows) -> dict[str, NDArray[np.bool_]]:
        labels, seed = torch.from_numpy(self._held.astype(np.int64)), self._settings.seeds[0]
        order = np.random.default_rng(seed).permutation(training)
        checks = max(2, round(VALIDATION_SHARE * len(order)))
        features: list[tuple[NDArray[Any], NDArray[Any]]] = []
        said = {}
        for sense, values in self._inputs.items():
            learnt, checked = (
                Labelled(values[rows], labels[rows]) for rows in (order[checks:], order[:checks])
            )
            network = fit_classifier(learnt, checked, 2, self._settings.encoder, seed)
            known, _ = answers(network, values[training])
            asked, logs = answers(network, values[test])
            features.append((known.numpy(), asked.numpy()))
            said[sense] = logs.argmax(dim=1).numpy() == 1
        model = make_pipeline(StandardScaler(), LogisticRegression(C=FUSION_STRENGTH))
        both, of_both = (np.hstack(parts) for parts in zip(*features, strict=True))
        return said | {"VT": _fitted(model, both, self._held[training], of_both)}


def _fitted(
    model: Any, known: NDArray[Any], held: NDArray[np.bool_], asked: NDArray[Any]
) -> NDArray[np.bool_]:
    return np.asarray(model.fit(known, held).predict(asked), dtype=bool)


def without_senses(grasps: Grasps, training: Rows, test: Rows) -> dict[str, NDArray[np.bool_]]:
    """Return the commoner answer, the commoner of each object, and that of trees that know what was done."""
    held, objects = grasps["held"], grasps["object"]
    common = held[training].mean() >= 0.5
    of_object = {
        label: held[training][objects[training] == label].mean() >= 0.5
        for label in np.unique(objects[training])
    }
    done = np.column_stack([grasps["grasp"], objects])
    return {
        "majority": np.full(len(test), common),
        "majority of the object": np.array([of_object.get(label, common) for label in objects[test]]),
        "trees on force and pose": _fitted(
            HistGradientBoostingClassifier(random_state=0), done[training], held[training], done[test]
        ),
    }


def _folds(grasps: Grasps, settings: Settings) -> Iterator[tuple[Rows, Rows]]:
    """Yield training and test rows, equal shares of them held."""
    folds = StratifiedKFold(settings.grasping.folds, shuffle=True, random_state=settings.seeds[0])
    yield from folds.split(grasps["held"], grasps["held"])


def evaluate(objects: Objects, settings: Settings) -> dict[str, Any]:
    """Return accuracies by the number of grasps, and of objects that were left out of the training."""
    grasps = grasps_of(objects, settings)
    held, predictor = grasps["held"], Predictor(objects, settings, grasps)
    curve: dict[str, Any] = {}
    for training, test in _folds(grasps, settings):
        random = np.random.default_rng(len(test))
        for size in sorted({min(size, len(training)) for size in settings.grasping.sizes}):
            rows = random.permutation(training)[:size]
            said = predictor.of(rows, test) | without_senses(grasps, rows, test)
            for name, answer in said.items():
                share = float(np.mean(answer == held[test]))
                curve.setdefault(str(size), {}).setdefault(name, []).append(100 * share)
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
        "unseen_object": _unseen_objects(objects, grasps, predictor),
    }


def _over(row: dict[str, list[float]], of: Callable[[Any], Any]) -> dict[str, float]:
    return {name: float(of(shares)) for name, shares in row.items()}


def _unseen_objects(objects: Objects, grasps: Grasps, predictor: Predictor) -> dict[str, dict[str, float]]:
    """Return balanced accuracies in percent on each object, all others being known."""
    result = {}
    for label in np.unique(grasps["object"]):
        mine = grasps["object"] == label
        training, test = np.flatnonzero(~mine), np.flatnonzero(mine)
        said = predictor.of(training, test) | without_senses(grasps, training, test)
        result[objects.ids[label]] = {
            who: 100 * float(balanced_accuracy_score(grasps["held"][test], answer))
            for who, answer in said.items()
        }
    return result
