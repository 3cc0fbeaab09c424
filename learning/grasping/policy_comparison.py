"""How many objects are held by policies that touch, and by acts that need no touch.

Beside the policies stand: lifting at the first grasp; moves drawn at random; the best of fixed moves, found
on episodes of the training; and, as one who sees could do, the hardest squeeze at the centre of mass. An
object is put back before it is grasped again. So a sequence of fixed moves is worth what their sum is.
Policies of the first seed to which gels show other things say what the parts of touch are worth.

They are learnt once more without the objects of a fold, and a fixed move is found without them. Each episode
of the test is then done by those that do not know its object.
"""

import itertools
from collections.abc import Collection, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from learning.folds import folds_of
from learning.grasping.touch_policy import (
    Grasps,
    Move,
    Played,
    fixed_act,
    joined,
    lift_act,
    random_act,
    showing,
    touch_act,
)
from learning.metrics import interval_over_objects
from learning.runs import Objects
from learning.settings import Settings
from learning.workers import Workers

FIXED_MOVES = tuple(itertools.product((-0.5, -0.25, 0.0, 0.25, 0.5), (0.0,), (-0.5, 0.0, 0.5)))
TOUCH, FIXED = "touch", "fixed move"
WITHOUT_IMAGES = ("force",)  # what gels show of a grasp but for their images
Figures = dict[str, Any]


class Learner(NamedTuple):
    """A policy by what it learns on and what it is tested on.

    Attributes
    ----------
    training, test
        Grasps of the objects that it knows, and of all.
    seed
        Of the policy.
    test_seeds
        Of its episodes of the test.
    """

    training: Grasps
    test: Grasps
    seed: int
    test_seeds: Sequence[int]


def evaluate(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return how many objects are held: by who knows them and, where there are folds, by who does not."""
    grasps = Grasps(objects, settings)
    workers.gather([workers.submit(grasps.worlds.part, name) for name in grasps.worlds])
    folds = unseen_objects(objects, settings, grasps.ids)
    learners, learners_of_folds = _seen_learners(objects, settings), unseen_learners(objects, settings, folds)
    last_rollouts = _submit_rollouts(
        [*itertools.chain(*learners.values(), *learners_of_folds.values())], settings, workers
    )
    tests = {
        "first grasp": grasps.tests(workers, lift_act, grasps.test_seeds),
        "random": grasps.tests(workers, random_act, grasps.test_seeds),
        "hardest, centred": grasps.tests(workers, lift_act, grasps.test_seeds, hardest=True),
    }
    grasps_of_folds = [Grasps(objects, settings, fold) for fold in folds]
    move, *moves_of_folds = _fixed_moves([grasps, *grasps_of_folds], workers)
    tests[FIXED] = grasps.tests(workers, partial(fixed_act, move), grasps.test_seeds)
    tests |= _tests_by_touch(learners, last_rollouts, workers)
    rates = _rates(tests, grasps.ids, workers)
    figures = {
        "spread_mm": 1e3 * settings.regrasping.spread_m,
        "fixed_move": list(move),
        "held": rates,
    }
    if not folds:
        return figures
    fixed_tests = (
        grasps.tests(workers, partial(fixed_act, own), grasps.test_seeds_of(fold))
        for fold, own in zip(folds, moves_of_folds, strict=True)
    )
    tests = {
        FIXED: [*itertools.chain(*fixed_tests)],
        **_tests_by_touch(learners_of_folds, last_rollouts, workers),
    }
    rates_unseen = _rates(tests, grasps.ids, workers)
    unseen_figures = {
        "folds": folds,
        "fixed_moves": [list(own) for own in moves_of_folds],
        "held": rates_unseen,
    }
    return figures | {
        "unseen": unseen_figures | _differences(rates, rates_unseen, settings.regrasping.seeds[0])
    }


def unseen_objects(objects: Objects, settings: Settings, names: Collection[str]) -> list[list[str]]:
    """Return which of the named objects are unseen together, by fold: near twins are, see `folds_of`."""
    if settings.regrasping.folds is None:
        return []
    dealt = folds_of(objects, settings.model_copy(update={"folds": settings.regrasping.folds}))
    folds = [[objects.ids[place] for place in sorted(fold) if objects.ids[place] in names] for fold in dealt]
    folds = [fold for fold in folds if fold]
    return folds if len(folds) > 1 else []


def unseen_learners(objects: Objects, settings: Settings, folds: list[list[str]]) -> dict[str, list[Learner]]:
    """Return policies of the first seed, one a fold, that learn without what they are tested on."""
    observations = {TOUCH: settings.regrasping.observation, " + ".join(WITHOUT_IMAGES): WITHOUT_IMAGES}
    learners: dict[str, list[Learner]] = {name: [] for name in observations if folds}
    for name, row in learners.items():
        own = showing(settings, observations[name])
        everything = Grasps(objects, own)
        for fold in folds:
            training, test_seeds = Grasps(objects, own, fold), everything.test_seeds_of(fold)
            row.append(Learner(training, everything, own.regrasping.seeds[0], test_seeds))
    return learners


def _seen_learners(objects: Objects, settings: Settings) -> dict[str, list[Learner]]:
    """Return policies of all seeds, and of the first one with other observations, that know all objects."""
    seeds, ablation = settings.regrasping.seeds, settings.regrasping.ablation
    observations = {_seeded(TOUCH, seed): (settings.regrasping.observation, seed) for seed in seeds}
    observations |= {_seeded(" + ".join(parts), seeds[0]): (parts, seeds[0]) for parts in ablation}
    learners = {}
    for name, (parts, seed) in observations.items():
        grasps = Grasps(objects, showing(settings, parts))
        learners[name] = [Learner(grasps, grasps, seed, grasps.test_seeds)]
    return learners


def _seeded(name: str, seed: int) -> str:
    return f"{name}, seed {seed}"


def _submit_rollouts(learners: list[Learner], settings: Settings, workers: Workers) -> dict[Learner, Any]:
    """Submit the rollouts of all policies in turn, so that all are learnt at a time."""
    last: dict[Learner, Any] = dict.fromkeys(learners)
    for number in range(settings.regrasping.rollouts):
        for learner, before in last.items():
            last[learner] = workers.submit(learner.training.learn, learner.seed, number, before)
    return last


def _tests_by_touch(
    learners: dict[str, list[Learner]], last_rollouts: dict[Learner, Any], workers: Workers
) -> dict[str, list[Any]]:
    tests: dict[str, list[Any]] = {name: [] for name in learners}
    for name, row in learners.items():
        for learner in row:
            act = partial(touch_act, learner.training.path(learner.seed))
            tests[name] += learner.test.tests(workers, act, learner.test_seeds, after=last_rollouts[learner])
    return tests


def _fixed_moves(trainings: list[Grasps], workers: Workers) -> list[Move]:
    """Return the fixed move that holds most of the objects of each training."""
    tries = [[workers.submit(grasps.tried, move) for move in FIXED_MOVES] for grasps in trainings]
    successes = [[played["held"].sum() for played in workers.gather(row)] for row in tries]
    return [FIXED_MOVES[int(np.argmax(row))] for row in successes]


def _rates(tests: dict[str, list[Any]], ids: list[str], workers: Workers) -> dict[str, Figures]:
    return {name: _figures(joined(workers.gather(batches)), ids) for name, batches in tests.items()}


def _figures(played: Played, ids: list[str]) -> Figures:
    """Return percents held with their binomial interval of 95 % (Wilson), by object too."""
    successes, objects = played["held"], played["object"]
    interval = binomtest(int(successes.sum()), len(successes)).proportion_ci(method="wilson")
    return {
        "percent": 100 * float(successes.mean()),
        "interval_percent": [100 * float(interval.low), 100 * float(interval.high)],
        "regrasps": float(played["regrasps"].mean()),
        "unseen_gels": int(played["unseen"].sum()),
        "by_object_percent": {
            ids[label]: 100 * float(successes[objects == label].mean()) for label in np.unique(objects)
        },
    }


def _differences(rates: dict[str, Figures], rates_unseen: dict[str, Figures], seed: int) -> Figures:
    """Return the points lost by not knowing an object, and those that touch is ahead of others then."""
    rates_known = {name: rates.get(FIXED if name == FIXED else _seeded(name, seed)) for name in rates_unseen}
    rates_beside = {name: rates[name] for name in ("first grasp", "random")} | rates_unseen
    return {
        "lost": {
            name: _ahead(row, rates_unseen[name]) for name, row in rates_known.items() if row is not None
        },
        "touch_ahead": {
            name: _ahead(rates_unseen[TOUCH], row) for name, row in rates_beside.items() if name != TOUCH
        },
    }


def _ahead(first: Figures, second: Figures) -> Figures:
    """Return a mean difference of objects in points with its interval of 95 % over objects."""
    points = [
        first["by_object_percent"][name] - percent for name, percent in second["by_object_percent"].items()
    ]
    return {"points": float(np.mean(points)), "interval_points": list(interval_over_objects(points))}
