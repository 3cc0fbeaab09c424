"""Collisions of a simulation as they are heard: when, how hard, in blocks, and what is refused."""

import mujoco
import numpy as np
import pytest

import objectfolder
from objectfolder.errors import QueryError
from objectfolder.live import Impact, LiveSound, MujocoSimulation
from objectfolder.live.heard_body import HeardBody

GRAVITY, STEP_S, RATE_HZ = 9.81, 0.002, 44_000.0  # 88 samples a step
RADIUS_M = 0.06
# So soft that the mug gives way as a rigid body: its modes swing many times while a contact lasts.
OTHERS = (1e5, 0.3), (1e6, 0.25), (5e6, 0.29)
WOOD = (1.1e10, 0.25)
LISTENER_M = np.array([0.0, -0.5, 0.5])


@pytest.fixture(scope="module")
def mug():
    return objectfolder.example("mug")


def world(
    bodies: dict[str, tuple[float, float, float]], mass_kg: float, step_s: float = STEP_S
) -> MujocoSimulation:
    """Balls of the mass of a mug above a plane, by the places of their centres."""
    moment = 0.4 * mass_kg * RADIUS_M**2
    balls = "".join(
        f'<body name="{name}" pos="{x} {y} {z}"><freejoint/>'
        f'<inertial pos="0 0 0" mass="{mass_kg}" diaginertia="{moment} {moment} {moment}"/>'
        f'<geom type="sphere" size="{RADIUS_M}"/></body>'
        for name, (x, y, z) in bodies.items()
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step_s}" gravity="0 0 -{GRAVITY}"/>'
        f'<worldbody><geom type="plane" size="1 1 .1"/>{balls}</worldbody></mujoco>'
    )
    return MujocoSimulation(model, mujoco.MjData(model))


def mass_of(file) -> float:
    return file.description["body"]["mass_kg"]


def heard(simulation: MujocoSimulation, files, blocks: int, **settings) -> tuple[np.ndarray, list[Impact]]:
    live = LiveSound(simulation, files, sample_rate_hz=RATE_HZ, listener_m=LISTENER_M, **settings)
    return np.concatenate([live.block() for _ in range(blocks)]), live.impacts


@pytest.mark.parametrize("height_m", [0.05, 0.2])
def test_a_ball_that_falls_strikes_when_and_as_hard_as_mechanics_says(mug, height_m):
    simulation = world({"mug": (0, 0, RADIUS_M + height_m)}, mass_of(mug))
    sound, impacts = heard(simulation, {"mug": mug}, 30, restitution=0.3, others=OTHERS[1])
    first = impacts[0]
    speed = np.sqrt(2 * GRAVITY * height_m)
    assert first.time_s == pytest.approx(speed / GRAVITY, abs=2 * STEP_S)
    assert set(first.bodies) == {"world", "mug"}
    size = 1.3 * mass_of(mug) * speed
    assert np.linalg.norm(first.impulse_n_s) == pytest.approx(size, rel=2 * STEP_S * GRAVITY / speed)
    before = int(first.time_s * RATE_HZ)
    assert not sound[:before].any()
    # Within 5 ms, of which the way to the listener takes 2.
    assert 0 < np.flatnonzero(sound)[0] / RATE_HZ - first.time_s < 5e-3


def test_blocks_are_what_the_file_answers_at_once(mug):
    simulation = world({"mug": (0, 0, RADIUS_M + 0.1)}, mass_of(mug))
    listener = LISTENER_M - [0, 0, RADIUS_M + 0.1]
    sound, (first, *_) = heard(simulation, {"mug": mug}, 30, block_samples=512, rest=None)
    simulation = world({"mug": (0, 0, RADIUS_M + 0.1)}, mass_of(mug))
    sound_again, _ = heard(simulation, {"mug": mug}, 30 * 4, block_samples=128, rest=None)
    scale = np.abs(sound).max()
    np.testing.assert_allclose(sound_again, sound, atol=1e-9 * scale)
    sign = 1 if first.bodies[1] == "mug" else -1
    # The ball touches the ground below its centre, at the foot of the mug's frame.
    point = mug.surface.closest_points(np.array([[0, 0, -RADIUS_M]])).points
    stream = mug.stream(RATE_HZ, listener=listener)
    place = stream.motion(mug.surface.closest_points(point))
    stream.spend(place, sign * first.impulse_n_s, 0, first.profile)
    expected = stream.block(round(0.2 * RATE_HZ))[0]
    start = round(first.time_s * RATE_HZ)
    count = 3000  # before the ball comes back
    np.testing.assert_allclose(sound[start : start + count], expected[:count], atol=1e-6 * scale)


def test_both_bodies_of_a_collision_ring_and_give_way(mug):
    places = {"left": (-RADIUS_M - 0.01, 0, 2.0), "right": (RADIUS_M + 0.01, 0, 2.0)}
    material, lasting = mug.description["material"], {}
    ceramic = material["youngs_modulus_pa"], material["poisson_ratio"]
    for files in (("left",), ("right",), ("left", "right")):
        simulation = world(places, mass_of(mug))
        simulation._data.qvel[0] = 1.0
        sound, impacts = heard(simulation, dict.fromkeys(files, mug), 20, others=ceramic)
        assert np.abs(sound).max() > 0
        collision = next(impact for impact in impacts if set(impact.bodies) == {"left", "right"})
        # About what rigid bodies would pass on, for the modes give much of theirs back.
        assert np.linalg.norm(collision.impulse_n_s) == pytest.approx(1.5 * mass_of(mug) / 2, rel=0.1)
        lasting[files] = collision.duration_s
    assert lasting["left", "right"] > max(lasting["left",], lasting["right",])


def test_a_harder_material_is_struck_for_a_shorter_time(mug):
    durations = []
    for ground in OTHERS:
        simulation = world({"mug": (0, 0, RADIUS_M + 0.1)}, mass_of(mug))
        _, impacts = heard(simulation, {"mug": mug}, 20, others=ground)
        durations.append(impacts[0].duration_s)
    material = mug.description["material"]
    own = (1 - material["poisson_ratio"] ** 2) / material["youngs_modulus_pa"]
    compliances = np.array([own + (1 - nu**2) / modulus for modulus, nu in OTHERS])
    np.testing.assert_allclose(
        np.array(durations) / durations[0], (compliances / compliances[0]) ** 0.4, rtol=2e-3
    )


def test_a_body_that_is_known_is_struck_as_of_its_matter(mug):
    durations = []
    for stated in ({"others": WOOD}, {"others": OTHERS[0], "known": {"world": WOOD}}):
        simulation = world({"mug": (0, 0, RADIUS_M + 0.1)}, mass_of(mug))
        durations.append(heard(simulation, {"mug": mug}, 20, **stated)[1][0].duration_s)
    assert durations[0] == durations[1]
    with pytest.raises(QueryError, match=r"known\['world'\]\[1\]"):
        LiveSound(simulation, {"mug": mug}, known={"world": (1e6, 0.7)})


def test_a_body_at_rest_is_silent(mug):
    sound, impacts = heard(world({"mug": (0, 0, RADIUS_M)}, mass_of(mug)), {"mug": mug}, 90)
    assert impacts == []
    assert not sound.any()


def test_what_cannot_be_heard_is_refused(mug, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where MuJoCo writes its log
    right = world({"mug": (0, 0, 1)}, mass_of(mug))
    with pytest.raises(QueryError, match="no body 'cup'"):
        LiveSound(right, {"cup": mug})
    with pytest.raises(QueryError, match=r"weighs 0\.\d+ kg in the simulation.*Give the file of that object"):
        LiveSound(world({"mug": (0, 0, 1)}, 1.1**3 * mass_of(mug)), {"mug": mug})
    with pytest.raises(QueryError, match=r"a time step of 0\.02 s is longer than a block"):
        LiveSound(world({"mug": (0, 0, 1)}, mass_of(mug), step_s=0.02), {"mug": mug})
    with pytest.raises(QueryError, match="restitution"):
        LiveSound(right, {"mug": mug}, restitution=2.0)
    live = LiveSound(right, {"mug": mug})
    right._data.qvel[0] = np.nan
    with pytest.raises(QueryError, match="not finite"):
        live.block()


def test_what_has_fallen_rings_out_and_nothing_else_is_heard(mug):
    """In the time in which the lowest mode of the mug falls by 65 dB; contacts at rest add nothing."""
    sound, impacts = heard(world({"mug": (0, 0, RADIUS_M + 0.05)}, mass_of(mug)), {"mug": mug}, 160)
    fallen_s = 65 / (20 * np.log10(np.e) * mug.modes.dampings_per_s[0])
    start = round(impacts[-1].time_s * RATE_HZ)
    early, late = sound[start : start + 4000], sound[start + round(fallen_s * RATE_HZ) :][:4000]
    assert len(late) == 4000
    assert 20 * np.log10(np.std(late) / np.std(early)) < -60


def test_the_nearest_place_is_the_surface_s_own(mug):
    body = HeardBody.of("mug", mug, mass_of(mug), RATE_HZ, LISTENER_M)
    points = mug.surface.sample(40, 0).points + np.random.default_rng(0).normal(scale=0.01, size=(40, 3))
    expected = mug.surface.closest_points(points)
    for row, point in enumerate(points):
        nearest = body.nearest(point)
        np.testing.assert_allclose(nearest.points[0], expected.points[row], atol=1e-12)
        assert nearest.distance[0] == pytest.approx(expected.distance[row])
