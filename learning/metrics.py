"""What the tasks are measured by."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, bootstrap

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]
RESAMPLES = 10_000


def binomial_interval(hits: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a share by Clopper and Pearson (1934)."""
    tail = (1 - level) / 2
    low = beta.ppf(tail, hits, trials - hits + 1) if hits else 0.0
    high = beta.ppf(1 - tail, hits + 1, trials - hits) if hits < trials else 1.0
    return float(low), float(high)


def means_by_object(values: Floats, labels: Labels) -> dict[int, float]:
    """Return the mean of each object's tests.

    Parameters
    ----------
    values, labels
        (n,) of each test.
    """
    return {label: float(np.mean(values[labels == label])) for label in np.unique(labels).tolist()}


def interval_over_objects(means: Sequence[float] | Floats, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a mean over objects, by resampling objects.

    Tests of one object are not independent: the object is the unit. The bootstrap is that of Efron (1987),
    bias-corrected and accelerated. Objects that are all alike have an interval without length.

    Parameters
    ----------
    means
        The mean of each object's tests.

    Raises
    ------
    ValueError
        Fewer than two objects.
    """
    values = np.asarray(means, dtype=np.float64)
    if len(values) < 2:
        raise ValueError(f"{len(values)} objects; an interval over objects needs two")
    if np.ptp(values) == 0:
        return float(values[0]), float(values[0])
    answer = bootstrap((values,), np.mean, confidence_level=level, n_resamples=RESAMPLES, rng=0)
    return float(answer.confidence_interval.low), float(answer.confidence_interval.high)


def share_interval(shares: Sequence[float] | Floats, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a share of right answers over objects, as `interval_over_objects`.

    Where every object has all of its tests right, or none, resampling sees no doubt: the interval is that of
    one test an object (`binomial_interval`).
    """
    values = np.asarray(shares, dtype=np.float64)
    if np.ptp(values) == 0 and values[0] in (0.0, 1.0):
        return binomial_interval(int(values.sum()), len(values), level)
    return interval_over_objects(shares, level)


def average_precisions(similarity: Floats, queries: Labels, gallery: Labels, seed: int) -> Floats:
    """Return the average precision (queries,) of each query: the whole ranking counts.

    Parameters
    ----------
    similarity
        (queries, gallery), larger is nearer.
    queries, gallery
        Labels of the rows and of the columns; every query has a positive.
    seed
        Breaks ties at random: in the gallery's own order equal answers would profit from its sorting.
    """
    order = np.random.default_rng(seed).permutation(len(gallery))
    ranked = order[np.argsort(-similarity[:, order], axis=1, kind="stable")]
    relevant = gallery[ranked] == queries[:, None]
    precision = np.cumsum(relevant, axis=1) / np.arange(1, len(gallery) + 1)
    return np.asarray((precision * relevant).sum(axis=1) / relevant.sum(axis=1))


def mean_average_precision(similarity: Floats, queries: Labels, gallery: Labels, seed: int) -> float:
    """Return the mean of `average_precisions`: positives are of the query's object."""
    return float(np.mean(average_precisions(similarity, queries, gallery, seed)))


def chance_average_precision(queries: Labels, gallery: Labels) -> float:
    """Return the mAP that a random ranking of this gallery has in the mean.

    At rank k of n a positive stands with the share r / n, and (k - 1) (r - 1) / (n - 1) positives before it.
    """
    n, ranks = len(gallery), np.arange(1, len(gallery) + 1)
    names, counts = np.unique(gallery, return_counts=True)
    positives = dict(zip(names.tolist(), counts.tolist(), strict=True))
    before = (ranks - 1) / max(n - 1, 1)
    chances = {r: float(np.mean((1 + before * (r - 1)) / ranks)) for r in set(positives.values())}
    return float(np.mean([chances[positives[label]] for label in queries.tolist()]))


def one_positive_galleries(gallery: Labels, draws: int, seed: int) -> list[NDArray[np.int64]]:
    """Return draws of one item of each object, as indices into the gallery; published tables have one."""
    random = np.random.default_rng(seed)
    rows = [np.flatnonzero(gallery == label) for label in np.unique(gallery)]
    return [np.array([random.choice(items) for items in rows]) for _ in range(draws)]
