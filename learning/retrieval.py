"""Given what one sense tells of an object, find the object by another sense.

Two heads bring the features of two senses into a common space (`common_space`), whose axes are the known
objects. What they are compared with gets the same features: a space of free axes, canonical correlations,
partial least squares, and naming the object, then looking it up. Canonical correlations are also taken of
inputs that no network was trained on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import softmax
from torch.nn.functional import normalize

from learning.common_space import PAIRINGS, SPACES, Pair, both_ways, fit_common_space
from learning.encoders import SPLITS, Encoded, Encoder, encoded, train
from learning.end_to_end import end_to_end_similarity
from learning.folds import folds_of
from learning.metrics import (
    average_precisions,
    chance_average_precision,
    interval_over_objects,
    mean_average_precision,
    means_by_object,
    one_positive_galleries,
    share_interval,
)
from learning.neighbours import with_neighbours
from learning.recognition import LETTERS, aligned
from learning.runs import Objects
from learning.samples import SENSES
from learning.settings import Retrieval, Settings
from learning.workers import Workers

Floats = NDArray[np.float64]
RIDGES = (1e-3, 1e-2, 1e-1, 1.0)
GALLERIES = 20  # draws of one positive an object
END_TO_END = "end_to_end"


@dataclass(frozen=True)
class Case:
    """What networks and a common space are trained on; see `learning.encoders.encoded`.

    Attributes
    ----------
    touch_protocol : of touch, where it differs from that of the other senses
    end_to_end : whether networks are trained for retrieval alone as well
    """

    protocol: str
    seed: int
    unseen: tuple[int, ...] = ()
    touch_protocol: str | None = None
    end_to_end: bool = False

    def protocol_of(self, sense: str) -> str:
        """Return the protocol of a sense."""
        return self.touch_protocol or self.protocol if sense == "touch" else self.protocol


class Projection(NamedTuple):
    """Linear maps of two senses into a common space: (features, dimensions) each, after mean and scale."""

    means: tuple[Floats, Floats]
    maps: tuple[Floats, Floats]

    def __call__(self, side: int, features: NDArray[Any]) -> Floats:
        """Return places (n, dimensions) of features of one of the two senses."""
        return (features - self.means[side]) @ self.maps[side]


def canonical_correlations(first: Floats, second: Floats, dimensions: int, ridge: float) -> Projection:
    """Return the directions of largest correlation, in closed form (Hotelling 1936; ridge: Vinod 1976).

    Parameters
    ----------
    first, second
        (n, features) of pairs.
    ridge
        Added to the variances, as a share of their mean.
    """
    means = first.mean(axis=0), second.mean(axis=0)
    a, b = first - means[0], second - means[1]
    whitened = [_inverse_root(x.T @ x / len(x), ridge) for x in (a, b)]
    left, correlations, right = np.linalg.svd(whitened[0] @ (a.T @ b / len(a)) @ whitened[1])
    count = min(dimensions, len(correlations))
    # Weighted by its correlation, a direction that says little counts little.
    return Projection(
        means,
        (
            whitened[0] @ left[:, :count] * correlations[:count],
            whitened[1] @ right[:count].T * correlations[:count],
        ),
    )


def partial_least_squares(first: Floats, second: Floats, dimensions: int) -> Projection:
    """Return the directions of largest covariance of standardised features (Bookstein's PLS by SVD)."""
    means = first.mean(axis=0), second.mean(axis=0)
    scales = [1 / (x.std(axis=0) + 1e-9) for x in (first, second)]
    a, b = (first - means[0]) * scales[0], (second - means[1]) * scales[1]
    left, _, right = np.linalg.svd(a.T @ b)
    return Projection(
        means, (scales[0][:, None] * left[:, :dimensions], scales[1][:, None] * right[:dimensions].T)
    )


def _inverse_root(covariance: Floats, ridge: float) -> Floats:
    values, vectors = np.linalg.eigh(covariance)
    floor = ridge * values.mean() + 1e-12
    return (vectors / np.sqrt(np.maximum(values, 0) + floor)) @ vectors.T


def similarities(
    pair: tuple[Encoder, Encoder], classes: int, parameters: Retrieval, seed: int
) -> dict[str, Floats]:
    """Return by method the similarity (first, second) of the test samples of two senses."""
    splits = [(pair[0].splits[split], pair[1].splits[split]) for split in SPLITS]
    averaged = [(_averaged(first), _averaged(second)) for first, second in splits]
    training, validation, test = splits
    joined = _joined(training, seed)
    spaces = {
        method: fit_common_space(training, validation, classes, parameters, seed, kind)
        for method, kind in SPACES.items()
    }
    return {
        **{method: both_ways(space, test)[0][0] for method, space in spaces.items()},
        "CCA": _correlated(splits, parameters, seed),
        "CCA of averaged inputs": _correlated(averaged, parameters, seed),
        "PLS": _projected(partial_least_squares(*joined, parameters.dimensions), test),
        "classify, then look up": _looked_up(test),
        "classify by neighbours too, then look up": _looked_up(
            tuple(with_neighbours(encoder).splits["test"] for encoder in pair)
        ),
    }


def _looked_up(test: Sequence[Encoded]) -> Floats:
    """Return how likely two samples (first, second) are of one object, by what each is taken for."""
    first, second = (softmax(encoding.log_probabilities.astype(np.float64), axis=1) for encoding in test)
    return np.asarray(first @ second.T)


def _averaged(encoding: Encoded) -> Encoded:
    """Return what is encoded with features that no training has seen."""
    return replace(encoding, features=encoding.averaged_inputs)


def _joined(training: Pair, seed: int) -> tuple[Floats, Floats]:
    """Return features (n, ...) of two senses whose rows are of the same object."""
    sizes = [encoding.features.shape[1] for encoding in training]
    first, second = aligned(training, PAIRINGS, seed)[0].split(sizes, dim=1)
    return first.double().numpy(), second.double().numpy()


def _projected(projection: Projection, pair: Pair) -> Floats:
    """Return the cosine (first, second) of what two senses are projected to."""
    places = [projection(side, encoding.features.astype(np.float64)) for side, encoding in enumerate(pair)]
    first, second = (normalize(torch.from_numpy(place), dim=1) for place in places)
    return (first @ second.T).numpy()


def _correlated(splits: Sequence[Pair], parameters: Retrieval, seed: int) -> Floats:
    """Return the similarity (first, second) of the test by canonical correlations of the training.

    The ridge is the one with the best mAP of the validation split.
    """
    training, validation, test = splits
    joined = _joined(training, seed)
    choices = [canonical_correlations(*joined, parameters.dimensions, ridge) for ridge in RIDGES]

    def validated(projection: Projection) -> float:
        similarity = _projected(projection, validation)
        return mean_average_precision(similarity, validation[0].labels, validation[1].labels, seed)

    return _projected(max(choices, key=validated), test)


class Scores(NamedTuple):
    """Mean average precisions of the queries of each object, by its label, and their chances.

    ``map`` ranks the whole gallery, ``map_one_positive`` galleries with one item of each object.
    """

    map: dict[int, float]
    chance: float
    map_one_positive: dict[int, float]
    chance_one_positive: float


def scores(similarity: Floats, queries: Encoded, gallery: Encoded, seed: int) -> Scores:
    """Return what a similarity (queries, gallery) of test samples is worth."""
    labels = queries.labels
    single = [
        average_precisions(similarity[:, items], labels, gallery.labels[items], seed)
        for items in one_positive_galleries(gallery.labels, GALLERIES, seed)
    ]
    return Scores(
        map=means_by_object(average_precisions(similarity, labels, gallery.labels, seed), labels),
        chance=chance_average_precision(labels, gallery.labels),
        map_one_positive=means_by_object(np.mean(single, axis=0), labels),
        chance_one_positive=chance_average_precision(labels, np.unique(gallery.labels)),
    )


def evaluate(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return figures by direction and method.

    They are of objects seen in training, of the same with touches at vertices as published, of unseen
    objects, and of unseen ones with networks that are trained for retrieval alone.
    """
    networks = [
        *((sense, "sample", seed) for sense in SENSES for seed in settings.seeds),
        *(("touch", "vertex", seed) for seed in settings.seeds),
    ]
    train(objects, settings, workers, networks, SENSES)
    folds = folds_of(objects, settings)
    seen = [Case("sample", seed) for seed in settings.seeds]
    at_vertices = [replace(case, touch_protocol="vertex") for case in seen]
    unseen = [Case("unseen", fold, tuple(out)) for fold, out in enumerate(folds)]
    whole = [replace(case, end_to_end=True) for case in unseen[: settings.retrieval.end_to_end_folds]]
    cases = {"seen": seen, "at_vertices": at_vertices, "unseen": unseen, END_TO_END: whole}
    submissions = {
        name: [
            workers.submit(_directions, objects, settings, senses, case)
            for case in cases_of_name
            for senses in combinations(SENSES, 2)
            if name != "at_vertices" or "touch" in senses
        ]
        for name, cases_of_name in cases.items()
    }
    return {
        **{
            name: _table(workers.gather(futures), name if name == END_TO_END else "ours")
            for name, futures in submissions.items()
        },
        "unseen_gallery_objects": [len(out) for out in folds],
    }


def _directions(
    objects: Objects, settings: Settings, senses: tuple[str, str], case: Case
) -> dict[str, dict[str, Scores]]:
    """Return the scores of both directions between two senses, by method."""
    first, second = (
        encoded(objects, settings, sense, case.protocol_of(sense), case.seed, case.unseen) for sense in senses
    )
    tests = first.splits["test"], second.splits["test"]
    similarity_by_method = similarities((first, second), len(objects), settings.retrieval, case.seed)
    if case.end_to_end:
        whole = end_to_end_similarity(objects, settings, senses, case.protocol, case.seed, case.unseen)
        similarity_by_method[END_TO_END] = whole
    return {
        f"{LETTERS[senses[query_side]]} to {LETTERS[senses[gallery_side]]}": {
            method: scores(
                similarity if query_side == 0 else similarity.T,
                tests[query_side],
                tests[gallery_side],
                case.seed,
            )
            for method, similarity in similarity_by_method.items()
        }
        for query_side, gallery_side in permutations((0, 1))
    }


def _table(runs: Sequence[dict[str, dict[str, Scores]]], own_method: str) -> dict[str, Any]:
    """Return by direction the figures of each method, and by how much our own is ahead of it.

    An object's figure is its mean over runs; means and intervals are over objects.
    """
    result: dict[str, Any] = {}
    for direction in sorted({direction for run in runs for direction in run}):
        rows = [run[direction] for run in runs if direction in run]
        methods = {method: [row[method] for row in rows] for method in rows[0]}
        ours = _by_object([row.map_one_positive for row in methods[own_method]])
        result[direction] = {}
        for method, own_rows in methods.items():
            single = _by_object([row.map_one_positive for row in own_rows])
            figures: dict[str, Any] = {
                "map": float(_by_object([row.map for row in own_rows]).mean()),
                "chance": float(np.mean([row.chance for row in own_rows])),
                "map_one_positive": float(single.mean()),
                "map_one_positive_interval": list(share_interval(single)),
                "chance_one_positive": float(np.mean([row.chance_one_positive for row in own_rows])),
            }
            if method != own_method:
                figures |= {
                    "ours_ahead": float((ours - single).mean()),
                    "ours_ahead_interval": list(interval_over_objects(ours - single)),
                }
            result[direction][method] = figures
    return result


def _by_object(rows: Sequence[dict[int, float]]) -> Floats:
    """Return each object's mean over the runs that it was a query of, in the order of labels."""
    labels = sorted({label for row in rows for label in row})
    return np.array([np.mean([row[label] for row in rows if label in row]) for label in labels])
