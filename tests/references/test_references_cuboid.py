"""Ritz solutions of cuboids: the exact Lame mode, published cubes, and thin limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from tests.drawn_examples import few_examples
from tests.references.cuboid import EdgeFunctions, class_stiffness, cuboid, lame_wavenumbers

pytestmark = pytest.mark.release("tests.references")


def test_the_published_cube() -> None:
    spectrum = cuboid((1, 1, 1), 0.3, 4.6)
    assert spectrum.multiplicities.tolist() == [2, 3, 3, 3, 3]
    np.testing.assert_allclose(spectrum.wavenumbers, [2.85608, 3.84599, 3.91127, 4.44288, 4.57281], rtol=2e-5)
    assert spectrum.convergence <= 2e-6


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.25, 0.45, 0.499])
def test_lame_modes_are_exact_and_at_least_threefold(poisson_ratio: float) -> None:
    edge = 0.3
    spectrum = cuboid((edge,) * 3, poisson_ratio, 4.9 / edge, tolerance=1e-4)
    lame = lame_wavenumbers(edge, 1)[0]
    nearest = np.abs(spectrum.wavenumbers / lame - 1).argmin()
    assert spectrum.wavenumbers[nearest] == pytest.approx(lame, rel=1e-8)
    assert spectrum.multiplicities[nearest] >= 3


def test_slender_beam_bends_as_timoshenko_says() -> None:
    """100 x 10 x 5 mm, first mode of each plane; Timoshenko with k = 5 (1 + nu) / (6 + 5 nu)."""
    speed = np.sqrt(7.2e10 / (2 * 1.19 * 2700))
    spectrum = cuboid((0.1, 0.01, 0.005), 0.19, 2 * np.pi * 6000 / speed, tolerance=1e-4)
    np.testing.assert_allclose(spectrum.repeated * speed / (2 * np.pi), [2631.2, 5133.7], rtol=1e-3)


def test_very_thin_plate_tends_to_kirchhoff() -> None:
    """Leissa's free square plate, omega a^2 sqrt(rho h / D), nu 0.3: 13.468, 19.596, 24.270, 34.801 twice."""
    thickness = 0.002
    rigidity = 2.6 * thickness**3 / (12 * (1 - 0.3**2))
    spectrum = cuboid((1, 1, thickness), 0.3, 36 * np.sqrt(rigidity / thickness), tolerance=1e-4)
    thin = spectrum.repeated * np.sqrt(thickness / rigidity)
    np.testing.assert_allclose(thin, [13.468, 19.596, 24.270, 34.801, 34.801], rtol=1.2e-3)
    assert spectrum.multiplicities.tolist() == [1, 1, 1, 2]


@few_examples(5)
@given(
    st.tuples(*[st.floats(0.5, 1.5)] * 3),
    st.floats(-0.5, 0.45),
    st.floats(1e-3, 1e3),
    st.permutations([0, 1, 2]),
)
def test_neither_unit_nor_order_of_the_edges_matters(
    lengths: tuple[float, float, float], poisson_ratio: float, scale: float, order: list[int]
) -> None:
    limit = 4.0 / max(lengths)
    wavenumbers = cuboid(lengths, poisson_ratio, limit, tolerance=1e-3).repeated
    turned = (scale * lengths[order[0]], scale * lengths[order[1]], scale * lengths[order[2]])
    again = cuboid(turned, poisson_ratio, limit / scale, tolerance=1e-3).repeated
    np.testing.assert_allclose(again * scale, wavenumbers, rtol=1e-9)


def test_six_motions_cost_no_energy() -> None:
    zeros = 0
    for parity in np.ndindex(2, 2, 2):
        values = eigh(class_stiffness((1.0, 0.4, 0.05), 0.3, 4, parity), eigvals_only=True)
        zeros += int(np.count_nonzero(values < 1e-8))
        assert values[0] > -1e-8
    assert zeros == 6


@pytest.mark.parametrize("layer", [2.0, 0.9, 0.1])
@pytest.mark.parametrize("parity", [0, 1])
def test_edge_functions_are_orthonormal_and_their_slopes_are_derivatives(layer: float, parity: int) -> None:
    functions = EdgeFunctions.along(1.0, layer, 5, parity)
    gram = (functions.values * functions.weights) @ functions.values.T
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=1e-9)
    assert functions.weights.sum() == pytest.approx(1.0)
    # x (odd) or 1 (even) are among them, with slope 1 or 0.
    points = EdgeFunctions.along(1.0, layer, 5, 1)
    polynomial = np.ones_like(functions.weights) if parity == 0 else _coordinate(points)
    coefficients = (functions.values * functions.weights) @ polynomial
    np.testing.assert_allclose(coefficients @ functions.values, polynomial, atol=1e-9)
    np.testing.assert_allclose(coefficients @ functions.slopes, float(parity), atol=1e-7)


def _coordinate(functions: EdgeFunctions) -> np.ndarray:
    """The coordinate at the quadrature points: the only function of slope 1 that vanishes in the middle."""
    unit_slopes = np.ones_like(functions.weights)
    coefficients, *_ = np.linalg.lstsq(functions.slopes.T, unit_slopes, rcond=None)
    return np.asarray(coefficients @ functions.values)


def test_impossible_cuboids_are_refused() -> None:
    with pytest.raises(ValueError, match="positive"):
        cuboid((1, 0, 1), 0.3, 4.0)
    with pytest.raises(ValueError, match="outside"):
        cuboid((1, 1, 1), 0.5, 4.0)
