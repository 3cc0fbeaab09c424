"""What the tasks are measured by."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]


def binomial_interval(hits: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a share by Clopper and Pearson (1934)."""
    tail = (1 - level) / 2
    low = beta.ppf(tail, hits, trials - hits + 1) if hits else 0.0
    high = beta.ppf(1 - tail, hits + 1, trials - hits) if hits < trials else 1.0
    return float(low), float(high)


def mean_average_precision(similarity: Floats, queries: Labels, gallery: Labels, seed: int) -> float:
    """Return the mAP of a retrieval: positives are of the query's object, and the whole ranking counts.

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
    return float(np.mean((precision * relevant).sum(axis=1) / relevant.sum(axis=1)))


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
