"""What shape is it? An occupancy network conditioned on an image, a strike, or both.

Conditions are what the networks of `encoders` say: the probability of each object that they know. The unit
cube hides an object's size; a linear map from their features says the size in metres.

Naming the object and returning its mesh is the first thing to compare with: on objects that were seen in
training it needs no idea of shape.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import torch
import trimesh

from learning.enclosure import Columns
from learning.encoders import Encoded, Encoder, encoded, train
from learning.folds import folds_of
from learning.likeness import Likeness, likeness
from learning.metrics import interval_over_objects
from learning.occupancy import Shapes, fit, predicted, shapes_of
from learning.recognition import aligned, name_of
from learning.runs import Objects, kept
from learning.settings import Reconstruction, Settings
from learning.shapes import overlap, volume_points
from learning.workers import Workers

VARIANTS = (("vision",), ("audio",), ("vision", "audio"))
OTHERS = 2  # meshes of other objects that the average takes for each
SHOWN = 12  # objects of a trial whose predicted mesh is kept, for the page
RIDGE = 1e-2
Pair = tuple[int, int]  # positions of an object whose mesh is an answer, and of the object that was asked for


class Measures:
    """Likeness of meshes to the objects' own, each pair of objects compared once."""

    def __init__(self, shapes: Shapes, parameters: Reconstruction) -> None:
        self.shapes, self._parameters = shapes, parameters
        self._columns = Columns(volume_points(seed=1))
        self._volumes = {label: self._columns.inside(mesh) for label, mesh in shapes.meshes.items()}
        self._pairs: dict[Pair, Likeness] = {}

    def of(self, mesh: trimesh.Trimesh | None, label: int) -> Likeness:
        """Compare a mesh with that of an object."""
        iou = 0.0 if mesh is None else overlap(self._columns.inside(mesh), self._volumes[label])
        return likeness(mesh, self.shapes.meshes[label], iou, self._parameters.surface_points, seed=0)

    def of_object(self, answer: int, label: int) -> Likeness:
        """Compare the mesh of an object with that of another, or with itself: the floor of the measure."""
        if (answer, label) not in self._pairs:
            first, second = (self.shapes.meshes[number] for number in (answer, label))
            iou = overlap(self._volumes[answer], self._volumes[label])
            self._pairs[answer, label] = likeness(first, second, iou, self._parameters.surface_points, seed=0)
        return self._pairs[answer, label]

    def keep(self, likenesses: Mapping[Pair, Likeness]) -> None:
        """Take what was found of pairs of objects elsewhere, so that `of_object` knows it."""
        self._pairs |= likenesses

    def mean(self, pairs: Sequence[Pair]) -> dict[str, float]:
        """Return the mean likeness of pairs of objects, by `Likeness`."""
        return _mean([self.of_object(*pair) for pair in pairs])

    def nearest(self, candidates: Sequence[int], label: int) -> int:
        """Return which of the known objects has the largest IoU with an object."""
        return max(candidates, key=lambda candidate: overlap(self._volumes[candidate], self._volumes[label]))


def _mean(likenesses: Sequence[Likeness]) -> dict[str, float]:
    names = Likeness.__dataclass_fields__
    return dict(zip(names, np.mean([astuple(entry) for entry in likenesses], axis=0).tolist(), strict=True))


@dataclass(frozen=True)
class Trial:
    """An occupancy network of some senses, trained on known objects and tested on some.

    Attributes
    ----------
    senses : what it is shown
    known, tested : positions of objects with a closed surface
    unseen : positions of objects that nothing was trained on; empty where all were seen
    seed : of all draws, the number of the fold where objects are unseen
    """

    objects: Objects
    settings: Settings
    measures: Measures
    senses: tuple[str, ...]
    known: tuple[int, ...]
    tested: tuple[int, ...]
    unseen: tuple[int, ...]
    seed: int

    @cached_property
    def encoders(self) -> list[Encoder]:
        """The networks of the senses."""
        protocol = "unseen" if self.unseen else "sample"
        return [
            encoded(self.objects, self.settings, sense, protocol, self.seed, self.unseen)
            for sense in self.senses
        ]

    def features(self, split: str) -> tuple[torch.Tensor, torch.Tensor]:
        """Return features of the senses together (n, sum of features), and labels."""
        return aligned([encoder.splits[split] for encoder in self.encoders], 1, self.seed)

    def conditions(self, split: str) -> tuple[torch.Tensor, torch.Tensor]:
        """Return `object_probabilities` of the senses, and labels."""
        return object_probabilities([encoder.splits[split] for encoder in self.encoders], self.seed)

    @cached_property
    def predictions(self) -> dict[str, np.ndarray]:
        """Likenesses (tests, 3), and the first predicted mesh of each object of `shown`, by its position."""
        settings = self.settings
        key = {
            "unit": "reconstruction", "senses": self.senses, "known": self.known, "tested": self.tested,
            "unseen": self.unseen, "seed": self.seed, "files": self.objects.digests,
            "shared_draws": settings.seeds[0] if self.unseen else None,
            "data": settings.data.model_dump(exclude={"root", "objects"}),
            "encoder": settings.encoder.model_dump(),
            "reconstruction": settings.reconstruction.model_dump(exclude={"folds"}),
        }  # fmt: skip
        return kept(__name__, key, self._predict)

    def _predict(self) -> dict[str, np.ndarray]:
        parameters = self.settings.reconstruction
        network = fit(*self.conditions("training"), self.measures.shapes, self.known, parameters, self.seed)
        conditions, labels = self.conditions("test")
        likenesses: list[tuple[float, ...]] = []
        arrays: dict[str, np.ndarray] = {}
        for label in self.tested:
            rows = np.flatnonzero(labels.numpy() == label)[: parameters.tests]
            meshes = predicted(network, conditions[rows], parameters.grid)
            likenesses += [astuple(self.measures.of(mesh, label)) for mesh in meshes]
            first = meshes[0]
            if label in self.shown and first is not None:
                # Of 256 cells a mesh has some 20 MB as doubles.
                arrays[f"{label}/vertices"] = first.vertices.astype(np.float32)
                arrays[f"{label}/faces"] = first.faces.astype(np.int32)
        return {"likeness": np.array(likenesses), **arrays}

    @property
    def shown(self) -> tuple[int, ...]:
        """Positions of the objects whose predicted mesh is kept."""
        return self.tested[:SHOWN]

    def mesh(self, label: int) -> trimesh.Trimesh | None:
        """Return the first mesh that was predicted of an object of `shown`; None if it was empty."""
        if f"{label}/faces" not in self.predictions:
            return None
        vertices, faces = (self.predictions[f"{label}/{name}"] for name in ("vertices", "faces"))
        return trimesh.Trimesh(vertices, faces, process=False)

    def likenesses(self) -> list[Likeness]:
        """Return the likeness of each prediction, an object's predictions one after another."""
        return [Likeness(*row) for row in self.predictions["likeness"].tolist()]

    def lookup_pairs(self) -> list[Pair]:
        """Return the object that the senses name for each prediction, as `likenesses`."""
        return [(answer, label) for label in self.tested for answer in self._answers(label)]

    def nearest_pairs(self) -> list[Pair]:
        """Return the known object whose shape is nearest to each of those tested."""
        return [(self.measures.nearest(self.known, label), label) for label in self.tested]

    def size_error(self) -> float:
        """Return the mean error of the size that the senses say, as a share of the size."""
        lengths_m = [file.frame.scale for file in self.objects.files.values()]
        return size_error(self.features("training"), self.features("test"), lengths_m)

    def _answers(self, label: int) -> list[int]:
        """Return the known objects that the senses together name for draws of an object's samples."""
        random = np.random.default_rng(self.seed)
        logs = np.zeros((self.settings.reconstruction.tests, len(self.objects)))
        for encoder in self.encoders:
            test = encoder.splits["test"]
            logs += test.log_probabilities[random.choice(np.flatnonzero(test.labels == label), len(logs))]
        return [self.known[best] for best in logs[:, list(self.known)].argmax(axis=1)]


def figures(trials_of_seeds: Sequence[Trial]) -> dict[str, Any]:
    """Return what was reached on the same objects with several seeds, and what it is compared with."""
    ious = np.array([[likeness.iou for likeness in trial.likenesses()] for trial in trials_of_seeds])
    tested = trials_of_seeds[0].tested
    by_object = ious.reshape(len(ious), len(tested), -1).mean(axis=(0, 2))
    measures = trials_of_seeds[0].measures
    look_up = [pair for trial in trials_of_seeds for pair in trial.lookup_pairs()]
    return {
        "ours": _mean([likeness for trial in trials_of_seeds for likeness in trial.likenesses()]),
        "iou_interval": list(interval_over_objects(by_object)) if len(tested) > 1 else None,
        "iou_sd": float(ious.mean(axis=1).std(ddof=1)) if len(ious) > 1 else None,
        "look_up": measures.mean(look_up),
        "nearest_known": measures.mean(trials_of_seeds[0].nearest_pairs()),
        "size_error_share": float(np.mean([trial.size_error() for trial in trials_of_seeds])),
        "objects": len(tested),
    }


def object_probabilities(encodings: Sequence[Encoded], seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return square roots of the probability of each object by several senses (n, objects), and labels (n,).

    Senses are taken as independent. Roots are unit vectors, as the places of `retrieval.CommonSpace`.
    """
    logs, labels = aligned(
        [replace(encoding, features=encoding.log_probabilities) for encoding in encodings], 1, seed
    )
    together = torch.stack(logs.chunk(len(encodings), dim=1)).sum(dim=0)
    return (torch.log_softmax(together, dim=1) / 2).exp(), labels


def size_error(
    training: tuple[torch.Tensor, torch.Tensor],
    test: tuple[torch.Tensor, torch.Tensor],
    lengths_m: Sequence[float],
) -> float:
    """Return the mean error of the size that a linear map of the features says, as a share of the size."""
    mean, scale = training[0].mean(dim=0), training[0].std(dim=0) + 1e-6
    x, u = (((features - mean) / scale).double().numpy() for features, _ in (training, test))
    y, v = (np.log([lengths_m[label] for label in labels.tolist()]) for _, labels in (training, test))
    weights = np.linalg.solve(x.T @ x + RIDGE * len(x) * np.eye(x.shape[1]), x.T @ (y - y.mean()))
    return float(np.mean(np.expm1(np.abs(u @ weights + y.mean() - v))))


def trials(objects: Objects, settings: Settings) -> Iterator[Trial]:
    """Yield what is tried, by each of `VARIANTS`: all objects seen by each seed, folds of unseen ones."""
    measures = Measures(shapes_of(objects), settings.reconstruction)
    closed = tuple(measures.shapes.meshes)
    for seed in settings.seeds:
        for senses in VARIANTS:
            yield Trial(objects, settings, measures, senses, closed, closed, (), seed)
    for fold, out in enumerate(folds_of(objects, settings)[: settings.reconstruction.folds]):
        known = tuple(label for label in closed if label not in out)
        tested = tuple(label for label in closed if label in out)
        for senses in VARIANTS:
            if tested:
                yield Trial(objects, settings, measures, senses, known, tested, tuple(out), fold)


@lru_cache(maxsize=1)
def _tried(objects: Objects, settings: Settings) -> list[Trial]:
    """Return all of `trials`, whose shapes take a while."""
    return list(trials(objects, settings))


def _predict_trial(objects: Objects, settings: Settings, number: int) -> None:
    _ = _tried(objects, settings)[number].predictions


def _likeness_of_objects(objects: Objects, settings: Settings, answer: int, label: int) -> Likeness:
    return _tried(objects, settings)[0].measures.of_object(answer, label)


def _others(labels: Sequence[int], seed: int) -> list[Pair]:
    """Return for each object `OTHERS` other ones, drawn by a seed."""
    random = np.random.default_rng(seed)
    return [
        (int(answer), label)
        for label in labels
        for answer in random.permutation([other for other in labels if other != label])[:OTHERS]
    ]


def evaluate(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return likenesses by senses and by what they are compared with, of seen and of unseen objects."""
    tried = _tried(objects, settings)
    senses = sorted({sense for variant in VARIANTS for sense in variant})
    networks = [(sense, "sample", seed) for sense in senses for seed in settings.seeds]
    train(objects, settings, workers, networks, senses, settings.reconstruction.folds)
    workers.gather(
        [workers.submit(_predict_trial, objects, settings, number) for number in range(len(tried))]
    )
    measures, closed = tried[0].measures, tried[0].known
    floor, others = [(label, label) for label in closed], _others(closed, settings.seeds[0])
    answers = [pair for trial in tried for pair in (*trial.lookup_pairs(), *trial.nearest_pairs())]
    pairs = sorted({*floor, *others, *answers})
    # Unlike shapes take over a CPU-second a pair, and a hundred objects have hundreds of pairs.
    units = [workers.submit(_likeness_of_objects, objects, settings, *pair) for pair in pairs]
    measures.keep(dict(zip(pairs, workers.gather(units), strict=True)))
    result: dict[str, Any] = {
        "left_out_open": [name for label, name in enumerate(objects.ids) if label not in closed],
        "floor": measures.mean(floor),
        "average_of_others": measures.mean(others),
        "seen": {},
        "unseen": {},
    }
    for senses_of_trial in VARIANTS:
        name, own = name_of(senses_of_trial), [trial for trial in tried if trial.senses == senses_of_trial]
        result["seen"][name] = figures([trial for trial in own if not trial.unseen])
        if unseen := [figures([trial]) for trial in own if trial.unseen]:
            result["unseen"][name] = unseen
    return result
