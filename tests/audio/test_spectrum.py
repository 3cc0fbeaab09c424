"""Frequencies of free solids against closed forms and published Ritz values."""

import numpy as np
import pytest
from structured_solids import ball, box, material, moved, together

from objectfolder.audio.eigen import count_below
from objectfolder.audio.elasticity import assemble
from objectfolder.audio.spectrum import Spectrum, first_frequencies, relative_errors, solve_spectrum, space_on
from objectfolder.audio.tetrahedra import Solid, clean


def spectrum(
    solid: Solid, length: float, poisson_ratio: float, modes: int, order: int = 3, below: float = np.inf
) -> Spectrum:
    return solve_spectrum(
        space_on(solid, order, length),
        solid.component,
        poisson_ratio,
        below=below,
        max_modes=modes,
        seed=0,
        cut=False,
        certify=np.isfinite(below),
    )


def test_ball_has_lambs_modes() -> None:
    """H. Lamb 1882: eta = omega R / c_s, nu 0.25; T2 five-fold, S2 five-fold, S1 three-fold, T3/S3, S0."""
    eta = np.sqrt(spectrum(ball(6, 1.0), 1.0, 0.25, 13, order=2).eta_squared)
    np.testing.assert_allclose(eta[:5], 2.501133, rtol=8e-3)
    np.testing.assert_allclose(eta[5:10], 2.639869, rtol=8e-3)
    np.testing.assert_allclose(eta[10:13], 3.42453, rtol=8e-3)


def test_cube_has_demarests_modes_and_the_exact_lame_mode() -> None:
    eta = np.sqrt(spectrum(box((3, 3, 3), (1, 1, 1)), 1.0, 0.3, 15).eta_squared)
    reference = np.repeat([2.85608, 3.84599, 3.91127, 4.44288, 4.57281], [2, 3, 3, 3, 3])
    np.testing.assert_allclose(eta[:14], reference, rtol=1.5e-3)
    for poisson_ratio in (0.0, 0.45):
        eta = np.sqrt(spectrum(box((3, 3, 3), (1, 1, 1)), 1.0, poisson_ratio, 24).eta_squared)
        nearest = eta[np.abs(eta - np.sqrt(2) * np.pi).argsort()[:2]]
        np.testing.assert_allclose(nearest, np.sqrt(2) * np.pi, rtol=5e-4)


def test_beam_has_the_three_dimensional_ritz_frequencies() -> None:
    stuff = material()
    found = spectrum(box((10, 2, 2), (0.1, 0.01, 0.005)), 0.1, stuff.poisson_ratio, 6)
    frequencies = np.sqrt(found.eta_squared) * stuff.shear_speed_m_s / 0.1 / (2 * np.pi)
    np.testing.assert_allclose(frequencies, [2631.6, 5134.8, 7146.0, 12404.2, 13405.7, 13718.3], rtol=2e-3)


@pytest.mark.parametrize(
    ("thickness", "first", "second"),
    [(0.01, 13.444, 19.589), (0.05, 13.153, 19.426), (0.1, 12.724, 18.955)],
)
def test_plate_bends_without_locking(thickness: float, first: float, second: float) -> None:
    """Free square plate, omega a^2 sqrt(rho h / D), nu 0.3, 3-D Ritz."""
    eta = np.sqrt(spectrum(box((6, 6, 1), (1, 1, thickness)), 1.0, 0.3, 2).eta_squared)
    rigidity = 2.6 * thickness**3 / (12 * (1 - 0.3**2))
    np.testing.assert_allclose(eta * np.sqrt(thickness / rigidity), [first, second], rtol=5e-3)


def test_two_orders_of_tetrahedra_bound_the_third_from_above() -> None:
    solid = box((4, 4, 1), (1, 1, 0.05))
    eta = [np.sqrt(spectrum(solid, 1.0, 0.3, 8, order).eta_squared) for order in (1, 2, 3)]
    assert np.all(eta[0] >= eta[1])
    assert np.all(eta[1] >= eta[2])


def test_the_error_estimate_is_of_the_size_of_the_error() -> None:
    coarse, fine = box((4, 4, 1), (1, 1, 0.02)), box((10, 10, 1), (1, 1, 0.02))
    truth = first_frequencies(fine, 1.0, 3, 0.3)
    ladder = [first_frequencies(coarse, 1.0, order, 0.3) for order in (1, 2, 3)]
    for orders in (2, 3):
        estimated = relative_errors(ladder[:orders])
        actual = ladder[orders - 1] / truth - 1
        assert 0.2 * actual.max() < estimated.max() < 8 * actual.max()


def test_six_rigid_motions_a_body_are_dropped_by_count() -> None:
    cube = box((2, 2, 2), (1, 1, 1))
    bodies = together(cube, moved(cube, (1.5, 0, 0)), moved(cube, (0, 3, 0)))
    assert bodies.components == 3
    found = spectrum(bodies, 1.0, 0.3, 40, below=20.0)
    assert found.certificate["rigid"] == 18
    assert found.certificate["holds"]
    single = spectrum(cube, 1.0, 0.3, 40, below=20.0)
    assert len(single.eta_squared) == 11
    np.testing.assert_allclose(found.eta_squared, np.repeat(single.eta_squared, 3), rtol=1e-6)
    assert found.rigid_eta_squared < 1e-10


def test_bodies_that_touch_along_an_edge_are_parted() -> None:
    cube = box((2, 2, 2), (1, 1, 1))
    vertices = np.concatenate([cube.vertices, cube.vertices + np.array([1, 1, 0])])
    welded, index = np.unique(np.round(vertices, 9), axis=0, return_inverse=True)
    hinged = clean(
        welded,
        index.reshape(-1)[np.concatenate([cube.tetrahedra, cube.tetrahedra + len(cube.vertices)])],
        {},
    )
    assert hinged.components == 2
    assert spectrum(hinged, 1.0, 0.3, 2).certificate["rigid"] == 12


def test_flat_inverted_and_crumb_elements_do_no_harm() -> None:
    cube = box((2, 2, 2), (1, 1, 1))
    crumb = np.array([[9, 9, 9], [9.01, 9, 9], [9, 9.01, 9], [9, 9, 9.01]])
    vertices = np.concatenate([cube.vertices, crumb])
    turned = cube.tetrahedra.copy()
    turned[::2] = turned[::2, [1, 0, 2, 3]]
    extra = np.array([[0, 1, 2, 2], np.arange(4) + len(cube.vertices)])
    dirty = clean(vertices, np.concatenate([turned, extra]), {})
    assert dirty.report["flat_elements_dropped"] == 1
    assert dirty.report["crumbs_dropped"] == 1
    assert dirty.volume_m3 == pytest.approx(1.0)


def test_nothing_depends_on_the_orientation() -> None:
    solid = box((4, 2, 1), (1, 0.5, 0.2))
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    turned = Solid(solid.vertices @ turn.T, solid.tetrahedra, solid.component, {})
    turned = clean(turned.vertices, turned.tetrahedra, {})
    np.testing.assert_allclose(
        spectrum(turned, 1.0, 0.3, 8, 2).eta_squared, spectrum(solid, 1.0, 0.3, 8, 2).eta_squared, rtol=1e-8
    )


def test_the_count_is_that_of_a_dense_solver() -> None:
    from scipy.linalg import eigh

    solid = box((3, 2, 2), (1, 0.7, 0.6))
    stiffness, mass = assemble(space_on(solid, 2, 1.0), 0.3)
    values = eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True)
    assert np.abs(values[:6]).max() < 1e-9 < values[6]
    for index in (6, 7, 20, 60):
        between = np.sqrt(max(values[index - 1], 1e-6) * values[index])
        assert count_below(stiffness, mass, between) == index
    found = spectrum(solid, 1.0, 0.3, 30, 2)
    np.testing.assert_allclose(found.eta_squared, values[6:36], rtol=1e-9)
    assert found.residuals.max() < 1e-5


def test_modes_are_mass_normalised_and_orthogonal() -> None:
    solid = box((3, 2, 2), (1, 0.7, 0.6))
    found = spectrum(solid, 1.0, 0.3, 20, 2)
    _, mass = assemble(found.space, 0.3)
    flat = found.vectors.reshape(-1, 20)
    np.testing.assert_allclose(flat.T @ (mass @ flat), np.eye(20), atol=1e-6)
    assert mass.sum() == pytest.approx(3 * 0.42)


@pytest.mark.parametrize("poisson_ratio", [0.5, -1.0, 0.7])
def test_impossible_poisson_ratios_are_refused(poisson_ratio: float) -> None:
    with pytest.raises(ValueError, match="outside"):
        assemble(space_on(box((1, 1, 1), (1, 1, 1)), 1, 1.0), poisson_ratio)
