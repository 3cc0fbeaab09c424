"""Retrieval against what is known of Gaussian variables, and on features that are made."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import log_softmax

from learning.common_space import SPACES, contrasted
from learning.encoders import Encoded, Encoder
from learning.networks import Labelled
from learning.recognition import (
    aligned,
    ensemble,
    fused,
    inverse_temperature,
    named_rightly,
    of_several,
)
from learning.retrieval import (
    canonical_correlations,
    partial_least_squares,
    scores,
    similarities,
)
from learning.settings import Retrieval
from learning.stand_in import detected, first_of_each, lost_on_truth, with_fewer

ASKED = Retrieval(dimensions=8, epochs=15, margin=0.2, temperature=0.1, end_to_end_folds=0)


def correlated(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of which one direction has a correlation of .8 and the others none."""
    random = np.random.default_rng(0)
    a, b = random.normal(size=(count, 4)), random.normal(size=(count, 5))
    b[:, 2] = 0.8 * a[:, 1] + 0.6 * b[:, 2]
    return a * [1, 100, 1, 1], b  # scales do not matter to correlations


def test_canonical_correlations_find_the_pair_of_directions():
    a, b = correlated(20_000)
    project = canonical_correlations(a, b, 1, ridge=1e-9)
    first, second = project(0, a)[:, 0], project(1, b)[:, 0]
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(0.8, abs=0.01)
    assert np.abs(np.corrcoef(first, a[:, 1])[0, 1]) > 0.999


def test_partial_least_squares_find_them_too():
    a, b = correlated(20_000)
    project = partial_least_squares(a, b, 1)
    assert np.abs(np.corrcoef(project(0, a)[:, 0], a[:, 1])[0, 1]) > 0.99


def made(objects: int, noise: float, seed: int, clusters: int = 0) -> Encoder:
    """Features about a centre an object, of one sense; the same seed gives the same centres."""
    centres = np.random.default_rng(clusters).normal(size=(objects, 16))
    random = np.random.default_rng(seed)
    splits = {}
    for split in ("training", "validation", "test"):
        labels = np.repeat(np.arange(objects), 12)
        features = centres[labels] + noise * random.normal(size=(len(labels), 16))
        logs = -(np.linalg.norm(features[:, None] - centres, axis=2) ** 2)
        logs = log_softmax(logs, axis=1)
        features, logs = features.astype(np.float32), logs.astype(np.float32)
        splits[split] = Encoded(features, logs, labels, features[:, ::2])
    return Encoder(splits, 0.1)


@pytest.mark.slow
def test_every_way_retrieves_what_is_plain_and_none_retrieves_noise():
    plain = similarities((made(6, 0.1, 1, 1), made(6, 0.1, 2, 2)), 6, ASKED, seed=0)
    noise = similarities((made(6, 60.0, 1, 1), made(6, 60.0, 2, 2)), 6, ASKED, seed=0)
    test = made(6, 0.1, 1).splits["test"]
    compared = {"CCA", "CCA of averaged inputs", "PLS", "classify, then look up"}
    assert {*SPACES, *compared, "classify by neighbours too, then look up"} == plain.keys()
    for method in plain:
        right = scores(plain[method], test, test, 0)
        assert min(right.map.values()) > 0.9, method
        assert min(right.map_one_positive.values()) > 0.9, method
        guessed = scores(noise[method], test, test, 0)
        assert abs(np.mean(list(guessed.map.values())) - guessed.chance) < 0.08, method


def test_the_contrastive_loss_is_the_surprise_at_positives():
    labels = torch.tensor([0, 0, 1, 2])
    places = torch.eye(3)[labels]
    # Either of the first two anchors has two positives of four candidates, the others have one.
    positive = np.exp(1 / 0.5)
    expected = np.mean([np.log(2 + 2 / positive)] * 2 + [np.log(1 + 3 / positive)] * 2)
    assert float(contrasted(places, places, labels, 0.5)) == pytest.approx(expected, rel=1e-6)
    # Where nothing is known all candidates are as likely.
    assert float(contrasted(0 * places, places, labels, 0.5)) == pytest.approx(np.log(4), rel=1e-6)


def test_joined_features_are_of_one_object():
    first, second = made(5, 0.0, 1, 1), made(5, 0.0, 2, 2)
    features, labels = aligned([first.splits["test"], second.splits["test"]], 3, seed=0)
    assert features.shape == (180, 32)
    own = {label: features[labels == label] for label in range(5)}
    assert all(torch.equal(rows, rows[:1].expand_as(rows)) for rows in own.values())


def test_two_weak_senses_together_are_better_than_each():
    weak = [made(6, 1.2, seed, seed) for seed in (1, 2)]
    alone = [fused([encoder], seed=0).mean() for encoder in weak]
    assert fused(weak, seed=0).mean() > max(alone) + 0.03


def test_several_samples_are_better_than_one_which_is_what_a_sense_names():
    test = made(6, 1.6, 1).splits["test"]
    alone = np.mean(test.log_probabilities.argmax(axis=1) == test.labels)
    single, pair, all_of_them = (of_several(test, count, seed=0) for count in (1, 2, 12))
    assert single == pytest.approx(alone, abs=0.02)
    assert pair > single + 0.05
    assert all_of_them == 1


def test_a_sense_is_made_as_sure_as_it_is_right():
    random = np.random.default_rng(0)
    right = log_softmax(random.normal(size=(4000, 6)), axis=1)
    labels = (np.cumsum(np.exp(right), axis=1) < random.random((4000, 1))).sum(axis=1)
    for times in (0.5, 1.0, 3.0):
        validation = Encoded(right, log_softmax(times * right, axis=1), labels, right)
        assert inverse_temperature(validation) == pytest.approx(1 / times, rel=0.1)


def test_a_sense_that_never_errs_is_not_without_doubt():
    never = made(6, 0.1, 1).splits["validation"]
    assert 1 <= inverse_temperature(never) < 3


def test_a_sense_that_is_too_sure_does_not_outvote_another():
    quiet, loud = made(6, 1.2, 1, 1), made(6, 1.6, 2, 2)
    louder = {
        name: replace(part, log_probabilities=4 * part.log_probabilities)
        for name, part in loud.splits.items()
    }
    right = fused([quiet, loud], seed=0).mean()
    assert fused([quiet, Encoder(louder, 0.1)], seed=0).mean() > right - 0.02
    said = [encoder.splits["test"] for encoder in (quiet, loud)]
    plain = said[0].log_probabilities + 4 * said[1].log_probabilities
    assert right > (plain.argmax(axis=1) == said[0].labels).mean() + 0.03


def test_networks_of_the_same_samples_together_are_better_than_each_and_one_that_knows_nothing_adds_nothing():
    networks = [made(6, 1.2, seed, seed) for seed in (1, 2)]
    together = ensemble(networks).splits["test"]
    assert np.exp(together.log_probabilities).sum(axis=1) == pytest.approx(1, abs=1e-5)
    alone = [named_rightly(network) for network in networks]
    assert named_rightly(ensemble(networks)).mean() > max(right.mean() for right in alone) + 0.03
    blank = Encoder(
        {
            name: replace(part, log_probabilities=np.full_like(part.log_probabilities, -np.log(6)))
            for name, part in networks[1].splits.items()
        },
        0.1,
    )
    assert np.array_equal(named_rightly(ensemble([networks[0], blank])), alone[0])


def test_a_detector_that_sees_no_difference_is_right_half_of_the_time():
    logs = np.random.default_rng(0).normal(size=100).astype(np.float32)
    assert (detected(np.concatenate([logs, logs])) == 0.5).all()
    assert (detected(np.concatenate([logs + 1, logs])) == 1.0).all()


def test_points_lost_are_those_of_the_same_queries():
    labels = np.repeat(np.arange(4), 10)
    right = -np.abs(np.arange(4) - labels[:, None]).astype(np.float32)
    wrong = np.roll(right, 1, axis=1)
    arrays = {}
    # Tests of 10 of each object that only the network trained on truth names rightly.
    for source, lost in (("truth", [0, 0, 0, 0]), ("object_file", [1, 2, 3, 6])):
        logs = np.where((np.arange(40) % 10 < np.repeat(lost, 10))[:, None], wrong, right)
        parts = {"features": right, "logs": logs, "labels": labels, "averaged": right}
        arrays |= {f"{source}/truth/test/{name}": values for name, values in parts.items()}
    answer = lost_on_truth([arrays, arrays])
    assert answer["points"] == pytest.approx(30)
    low, high = answer["interval_points"]
    assert 10 <= low < 30 < high <= 60
    fewer = {f"0.2/{source}": arrays[f"{source}/truth/test/logs"] for source in ("truth", "object_file")}
    assert with_fewer([arrays | fewer] * 2, 0.2) == answer | {
        "accuracy_percent": {"truth": 100, "object_file": 70}
    }


def test_fewer_queries_are_as_many_of_each_object():
    labels = torch.tensor([0] * 10 + [1] * 6 + [2])
    part = first_of_each(Labelled(torch.arange(17.0)[:, None], labels), 0.5)
    assert part.inputs[:, 0].tolist() == [0, 1, 2, 3, 4] * 2 + [10, 11, 12] * 2 + [16]
    assert part.labels.tolist() == [0] * 10 + [1] * 6 + [2]
