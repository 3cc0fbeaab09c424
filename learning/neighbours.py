"""The nearest training samples of a test sample, by a network's features, beside what the network says.

A network that has not seen its samples often enough says less than its features know: touches of neighbouring
vertices lie close in them long before its last layer parts a hundred objects.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from learning.encoders import Encoded, Encoder

NEIGHBOURS = 5
WEIGHT = 3.0  # of their log probabilities; chosen, as `NEIGHBOURS`, on validation touches of 76 scans
SHARE_OF_DISTANCE = 0.3  # over which a neighbour's vote falls by e, of the median distance
UNSEEN = 1e-3  # votes of an object without a neighbour
RIDGE = 1e-3
PART = 256
Floats = NDArray[np.float32]


def with_neighbours(encoder: Encoder) -> Encoder:
    """Return an encoder whose log probabilities hold the votes of each sample's nearest training samples.

    Validation and test have them. Training samples stay as they are: each would be its own neighbour.

    Features are whitened by their covariance within objects (linear discriminant analysis). A neighbour's
    vote falls with its distance beyond the nearest one's. Votes are normalised, and their logarithm is added
    to what the network says, `WEIGHT` times.
    """
    training = encoder.splits["training"]
    maps = whitening(training)
    references = training.features @ maps
    parts = {
        split: _with_votes(part, training, references, part.features @ maps)
        for split, part in encoder.splits.items()
        if split != "training"
    }
    return replace(encoder, splits={"training": training, **parts})


def _with_votes(part: Encoded, training: Encoded, references: Floats, queries: Floats) -> Encoded:
    votes = np.full(part.log_probabilities.shape, UNSEEN)
    nearest, distances = _nearest(references, queries)
    scale = SHARE_OF_DISTANCE * np.median(distances)
    weights = np.exp(-(distances - distances[:, :1]) / scale)
    for column in range(NEIGHBOURS):
        votes[np.arange(len(queries)), training.labels[nearest[:, column]]] += weights[:, column]
    logs = np.log(votes / votes.sum(axis=1, keepdims=True))
    return replace(part, log_probabilities=part.log_probabilities + WEIGHT * logs.astype(np.float32))


def whitening(training: Encoded) -> Floats:
    """Return a linear map (features, features) after which samples of an object have unit covariance."""
    features, labels = training.features.astype(np.float64), training.labels
    spread = np.empty_like(features)
    for label in np.unique(labels):
        spread[labels == label] = features[labels == label] - features[labels == label].mean(axis=0)
    covariance = spread.T @ spread / len(spread)
    ridge = RIDGE * np.trace(covariance) / len(covariance)
    values, vectors = np.linalg.eigh(covariance + ridge * np.eye(len(covariance)))
    return np.asarray(vectors / np.sqrt(values), dtype=np.float32)


def _nearest(references: Floats, queries: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return the rows (n, NEIGHBOURS) of the nearest references, nearest first, and squared distances."""
    lengths, rows, distances = np.square(references).sum(axis=1), [], []
    for first in range(0, len(queries), PART):
        part = queries[first : first + PART]
        squares = lengths - 2 * part @ references.T + np.square(part).sum(axis=1, keepdims=True)
        nearest = np.argpartition(squares, NEIGHBOURS, axis=1)[:, :NEIGHBOURS]
        own = np.take_along_axis(squares, nearest, axis=1)
        order = np.argsort(own, axis=1)
        rows.append(np.take_along_axis(nearest, order, axis=1))
        distances.append(np.take_along_axis(own, order, axis=1))
    return np.concatenate(rows), np.concatenate(distances)
