"""Votes of the nearest training samples."""

import numpy as np

from learning import recognition
from learning.encoders import Encoded, Encoder
from learning.neighbours import whitening, with_neighbours

SPREAD = np.array([3.0, 0.3, 0.3, 1.0])


def split_of(random, labels, centres):
    features = centres[labels] + SPREAD * random.normal(size=(len(labels), 4))
    logs = np.log(np.full((len(labels), 2), 0.5, dtype=np.float32))
    return Encoded(features.astype(np.float32), logs, labels, features.astype(np.float32))


def made_splits():
    """Splits of two objects that one feature tells apart, and a network that says nothing."""
    random, centres = np.random.default_rng(0), np.zeros((2, 4))
    centres[1, 1] = 3.0  # no more than the first feature's spread, ten deviations of its own
    return {
        name: split_of(random, np.repeat([0, 1], count), centres)
        for name, count in (("training", 400), ("validation", 5), ("test", 50))
    }


def test_recognition_has_a_row_with_neighbours_by_each_of_several_senses(monkeypatch):
    monkeypatch.setattr(recognition, "encoded", lambda *arguments: Encoder(made_splits(), 0.0))
    for senses in (("vision",), ("vision", "touch")):
        alone, with_votes = (
            recognition._shares(None, None, senses, "region", 0, neighbours) for neighbours in (False, True)
        )
        assert alone.tolist() == [1, 0]  # the first object is named whatever is shown
        assert with_votes.tolist() == [1, 1]


def test_features_are_white_within_objects_and_neighbours_tell_what_the_network_does_not():
    splits = made_splits()
    features, labels = splits["training"].features @ whitening(splits["training"]), splits["training"].labels
    within = features - np.stack([features[labels == label].mean(axis=0) for label in (0, 1)])[labels]
    np.testing.assert_allclose(within.T @ within / len(within), np.eye(4), atol=0.05)
    splits_with_votes = with_neighbours(Encoder(splits, 0.0)).splits
    assert splits_with_votes["training"] is splits["training"]
    for answers in (splits_with_votes["validation"], splits_with_votes["test"]):
        assert (answers.log_probabilities.argmax(axis=1) == answers.labels).all()
    # What a network is sure of outweighs them.
    sure = splits["test"].log_probabilities - 100 * np.eye(2, dtype=np.float32)[splits["test"].labels]
    splits["test"] = Encoded(*(splits["test"].features, sure, splits["test"].labels, splits["test"].features))
    answers = with_neighbours(Encoder(splits, 0.0)).splits["test"]
    assert (answers.log_probabilities.argmax(axis=1) != answers.labels).all()
