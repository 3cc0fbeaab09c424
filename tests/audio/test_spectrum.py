"""Frequencies of free solids against closed forms and published Ritz values."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from structured_solids import box, moved, together

from objectfolder.making.elements.elasticity import ElementMatrices, assemble
from objectfolder.making.elements.space import Space
from objectfolder.making.modes.adaptive import Goal, adapt_spectrum, what_is_to_come
from objectfolder.making.modes.eigen import Eigenpairs, count_below, weigh
from objectfolder.making.modes.spectrum import Spectrum, pencil_of, solve_spectrum, space_on
from objectfolder.making.solid.solid import Solid, clean

RELEASE = pytest.mark.release("objectfolder.making.elements", "objectfolder.making.modes")


def spectrum(
    solid: Solid, length: float, poisson_ratio: float, modes: int, order: int = 3, below: float = np.inf
) -> Spectrum:
    return solve_spectrum(
        space_on(solid, order, length)[0],
        solid.component,
        poisson_ratio,
        below=below,
        max_modes=modes,
        seed=0,
        cut=False,
        certify=np.isfinite(below),
    )


def test_a_thin_plate_bends_without_locking() -> None:
    """Free square plate, omega a^2 sqrt(rho h / D), nu 0.3, 3-D Ritz."""
    thickness = 0.01
    eta = np.sqrt(spectrum(box((6, 6, 1), (1, 1, thickness)), 1.0, 0.3, 2).eta_squared)
    rigidity = 2.6 * thickness**3 / (12 * (1 - 0.3**2))
    np.testing.assert_allclose(eta * np.sqrt(thickness / rigidity), [13.444, 19.589], rtol=5e-3)


def test_two_orders_of_tetrahedra_bound_the_third_from_above() -> None:
    solid = box((4, 4, 1), (1, 1, 0.05))
    eta = [np.sqrt(spectrum(solid, 1.0, 0.3, 8, order).eta_squared) for order in (1, 2, 3)]
    assert np.all(eta[0] >= eta[1])
    assert np.all(eta[1] >= eta[2])


def adapted(solid: Solid, accuracy_cents: float, order: int = 4, below: float = np.inf) -> Spectrum:
    return adapt_spectrum(
        space_on(solid, order, 1.0)[0],
        solid.component,
        0.3,
        Goal(below, accuracy_cents, 20, 10**6, 0),
    )


@cache
def adapted_plate(accuracy_cents: float) -> Spectrum:
    return adapted(box((5, 5, 1), (1, 1, 0.02)), accuracy_cents)


@pytest.fixture(scope="module")
def plate_truth() -> np.ndarray:
    """Frequencies of that plate by elements of order 4 on a finer mesh: 20 of them."""
    return np.sqrt(spectrum(box((7, 7, 1), (1, 1, 0.02)), 1.0, 0.3, 20, order=4).eta_squared)


@pytest.mark.parametrize(
    "accuracy_cents", [30.0, pytest.param(8.0, marks=pytest.mark.slow), pytest.param(2.0, marks=RELEASE)]
)
def test_a_wanted_accuracy_is_reached_and_the_estimate_is_of_the_size_of_the_error(
    accuracy_cents: float, plate_truth: np.ndarray
) -> None:
    solution = adapted_plate(accuracy_cents)
    error = 1200 * np.log2(np.sqrt(solution.eta_squared) / plate_truth[: len(solution.eta_squared)])
    assert error.max() < max(accuracy_cents, 2.5)  # as near as order 4 comes on these elements
    assert solution.error_cents.max() < 10 * error.max()
    assert np.mean(solution.error_cents >= error) >= 0.95
    assert np.all(error > -0.05)


# eta^2 below 5 of a free plate a hundredth as thick as wide, nu 0.3: 12 x 12 cells of order 5, to 1 cent.
WIDE_PLATE = np.array([
    0.0042908, 0.0091359, 0.014011, 0.028639, 0.02864, 0.088647, 0.088647, 0.09567, 0.11338, 0.14099,
    0.26199, 0.262, 0.32497, 0.35535, 0.40851, 0.40851, 0.54906, 0.61352, 0.66862, 0.92892, 0.92894,
    0.98254, 1.0799, 1.0887, 1.0888, 1.3869, 1.3869, 1.8489, 1.9935, 2.0316, 2.0878, 2.1193, 2.2137, 2.2138,
    2.6532, 2.7874, 3.0917, 3.0923, 3.6094, 3.6096, 4.0501, 4.0502, 4.1096, 4.31, 4.718, 4.8938, 4.8941,
    4.9467
])  # fmt: skip


@RELEASE
def test_a_wide_thin_plate_has_every_mode_at_the_usual_accuracy() -> None:
    """With order 4 it lacks the last: that is 30 cents too high, and above the limit."""
    plate = box((8, 8, 1), (1, 1, 0.01))
    goal = Goal(5.0, 5.0, 200, 180_000, 0)
    usual = adapt_spectrum(space_on(plate, 5, 1.0)[0], plate.component, 0.3, goal)
    assert [step["order"] for step in usual.steps] == [2, 3, 4]  # and 5 at last
    assert len(usual.eta_squared) == len(WIDE_PLATE)
    assert np.abs(600 * np.log2(usual.eta_squared / WIDE_PLATE)).max() < 10


@pytest.mark.slow
def test_more_accuracy_takes_more_functions_and_lowers_every_eigenvalue() -> None:
    coarse, fine = adapted_plate(30.0), adapted_plate(8.0)
    assert coarse.unknowns < fine.unknowns < 3 * space_on(box((5, 5, 1), (1, 1, 0.02)), 4, 1.0)[0].size
    shared = min(len(coarse.eta_squared), len(fine.eta_squared))
    assert np.all(coarse.eta_squared[:shared] >= fine.eta_squared[:shared] * (1 - 1e-9))


@pytest.mark.parametrize("order", [3, 4, 5])
def test_what_is_to_come_is_that_of_edges_where_a_mode_fell_by_little(order: int) -> None:
    """An error of C p^-3 to the last digit, those that fall faster from above, and large ones in part."""
    step, size = np.array([order - 1.0, order]), np.array([[5.0, 20.0, 50.0]])
    for rate in (3.0, 4.0, 9.0):
        before, after = (size * 2.0 ** (rate - 3) * p**-rate for p in step)
        to_come = what_is_to_come(before - after, order)
        assert np.all(to_come >= after * (1 - 1e-12))
        if rate == 3:
            np.testing.assert_allclose(to_come, after, rtol=1e-12)
    large = what_is_to_come(np.array([100.0, 200.0]), order)
    np.testing.assert_allclose(np.diff(large), 7.0)


@cache
def plate() -> tuple[Solid, Space]:
    """A plate some of whose modes are repeated, with its functions of order 3."""
    solid = box((4, 4, 1), (1, 1, 0.03))
    return solid, space_on(solid, 3, 1.0)[0]


@cache
def modes_of_plate(max_modes: int) -> Spectrum:
    solid, space = plate()
    return solve_spectrum(space, solid.component, 0.3, below=25.0, max_modes=max_modes, seed=0)


def columns(solution: Spectrum) -> np.ndarray:
    """Vectors (3 n, k) of modes in all functions."""
    return solution.vectors.reshape(-1, len(solution.eta_squared))


@pytest.mark.slow
@pytest.mark.parametrize("max_modes", [12, pytest.param(60, marks=RELEASE)])
def test_modes_from_a_start_are_those_found_from_scratch(max_modes: int) -> None:
    """Inverse iteration at the limit from modes of fewer functions against Lanczos; some are repeated."""
    solid, space = plate()
    solution = adapt_spectrum(space, solid.component, 0.3, Goal(25.0, 1e-3, max_modes, 10**6, 0))
    scratch = modes_of_plate(max_modes)
    assert solution.unknowns == scratch.unknowns
    assert solution.certificate == scratch.certificate
    np.testing.assert_allclose(solution.eta_squared, scratch.eta_squared, rtol=1e-5)
    _, mass = assemble(solution.space, 0.3)
    first, second = (modes.vectors.reshape(-1, len(modes.eta_squared)) for modes in (solution, scratch))
    # Cosines of the angles between the two spaces.
    assert np.linalg.svd(first.T @ weigh(mass, second), compute_uv=False).min() > 1 - 1e-5


@pytest.mark.slow
def test_a_start_that_lacks_modes_is_not_believed() -> None:
    solid, space = plate()
    settings: dict[str, Any] = {"below": 25.0, "max_modes": 60, "seed": 0}
    whole = modes_of_plate(60)
    lacking = Eigenpairs(whole.eta_squared[::2], columns(whole)[:, ::2].copy())
    solution = solve_spectrum(space, solid.component, 0.3, start=lacking, **settings)
    np.testing.assert_allclose(solution.eta_squared, whole.eta_squared, rtol=1e-7)


@pytest.mark.parametrize("missing", [1, 12])
def test_modes_that_the_start_has_not_are_found_by_their_count(
    missing: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    solid, space = plate()
    settings: dict[str, Any] = {"below": 25.0, "max_modes": 60, "seed": 0}
    whole = modes_of_plate(60)
    lacking = Eigenpairs(whole.eta_squared[:-missing], columns(whole)[:, :-missing].copy())
    assert len(lacking.values) > missing + 8
    # Not by a search from scratch.
    monkeypatch.setattr("objectfolder.making.modes.spectrum.lowest_elastic", None)
    solution = solve_spectrum(space, solid.component, 0.3, start=lacking, **settings)
    np.testing.assert_allclose(solution.eta_squared, whole.eta_squared, rtol=1e-5)
    assert solution.residuals.max() < 1e-4
    assert solution.certificate == whole.certificate


def test_a_silent_body_costs_one_count() -> None:
    solution = adapted(box((3, 3, 3), (1, 1, 1)), 5.0, below=1.5)
    assert len(solution.eta_squared) == 0
    assert solution.steps == []
    assert solution.certificate["counted"] == 6


@pytest.mark.slow
@pytest.mark.parametrize("below", [4.0, 7.9])
def test_a_compact_body_near_the_limit_is_silent_without_a_solution_in_all_functions(below: float) -> None:
    """A cube's first eta^2 is 8.16."""
    cube = box((4, 4, 4), (1, 1, 1))
    solution = adapted(cube, 5.0, below=below)
    assert len(solution.eta_squared) == 0
    assert solution.unknowns == 3 * space_on(cube, 2, 1.0)[0].size
    assert len(adapted(cube, 5.0, below=8.3).eta_squared) == 2


@pytest.mark.slow
def test_a_thin_body_whose_first_mode_lies_near_the_limit_is_not_called_silent() -> None:
    """A strip on two cells: order 2 has its first eigenvalue 44 % high, far above the limit."""
    size = (1, 0.1, 0.01)
    truth = spectrum(box((8, 2, 1), size), 1.0, 0.3, 1, order=4).eta_squared[0]
    low = spectrum(box((2, 1, 1), size), 1.0, 0.3, 1, order=2).eta_squared[0]
    assert low > 1.15 * 1.1 * truth
    solution = adapted(box((2, 1, 1), size), 5.0, below=1.1 * truth)
    np.testing.assert_allclose(solution.eta_squared, [truth], rtol=0.02)
    assert len(adapted(box((2, 1, 1), size), 5.0, below=0.9 * truth).eta_squared) == 0


@pytest.mark.slow
def test_six_rigid_motions_a_body_are_dropped_by_count() -> None:
    cube = box((2, 2, 2), (1, 1, 1))
    bodies = together(cube, moved(cube, (1.5, 0, 0)), moved(cube, (0, 3, 0)))
    assert bodies.components == 3
    solution = spectrum(bodies, 1.0, 0.3, 40, below=20.0)
    assert solution.certificate["rigid"] == 18
    assert solution.certificate["holds"]
    single = spectrum(cube, 1.0, 0.3, 40, below=20.0)
    assert len(single.eta_squared) == 11
    np.testing.assert_allclose(solution.eta_squared, np.repeat(single.eta_squared, 3), rtol=1e-6)
    assert solution.rigid_eta_squared < 1e-10


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
    space = space_on(solid, 2, 1.0)[0]
    pencil = pencil_of(ElementMatrices(space, 0.3), solid.component, np.ones(space.size, dtype=bool))
    stiffness, mass = pencil.stiffness, pencil.mass
    values = eigh(stiffness.toarray(), np.kron(mass.toarray(), np.eye(3)), eigvals_only=True)
    assert np.abs(values[:6]).max() < 1e-9 < values[6]
    for index in (6, 7, 20, 60):
        between = np.sqrt(max(values[index - 1], 1e-6) * values[index])
        assert count_below(pencil, between) == index - 6
    solution = spectrum(solid, 1.0, 0.3, 30, 2)
    np.testing.assert_allclose(solution.eta_squared, values[6:36], rtol=1e-9)
    assert solution.residuals.max() < 1e-5


def test_modes_are_mass_normalised_and_orthogonal() -> None:
    solid = box((3, 2, 2), (1, 0.7, 0.6))
    solution = spectrum(solid, 1.0, 0.3, 20, 2)
    _, mass = assemble(solution.space, 0.3)
    flat = solution.vectors.reshape(-1, 20)
    np.testing.assert_allclose(flat.T @ weigh(mass, flat), np.eye(20), atol=1e-6)
    assert solution.volume == pytest.approx(0.42)


@pytest.mark.parametrize("poisson_ratio", [0.5, -1.0, 0.7])
def test_impossible_poisson_ratios_are_refused(poisson_ratio: float) -> None:
    with pytest.raises(ValueError, match="outside"):
        assemble(space_on(box((1, 1, 1), (1, 1, 1)), 1, 1.0)[0], poisson_ratio)
