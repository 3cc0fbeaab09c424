"""Environments of a squeeze and of strikes: gymnasium's checker, seeds, what is observed and rewarded."""

import sys
from importlib import import_module, reload

import numpy as np
import pytest

import objectfolder
from objectfolder.errors import MissingPackageError, QueryError

gymnasium = pytest.importorskip("gymnasium")
environments = import_module("objectfolder.live.environments")


@pytest.fixture(scope="module")
def squeeze():
    name = "objectfolder.live.environments:objectfolder/Squeeze-v0"
    return gymnasium.make(name, pixels=32, render_mode="rgb_array")


def squeezed(env, actions, seed=0):
    """The first observation, and those, the rewards and the ends that follow."""
    first, _ = env.reset(seed=seed)
    return first, *zip(*[env.step(np.array(action, np.float32))[:4] for action in actions], strict=True)


@pytest.fixture(scope="module")
def strike():
    return gymnasium.make("objectfolder/Strike-v0", pixels=32, render_mode="rgb_array")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["squeeze", "strike"])
def test_gymnasiums_checker_is_content(name, request):
    from gymnasium.utils.env_checker import check_env

    check_env(request.getfixturevalue(name).unwrapped)


def test_equal_seeds_are_equal_to_the_bit_and_others_differ(squeeze):
    actions = [(1.0, 0.0)] * 4
    (first, steps, *_), (_, twin, *_), (second, *_) = (squeezed(squeeze, actions, seed) for seed in (5, 5, 6))
    for name in steps[-1]:
        np.testing.assert_array_equal(steps[-1][name], twin[-1][name])
    assert (first["image"] != second["image"]).any()


def test_a_mug_is_gripped_lifted_heard_and_felt(squeeze):
    actions = [(0.4, 0.0)] * 20 + [(0.4, 1.0)] * 13
    first, steps, rewards, ended, _ = squeezed(squeeze, actions)
    untouched = objectfolder.example("mug").touch.no_contact
    assert (first["touch"] == untouched).all()
    assert not first["audio"].any()
    assert max(np.abs(step["audio"]).max() for step in steps[:20]) > 0.01  # the fingers hit it
    assert (steps[-1]["touch"] != untouched).any(axis=(1, 2, 3)).all()
    closed, risen, normal_n, tangential_n = steps[-1]["proprioception"].reshape(2, 4).T
    assert normal_n == pytest.approx([7.0, 7.0], rel=0.03)
    mug = objectfolder.example("mug").description["body"]["mass_kg"]
    assert tangential_n.sum() == pytest.approx(mug * 9.81, rel=0.1)
    assert (closed > 0).all()
    assert (risen > 0.02).all()
    assert sum(rewards) > 0.5
    assert ended[-1] == (sum(rewards) >= 1)
    assert squeeze.render().shape == (32, 32, 3)


def test_a_mug_that_is_held_too_softly_stays_and_earns_nothing(squeeze):
    *_, rewards, ended, _ = squeezed(squeeze, [(-0.9, 0.0)] * 20 + [(-0.9, 1.0)] * 13)
    assert abs(sum(rewards)) < 0.05
    assert not any(ended)


def test_a_harder_strike_is_louder_and_the_reward_tells_how_far_from_the_wanted_level(strike):
    levels = []
    for hard in (-0.5, 0.0, 0.5):
        observation, _ = strike.reset(seed=1)
        wanted_db = float(observation["wanted"][0])
        observation, reward, ended, _, info = strike.step(np.array([0.3, -0.5, hard], np.float32))
        heard_db = 20 * np.log10(np.sqrt((observation["audio"].astype(float) ** 2).mean()) / 2e-5)
        assert info["level_db"] == pytest.approx(heard_db, abs=0.01)
        assert reward == pytest.approx(-abs(heard_db - wanted_db) / 20, abs=1e-3)
        assert ended == (abs(heard_db - wanted_db) <= 1)
        levels.append(heard_db)
    # Ten times the impulse in two steps, and a shorter contact: 20 dB and more of brightness.
    assert levels[2] - levels[0] > 19


def test_a_strike_moves_the_object_as_its_impulse_says(strike):
    strike.reset(seed=0)
    world, mug = strike.unwrapped, objectfolder.example("mug")
    world._strike(0.0, 0.0, 0.05)
    (impact,) = world._sound.impacts
    assert impact.bodies == ("hammer", "object")
    assert np.linalg.norm(impact.impulse_n_s) == pytest.approx(0.05)
    velocity = world._data.qvel[:3]
    turned = world._data.qvel[3:6]
    centre = np.array(mug.description["body"]["centre_of_mass_m"])
    momentum = mug.description["body"]["mass_kg"] * (velocity + np.cross(turned, centre))
    np.testing.assert_allclose(momentum, impact.impulse_n_s, atol=1e-4)


@pytest.mark.slow
def test_strikes_side_by_side_are_those_one_by_one():
    both = gymnasium.make_vec("objectfolder/Strike-v0", num_envs=2, vectorization_mode="sync", pixels=16)
    both.reset(seed=[3, 4])
    actions = np.array([[0.1, 0.0, 0.2], [0.6, -0.5, -0.4]], np.float32)
    observations = both.step(actions)[0]
    for number, seed in enumerate((3, 4)):
        alone = gymnasium.make("objectfolder/Strike-v0", pixels=16)
        alone.reset(seed=seed)
        expected = alone.step(actions[number])[0]
        for name, value in expected.items():
            np.testing.assert_array_equal(observations[name][number], value)


def test_no_environment_without_pixels_or_gymnasium(monkeypatch):
    with pytest.raises(QueryError, match="pixels: 0"):
        environments.Squeeze(pixels=0)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(MissingPackageError, match=r"gymnasium: is not installed\. .*factory\[gymnasium\]"):
        reload(environments)
