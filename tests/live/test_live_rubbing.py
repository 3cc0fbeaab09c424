"""What rolls and scrapes: pitch with speed, level with force, silence at rest and in the air, damping."""

import numpy as np
import pytest
from scipy.signal import welch
from scripted import Scripted

import objectfolder
from objectfolder.audio.synthesis import Support
from objectfolder.errors import QueryError
from objectfolder.live import LiveSound

RATE_HZ = 44100.0
LISTENER_M = np.array([0.0, -0.5, 0.5])
RADIUS_M = 0.04


@pytest.fixture(scope="module")
def mug():
    return objectfolder.example("mug")


def scripted(mug, force_n=2.0, speed_m_s=0.3, **given) -> Scripted:
    return Scripted(mug.description["body"]["mass_kg"], force_n, speed_m_s, **given)


def live(mug, simulation, **given) -> LiveSound:
    return LiveSound(simulation, {"mug": mug}, listener_m=LISTENER_M, **given)


def heard(mug, simulation, blocks=43, **given) -> np.ndarray:
    sounding = live(mug, simulation, **given)
    return np.concatenate([sounding.block() for _ in range(blocks)])


def pushes(mug, simulation, blocks: int) -> np.ndarray:
    """What roughness pushes, newtons at the samples."""
    sounding, parts = live(mug, simulation), []
    forget = sounding._lasting.forget

    def keep(time_s):
        (rubbing,) = sounding._rubbing.values()
        parts.append(rubbing.force_n(time_s + np.arange(-512, 0) / RATE_HZ))
        forget(time_s)

    sounding._lasting.forget = keep
    for _ in range(blocks):
        sounding.block()
    return np.concatenate(parts)


def test_a_sliding_point_runs_over_the_ground_alone_and_a_rolling_one_over_both(mug):
    for radius_m, wanted in ((None, (0.3, 0.0)), (RADIUS_M, (0.3, 0.3))):
        sounding = live(mug, scripted(mug, radius_m=radius_m))
        for _ in range(20):
            sounding.block()
        (contact,) = sounding._lasting.contacts
        np.testing.assert_allclose(np.linalg.norm(contact.way_m_s, axis=1), wanted, atol=2e-3)


def test_twice_the_speed_is_an_octave_up(mug):
    """Both run over the same stretch of the ground."""
    centroids, forces = [], []
    for times in (1, 2):
        force = pushes(mug, scripted(mug, speed_m_s=0.15 * times), 172 // times)[8192 // times :]
        frequencies, power = welch(force, RATE_HZ, nperseg=8192 // times)
        heard = frequencies < 5e3 * times
        centroids.append((frequencies * power)[heard].sum() / power[heard].sum())
        forces.append(np.std(force))
    assert centroids[1] / centroids[0] == pytest.approx(2.0, rel=0.05)
    assert forces[1] == pytest.approx(forces[0], rel=0.05)


def test_the_sound_is_linear_in_the_force(mug):
    one, two = (heard(mug, scripted(mug, force_n), resting_damping_n_s_m=0) for force_n in (1.0, 2.0))
    assert np.abs(one).max() > 0
    np.testing.assert_allclose(two, 2 * one, atol=1e-12 * np.abs(two).max())


def test_the_sound_grows_with_roughness(mug):
    rough = objectfolder.example("mug")
    rough.description["material"]["roughness_um"] = 3.0
    smooth = objectfolder.example("mug")
    smooth.description["material"]["roughness_um"] = 1.0
    rolls = [heard(one, scripted(one, radius_m=RADIUS_M)) for one in (smooth, rough)]
    # The ground keeps its own micrometre: sqrt(1 + 9) over sqrt(1 + 1) in the mean.
    assert np.std(rolls[1]) / np.std(rolls[0]) == pytest.approx(np.sqrt(5), rel=0.25)


def test_a_seed_gives_its_own_surface_and_the_same_each_time(mug):
    first, again, other = (heard(mug, scripted(mug), seed=seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.1 * np.abs(first).max()


@pytest.mark.parametrize(("damping_n_s_m", "tolerance"), [(0.0, 1e-9), (2.0, 0.05)])
def test_blocks_of_another_size_rub_alike(mug, damping_n_s_m, tolerance):
    """What damps a force that lasts is taken in the middle of a block: shorter ones are nearer the truth."""
    sounds = [
        heard(mug, scripted(mug), blocks, block_samples=blocks_of, resting_damping_n_s_m=damping_n_s_m)
        for blocks, blocks_of in ((172, 128), (43, 512))
    ]
    np.testing.assert_allclose(sounds[0], sounds[1], atol=tolerance * np.abs(sounds[1]).max())


def test_what_rests_is_silent_and_so_is_what_left_the_ground(mug):
    assert not heard(mug, scripted(mug, speed_m_s=0.0)).any()
    assert not heard(mug, scripted(mug, speed_m_s=2e-4)).any()  # creeps of an engine
    lifted = live(mug, scripted(mug, lifted_s=0.2))
    sound = np.concatenate([lifted.block() for _ in range(30)])
    assert np.abs(sound[: round(0.2 * RATE_HZ)]).max() > 0
    assert not lifted._lasting.contacts
    assert not lifted._rubbing


def test_the_ground_damps_as_a_support_of_the_same_place_does(mug):
    """Rung and then left standing, the mug decays as its file says of a damper at the foot."""
    damping_n_s_m, seconds = 2.0, 0.6
    mass_kg = mug.description["body"]["mass_kg"]
    standing = live(mug, Scripted(mass_kg, 9.81 * mass_kg, 0.0), resting_damping_n_s_m=damping_n_s_m)
    for _ in range(10):
        standing.block()
    body = standing._bodies["mug"]
    body.stream.strike(mug.surface.sample(1, 3).points[0], [0.0, 0.0, 0.1], pulse=1e-4)
    sound = np.concatenate([standing.block() for _ in range(int(seconds * RATE_HZ / 512))])
    place = body._tree.data[body._tree.query([0.0, 0.0, -0.04])[1]]
    foot = Support(place, damping_n_s_m=damping_n_s_m)
    wanted = mug.strike(
        mug.surface.sample(1, 3).points,
        [[0.0, 0.0, 0.1]],
        seconds,
        RATE_HZ,
        pulse=1e-4,
        listener=LISTENER_M,
        support=foot,
    )[0][: len(sound)]
    np.testing.assert_allclose(sound[2000:], wanted[2000:], atol=1e-4 * np.abs(wanted[2000:]).max())
    free = mug.strike(
        mug.surface.sample(1, 3).points, [[0.0, 0.0, 0.1]], seconds, RATE_HZ, pulse=1e-4, listener=LISTENER_M
    )[0]
    assert np.abs(free[: len(wanted)] - wanted)[2000:].max() > 0.05 * np.abs(wanted[2000:]).max()


def test_a_pose_that_is_not_finite_is_refused(mug):
    simulation = scripted(mug)
    sounding = live(mug, simulation)
    simulation._speed_m_s = np.nan
    with pytest.raises(QueryError, match="the pose of 'mug' is not finite"):
        sounding.block()


def test_a_body_that_does_not_climb_its_roughness_rests(mug):
    ground_um = 1.0
    climbed_m = 1e-6 * np.hypot(mug.description["material"]["roughness_um"], ground_um)
    held_m_s = np.sqrt(2 * 9.81 * climbed_m)
    assert not heard(mug, scripted(mug, speed_m_s=0.95 * held_m_s), blocks=20).any()
    assert heard(mug, scripted(mug, speed_m_s=1.05 * held_m_s), blocks=20).any()
