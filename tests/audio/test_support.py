"""What holds a struck object, against the coupled problem of all of its modes."""

from pathlib import Path

import numpy as np
import pytest

import objectfolder
from objectfolder.audio.synthesis import Support
from objectfolder.audio.synthesis.support import LYING_PER_S
from objectfolder.errors import QueryError
from objectfolder.object_file import ObjectFile


@pytest.fixture
def bar(small_file: Path) -> ObjectFile:
    return objectfolder.load(small_file)


def coupled(file: ObjectFile, support: Support) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and decay rates of the modes that springs and dampers couple: a quadratic problem."""
    shapes, count = file.modes.gains(support.points), len(file.modes.eigenvalues)
    stiffness, damping = (
        np.einsum("p,pki,pkj->ij", each, shapes, shapes)
        for each in (support.stiffness_n_m, support.damping_n_s_m)
    )
    stiffness += np.diag(file.modes.eigenvalues)
    damping += np.diag(2 * file.modes.dampings_per_s)
    first_order = np.block([[np.zeros((count, count)), np.eye(count)], [-stiffness, -damping]])
    roots = np.linalg.eigvals(first_order)
    roots = roots[roots.imag > 0][np.argsort(roots[roots.imag > 0].imag)]
    return np.abs(roots) ** 2, -roots.real


@pytest.mark.parametrize("kind", ["stiffness_n_m", "damping_n_s_m"])
def test_a_weak_support_is_the_coupled_problem_to_first_order(bar: ObjectFile, kind: str) -> None:
    points = bar.sample_contacts(3, seed=3, reachable=False)[0]
    shapes = bar.modes.gains(points)
    unit = Support(points, **{kind: 1.0}).strength(shapes, bar.modes.eigenvalues).max()
    for strength, cents, share in ((0.1, 5.0, 0.05), (0.01, 0.05, 5e-3)):
        support = Support(points, **{kind: strength / unit})
        stiffer, faster = support.added(shapes)
        eigenvalues, decays = coupled(bar, support)
        estimates = bar.modes.eigenvalues + stiffer
        assert np.abs(600 * np.log2(estimates / eigenvalues)).max() < cents
        np.testing.assert_allclose(bar.modes.dampings_per_s + faster, decays, rtol=share)


def test_a_support_is_heard_in_strikes_streams_and_nowhere_when_it_is_nothing(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(2, seed=4, reachable=False)
    free = bar.strike(points, -normals, 0.05)
    np.testing.assert_array_equal(bar.strike(points, -normals, 0.05, support=Support(points)), free)
    support = Support(points, damping_n_s_m=50.0)
    sound = bar.strike(points, -normals, 0.05, support=support)
    assert (sound[:, -500:] ** 2).sum() < 0.5 * (free[:, -500:] ** 2).sum()
    np.testing.assert_array_equal(
        sound, np.concatenate([part for _, part in bar.strikes(points, -normals, 0.05, support=support)])
    )
    stream = bar.stream(support=support)
    stream.strike(points[0], -normals[0])
    np.testing.assert_allclose(stream.block(sound.shape[1])[0], sound[0], atol=1e-5)


def test_what_lies_decays_faster_by_one_rate_or_by_its_radiation(bar: ObjectFile) -> None:
    points = bar.sample_contacts(1, seed=4, reachable=False)[0]
    body, lying = bar.sound._struck_body(None), bar.sound._struck_body(None, "lying")
    np.testing.assert_array_equal(lying.eigenvalues, body.eigenvalues)
    radiated = body.radiation_dampings_per_s
    radiated = np.zeros(len(body.eigenvalues)) if radiated is None else radiated
    larger = body.dampings_per_s - radiated + np.maximum(LYING_PER_S, radiated)
    np.testing.assert_allclose(lying.dampings_per_s, larger, rtol=1e-12)
    few, silent = np.zeros((0, 3, 3)), np.array([0.0, 20.0, 90.0])
    np.testing.assert_allclose(Support.lying().added(few, silent)[1], LYING_PER_S - np.array([0, 20, 58.0]))
    np.testing.assert_allclose(Support.lying().added(few)[1], LYING_PER_S)
    both = Support(points, damping_n_s_m=3.0, rate_per_s=7.0)
    alone, shapes = Support(points, damping_n_s_m=3.0), bar.modes.gains(points)
    np.testing.assert_allclose(both.added(shapes)[1], alone.added(shapes)[1] + 7.0)
    with pytest.raises(QueryError, match="'held'"):
        bar.strike(points, support="held")


def test_points_share_what_is_given_as_one_number(bar: ObjectFile) -> None:
    point = bar.sample_contacts(1, seed=5, reachable=False)[0]
    once, twice = Support(point, 7.0, 3.0), Support(np.repeat(point, 2, axis=0), 7.0, 3.0)
    shapes = bar.modes.gains(point)
    np.testing.assert_allclose(
        np.array(once.added(shapes)), np.array(twice.added(np.repeat(shapes, 2, axis=0))), rtol=1e-12
    )


def test_a_grip_is_where_it_is_and_a_foot_lies_lowest(bar: ObjectFile) -> None:
    centre = np.array([0.05, 0.0, 0.004])
    grip = Support.grip(bar.surface, centre, 0.008, damping_n_s_m=4.0)
    assert 3 <= len(grip.points) <= 128
    assert np.linalg.norm(grip.points - centre, axis=1).max() <= 0.008
    assert grip.damping_n_s_m.sum() == pytest.approx(4.0)
    foot = Support.stand(bar.surface, stiffness_n_m=1e4)
    assert foot.points[:, 2].max() <= bar.surface.bounds[0, 2] + 5e-4
    assert np.ptp(foot.points, axis=0)[0] > 0.9 * np.ptp(bar.surface.bounds, axis=0)[0]


def test_what_is_no_support_is_refused(bar: ObjectFile) -> None:
    for arguments, said in (
        ({"points": np.zeros(4)}, "support"),
        ({}, "support"),
        ({"rate_per_s": -1.0}, "rate_per_s"),
        ({"points": np.zeros(3), "stiffness_n_m": -1.0}, "stiffness_n_m"),
        ({"points": np.zeros((2, 3)), "damping_n_s_m": [1.0, 2.0, 3.0]}, "damping_n_s_m"),
    ):
        with pytest.raises(QueryError, match=said):
            Support(**arguments)
    with pytest.raises(QueryError, match="no surface within"):
        Support.grip(bar.surface, [1.0, 0.0, 0.0], 0.01)
    with pytest.raises(QueryError, match="points"):
        bar.strike(np.zeros(3), np.ones(3), support=Support([1.0, 0.0, 0.0], 1.0))
