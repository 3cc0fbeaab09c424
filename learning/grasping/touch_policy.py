"""A policy that grasps again by touch, learnt by TRPO and kept, and acts that need no touch."""

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

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
LIFT = np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32)
TEST = 1_000_000  # seeds of the test's episodes are this and above
BATCH_EPISODES = 50
# Settings that no unit depends on.
UNKEYED = {"seeds", "ablation", "rollouts", "episodes", "fixed_episodes", "folds"}
# An action by what is observed, by the number of regrasps, and by chance, which is the episode's own.
Act = Callable[[Floats, int, np.random.Generator], Floats]
Played = dict[str, NDArray[Any]]
Move = tuple[float, ...]


def showing(settings: Settings, shown: Sequence[str]) -> Settings:
    """Return the same settings but that gels show these parts of a grasp."""
    regrasping = settings.regrasping.model_copy(update={"observation": tuple(shown)})
    return settings.model_copy(update={"regrasping": regrasping})


def lift_act(observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    """Lift at the first grasp."""
    return LIFT


def random_act(observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    """Move at random, and lift as often as not."""
    return random.uniform(-1, 1, 4).astype(np.float32)


def fixed_act(move: Move, observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    """Move once, always alike, and lift."""
    return LIFT if regrasps else np.array([*move, -1.0], dtype=np.float32)


def feeling(observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    """Move at random until both gels are pressed, and then lift."""
    pressed = observed[:-WITHOUT_GELS].reshape(2, -1).any(axis=1).all()
    return LIFT if pressed else np.array([*random.uniform(-1, 1, 3), -1.0], dtype=np.float32)


def touch_act(path: Path, observed: Floats, regrasps: int, random: np.random.Generator) -> Floats:
    """Do what a policy that is kept makes of what is felt."""
    return np.asarray(_policy(path).predict(observed, deterministic=True)[0])


def _act_name(act: Act) -> str:
    return f"{act.func.__name__} {act.args}" if isinstance(act, partial) else act.__name__


@cache
def _policy(path: Path) -> Any:
    """Return a policy that is kept."""
    from sb3_contrib import TRPO

    return TRPO.load(path).policy


def play(environment: Regrasping, act: Act, seeds: Iterable[int]) -> Played:
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

    Parameters
    ----------
    objects, settings
        Of the data set.
    left_out
        Names of objects that no episode has: nothing that is learnt or kept here depends on their files.

    Attributes
    ----------
    worlds, ids
        Of the other objects with a mass, in order, and their names.
    """

    def __init__(self, objects: Objects, settings: Settings, left_out: Collection[str] = ()) -> None:
        self._parameters, self.worlds = settings.regrasping, Worlds(objects, left_out)
        self.ids = list(self.worlds)
        self._least_n = {name: world.least_force_n(objects.files[name]) for name in self.ids}
        self._key: Mapping[str, Any] = {
            "asked": self._parameters.model_dump(exclude=UNKEYED),
            "files": self.worlds.digests,
        }

    def environment(self, force_share: float, spread_m: float) -> Regrasping:
        """Return an environment of these objects."""
        forces_n = {name: force_share * least_n for name, least_n in self._least_n.items()}
        parameters = self._parameters
        return Regrasping(
            self.worlds, forces_n, spread_m, parameters.regrasps, parameters.charge, parameters.observation
        )

    def _usual_environment(self) -> Regrasping:
        return self.environment(self._parameters.force_share, self._parameters.spread_m)

    @property
    def test_seeds(self) -> range:
        """Seeds of the test's episodes."""
        return range(TEST, TEST + self._parameters.episodes)

    def test_seeds_of(self, names: Collection[str]) -> tuple[int, ...]:
        """Return seeds of those of the test's episodes that have some of the objects."""
        environment = self._usual_environment()
        return tuple(seed for seed in self.test_seeds if environment.object_of(seed) in names)

    def tests(
        self, workers: Workers, act: Act, seeds: Sequence[int], *, hardest: bool = False, after: Any = None
    ) -> list[Any]:
        """Submit episodes in batches."""
        starts = range(0, len(seeds), BATCH_EPISODES)
        return [
            workers.submit(self.played, act, seeds[start : start + BATCH_EPISODES], hardest, after)
            for start in starts
        ]

    def played(self, act: Act, seeds: Sequence[int], hardest: bool = False, after: Any = None) -> Played:
        """Return an episode a seed, `hardest` with the greatest force at the centre of mass."""
        environment = self.environment(world.FORCE_SHARES[1], 0.0) if hardest else self._usual_environment()
        key = {
            **self._key,
            "unit": "episodes",
            "act": _act_name(act),
            "hardest": hardest,
            "seeds": str(seeds),
        }
        return kept(__name__, key, lambda: play(environment, act, seeds))

    def tried(self, move: Move) -> Played:
        """Return what becomes of a fixed move, on the first seeds that are no test's."""
        return self.played(partial(fixed_act, move), range(self._parameters.fixed_episodes))

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
        steps = self._parameters.rollout_steps
        environment = DummyVecEnv([self._usual_environment])
        model = TRPO.load(self._path(seed, number - 1)) if number else _untrained(seed, environment, steps)
        rollout_seed = seed_from(seed, "rollout", str(number)) % 2**32
        set_random_seed(rollout_seed)
        environment.seed(rollout_seed)
        model.set_env(environment, force_reset=True)
        model.learn(steps, reset_num_timesteps=False)
        _save(model, path)

    def path(self, seed: int) -> Path:
        """Return where the policy of a seed is kept."""
        return self._path(seed, self._parameters.rollouts - 1)

    def known(self, seed: int) -> Act | None:
        """Return the learnt policy of a seed as an act; None if it is not trained yet."""
        path = self.path(seed)
        return partial(touch_act, path) if path.exists() else None

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
