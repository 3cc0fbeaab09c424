"""Given what one sense tells of an object, find the object by another sense.

Two heads bring the features of two senses into a common space, by a triplet loss and by naming the object:
its axes are the objects that are known. What they are compared with gets the same features: canonical
correlations, partial least squares, and naming the object, then looking it up.
"""

from collections.abc import Sequence
from itertools import combinations, permutations
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn.functional import nll_loss, normalize

from learning.encoders import Encoded, Encoder, encoded, train
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
from learning.networks import batches
from learning.recognition import LETTERS, aligned
from learning.runs import Objects
from learning.samples import SENSES
from learning.settings import Retrieval, Settings
from learning.workers import Workers

Floats = NDArray[np.float64]
RIDGES = (1e-3, 1e-2, 1e-1, 1.0)
PAIRINGS = 4
BATCH = 64
GALLERIES = 20  # draws of one positive an object


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


class CommonSpace(nn.Module):
    """Two heads that say how likely each known object is; places are the square roots of that.

    They are unit vectors, and the cosine of two is the coefficient of Bhattacharyya (1943): a touch that fits
    ten objects lies between them, where a linear space has it near one of them.
    """

    def __init__(self, inputs: Sequence[int], classes: int) -> None:
        super().__init__()
        self.scales = nn.ModuleList(nn.BatchNorm1d(size) for size in inputs)
        self.heads = nn.ModuleList(nn.Linear(size, classes) for size in inputs)

    def log_probabilities(self, side: int, features: torch.Tensor) -> torch.Tensor:
        """Return (n, classes)."""
        return torch.log_softmax(self.heads[side](self.scales[side](features)), dim=1)

    def forward(self, side: int, features: torch.Tensor) -> torch.Tensor:
        """Return unit vectors (n, classes)."""
        return (self.log_probabilities(side, features) / 2).exp()


def _triplets(
    anchors: torch.Tensor, candidates: torch.Tensor, labels: torch.Tensor, margin: float
) -> torch.Tensor:
    """Return the mean triplet loss with the farthest positive and the nearest negative of a batch."""
    similarity = anchors @ candidates.T
    same = labels[:, None] == labels
    positive = similarity.masked_fill(~same, 2).amin(dim=1)
    negative = similarity.masked_fill(same, -2).amax(dim=1)
    return torch.relu(negative - positive + margin).mean()


def fit_common_space(
    training: tuple[Encoded, Encoded],
    validation: tuple[Encoded, Encoded],
    classes: int,
    parameters: Retrieval,
    seed: int,
) -> CommonSpace:
    """Train the heads, and return the epoch with the best mAP of both directions in the validation split."""
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    sizes = [encoding.features.shape[1] for encoding in training]
    features, labels = aligned(training, PAIRINGS, seed)
    space = CommonSpace(sizes, classes)
    optimiser = torch.optim.AdamW(space.parameters(), 5e-3, weight_decay=1e-2)
    steps = parameters.epochs * -(-len(labels) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 5e-3, total_steps=steps)
    best, best_score = space.state_dict(), -1.0
    for _ in range(parameters.epochs):
        space.train()
        for rows in batches(len(labels), BATCH, random):
            joined = features[rows].split(sizes, dim=1)
            logs = [space.log_probabilities(side, part) for side, part in enumerate(joined)]
            places = [(log / 2).exp() for log in logs]
            targets = labels[rows]
            parts = [_triplets(places[i], places[1 - i], targets, parameters.margin) for i in (0, 1)]
            parts += [nll_loss(log, targets) for log in logs]
            loss = torch.stack(parts).sum()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        score = np.mean(
            [
                mean_average_precision(similarity, queries.labels, gallery.labels, seed)
                for similarity, queries, gallery in both_ways(space, validation)
            ]
        )
        if score > best_score:
            best_score = float(score)
            best = {name: value.clone() for name, value in space.state_dict().items()}
    space.load_state_dict(best)
    return space


@torch.no_grad()
def both_ways(space: CommonSpace, pair: tuple[Encoded, Encoded]) -> list[tuple[Floats, Encoded, Encoded]]:
    """Return similarity (queries, gallery), queries and gallery of both directions."""
    space.eval()
    places = [space(side, torch.from_numpy(encoding.features)) for side, encoding in enumerate(pair)]
    similarity = (places[0] @ places[1].T).double().numpy()
    return [(similarity, *pair), (similarity.T, pair[1], pair[0])]


def _cosine(first: Floats, second: Floats) -> Floats:
    a, b = (normalize(torch.from_numpy(features), dim=1) for features in (first, second))
    return (a @ b.T).numpy()


def similarities(
    pair: tuple[Encoder, Encoder], classes: int, parameters: Retrieval, seed: int
) -> dict[str, Floats]:
    """Return by method the similarity (first, second) of the test samples of two senses."""
    training, validation, test = (
        (pair[0].splits[split], pair[1].splits[split]) for split in ("training", "validation", "test")
    )
    space = fit_common_space(training, validation, classes, parameters, seed)
    sizes = [encoding.features.shape[1] for encoding in training]
    joined = aligned(training, PAIRINGS, seed)[0].split(sizes, dim=1)
    first, second = (part.double().numpy() for part in joined)

    def score(projection: Projection, over: tuple[Encoded, Encoded]) -> Floats:
        return _cosine(
            *(projection(side, encoding.features.astype(np.float64)) for side, encoding in enumerate(over))
        )

    def validated(projection: Projection) -> float:
        similarity = score(projection, validation)
        return mean_average_precision(similarity, validation[0].labels, validation[1].labels, seed)

    choices = [canonical_correlations(first, second, parameters.dimensions, ridge) for ridge in RIDGES]
    return {
        "ours": both_ways(space, test)[0][0],
        "CCA": score(max(choices, key=validated), test),
        "PLS": score(partial_least_squares(first, second, parameters.dimensions), test),
        "classify, then look up": np.exp(test[0].log_probabilities.astype(np.float64))
        @ np.exp(test[1].log_probabilities.astype(np.float64)).T,
    }


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
    """Return figures by direction and method, of objects seen in training and of unseen ones."""
    networks = [(sense, "sample", seed) for sense in SENSES for seed in settings.seeds]
    train(objects, settings, workers, networks, SENSES)
    folds = folds_of(objects, settings)
    cases: dict[str, list[tuple[str, int, tuple[int, ...]]]] = {
        "seen": [("sample", seed, ()) for seed in settings.seeds],
        "unseen": [("unseen", fold, tuple(out)) for fold, out in enumerate(folds)],
    }
    submissions = {
        name: [
            workers.submit(_directions, objects, settings, senses, *case)
            for case in cases_of_name
            for senses in combinations(SENSES, 2)
        ]
        for name, cases_of_name in cases.items()
    }
    return {
        **{name: _table(workers.gather(futures)) for name, futures in submissions.items()},
        "unseen_gallery_objects": [len(out) for out in folds],
    }


def _directions(
    objects: Objects,
    settings: Settings,
    senses: tuple[str, str],
    protocol: str,
    seed: int,
    unseen: Sequence[int],
) -> dict[str, dict[str, Scores]]:
    """Return the scores of both directions between two senses, by method."""
    first, second = (encoded(objects, settings, sense, protocol, seed, unseen) for sense in senses)
    tests = first.splits["test"], second.splits["test"]
    similarity_by_method = similarities((first, second), len(objects), settings.retrieval, seed)
    return {
        f"{LETTERS[senses[query_side]]} to {LETTERS[senses[gallery_side]]}": {
            method: scores(
                similarity if query_side == 0 else similarity.T, tests[query_side], tests[gallery_side], seed
            )
            for method, similarity in similarity_by_method.items()
        }
        for query_side, gallery_side in permutations((0, 1))
    }


def _table(runs: Sequence[dict[str, dict[str, Scores]]]) -> dict[str, Any]:
    """Return by direction the figures of each method, and by how much ours is ahead of it.

    An object's figure is its mean over runs; means and intervals are over objects.
    """
    result: dict[str, Any] = {}
    for direction in sorted({direction for run in runs for direction in run}):
        rows = [run[direction] for run in runs if direction in run]
        methods = {method: [row[method] for row in rows] for method in rows[0]}
        ours = _by_object([row.map_one_positive for row in methods["ours"]])
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
            if method != "ours":
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
