"""Grasps: what holds by Coulomb's law, what is repeated, and what is predicted of them."""

import json

import numpy as np
import pytest

from learning import runs
from learning.grasping import stability
from learning.grasping.world import (
    FRICTION,
    GRAVITY_M_S2,
    Grasp,
    attempts,
    drawn_grasps,
    least_force_n,
)
from learning.grasping.worlds import Worlds
from learning.runs import Objects
from learning.workers import Here
from objectfolder import example
from objectfolder.errors import InputError

PIXELS = 16


@pytest.fixture(scope="module")
def file():
    return example("mug")


@pytest.fixture(scope="module")
def world(held):
    return held[0]["mug"]


@pytest.mark.parametrize(("share", "holds"), [(0.6, False), (0.85, False), (1.3, True), (3.0, True)])
def test_a_mug_is_held_from_the_force_on_that_friction_asks_for(world, file, share, holds):
    """Two fingers bear 2 mu F: they hold the weight from F = m g / (2 mu) on."""
    weight_n = file.description["body"]["mass_kg"] * GRAVITY_M_S2
    outcome = world.attempt(Grasp(0.0, 0.0, 0.0, share * weight_n / (2 * FRICTION)), PIXELS)
    assert outcome.held is holds


def test_a_grasp_is_the_same_whatever_was_tried_before_it(world, file):
    grasps = [grasp for _, grasp in zip(range(3), drawn_grasps(file, 1), strict=False)]
    first = [world.attempt(grasp, PIXELS) for grasp in grasps]
    again = [world.attempt(grasp, PIXELS) for grasp in grasps[::-1]][::-1]
    for outcome, outcome_again in zip(first, again, strict=True):
        assert outcome.risen_share == outcome_again.risen_share
        np.testing.assert_array_equal(outcome.touch, outcome_again.touch)
        np.testing.assert_array_equal(outcome.image, outcome_again.image)


def test_a_harder_grasp_is_felt_deeper(world, file):
    least = least_force_n(file)
    soft, hard = (world.attempt(Grasp(0.0, 0.0, 0.0, share * least), PIXELS) for share in (1.5, 4.0))
    assert np.abs(hard.touch.astype(int) - soft.touch).max() > 10
    assert hard.touch.shape == (2, 160, 120, 3)


def test_attempts_are_those_of_the_seed(world):
    once, more = (attempts(world, count, 5, PIXELS) for count in (3, 5))
    for name in ("image", "touch", "grasp", "held"):
        np.testing.assert_array_equal(once[name], more[name][:3])
    assert once["grasp"].shape == (3, 4)


def test_a_data_set_without_masses_is_an_error(bars):
    objects = Objects(bars)
    with pytest.raises(InputError, match="no object has a mass"):
        Worlds(objects, left_out=objects.ids)


def test_folds_that_are_not_equal_are_trained_on_as_many(tiny):
    grasping = tiny.grasping.model_copy(update={"folds": 3, "sizes": (5, 100)})
    settings = tiny.model_copy(update={"grasping": grasping})
    folds = list(stability._by_size({"held": np.arange(32) % 2 == 0}, settings))
    assert [size for size, _, _ in folds] == [5, 21] * 3
    assert [len(rows) for _, rows, _ in folds] == [5, 21] * 3
    assert sorted(np.concatenate([test for _, _, test in folds[::2]])) == list(range(32))


@pytest.mark.slow
def test_of_four_objects_each_is_left_out_once(mugs, tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "RUNS", tmp_path / "runs")
    figures = stability.evaluate(Objects(mugs), mugs, Here())
    json.dumps(figures, allow_nan=False)
    (size,) = figures["accuracy_percent"]
    assert set(figures["accuracy_percent"][size]) == {
        "V", "T", "VT", "majority", "majority of the object", "trees on force and pose",
    }  # fmt: skip
    assert figures["grasps"] == 4 * mugs.grasping.grasps
    assert set(figures["unseen_object"]) == set("abcd")
    assert all(answer["majority"] == 50 for answer in figures["unseen_object"].values())
