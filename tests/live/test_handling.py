"""A scene in one's hands: what a ray finds, how things are carried, what fingers bear, what is refused."""

import numpy as np
import pytest

from objectfolder.errors import QueryError
from objectfolder.live import Finger, LiveSound, LiveTouch
from pipeline.publish.scenes import handling
from pipeline.publish.scenes.handling import CARRYING_RAD_S, FELT_BY, FRICTION, Handling
from pipeline.publish.scenes.opened_scene import OpenedScene
from tests.live.drop_scenes import drop_scene

mujoco = pytest.importorskip("mujoco")
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def opened(tmp_path):
    return OpenedScene.of(drop_scene(tmp_path, "mug", "bell"))


@pytest.fixture
def world(opened):
    return Handling(opened.spec, opened.files)


def ran(world, seconds):
    for _ in range(round(seconds / world.timestep_s)):
        world.step()


def test_a_ray_finds_the_nearest_surface_and_its_side(world):
    through = np.array([-1.0, 0.0, 0.06]), np.array([1.0, 0.0, 0.0])
    hit = world.under(*through)
    assert hit.body == "0_mug"
    assert hit.normal[0] < -0.5
    assert world.where("0_mug", hit.local_m)[2] == pytest.approx(0.06, abs=1e-6)
    assert world.under(-through[0] + [0, 0, 0.12], -through[1]).body == "1_bell"
    assert world.under(through[0], -through[1]) is None


def test_what_is_carried_follows_a_critically_damped_spring(world):
    ran(world, 0.3)  # it stands
    centre = world._data.body("1_bell").xipos.copy()
    local = world._data.body("1_bell").xmat.reshape(3, 3).T @ (centre - world.pose("1_bell")[:3, 3])
    world.carry("1_bell", local, centre + 0.1 * UP)
    for _ in range(4):
        begun_s = world.time_s
        ran(world, 0.05)
        turn = CARRYING_RAD_S * (world.time_s - 0.3)
        risen = world.where("1_bell", local)[2] - centre[2]
        assert risen == pytest.approx(0.1 * (1 - (1 + turn) * np.exp(-turn)), abs=0.004), begun_s
    ran(world, 1.0)
    np.testing.assert_allclose(world.where("1_bell", local), centre + 0.1 * UP, atol=1e-4)
    world.let_go()
    ran(world, 1.0)
    assert world.where("1_bell", local)[2] < centre[2] + 0.02


def test_both_fingers_press_alike_and_bear_the_weight_when_they_lift(world, opened):
    ran(world, 0.2)
    touch = LiveTouch(world, opened.files, {name: Finger(friction=FRICTION) for name in FELT_BY})
    stood_m = world.pose("0_mug")[2, 3]
    world.reach_round("0_mug", np.array([0.0, 1.0, 0.0]))
    world.grip(6.0, 0.0)
    ran(world, 0.5)
    world.grip(6.0, 0.05)
    ran(world, 1.0)
    world.grip(6.0, 0.0)
    ran(world, 0.2)
    felt = touch.feel()
    assert [felt[name].normal_n for name in FELT_BY] == pytest.approx([6.0, 6.0], rel=0.02)
    weight_n = 9.81 * world.mass_kg("0_mug")
    assert sum(felt[name].tangential_n for name in FELT_BY) == pytest.approx(weight_n, rel=0.05)
    assert world.pose("0_mug")[2, 3] - stood_m == pytest.approx(0.05, abs=0.01)
    world.park()
    ran(world, 0.5)
    assert world.pose("0_mug")[2, 3] < stood_m + 0.02
    assert not any(feeling.normal_n for feeling in touch.feel().values())


def test_a_body_that_was_lifted_starts_from_its_place_at_rest(world):
    world.strike("0_mug", world.pose("0_mug")[:3, 3], np.array([0.3, 0.2, 0.1]))
    ran(world, 0.3)
    world.lift("0_mug", 0.1)
    assert world.pose("0_mug")[2, 3] == pytest.approx(0.01 - world._files["0_mug"].surface.bounds[0][2] + 0.1)
    world.step()
    assert abs(world._data.qvel[:6]).max() <= 9.81 * world.timestep_s + 1e-9


def test_what_cannot_be_handled_is_refused(world, opened, monkeypatch):
    with pytest.raises(QueryError, match="not level"):
        world.reach_round("0_mug", np.array([0.0, 0.0, 1.0]))
    monkeypatch.setattr(handling, "STARTS_M", 0.05)
    with pytest.raises(QueryError, match="wider than the hand"):
        world.reach_round("0_mug", np.array([1.0, 0.0, 0.0]))
    with pytest.raises(QueryError, match="force_n"):
        world.grip(11.0, 0.0)
    with pytest.raises(QueryError, match="no body"):
        world.strike("2_cup", np.zeros(3), np.zeros(3))
    with pytest.raises(QueryError, match="has no Object File"):
        LiveSound(world, opened.files).strike("hand/left", np.zeros(3), np.ones(3))
    fast = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="0_mug"><geom size="1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(QueryError, match="does not move freely"):
        Handling(fast, {"0_mug": opened.files["0_mug"]})


def test_a_strike_of_no_impulse_is_not_heard(world, opened):
    sound = LiveSound(world, {"1_bell": opened.files["1_bell"]})
    sound.strike("1_bell", world.pose("1_bell")[:3, 3], np.zeros(3))
    assert not sound.impacts
    sound.strike("1_bell", world.pose("1_bell")[:3, 3], np.array([0.01, 0.0, 0.0]))
    assert sound.impacts[0].duration_s > 0
    assert abs(sound.block()).max() > 0
