"""A policy that grasps again by touch, learnt by TRPO, beside what needs no touch.

Beside it stand: lifting at the first grasp; moves drawn at random; the best of fixed moves, found on
episodes of the training; and, as one who sees could do, the hardest squeeze at the centre of mass. An object
is put back before it is grasped again. So a sequence of fixed moves is worth what their sum is.
"""

import itertools
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import TRPO
from scipy.stats import binomtest
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv

from learning.grasping import regrasping, world
from learning.grasping.regrasping import GEL, Floats, Regrasping
from learning.runs import Objects, digest, kept, kept_path
from learning.settings import Settings
from objectfolder.products.provenance import seed_from

HIDDEN, LOG_SD, LIFTING = (64, 64), -1.0, -0.5  # of the networks; of actions, and lifting's mean, at first
BATCH, TARGET_DIVERGENCE, LEARNING_RATE, CRITIC_UPDATES = 128, 0.03, 1e-3, 15
FIXED_MOVES = tuple(itertools.product((-0.5, -0.25, 0.0, 0.25, 0.5), (0.0,), (-0.5, 0.0, 0.5)))
LIFT = np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32)
TEST = 1_000_000  # seeds of the test's episodes are this and above
Act = Callable[[Floats, int], Floats]  # an action by what is observed and the number of regrasps
Played = dict[str, NDArray[Any]]


def evaluate(objects: Objects, settings: Settings) -> dict[str, Any]:
    """Return how many objects are held, by policies that touch and by what stands beside them."""
    grasps = Grasps(objects, settings)
    asked = settings.regrasping
    best = grasps.best_fixed_move()
    found = {
        "first grasp": grasps.played("first grasp", _lift),
        "random": grasps.played("random", _random(asked.seeds[0])),
        "fixed move": grasps.played("fixed move", _fixed(best)),
        "hardest, centred": grasps.played("hardest, centred", _lift),
    }
    for seed in asked.seeds:
        found[f"touch, seed {seed}"] = grasps.played(f"touch, seed {seed}", _of(grasps.learnt(seed)))
    return {
        "spread_mm": 1e3 * asked.spread_m,
        "fixed_move": list(best),
        "held": {who: _figures(one, grasps.ids) for who, one in found.items()},
    }


def _figures(played: Played, ids: list[str]) -> dict[str, Any]:
    """Return percents held with their binomial interval of 95 % (Wilson), by object too."""
    held, objects = played["held"], played["object"]
    interval = binomtest(int(held.sum()), len(held)).proportion_ci(method="wilson")
    return {
        "percent": 100 * float(held.mean()),
        "interval_percent": [100 * float(interval.low), 100 * float(interval.high)],
        "regrasps": float(played["regrasps"].mean()),
        "unseen_gels": int(played["unseen"].sum()),
        "by_object_percent": {
            ids[label]: 100 * float(held[objects == label].mean()) for label in np.unique(objects)
        },
    }


def _lift(observed: Floats, regrasps: int) -> Floats:
    return LIFT


def _random(seed: int) -> Act:
    random = np.random.default_rng(seed)
    return lambda observed, regrasps: random.uniform(-1, 1, 4).astype(np.float32)


def _fixed(move: tuple[float, ...]) -> Act:
    first = np.array([*move, -1.0], dtype=np.float32)
    return lambda observed, regrasps: LIFT if regrasps else first


def feeling(seed: int) -> Act:
    """Return who moves at random until both gels are pressed, and then lifts."""
    moved = _random(seed)

    def act(observed: Floats, regrasps: int) -> Floats:
        pressed = observed[: 2 * GEL].reshape(2, GEL).any(axis=1).all()
        return LIFT if pressed else np.append(moved(observed, regrasps)[:3], np.float32(-1.0))

    return act


def _of(model: TRPO) -> Act:
    return lambda observed, regrasps: model.predict(observed, deterministic=True)[0]


def play(environment: Regrasping, act: Act, seeds: range) -> Played:
    """Return what became of an episode a seed.

    Returns
    -------
    held
        (n,) bool.
    object, regrasps, unseen
        (n,) int64: the object's place among the names in order, regrasps, touches the gels could not show.
    """
    rows = []
    for seed in seeds:
        observed, said = environment.reset(seed=seed)
        over = False
        while not over:
            observed, _, over, _, said = environment.step(act(observed, said["regrasps"]))
        label = environment.ids.index(said["object"])
        rows.append((said["is_success"], label, said["regrasps"], said["unseen"]))
    held, label, regrasps, unseen = np.array(rows, dtype=np.int64).T
    return {"held": held == 1, "object": label, "regrasps": regrasps, "unseen": unseen}


class Grasps:
    """Episodes of the training and of the test, kept by what they depend on.

    Attributes
    ----------
    ids, worlds
        Names of the objects with a mass, in order, and their worlds.
    """

    def __init__(self, objects: Objects, settings: Settings) -> None:
        files = {name: file for name, file in objects.files.items() if file.description["body"] is not None}
        self._asked, self.ids = settings.regrasping, sorted(files)
        self.worlds = {name: world.world_of(file) for name, file in files.items()}
        self._least_n = {name: world.least_force_n(file) for name, file in files.items()}
        modules = (world.__file__, regrasping.__file__, __file__)
        self._key: Mapping[str, Any] = {
            "asked": self._asked.model_dump(exclude={"seeds", "rollouts", "episodes", "fixed_episodes"}),
            "files": {name: objects.digests[name] for name in files},
            "code": [digest(Path(module)) for module in modules],
        }

    def environment(self, force_share: float, spread_m: float) -> Regrasping:
        """Return an environment of all objects."""
        forces_n = {name: force_share * least_n for name, least_n in self._least_n.items()}
        return Regrasping(self.worlds, forces_n, spread_m, self._asked.regrasps, self._asked.charge)

    def played(self, who: str, act: Act) -> Played:
        """Return the test's episodes."""
        asked = self._asked
        squeezes = who == "hardest, centred"
        hardest = self.environment(world.FORCE_SHARES[1], 0.0)
        environment = hardest if squeezes else self.environment(asked.force_share, asked.spread_m)
        key = {**self._key, "unit": f"test of {who}", "episodes": asked.episodes, "rollouts": asked.rollouts}
        return kept(key, lambda: play(environment, act, range(TEST, TEST + asked.episodes)))

    def best_fixed_move(self) -> tuple[float, ...]:
        """Return which of `FIXED_MOVES` holds most, on the first seeds that are no test's."""
        environment = self.environment(self._asked.force_share, self._asked.spread_m)
        count = self._asked.fixed_episodes

        def tried() -> Played:
            held = [play(environment, _fixed(move), range(count))["held"].sum() for move in FIXED_MOVES]
            return {"held": np.array(held)}

        key = {**self._key, "unit": "fixed moves", "episodes": count}
        return FIXED_MOVES[int(kept(key, tried)["held"].argmax())]

    def learnt(self, seed: int) -> TRPO:
        """Return the policy of a seed, trained on from the last rollout that was kept.

        A rollout depends on the policy before it and on its number alone.
        """
        asked, paths = self._asked, self._paths(seed)
        environment = DummyVecEnv([lambda: self.environment(asked.force_share, asked.spread_m)])
        done = max((number for number, path in enumerate(paths, 1) if path.exists()), default=0)
        model = TRPO.load(paths[done - 1]) if done else _untrained(seed, environment, asked.rollout_steps)
        for number in range(done, asked.rollouts):
            drawn = seed_from(seed, "rollout", str(number)) % 2**32
            set_random_seed(drawn)
            environment.seed(drawn)
            model.set_env(environment, force_reset=True)
            model.learn(asked.rollout_steps, reset_num_timesteps=False)
            _save(model, paths[number])
        return model

    def known(self, seed: int) -> Act | None:
        """Return what `learnt` would, if it has been learnt."""
        last = self._paths(seed)[-1]
        return _of(TRPO.load(last)) if last.exists() else None

    def _paths(self, seed: int) -> list[Path]:
        """Return where the policy of a seed is kept after each rollout."""
        numbers = range(self._asked.rollouts)
        return [
            kept_path({**self._key, "unit": "policy", "seed": seed, "rollout": number}, ".zip")
            for number in numbers
        ]


def _untrained(seed: int, environment: DummyVecEnv, steps: int) -> TRPO:
    """Return a policy that seldom lifts: it comes to grasp again before it knows what that is worth."""
    model = TRPO(
        "MlpPolicy", environment, n_steps=steps, batch_size=BATCH, gamma=1.0, target_kl=TARGET_DIVERGENCE,
        learning_rate=LEARNING_RATE, n_critic_updates=CRITIC_UPDATES, device="cpu", seed=seed,
        policy_kwargs={"net_arch": list(HIDDEN), "log_std_init": LOG_SD},
    )  # fmt: skip
    with torch.no_grad():
        model.policy.action_net.bias[3] = LIFTING
    return model


def _save(model: TRPO, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.partial")
    with partial.open("wb") as file:
        model.save(file)
    partial.replace(path)
