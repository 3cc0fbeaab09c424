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

from learning.common_space import Pair, both_ways, fit_common_space
from learning.encoders import Arrays, Encoded, packed
from learning.metrics import interval_over_objects, mean_average_precision, means_by_object, share_interval
from learning.networks import Labelled, answers, fit_classifier
from learning.recognition import LETTERS, name_of
from learning.runs import Objects, kept
from learning.samples import SENSES, stored
from learning.settings import Settings
from learning.workers import Workers
from objectfolder.dataset import ObjectFolderDataset

SOURCES = ("truth", "object_file")
SPLITS = ("training", "validation", "test")
FITTED = ("audio",)  # senses that an Object File fits to its training queries, where a material is known


def drawn(
    objects: Objects, settings: Settings, sense: str, seed: int, resolutions: Sequence[int]
) -> list[dict[str, dict[str, Labelled]]]:
    """Return samples by resolution, source and split; a row of either source is the same query."""
    result: list[dict[str, dict[str, Labelled]]] = [{} for _ in resolutions]
    for source in SOURCES:
        inputs_of_objects = [
            _inputs(objects, settings, sense, source, name, seed, resolutions) for name in objects.ids
        ]
        for samples, inputs_by_split in zip(result, zip(*inputs_of_objects, strict=True), strict=True):
            samples[source] = {
                split: Labelled(
                    torch.cat(inputs),
                    torch.cat([torch.full((len(rows),), label) for label, rows in enumerate(inputs)]),
                )
                for split, inputs in zip(SPLITS, zip(*inputs_by_split, strict=True), strict=True)
            }
    return result


def _inputs(
    objects: Objects,
    settings: Settings,
    sense: str,
    source: str,
    object_id: str,
    seed: int,
    resolutions: Sequence[int],
) -> list[tuple[torch.Tensor, ...]]:
    """Return an object's inputs by resolution, of each of `SPLITS`."""
    data = settings.data
    training = getattr(data.training, sense)

    def first(part: str, count: int) -> list[torch.Tensor]:
        dataset = ObjectFolderDataset(objects.root, sense, part, source, objects=[object_id])
        return stored(dataset, count, seed, resolutions)

    count = training + data.validation
    if sense in FITTED:
        held_out = first("held_out", data.test + count)
        pairs = [(inputs[: data.test], inputs[data.test :]) for inputs in held_out]
    else:
        pairs = list(zip(first("held_out", data.test), first("training", count), strict=True))
    # A data set may hold fewer views or touches than are asked for.
    split = len(pairs[0][1]) * training // count
    return [(remainder[:split], remainder[split:], test) for test, remainder in pairs]


def _compared(objects: Objects, settings: Settings, sense: str, seed: int) -> Arrays:
    """Train on truth and on Object Files, answer both; and train a detector of truth."""
    parameters = settings.encoder
    resolutions = [
        getattr(sides, sense) for sides in (settings.data.resolution, settings.stand_in.detector_resolution)
    ]
    samples, finer = drawn(objects, settings, sense, seed, resolutions)
    by_source = {split: _told_apart([finer[source][split] for source in SOURCES]) for split in SPLITS}
    del finer  # gigabytes of a hundred objects
    detector = fit_classifier(by_source["training"], by_source["validation"], 2, parameters, seed)
    arrays: Arrays = {"detector": answers(detector, by_source["test"].inputs)[1][:, 0].numpy()}
    del by_source
    for trained in SOURCES:
        own = samples[trained]
        network = fit_classifier(own["training"], own["validation"], len(objects), parameters, seed)
        for tested in SOURCES:
            encodings = packed(network, samples[tested])
            arrays |= {f"{trained}/{tested}/{name}": values for name, values in encodings.items()}
        for share in settings.stand_in.training_shares:
            training = first_of_each(own["training"], share)
            network = fit_classifier(training, own["validation"], len(objects), parameters, seed)
            arrays[f"{share}/{trained}"] = answers(network, samples["truth"]["test"].inputs)[1].numpy()
    return arrays


def first_of_each(part: Labelled, share: float) -> Labelled:
    """Return the first samples of each object, a share of them and one at least, as often as all would be."""
    rows = []
    for label in part.labels.unique():
        own = torch.nonzero(part.labels == label)[:, 0]
        rows.append(own[torch.arange(len(own)) % max(1, round(share * len(own)))])
    indices = torch.cat(rows)
    return Labelled(part.inputs[indices], part.labels[indices])


def _told_apart(sources: list[Labelled]) -> Labelled:
    """Label samples by their source: truth 0, Object File 1."""
    labels = torch.arange(len(sources)).repeat_interleave(len(sources[0].labels))
    return Labelled(torch.cat([source.inputs for source in sources]), labels)


def _encoded(arrays: Arrays, trained: str, tested: str, split: str) -> Encoded:
    return Encoded.of_arrays(arrays, f"{trained}/{tested}/{split}/")


def _retrieved(
    objects: Objects, settings: Settings, senses: tuple[str, str], trained: str, seed: int
) -> dict[str, float]:
    """Return by the tested source the mAP, both directions, of heads trained on one source."""
    arrays = [_kept(objects, settings, sense, seed) for sense in senses]

    def pair(tested: str, split: str) -> Pair:
        first, second = (_encoded(own, trained, tested, split) for own in arrays)
        return first, second

    splits = pair(trained, "training"), pair(trained, "validation")
    space = fit_common_space(*splits, len(objects), settings.retrieval, seed)
    return {
        tested: float(
            np.mean(
                [
                    mean_average_precision(similarity, queries.labels, gallery.labels, seed)
                    for similarity, queries, gallery in both_ways(space, pair(tested, "test"))
                ]
            )
        )
        for tested in SOURCES
    }


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

    def recognised(sense: str, trained: str, tested: str) -> float:
        encodings = [_encoded(arrays[sense, seed], trained, tested, "test") for seed in settings.seeds]
        return 100 * float(np.mean([_accuracy(encoding) for encoding in encodings]))

    cases = [(pair, trained) for pair in combinations(SENSES, 2) for trained in SOURCES]
    submissions = {
        case: [workers.submit(_retrieved, objects, settings, *case, seed) for seed in settings.seeds]
        for case in cases
    }
    precisions = {case: workers.gather(futures) for case, futures in submissions.items()}

    def retrieved(pair: tuple[str, str], trained: str, tested: str) -> float:
        return float(np.mean([by_tested[tested] for by_tested in precisions[pair, trained]]))

    ways = [(trained, tested) for trained in SOURCES for tested in SOURCES]
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
            name_of(pair): {f"{a} to {b}": retrieved(pair, a, b) for a, b in ways}
            for pair in combinations(SENSES, 2)
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
