"""What rolls and scrapes: pitch with speed, level with force, silence at rest and in the air, damping."""

import numpy as np
import pytest
from scipy.signal import welch
from scripted import Scripted

import objectfolder
from objectfolder.errors import QueryError
from objectfolder.live import LiveSound, Rest
from objectfolder.live.resting import WOODEN_TOP

RATE_HZ = 44100.0
LISTENER_M = np.array([0.0, -0.5, 0.5])
RADIUS_M = 0.04


@pytest.fixture(scope="module")
def mug():
    return objectfolder.example("mug")


def scripted(mug, force_n=2.0, speed_m_s=0.3, **settings) -> Scripted:
    return Scripted(mug.description["body"]["mass_kg"], force_n, speed_m_s, **settings)


def live(mug, simulation, **settings) -> LiveSound:
    return LiveSound(simulation, {"mug": mug}, listener_m=LISTENER_M, **settings)


def heard(mug, simulation, blocks=43, **settings) -> np.ndarray:
    sounding = live(mug, simulation, **settings)
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
    for radius_m, speeds_m_s in ((None, (0.3, 0.0)), (RADIUS_M, (0.3, 0.3))):
        sounding = live(mug, scripted(mug, radius_m=radius_m))
        for _ in range(20):
            sounding.block()
        (contact,) = sounding._lasting.contacts
        np.testing.assert_allclose(np.linalg.norm(contact.way_m_s, axis=1), speeds_m_s, atol=2e-3)


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
    soft, loud = (heard(mug, scripted(mug, force_n), rest=None) for force_n in (1.0, 2.0))
    assert np.abs(soft).max() > 0
    np.testing.assert_allclose(loud, 2 * soft, atol=1e-12 * np.abs(loud).max())


def test_the_sound_grows_with_roughness(mug):
    rough = objectfolder.example("mug")
    rough.description["material"]["roughness_um"] = 3.0
    smooth = objectfolder.example("mug")
    smooth.description["material"]["roughness_um"] = 1.0
    rolls = [heard(file, scripted(file, radius_m=RADIUS_M)) for file in (smooth, rough)]
    # The ground keeps its own micrometre: sqrt(1 + 9) over sqrt(1 + 1) in the mean.
    assert np.std(rolls[1]) / np.std(rolls[0]) == pytest.approx(np.sqrt(5), rel=0.25)


def test_a_seed_gives_its_own_surface_and_the_same_each_time(mug):
    first, again, second = (heard(mug, scripted(mug), seed=seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - second).max() > 0.1 * np.abs(first).max()


@pytest.mark.parametrize(("rest", "tolerance"), [(None, 1e-9), (WOODEN_TOP, 0.05)])
def test_blocks_of_another_size_rub_alike(mug, rest, tolerance):
    """What damps a force that lasts is taken in the middle of a block: shorter ones are nearer the truth."""
    sounds = [
        heard(mug, scripted(mug), blocks, block_samples=blocks_of, rest=rest)
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


def test_the_ground_damps_as_a_spring_on_a_plate_at_the_foot(mug):
    """Each mode of a mug that was struck and stands decays as Hertz's spring and the plate say."""
    force_n, hertz_m, plate = 2.0, 0.02 * np.ptp(mug.surface.bounds, axis=0).max(), WOODEN_TOP
    standing = live(mug, scripted(mug, force_n, 0.0))
    for _ in range(10):
        standing.block()
    stream = standing._bodies["mug"].stream
    stream.strike(mug.surface.sample(1, 3).points[0], [0.0, 0.0, 0.1], pulse=1e-5)
    levels = []
    for _ in range(3):
        standing.block()
        levels.append(stream.loudness()[1])
    material = mug.description["material"]
    bodies = (material["youngs_modulus_pa"], material["poisson_ratio"]), (1.1e10, 0.25)
    modulus_pa = 1 / sum((1 - nu**2) / young for young, nu in bodies)

    def approach_m(force_n):  # Johnson 1985, 4.23
        return (9 * force_n**2 / (16 * hertz_m * modulus_pa**2)) ** (1 / 3)

    spring = 1e-3 / (approach_m(force_n + 5e-4) - approach_m(force_n - 5e-4)) * (1 + 1j * plate.loss_factor)
    angular = np.sqrt(mug.modes.eigenvalues)
    normal = 1 / (1 / plate.impedance_n_s_m + 1j * angular / spring)
    across = 6 / 7 * spring / (1j * angular)
    place = standing._bodies["mug"]
    shapes = stream.motions(place._tree.data[[place._tree.query([0.0, 0.0, -0.04])[1]]])[0].shapes[0]
    added = (normal.real * shapes[2] ** 2 + across.real * (shapes[0] ** 2 + shapes[1] ** 2)) / 2
    frequencies = stream.loudness()[0]
    shares = []
    for mode in range(8):
        (row,) = np.flatnonzero(np.isclose(frequencies, mug.modes.frequencies_hz[mode], rtol=1e-9))
        decay = np.log(levels[1][row] / levels[2][row]) * RATE_HZ / 512
        assert decay - mug.modes.dampings_per_s[mode] == pytest.approx(added[mode], rel=1e-3, abs=1e-7)
        shares.append(added[mode] / decay)
    assert max(shares) > 0.05


def test_a_wide_plate_carries_as_the_books_say_and_a_lossless_contact_on_rock_damps_nothing():
    """Steel of 10 mm: Z = 8 (B m)^(1/2) with c_L = 5200 m/s is 2.3 c_L rho h^2 (Cremer and Heckl)."""
    plate = Rest.on_plate(
        youngs_modulus_pa=7800 * 5200**2 * (1 - 0.28**2), poisson_ratio=0.28, density_kg_m3=7800.0,
        thickness_m=0.01, loss_factor=0.0,
    )  # fmt: skip
    assert plate.impedance_n_s_m == pytest.approx(2.3 * 5200 * 7800 * 0.01**2, rel=0.01)
    angular = np.array([1e3, 1e5])
    assert not np.any(Rest(np.inf, 0.0).resistance_n_s_m(angular, 1e6))
    assert not np.any(Rest(0.0, 0.1).resistance_n_s_m(angular, 1e6))
    for impedance_n_s_m, loss_factor in ((-1.0, 0.0), (np.nan, 0.0), (1.0, np.inf)):
        with pytest.raises(QueryError, match="rest"):
            Rest(impedance_n_s_m, loss_factor)


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
