"""The modes of a pair of a body of revolution have one frequency, and no others are made equal."""

import numpy as np

from objectfolder.making.modes.equal_pairs import TURN_RAD, _pairs


def turned(numbers: list[int]) -> np.ndarray:
    """Products (k, k) of modes with themselves turned: pairs of n >= 1, single modes of n = 0."""
    blocks = []
    for number in numbers:
        cosine, sine = np.cos(number * TURN_RAD), np.sin(number * TURN_RAD)
        blocks.append(np.array([[cosine, -sine], [sine, cosine]]) if number else np.eye(1))
    size = sum(map(len, blocks))
    result, first = np.zeros((size, size)), 0
    for block in blocks:
        result[first : first + len(block), first : first + len(block)] = block
        first += len(block)
    return result


def test_modes_that_a_turn_mixes_are_pairs() -> None:
    """A single mode next to a pair, and two pairs whose frequencies are mixed, are told apart."""
    values = 1 + 1e-4 * np.arange(9)
    order = np.array([0, 1, 3, 5, 2, 4, 6, 7, 8])
    across = turned([2, 0, 30, 1, 0, 0])[np.ix_(order, order)]
    assert _pairs(values, np.eye(9), across) == [[0, 1], [2, 5], [3, 6]]


def test_a_mixture_of_two_pairs_is_no_pair() -> None:
    mixed = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    assert _pairs(1 + 1e-6 * np.arange(4), np.eye(4), mixed.T @ turned([2, 3]) @ mixed) == []


def test_modes_of_other_frequencies_are_no_pair() -> None:
    assert _pairs(np.array([1.0, 1.1]), np.eye(2), turned([2])) == []
