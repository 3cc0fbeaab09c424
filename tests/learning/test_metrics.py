"""Measures of the learning tasks against closed forms and against counting."""

import numpy as np
import pytest

from learning.metrics import (
    binomial_interval,
    chance_average_precision,
    interval_over_objects,
    mean_average_precision,
    means_by_object,
    one_positive_galleries,
    share_interval,
)


def counted(similarity: np.ndarray, queries: np.ndarray, gallery: np.ndarray) -> float:
    """The mAP by its definition, a query at a time."""
    precisions = []
    for row, label in zip(similarity, queries, strict=True):
        ranked = gallery[np.argsort(-row)] == label
        precisions.append(np.mean([ranked[: place + 1].mean() for place in np.flatnonzero(ranked)]))
    return float(np.mean(precisions))


def test_mean_average_precision_is_what_counting_gives():
    random = np.random.default_rng(0)
    queries, gallery = random.integers(0, 5, 30), np.repeat(np.arange(5), 8)
    similarity = random.normal(size=(30, 40)) + (queries[:, None] == gallery)
    assert mean_average_precision(similarity, queries, gallery, 0) == pytest.approx(
        counted(similarity, queries, gallery), abs=1e-12
    )


@pytest.mark.parametrize(("objects", "positives"), [(100, 1), (10, 5), (20, 10)])
def test_chance_is_the_mean_of_random_rankings(objects, positives):
    gallery = np.repeat(np.arange(objects), positives)
    random = np.random.default_rng(1)
    averages = [
        mean_average_precision(random.normal(size=(objects, len(gallery))), np.arange(objects), gallery, draw)
        for draw in range(60)
    ]
    error = np.std(averages) / np.sqrt(len(averages))
    chance = chance_average_precision(np.arange(objects), gallery)
    assert chance == pytest.approx(np.mean(averages), abs=4 * error)
    if positives == 1:
        assert chance == pytest.approx(np.mean(1 / np.arange(1, objects + 1)))  # .0519 of a hundred


def test_equal_answers_score_chance_whatever_the_order_of_the_gallery():
    gallery = np.repeat(np.arange(10), 10)
    queries = np.zeros(400, dtype=np.int64)  # the sorted gallery has these positives first
    averages = [mean_average_precision(np.zeros((400, 100)), queries, gallery, seed) for seed in range(200)]
    chance = chance_average_precision(queries, gallery)
    assert np.mean(averages) == pytest.approx(chance, abs=4 * np.std(averages) / np.sqrt(200))


def test_galleries_with_one_positive_have_one_item_an_object():
    gallery = np.array([0, 0, 1, 1, 1, 2])
    for items in one_positive_galleries(gallery, 5, seed=0):
        assert gallery[items].tolist() == [0, 1, 2]


def test_binomial_interval_of_none_and_of_all():
    assert binomial_interval(0, 10) == pytest.approx((0, 1 - 0.025 ** (1 / 10)))
    assert binomial_interval(10, 10) == pytest.approx((0.025 ** (1 / 10), 1))
    low, high = binomial_interval(5, 10)
    assert low + high == pytest.approx(1)


def test_interval_over_objects_covers_the_mean_of_the_objects_that_are_drawn_from():
    random, covered = np.random.default_rng(0), 0
    for _ in range(60):
        low, high = interval_over_objects(random.beta(4, 2, 40))
        covered += low <= 4 / 6 <= high
    assert covered >= 60 * 0.95 - 3 * np.sqrt(60 * 0.95 * 0.05)


def test_many_tests_of_few_objects_do_not_narrow_the_interval():
    random = np.random.default_rng(0)
    labels = np.repeat(np.arange(8), 500)
    hits = (random.random(4000) < random.random(8)[labels]).astype(float)
    low, high = share_interval(list(means_by_object(hits, labels).values()))
    independent = binomial_interval(int(hits.sum()), len(hits))
    assert high - low > 5 * (independent[1] - independent[0])


def test_share_without_an_error_has_the_doubt_of_its_objects():
    assert share_interval([1.0] * 10) == binomial_interval(10, 10)
    assert interval_over_objects([0.0] * 10) == (0.0, 0.0)
    with pytest.raises(ValueError, match="1 objects"):
        interval_over_objects([0.3])
