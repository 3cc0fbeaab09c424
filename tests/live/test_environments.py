"""The environment of a squeeze: gymnasium's own checker, seeds, what is observed, what is rewarded."""

import sys
from importlib import import_module, reload

import numpy as np
import pytest

import objectfolder
from objectfolder.errors import QueryError

gymnasium = pytest.importorskip("gymnasium")
environments = import_module("objectfolder.live.environments")


@pytest.fixture(scope="module")
def squeeze():
    return gymnasium.make("objectfolder/Squeeze-v0", pixels=32, render_mode="rgb_array")


def squeezed(env, actions, seed=0):
    """The first observation, and those, the rewards and the ends that follow."""
    first, _ = env.reset(seed=seed)
    return first, *zip(*[env.step(np.array(action, np.float32))[:4] for action in actions], strict=True)


@pytest.mark.slow
def test_gymnasiums_checker_is_content(squeeze):
    from gymnasium.utils.env_checker import check_env

    check_env(squeeze.unwrapped)


def test_equal_seeds_are_equal_to_the_bit_and_others_differ(squeeze):
    actions = [(1.0, 0.0)] * 4
    (first, one, *_), (_, two, *_), (other, *_) = (squeezed(squeeze, actions, seed) for seed in (5, 5, 6))
    for name in one[-1]:
        np.testing.assert_array_equal(one[-1][name], two[-1][name])
    assert (first["image"] != other["image"]).any()


def test_a_mug_is_gripped_lifted_heard_and_felt(squeeze):
    actions = [(0.4, 0.0)] * 20 + [(0.4, 1.0)] * 13
    first, seen, rewards, ended, _ = squeezed(squeeze, actions)
    untouched = objectfolder.example("mug").touch.no_contact
    assert (first["touch"] == untouched).all()
    assert not first["audio"].any()
    assert max(np.abs(one["audio"]).max() for one in seen[:20]) > 0.01  # the fingers hit it
    assert (seen[-1]["touch"] != untouched).any(axis=(1, 2, 3)).all()
    closed, risen, normal_n, tangential_n = seen[-1]["proprioception"].reshape(2, 4).T
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


def test_no_environment_without_pixels_or_gymnasium(monkeypatch):
    with pytest.raises(QueryError, match="pixels: 0"):
        environments.Squeeze(pixels=0)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(QueryError, match=r"gymnasium: is not installed\. pip install gymnasium"):
        reload(environments)
