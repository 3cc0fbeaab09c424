"""Is the Object File a faithful stand-in for the simulation?

Both answer the same queries: those that the data set stores with its ground truth. Networks are trained on
either and tested on either. And a detector, which sees more pixels, is shown both and has to tell which is
the truth. Tests are queries that are held out. So are all strikes: an Object File's sound is fitted to its
training points, where it is nearer to the truth than elsewhere.

A sense that names all objects cannot show a loss. So networks are also trained on fewer queries of each
object, by as many steps.
"""

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from learning.common_space import both_ways, fit_common_space
from learning.encoders import Arrays, Encoded, packed
from learning.metrics import interval_over_objects, mean_average_precision, means_by_object, share_interval
from learning.networks import Labelled, answers, fit_classifier
from learning.recognition import LETTERS
from learning.runs import Objects, kept
from learning.samples import SENSES, stored
from learning.settings import Settings
from learning.workers import Workers
from objectfolder.dataset import ObjectFolderDataset

SOURCES = ("truth", "object_file")
SPLITS = ("training", "validation", "test")
FITTED = ("audio",)  # senses that an Object File fits to its training queries, where a material is known


def drawn(objects: Objects, settings: Settings, sense: str, seed: int) -> dict[str, dict[str, Labelled]]:
    """Return samples by source and split; a row of one source is the same query as that of the other."""
    result: dict[str, dict[str, Labelled]] = {}
    for source in SOURCES:
        inputs_of_objects = [_inputs(objects, settings, sense, source, name, seed) for name in objects.ids]
        result[source] = {
            split: Labelled(
                torch.cat(inputs),
                torch.cat([torch.full((len(rows),), label) for label, rows in enumerate(inputs)]),
            )
            for split, inputs in zip(SPLITS, zip(*inputs_of_objects, strict=True), strict=True)
        }
    return result


def _inputs(
    objects: Objects, settings: Settings, sense: str, source: str, object_id: str, seed: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return an object's inputs of each of `SPLITS`."""
    data = settings.data
    training, resolution = getattr(data.training, sense), getattr(data.resolution, sense)

    def first(part: str, count: int) -> torch.Tensor:
        dataset = ObjectFolderDataset(objects.root, sense, part, source, objects=[object_id])
        return stored(dataset, count, seed, resolution)

    count = training + data.validation
    if sense in FITTED:
        held_out = first("held_out", data.test + count)
        test, others = held_out[: data.test], held_out[data.test :]
    else:
        test, others = first("held_out", data.test), first("training", count)
    # A data set may hold fewer views or touches than are asked for.
    learnt = len(others) * training // count
    return others[:learnt], others[learnt:], test


def _compared(objects: Objects, settings: Settings, sense: str, seed: int) -> Arrays:
    """Train on truth and on Object Files, answer both; and train a detector of truth."""
    samples = drawn(objects, settings, sense, seed)
    arrays: Arrays = {}
    for trained in SOURCES:
        own = samples[trained]
        network = fit_classifier(own["training"], own["validation"], len(objects), settings.encoder, seed)
        for tested in SOURCES:
            encodings = packed(network, samples[tested])
            arrays |= {f"{trained}/{tested}/{name}": values for name, values in encodings.items()}
        for share in settings.stand_in.training_shares:
            training = first_of_each(own["training"], share)
            longer = {"epochs": round(settings.encoder.epochs / share)}
            parameters = settings.encoder.model_copy(update=longer)
            network = fit_classifier(training, own["validation"], len(objects), parameters, seed)
            arrays[f"{share}/{trained}"] = answers(network, samples["truth"]["test"].inputs)[1].numpy()
    samples = drawn(objects, _for_detector(settings), sense, seed)
    by_source = {split: _told_apart([samples[source][split] for source in SOURCES]) for split in SPLITS}
    detector = fit_classifier(by_source["training"], by_source["validation"], 2, settings.encoder, seed)
    arrays["detector"] = answers(detector, by_source["test"].inputs)[1][:, 0].numpy()
    return arrays


def first_of_each(part: Labelled, share: float) -> Labelled:
    """Return the first samples of each object, a share of them and one at least."""
    rows = [torch.nonzero(part.labels == label)[:, 0] for label in part.labels.unique()]
    first = torch.cat([indices[: max(1, round(share * len(indices)))] for indices in rows])
    return Labelled(part.inputs[first], part.labels[first])


def _for_detector(settings: Settings) -> Settings:
    """Return the same settings with the detector's pixels: means of several hide what differs."""
    return settings.with_resolution(**settings.stand_in.detector_resolution.model_dump())


def _told_apart(sources: list[Labelled]) -> Labelled:
    """Label samples by their source: truth 0, Object File 1."""
    labels = torch.arange(len(sources)).repeat_interleave(len(sources[0].labels))
    return Labelled(torch.cat([source.inputs for source in sources]), labels)


def _encoded(arrays: Arrays, trained: str, tested: str, split: str) -> Encoded:
    return Encoded.of_arrays(arrays, f"{trained}/{tested}/{split}/")


def _retrieved(
    pair: tuple[Arrays, Arrays], trained: str, tested: str, classes: int, settings: Settings, seed: int
) -> float:
    """Return the mAP, both directions, of heads trained on one source and tested on another."""
    training, validation = (
        (_encoded(pair[0], trained, trained, split), _encoded(pair[1], trained, trained, split))
        for split in ("training", "validation")
    )
    space = fit_common_space(training, validation, classes, settings.retrieval, seed)
    test = _encoded(pair[0], trained, tested, "test"), _encoded(pair[1], trained, tested, "test")
    return float(
        np.mean(
            [
                mean_average_precision(similarity, queries.labels, gallery.labels, seed)
                for similarity, queries, gallery in both_ways(space, test)
            ]
        )
    )


def detected(logs: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return of each pair (pairs,) whether the truth looks truer than the Object File's answer; a tie is .5.

    Parameters
    ----------
    logs
        (2 pairs,) log probability of being the truth: truths first, then answers to the same queries.
    """
    truths, answers_logs = np.split(logs, 2)
    return (truths > answers_logs) + 0.5 * (truths == answers_logs)


def _kept(objects: Objects, settings: Settings, sense: str, seed: int) -> Arrays:
    """Return `_compared`, from disk where it was made before."""
    key = {
        "unit": "stand-in", "sense": sense, "seed": seed, "files": objects.digests,
        "data": settings.data.model_dump(exclude={"root", "objects"}),
        "encoder": settings.encoder.model_dump(), "stand_in": settings.stand_in.model_dump(),
    }  # fmt: skip
    return kept(__name__, key, partial(_compared, objects, settings, sense, seed))


def _trained(objects: Objects, settings: Settings, sense: str, seed: int) -> None:
    _kept(objects, settings, sense, seed)


def evaluate(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return what is lost with one source in place of the other, by sense."""
    units = [(sense, seed) for sense in SENSES for seed in settings.seeds]
    workers.gather([workers.submit(_trained, objects, settings, *unit) for unit in units])
    arrays = {unit: _kept(objects, settings, *unit) for unit in units}
    ways = [(trained, tested) for trained in SOURCES for tested in SOURCES]

    def recognised(sense: str, trained: str, tested: str) -> float:
        encodings = [_encoded(arrays[sense, seed], trained, tested, "test") for seed in settings.seeds]
        return 100 * float(np.mean([_accuracy(encoding) for encoding in encodings]))

    def retrieved(first: str, second: str, trained: str, tested: str) -> float:
        pairs = [((arrays[first, seed], arrays[second, seed]), seed) for seed in settings.seeds]
        classes = len(objects)
        precisions = [_retrieved(pair, trained, tested, classes, settings, seed) for pair, seed in pairs]
        return float(np.mean(precisions))

    return {
        "recognition": {
            LETTERS[sense]: {f"{a} to {b}": recognised(sense, a, b) for a, b in ways} for sense in SENSES
        },
        "lost_on_truth": {
            LETTERS[sense]: lost_on_truth([arrays[sense, seed] for seed in settings.seeds])
            for sense in SENSES
        },
        "fewer_queries": {
            LETTERS[sense]: {
                str(share): with_fewer([arrays[sense, seed] for seed in settings.seeds], share)
                for share in settings.stand_in.training_shares
            }
            for sense in SENSES
        },
        "retrieval": {
            LETTERS[first] + LETTERS[second]: {f"{a} to {b}": retrieved(first, second, a, b) for a, b in ways}
            for first, second in combinations(SENSES, 2)
        },
        "detector": {
            LETTERS[sense]: _detector([arrays[sense, seed] for seed in settings.seeds]) for sense in SENSES
        },
    }


def _accuracy(test: Encoded) -> float:
    return float(np.mean(_right(test)))


def _right(test: Encoded) -> NDArray[np.bool_]:
    return np.asarray(test.log_probabilities.argmax(axis=1) == test.labels)


def lost_on_truth(arrays_of_seeds: Sequence[Arrays]) -> dict[str, Any]:
    """Return how many points of recognition of the truth are lost by training on Object Files.

    Both networks are tested on the same queries: an object's loss is its mean over these and over seeds, and
    the interval of 95 % is over objects.
    """
    tests = [
        [_encoded(arrays, trained, "truth", "test") for trained in SOURCES] for arrays in arrays_of_seeds
    ]
    return _lost(np.stack([[_right(test) for test in row] for row in tests]), tests[0][0].labels)


def with_fewer(arrays_of_seeds: Sequence[Arrays], share: float) -> dict[str, Any]:
    """Return what `lost_on_truth` does, of networks trained on a share of the queries, and accuracies."""
    labels = arrays_of_seeds[0]["truth/truth/test/labels"]
    right = np.array(
        [
            [arrays[f"{share}/{trained}"].argmax(axis=1) == labels for trained in SOURCES]
            for arrays in arrays_of_seeds
        ]
    )
    accuracies = dict(zip(SOURCES, (100 * right.mean(axis=(0, 2))).tolist(), strict=True))
    return {"accuracy_percent": accuracies, **_lost(right, labels)}


def _lost(right: NDArray[np.bool_], labels: NDArray[np.int64]) -> dict[str, Any]:
    """Return the points lost, given who is right: (seeds, `SOURCES`, n) of tests of objects (n,)."""
    losses = 100 * (right[:, 0].astype(np.float64) - right[:, 1]).mean(axis=0)
    by_object = list(means_by_object(losses, labels).values())
    return {"points": float(np.mean(by_object)), "interval_points": list(interval_over_objects(by_object))}


def _detector(arrays_of_seeds: list[Arrays]) -> dict[str, Any]:
    right = np.concatenate([detected(arrays["detector"]) for arrays in arrays_of_seeds])
    labels = np.concatenate([arrays["truth/truth/test/labels"] for arrays in arrays_of_seeds])
    low, high = share_interval(list(means_by_object(right, labels).values()))
    return {"right_percent": 100 * float(np.mean(right)), "interval_percent": [100 * low, 100 * high]}
