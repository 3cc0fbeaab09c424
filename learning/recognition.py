"""Which object is it? From one image, one strike, one touch, and any two or three of them."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax

from learning.encoders import Encoded, Encoder, encoded, train
from learning.metrics import interval_over_objects, means_by_object, share_interval
from learning.neighbours import with_neighbours
from learning.runs import Objects
from learning.samples import SENSES
from learning.settings import Settings
from learning.workers import Workers

LETTERS = dict(zip(SENSES, "VAT", strict=True))
COMBINATIONS = tuple(chosen for size in (1, 2, 3) for chosen in combinations(SENSES, size))
PROTOCOLS: dict[str, Sequence[str]] = {"sample": SENSES, "region": SENSES, "vertex": ("touch",)}
PRETRAINED = ("sample", "region")  # protocols in which a network that ImageNet trained is shown images, too
SEVERAL = (1, 2, 3, 5)
CONFUSIONS = 12  # of a sense, that are stated
DRAWS = 500  # of several samples of an object
PAIRINGS = 8  # of test samples, each with others of its object
PRIOR_DEVIATION = 0.5  # of the logarithm of an inverse temperature


def name_of(senses: Sequence[str]) -> str:
    """Return ``VAT`` and so on."""
    return "".join(LETTERS[sense] for sense in senses)


def paired(parts: Sequence[Encoded], draws: int, seed: int) -> list[NDArray[np.int64]]:
    """Return rows (draws n,) of each sense, drawn so that all are of the same object."""
    random = np.random.default_rng(seed)
    labels = np.tile(parts[0].labels, draws)
    result = []
    for part in parts:
        rows = np.empty(len(labels), dtype=np.int64)
        for label in np.unique(labels):
            mask = labels == label
            rows[mask] = random.choice(np.flatnonzero(part.labels == label), mask.sum())
        result.append(rows)
    return result


def aligned(parts: Sequence[Encoded], draws: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Join features of several senses, as `paired`.

    Returns
    -------
    features
        (draws n, sum of features).
    labels
        (draws n,).
    """
    rows = paired(parts, draws, seed)
    columns = [part.features[indices] for part, indices in zip(parts, rows, strict=True)]
    labels = parts[0].labels[rows[0]]
    return torch.from_numpy(np.concatenate(columns, axis=1)), torch.from_numpy(labels)


def inverse_temperature(validation: Encoded) -> float:
    """Return the factor on a sense's log probabilities that makes its confidence match its accuracy.

    That is the inverse temperature of Guo et al. (2017, ICML, section 4.2), found on the validation samples.
    Its logarithm has a normal prior of `PRIOR_DEVIATION`: else a sense that never errs there has no doubt.
    """
    logs, rows = validation.log_probabilities.astype(np.float64), np.arange(len(validation.labels))

    def loss(logarithm: float) -> float:
        scaled = log_softmax(np.exp(logarithm) * logs, axis=1)
        return (logarithm / PRIOR_DEVIATION) ** 2 / 2 - scaled[rows, validation.labels].sum()

    return float(np.exp(minimize_scalar(loss, bounds=(-3, 3), method="bounded").x))


def fused(encoders: Sequence[Encoder], seed: int) -> NDArray[np.bool_]:
    """Return which test samples several senses together name rightly.

    Their log probabilities are summed, each times its `inverse_temperature`. That is a linear layer on their
    joined features, each sense's part trained alone. One that is trained on joined features relies on the
    sense that its training samples fit best, and errs more often.
    """
    tests = [encoder.splits["test"] for encoder in encoders]
    rows = paired(tests, PAIRINGS, seed)
    scaled_logs = [
        inverse_temperature(encoder.splits["validation"]) * test.log_probabilities[own]
        for encoder, test, own in zip(encoders, tests, rows, strict=True)
    ]
    return np.asarray(np.argmax(sum(scaled_logs), axis=1) == tests[0].labels[rows[0]])


def of_several(test: Encoded, count: int, seed: int) -> float:
    """Return the accuracy of `count` samples of an object together: their log probabilities are summed."""
    return float(shares_of_several(test, count, seed).mean())


def shares_of_several(test: Encoded, count: int, seed: int) -> NDArray[np.float64]:
    """Return the share (objects,) of draws whose `count` samples together are named rightly."""
    random = np.random.default_rng(seed)
    shares = []
    for label in np.unique(test.labels):
        rows = np.tile(np.flatnonzero(test.labels == label), (DRAWS, 1))
        chosen = random.permuted(rows, axis=1)[:, :count]
        answers = test.log_probabilities[chosen].sum(axis=1).argmax(axis=1)
        shares.append(np.mean(answers == label))
    return np.array(shares)


def accuracies(shares_of_seeds: Sequence[NDArray[np.float64]]) -> dict[str, Any]:
    """Return mean and standard deviation over seeds in percent, and the interval over objects.

    Parameters
    ----------
    shares_of_seeds
        Of each seed the share (objects,) of an object's test samples that were named rightly.
    """
    shares = [float(by_object.mean()) for by_object in shares_of_seeds]
    low, high = share_interval(np.mean(shares_of_seeds, axis=0))
    spread = float(np.std(shares, ddof=1)) if len(shares) > 1 else None
    return {
        "accuracy_percent": 100 * float(np.mean(shares)),
        "sd_percent": None if spread is None else 100 * spread,
        "interval_percent": [100 * low, 100 * high],
    }


def worst_object(
    shares_of_seeds: Sequence[NDArray[np.float64]], ids: Sequence[str]
) -> dict[str, str | float]:
    """Return the object that is named rightly least often, and the percentage of its tests over all seeds."""
    by_object = np.mean(shares_of_seeds, axis=0)
    worst = int(by_object.argmin())
    return {"object": ids[worst], "accuracy_percent": 100 * float(by_object[worst])}


def named_rightly(encoder: Encoder) -> NDArray[np.bool_]:
    """Return which of the test samples one sense alone names rightly."""
    test = encoder.splits["test"]
    return test.log_probabilities.argmax(axis=1) == test.labels


def ensemble(encoders: Sequence[Encoder]) -> Encoder:
    """Return one encoder of what several networks say of the same samples.

    Its log probabilities are the normalised sum of theirs, each times its `inverse_temperature`.
    """
    weights = [inverse_temperature(encoder.splits["validation"]) for encoder in encoders]
    splits = {}
    for split, part in encoders[0].splits.items():
        parts = [encoder.splits[split].log_probabilities for encoder in encoders]
        logs = log_softmax(np.tensordot(weights, parts, axes=1), axis=1)
        splits[split] = replace(part, log_probabilities=logs.astype(np.float32))
    return replace(encoders[0], splits=splits)


def _shares(
    objects: Objects,
    settings: Settings,
    senses: Sequence[str],
    protocol: str,
    seed: int,
    neighbours: bool = False,
) -> NDArray[np.float64]:
    """Return the share (objects,) of each object's test samples that senses name rightly."""
    encoders = [encoded(objects, settings, sense, protocol, seed) for sense in senses]
    if neighbours:
        encoders = [with_neighbours(encoder) for encoder in encoders]
    hits = named_rightly(encoders[0]) if len(senses) == 1 else fused(encoders, seed)
    return _by_object(hits, encoders[0])


def _by_object(hits: NDArray[np.bool_], encoder: Encoder) -> NDArray[np.float64]:
    labels = encoder.splits["test"].labels
    rounds = len(hits) // len(labels)
    return np.array(list(means_by_object(hits.astype(np.float64), np.tile(labels, rounds)).values()))


def _with_pretrained(
    objects: Objects, settings: Settings, workers: Workers, protocol: str
) -> dict[str, dict[str, Any]]:
    """Return accuracies of images by the pretrained network, and by it with our own and with touch."""
    rows = [workers.submit(_pretrained_shares, objects, settings, protocol, seed) for seed in settings.seeds]
    shares = workers.gather(rows)
    return {way: accuracies([row[way] for row in shares]) for way in shares[0]}


def _pretrained_shares(
    objects: Objects, settings: Settings, protocol: str, seed: int
) -> dict[str, NDArray[np.float64]]:
    own = encoded(objects, settings, "vision", protocol, seed)
    head = encoded(objects, settings, "vision", protocol, seed, pretrained=True)
    touch = encoded(objects, settings, "touch", protocol, seed)
    both = ensemble([own, head])
    with_nearest = ensemble([with_neighbours(encoder) for encoder in (own, head)])
    return {
        "pretrained": _by_object(named_rightly(head), head),
        "with_own": _by_object(named_rightly(both), head),
        "with_own_and_neighbours": _by_object(named_rightly(with_nearest), head),
        "with_own_and_touch": _by_object(fused([both, touch], seed), head),
    }


def evaluate(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return accuracies by protocol and senses, curves of several samples, and how confused objects are."""
    cases = [(sense, protocol) for protocol, senses in PROTOCOLS.items() for sense in senses]
    networks = [(*case, seed) for case in [*cases, ("vision", "one lamp")] for seed in settings.seeds]
    seen = [("vision", protocol, seed) for protocol in PRETRAINED for seed in settings.seeds]
    train(objects, settings, workers, networks, pretrained=seen)
    result: dict[str, Any] = {
        "chance_percent": 100 / len(objects),
        "tests_a_seed": settings.data.test * len(objects),
    }
    for protocol, senses in PROTOCOLS.items():
        result[protocol] = _row(objects, settings, workers, protocol, senses)
    result["vertex"] |= _at_vertices(objects, settings, workers)
    result["pretrained"] = {
        protocol: _with_pretrained(objects, settings, workers, protocol) for protocol in PRETRAINED
    }
    dark = [_shares(objects, settings, ("vision",), "one lamp", seed) for seed in settings.seeds]
    result["one lamp"] = {"V": accuracies(dark)}
    return result


def _row(
    objects: Objects, settings: Settings, workers: Workers, protocol: str, senses: Sequence[str]
) -> dict[str, Any]:
    """Return what a protocol gives: accuracies of all combinations of senses, and more of each sense."""
    encoders = [
        {sense: encoded(objects, settings, sense, protocol, seed) for sense in senses}
        for seed in settings.seeds
    ]
    row: dict[str, Any] = {}
    for neighbours in (False, True):
        by_senses = {}
        for joined in COMBINATIONS:
            if set(joined) <= set(senses):
                shares = [
                    workers.submit(_shares, objects, settings, joined, protocol, seed, neighbours)
                    for seed in settings.seeds
                ]
                shares_of_seeds = workers.gather(shares)
                worst = worst_object(shares_of_seeds, objects.ids)
                by_senses[name_of(joined)] = accuracies(shares_of_seeds) | {"worst": worst}
        row |= {"with_neighbours": by_senses} if neighbours else by_senses
    row["several"] = {
        LETTERS[sense]: {str(count): _several(encoders, sense, count) for count in SEVERAL}
        for sense in senses
    }
    row["nearest_training_place"] = {
        LETTERS[sense]: float(np.mean([by_sense[sense].nearest_share for by_sense in encoders]))
        for sense in senses
    }
    row["confusions"] = {LETTERS[sense]: _confusions(encoders, sense, objects.ids) for sense in senses}
    return row


def _at_vertices(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return how many vertices of an object were trained on, least and most, and what finer images gain."""
    seed, pixels = settings.seeds[0], settings.touch_at_vertices.finer_resolution
    labels = encoded(objects, settings, "touch", "vertex", seed).splits["training"].labels
    counts = np.bincount(labels)
    result: dict[str, Any] = {"training_touches": [int(counts.min()), int(counts.max())]}
    if pixels is None:
        return result
    finer = settings.with_resolution(touch=pixels)
    train(objects, finer, workers, [("touch", "vertex", seed)])
    shares = [_shares(objects, each, ("touch",), "vertex", seed) for each in (settings, finer)]
    low, high = interval_over_objects(shares[1] - shares[0])
    return result | {
        "finer": {
            "pixels": pixels,
            "accuracy_percent": 100 * float(shares[1].mean()),
            "points_gained": 100 * float((shares[1] - shares[0]).mean()),
            "interval_points": [100 * low, 100 * high],
        }
    }


def _several(encoders: Sequence[dict[str, Encoder]], sense: str, count: int) -> float:
    shares = [
        of_several(by_sense[sense].splits["test"], count, seed) for seed, by_sense in enumerate(encoders)
    ]
    return 100 * float(np.mean(shares))


def _confusions(
    encoders: Sequence[dict[str, Encoder]], sense: str, ids: Sequence[str]
) -> list[dict[str, Any]]:
    """Return which object is oftenest named as which other, and in how many of its tests over all seeds."""
    counts = np.zeros((len(ids), len(ids)), dtype=np.int64)
    for by_sense in encoders:
        test = by_sense[sense].splits["test"]
        np.add.at(counts, (test.labels, test.log_probabilities.argmax(axis=1)), 1)
    np.fill_diagonal(counts, 0)
    rows, columns = np.unravel_index(np.argsort(-counts, axis=None, kind="stable"), counts.shape)
    return [
        {"object": ids[row], "named": ids[column], "tests": int(counts[row, column])}
        for row, column in zip(rows[:CONFUSIONS], columns[:CONFUSIONS], strict=True)
        if counts[row, column]
    ]
