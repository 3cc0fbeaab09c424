import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.optimize import nnls

from objectfolder.touch.elastic.contact_problem import Contact, force_depth_curve, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.influence import Compliance, influence_coefficients

SHAPE = (96, 64)
PITCH = (0.03 / 96, 0.02 / 64)
SILICONE = Elastomer(2e5, 0.48)
MODULUS = 2e5 / (1 - 0.48**2)


def places(
    shape: tuple[int, int] = SHAPE, pitch: tuple[float, float] = PITCH
) -> tuple[np.ndarray, np.ndarray]:
    y = (np.arange(shape[0]) - (shape[0] - 1) / 2) * pitch[0]
    x = (np.arange(shape[1]) - (shape[1] - 1) / 2) * pitch[1]
    return y[:, None], x[None, :]


def paraboloid(radius: float) -> np.ndarray:
    y, x = places()
    return (y * y + x * x) / (2 * radius)


def hertz(radius: float, depth: float) -> tuple[float, float, float]:
    """Force, peak pressure, contact radius."""
    a = np.sqrt(radius * depth)
    return 4 / 3 * MODULUS * a * depth, 2 * MODULUS * a / (np.pi * radius), a


@pytest.mark.parametrize(
    ("radius", "depth"), [(0.012, 0.00025), (0.012, 0.001), (0.02, 0.0005), (0.04, 0.001)]
)
def test_force_and_peak_pressure_are_those_of_hertz(radius: float, depth: float) -> None:
    contact = solve_contact(paraboloid(radius), PITCH, SILICONE, indentation_m=depth)
    force, peak, a = hertz(radius, depth)
    assert contact.force_n == pytest.approx(force, rel=0.01)
    assert contact.peak_pressure_pa == pytest.approx(peak, rel=0.01)
    assert abs(np.sqrt(contact.contact_area_m2 / np.pi) - a) < PITCH[0] / 8
    assert contact.relative_residual <= 1e-5
    assert not contact.reaches_border


def test_the_pressure_and_the_surface_outside_are_those_of_hertz() -> None:
    radius, depth = 0.03, 0.001
    contact = solve_contact(paraboloid(radius), PITCH, SILICONE, indentation_m=depth)
    y, x = places()
    r, a = np.hypot(y, x), np.sqrt(radius * depth)
    _, peak, _ = hertz(radius, depth)
    pressure = peak * np.sqrt(np.maximum(1 - r * r / a**2, 0))
    inner = r < a - 2 * PITCH[0]
    assert np.abs(contact.pressure_pa - pressure)[inner].max() < 0.02 * peak
    out = np.minimum(a / np.maximum(r, a), 1.0)
    # Johnson 1985, equation 3.42a.
    surface = ((2 * a**2 - r * r) * np.arcsin(out) + r * r * out * np.sqrt(1 - out**2)) / (np.pi * radius)
    outside = r > a + PITCH[0]
    assert np.abs(contact.displacement_m - surface)[outside].max() < 0.002 * depth


@pytest.mark.parametrize("contact_radius", [0.002, 0.004, 0.006])
def test_a_ball_that_is_no_paraboloid_follows_sneddon(contact_radius: float) -> None:
    """Sneddon 1965, Int. J. Engng Sci. 3, section 6: exact for a rigid sphere of any contact radius."""
    a, radius = contact_radius, 0.008
    logarithm = np.log((radius + a) / (radius - a))
    y, x = places()
    squared = radius**2 - y * y - x * x
    gap = np.where(squared > 0, radius - np.sqrt(np.maximum(squared, 0)), np.inf)
    contact = solve_contact(gap, PITCH, SILICONE, indentation_m=a / 2 * logarithm)
    force = MODULUS * ((a * a + radius**2) / 2 * logarithm - a * radius)
    assert contact.force_n == pytest.approx(force, rel=0.005)
    assert abs(np.sqrt(contact.contact_area_m2 / np.pi) - a) < PITCH[0] / 8


@pytest.mark.parametrize("cells", [3, 4, 6, 12])
def test_the_area_is_that_of_hertz_to_parts_of_a_cell(cells: int) -> None:
    """Wherever the contact lies on the grid: the radius to an eighth of a cell."""
    pitch, radius = 1e-4, 0.01
    a = cells * pitch
    places = (np.arange(2 * cells + 12) - cells - 5.5) * pitch
    for shift in np.random.default_rng(0).uniform(-0.5, 0.5, (4, 2)) * pitch:
        y, x = np.meshgrid(places + shift[0], places + shift[1], indexing="ij")
        gap = (y * y + x * x) / (2 * radius)
        contact = solve_contact(gap, pitch, SILICONE, indentation_m=a * a / radius)
        assert abs(np.sqrt(contact.contact_area_m2 / np.pi) - a) < pitch / 8


@pytest.mark.parametrize("shape", [(32, 32), (64, 64), (128, 128)])
def test_a_round_flat_punch_approaches_the_closed_form_with_the_grid(shape: tuple[int, int]) -> None:
    radius, depth = 0.005, 0.0003
    pitch = (0.016 / shape[0], 0.016 / shape[1])
    y, x = places(shape, pitch)
    gap = np.where(np.hypot(y, x) < radius, 0.0, np.inf)
    contact = solve_contact(gap, pitch, SILICONE, indentation_m=depth)
    effective = np.sqrt(contact.contact_area_m2 / np.pi)
    assert contact.mask.sum() == (gap == 0).sum()
    # Pressure at the rim is infinite: the error falls with the cells across.
    assert contact.force_n == pytest.approx(2 * MODULUS * effective * depth, rel=1.6 / shape[0])


def test_force_control_finds_the_depth_and_depth_control_the_force() -> None:
    for radius in (0.006, 0.03):
        by_depth = solve_contact(paraboloid(radius), PITCH, SILICONE, indentation_m=0.0005)
        by_force = solve_contact(paraboloid(radius), PITCH, SILICONE, force_n=by_depth.force_n)
        assert by_force.force_n == pytest.approx(by_depth.force_n, rel=1e-9)
        assert by_force.indentation_m == pytest.approx(0.0005, rel=1e-4)
        assert np.abs(by_force.pressure_pa - by_depth.pressure_pa).max() < 1e-3 * by_depth.peak_pressure_pa


def test_force_grows_with_depth_and_a_warm_start_changes_nothing_but_the_work() -> None:
    y, x = places()
    gap = paraboloid(0.02) + 0.0002 * np.sin(3000 * y) * np.sin(4000 * x)
    depths = np.linspace(-0.0002, 0.0012, 15)
    curve = force_depth_curve(gap, PITCH, SILICONE, depths)
    forces = np.array([contact.force_n for contact in curve])
    assert (np.diff(forces)[forces[1:] > 0] > 0).all()
    cold = [solve_contact(gap, PITCH, SILICONE, indentation_m=float(depth)) for depth in depths]
    # Contact reaches farther at every step: what is warm must be correct in what it did not start with.
    assert np.allclose(forces, [contact.force_n for contact in cold], rtol=1e-3, atol=1e-9)
    assert sum(c.iterations for c in curve) <= 1.2 * sum(c.iterations for c in cold)


def test_influence_coefficients_are_integrals_of_the_point_load() -> None:
    pitch = (0.0004, 0.0003)
    coefficients = influence_coefficients(SILICONE, (6, 5), pitch)
    for row, column in ((0, 1), (3, 0), (2, 4), (5, 4)):
        centre = (row * pitch[0], column * pitch[1])
        value, _ = dblquad(
            lambda x, y: 1 / np.hypot(x, y),
            centre[0] - pitch[0] / 2,
            centre[0] + pitch[0] / 2,
            centre[1] - pitch[1] / 2,
            centre[1] + pitch[1] / 2,
            epsabs=1e-14,
        )
        assert coefficients[row, column] == pytest.approx(value / (np.pi * MODULUS), rel=1e-8)
    # A square under its own load: 4 ln(1 + sqrt 2) / pi of its side (Johnson 1985, equation 3.26).
    side = 0.0004
    own = influence_coefficients(SILICONE, (2, 2), (side, side))[0, 0]
    assert own == pytest.approx(4 * np.log(1 + np.sqrt(2)) * side / (np.pi * MODULUS), rel=1e-12)


@pytest.mark.parametrize(
    ("elastomer", "shape"),
    [(SILICONE, (7, 10)), (Elastomer(1e5, 0.5, 0.002), (16, 9)), (SILICONE, (1, 5))],
)
def test_displacement_is_the_sum_over_all_cells_without_wrapping(
    elastomer: Elastomer, shape: tuple[int, int]
) -> None:
    pitch = (0.0004, 0.0003)
    coefficients = influence_coefficients(elastomer, shape, pitch)
    pressure = np.random.default_rng(4).random(shape) * 1e4
    row, column = (part.ravel() for part in np.indices(shape))
    matrix = coefficients[np.abs(row[:, None] - row), np.abs(column[:, None] - column)]
    direct = (matrix @ pressure.ravel()).reshape(shape)
    displacement = Compliance(coefficients).displacement(pressure)
    assert np.abs(displacement - direct).max() < 1e-12 * np.abs(direct).max()
    assert np.linalg.eigvalsh(matrix).min() > 0


def test_a_solved_contact_is_that_of_a_solver_for_all_pairs_of_cells() -> None:
    random = np.random.default_rng(7)
    shape, pitch = (14, 11), (0.0004, 0.0003)
    gap = 0.0004 * random.random(shape)
    coefficients = influence_coefficients(SILICONE, shape, pitch)
    row, column = (part.ravel() for part in np.indices(shape))
    matrix = coefficients[np.abs(row[:, None] - row), np.abs(column[:, None] - column)]
    # min p K p / 2 - p d with p >= 0, as least squares through the Cholesky factor.
    lower = np.linalg.cholesky(matrix)
    exact, _ = nnls(lower.T, np.linalg.solve(lower, (0.0003 - gap).ravel()), maxiter=10_000)
    contact = solve_contact(gap, pitch, SILICONE, indentation_m=0.0003, tolerance=1e-9)
    assert np.abs(contact.pressure_pa.ravel() - exact).max() < 1e-6 * exact.max()
    assert (contact.mask.ravel() == (exact > 0)).all()


def test_a_contact_that_leaves_the_grid_says_so() -> None:
    contact: Contact = solve_contact(np.zeros(SHAPE), PITCH, SILICONE, indentation_m=0.0001)
    assert contact.reaches_border
