"""A policy that grasps again by touch, learnt by TRPO, beside what needs no touch.

Beside it stand: lifting at the first grasp; moves drawn at random; the best of fixed moves, found on
episodes of the training; and, as one who sees could do, the hardest squeeze at the centre of mass. An object
is put back before it is grasped again. So a sequence of fixed moves is worth what their sum is. Policies of
the first seed to which gels show other things say what the parts of touch are worth.
"""

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import binomtest

from learning.grasping import world
from learning.grasping.regrasping import WITHOUT_GELS, Floats, Regrasping
from learning.grasping.worlds import Worlds
from learning.runs import Objects, kept, kept_path
from learning.settings import Settings
from learning.workers import Workers
from objectfolder.products.provenance import seed_from

if TYPE_CHECKING:
    from sb3_contrib import TRPO
    from stable_baselines3.common.vec_env import DummyVecEnv

HIDDEN, LOG_SD, LIFTING = (64, 64), -1.0, -0.5  # of the networks; of actions, and lifting's mean, at first
BATCH, TARGET_DIVERGENCE, LEARNING_RATE, CRITIC_UPDATES = 128, 0.03, 1e-3, 15
FIXED_MOVES = tuple(itertools.product((-0.5, -0.25, 0.0, 0.25, 0.5), (0.0,), (-0.5, 0.0, 0.5)))
LIFT = np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32)
TEST = 1_000_000  # seeds of the test's episodes are this and above
BATCH_EPISODES = 50
UNKEYED = {"seeds", "ablation", "rollouts", "episodes", "fixed_episodes"}  # settings that no unit depends on
# An action by what is observed, by the number of regrasps, and by chance, which is the episode's own.
Act = Callable[[Floats, int, np.random.Generator], Floats]
Played = dict[str, NDArray[Any]]


def evaluate(objects: Objects, settings: Settings, workers: Workers) -> dict[str, Any]:
    """Return how many objects are held, by policies that touch and by what stands beside them."""
    grasps, parameters = Grasps(objects, settings), settings.regrasping
    workers.gather([workers.submit(grasps.worlds.part, name) for name in grasps.worlds])
    learners = {f"touch, seed {seed}": (grasps, seed) for seed in parameters.seeds}
    for shown in parameters.ablation:
        name = f"{' + '.join(shown)}, seed {parameters.seeds[0]}"
        learners[name] = Grasps(objects, showing(settings, shown)), parameters.seeds[0]
    learnt: dict[str, Any] = dict.fromkeys(learners)
    for number in range(parameters.rollouts):
        for name, (own, seed) in learners.items():  # in turn, so that all are learnt at a time
            learnt[name] = workers.submit(own.learn, seed, number, learnt[name])
    moves = [workers.submit(grasps.tried, move) for move in FIXED_MOVES]
    tests = {
        "first grasp": grasps.tests(workers, _lift),
        "random": grasps.tests(workers, _random),
        "hardest, centred": grasps.tests(workers, _lift, hardest=True),
    }
    held = [episodes["held"].sum() for episodes in workers.gather(moves)]
    best = FIXED_MOVES[int(np.argmax(held))]
    tests["fixed move"] = grasps.tests(workers, partial(_moved, best))
    for name, (own, seed) in learners.items():
        tests[name] = own.tests(workers, partial(_touched, own.path(seed)), after=learnt[name])
    return {
        "spread_mm": 1e3 * parameters.spread_m,
        "fixed_move": list(best),
        "held": {
            who: _figures(joined(workers.gather(batches)), grasps.ids) for who, batches in tests.items()
        },
    }


def showing(settings: Settings, shown: Sequence[str]) -> Settings:
    """Return the same settings but that gels show these parts of a grasp."""
    regrasping = settings.regrasping.model_copy(update={"observation": tuple(shown)})
    return settings.model_copy(update={"regrasping": regrasping})


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


def _lift(observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    return LIFT


def _random(observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    return random.uniform(-1, 1, 4).astype(np.float32)


def _moved(move: tuple[float, ...], observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    return LIFT if regrasps else np.array([*move, -1.0], dtype=np.float32)


def feeling(observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    """Move at random until both gels are pressed, and then lift."""
    pressed = observed[:-WITHOUT_GELS].reshape(2, -1).any(axis=1).all()
    return LIFT if pressed else np.array([*random.uniform(-1, 1, 3), -1.0], dtype=np.float32)


def _touched(path: Path, observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    return np.asarray(_policy(path).predict(observed, deterministic=True)[0])


def _act_name(act: Act) -> str:
    return f"{act.func.__name__} {act.args}" if isinstance(act, partial) else act.__name__


@cache
def _policy(path: Path) -> Any:
    """Return a policy that is kept."""
    from sb3_contrib import TRPO

    return TRPO.load(path).policy


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
        observed, info = environment.reset(seed=seed)
        over, random = False, np.random.default_rng([seed, 1])
        while not over:
            observed, _, over, _, info = environment.step(act(observed, info["regrasps"], random))
        label = environment.ids.index(info["object"])
        rows.append((info["is_success"], label, info["regrasps"], info["unseen"]))
    held, label, regrasps, unseen = np.array(rows, dtype=np.int64).T
    return {"held": held == 1, "object": label, "regrasps": regrasps, "unseen": unseen}


def joined(parts: list[Played]) -> Played:
    """Return episodes one after another."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


class Grasps:
    """Episodes of the training and of the test, kept by what they depend on.

    Attributes
    ----------
    worlds, ids
        Of the objects with a mass, in order, and their names.
    """

    def __init__(self, objects: Objects, settings: Settings) -> None:
        self._parameters, self.worlds = settings.regrasping, Worlds(objects)
        self.ids = list(self.worlds)
        self._least_n = {name: world.least_force_n(objects.files[name]) for name in self.ids}
        self._key: Mapping[str, Any] = {
            "asked": self._parameters.model_dump(exclude=UNKEYED),
            "files": self.worlds.digests,
        }

    def environment(self, force_share: float, spread_m: float) -> Regrasping:
        """Return an environment of all objects."""
        forces_n = {name: force_share * least_n for name, least_n in self._least_n.items()}
        parameters = self._parameters
        return Regrasping(
            self.worlds, forces_n, spread_m, parameters.regrasps, parameters.charge, parameters.observation
        )

    def tests(self, workers: Workers, act: Act, *, hardest: bool = False, after: Any = None) -> list[Any]:
        """Submit the test's episodes in batches, which each have their own seeds."""
        ends = [*range(0, self._parameters.episodes, BATCH_EPISODES), self._parameters.episodes]
        return [
            workers.submit(self.played, act, range(TEST + first, TEST + end), hardest, after)
            for first, end in itertools.pairwise(ends)
        ]

    def played(self, act: Act, seeds: range, hardest: bool = False, after: Any = None) -> Played:
        """Return an episode a seed, `hardest` with the greatest force at the centre of mass."""
        parameters = self._parameters
        force_share = world.FORCE_SHARES[1] if hardest else parameters.force_share
        environment = self.environment(force_share, 0.0 if hardest else parameters.spread_m)
        key = {
            **self._key,
            "unit": "episodes",
            "act": _act_name(act),
            "hardest": hardest,
            "seeds": str(seeds),
        }
        return kept(__name__, key, lambda: play(environment, act, seeds))

    def tried(self, move: tuple[float, ...]) -> Played:
        """Return what becomes of a fixed move, on the first seeds that are no test's."""
        return self.played(partial(_moved, move), range(self._parameters.fixed_episodes))

    def learnt(self, seed: int) -> "TRPO":
        """Return the policy of a seed."""
        from sb3_contrib import TRPO

        for number in range(self._parameters.rollouts):
            self.learn(seed, number)
        return TRPO.load(self.path(seed))

    def learn(self, seed: int, number: int, before: None = None) -> None:
        """Train the policy of a seed by a rollout, which is kept.

        It depends on the policy before it and on its number alone.
        """
        from sb3_contrib import TRPO
        from stable_baselines3.common.utils import set_random_seed
        from stable_baselines3.common.vec_env import DummyVecEnv

        path = self._path(seed, number)
        if path.exists():
            return
        parameters = self._parameters
        environment = DummyVecEnv([lambda: self.environment(parameters.force_share, parameters.spread_m)])
        model = (
            TRPO.load(self._path(seed, number - 1))
            if number
            else _untrained(seed, environment, parameters.rollout_steps)
        )
        rollout_seed = seed_from(seed, "rollout", str(number)) % 2**32
        set_random_seed(rollout_seed)
        environment.seed(rollout_seed)
        model.set_env(environment, force_reset=True)
        model.learn(parameters.rollout_steps, reset_num_timesteps=False)
        _save(model, path)

    def path(self, seed: int) -> Path:
        """Return where the policy of a seed is kept."""
        return self._path(seed, self._parameters.rollouts - 1)

    def known(self, seed: int) -> Act | None:
        """Return the learnt policy of a seed as an act; None if it is not trained yet."""
        path = self.path(seed)
        return partial(_touched, path) if path.exists() else None

    def _path(self, seed: int, number: int) -> Path:
        return kept_path(__name__, {**self._key, "unit": "policy", "seed": seed, "rollout": number}, ".zip")


def _untrained(seed: int, environment: "DummyVecEnv", steps: int) -> "TRPO":
    """Return a policy that seldom lifts: it comes to grasp again before it knows what that is worth."""
    from sb3_contrib import TRPO

    model = TRPO(
        "MlpPolicy", environment, n_steps=steps, batch_size=BATCH, gamma=1.0, target_kl=TARGET_DIVERGENCE,
        learning_rate=LEARNING_RATE, n_critic_updates=CRITIC_UPDATES, device="cpu", seed=seed,
        policy_kwargs={"net_arch": list(HIDDEN), "log_std_init": LOG_SD},
    )  # fmt: skip
    with torch.no_grad():
        model.policy.action_net.bias[3] = LIFTING
    return model


def _save(model: "TRPO", path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.partial")
    with partial.open("wb") as file:
        model.save(file)
    partial.replace(path)
