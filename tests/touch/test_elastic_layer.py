import mpmath
import numpy as np
import pytest
from layer_reference import LayerContact, layer_compliance

from objectfolder.errors import InputError
from objectfolder.touch.elastic.contact_problem import solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.influence import (
    REACH,
    bonding_correction,
    influence_coefficients,
    relative_compliance,
)

SHAPE = (96, 64)
PITCH = (0.03 / 96, 0.02 / 64)


def paraboloid(radius: float) -> np.ndarray:
    y = (np.arange(SHAPE[0]) - (SHAPE[0] - 1) / 2) * PITCH[0]
    x = (np.arange(SHAPE[1]) - (SHAPE[1] - 1) / 2) * PITCH[1]
    return (y[:, None] ** 2 + x**2) / (2 * radius)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.48, 0.5])
def test_the_closed_form_of_waves_is_what_elasticity_integrates_to(poisson_ratio: float) -> None:
    k = np.geomspace(0.01, 11, 30)
    compliance = relative_compliance(k, poisson_ratio)
    assert compliance == pytest.approx(layer_compliance(k, poisson_ratio), rel=1e-11)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.49999, 0.5])
def test_no_wave_number_is_lost_to_cancellation(poisson_ratio: float) -> None:
    k = np.array([1e-8, 1e-5, 1e-3, 0.05, 0.149999, 0.15, 0.299999, 0.3, 0.300001, 1, 10, 300, 1e4])
    compliance = relative_compliance(k, poisson_ratio)
    with mpmath.workdps(60):
        n = mpmath.mpf(poisson_ratio)
        for value, a in zip(compliance[:-1], map(mpmath.mpf, k[:-1].tolist()), strict=True):
            above = (3 - 4 * n) * mpmath.sinh(2 * a) - 2 * a
            below = (3 - 4 * n) * mpmath.cosh(2 * a) + 2 * a * a + 5 - 12 * n + 8 * n * n
            assert value == pytest.approx(float(above / below), rel=2e-13)
    assert compliance[-1] == 1
    assert relative_compliance(np.zeros(1), poisson_ratio)[0] == 0


@pytest.mark.parametrize(
    ("radius", "thickness", "poisson_ratio"),
    [
        (0.006, 0.001, 0.5),
        (0.006, 0.002, 0.3),
        (0.006, 0.008, 0.48),
        (0.03, 0.001, 0.48),
        (0.03, 0.002, 0.5),
        (0.03, 0.004, 0.3),
    ],
)
def test_a_paraboloid_on_a_layer_is_that_of_the_integral_equation(
    poisson_ratio: float, thickness: float, radius: float
) -> None:
    depth = 0.0005
    expected = LayerContact(thickness, poisson_ratio).at_indentation(depth, radius)
    gel = Elastomer(2e5, poisson_ratio, thickness)
    contact = solve_contact(paraboloid(radius), PITCH, gel, indentation_m=depth)
    modulus = gel.contact_modulus_pa
    assert contact.force_n == pytest.approx(expected.force_over_modulus_m2 * modulus, rel=0.005)
    assert contact.peak_pressure_pa == pytest.approx(expected.peak_pressure_over_modulus * modulus, rel=0.01)
    measured = np.sqrt(contact.contact_area_m2 / np.pi)
    assert abs(measured - expected.contact_radius_m) < PITCH[0] / 2


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.45, 0.5])
def test_thinner_layers_are_stiffer_and_thick_ones_are_half_spaces(poisson_ratio: float) -> None:
    gap, depth = paraboloid(0.012), 0.0005
    thicknesses = [0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.064, 10.0]
    forces = [
        solve_contact(gap, PITCH, Elastomer(2e5, poisson_ratio, thickness), indentation_m=depth).force_n
        for thickness in thicknesses
    ]
    assert (np.diff(forces) < 0).all()
    half_space = solve_contact(gap, PITCH, Elastomer(2e5, poisson_ratio), indentation_m=depth).force_n
    assert forces[-1] == pytest.approx(half_space, rel=0.001)
    assert forces[-1] > half_space


def test_a_thin_compressible_layer_is_a_bed_of_springs() -> None:
    """Pressure = oedometric modulus * shortening / thickness (Johnson 1985, equation 5.68)."""
    depth, radius, excess = 0.00002, 0.5, []
    for thickness in (0.0016, 0.0008, 0.0004):
        contact = solve_contact(
            paraboloid(radius), PITCH, Elastomer(1e5, 0.3, thickness), indentation_m=depth
        )
        oedometric = 1e5 * 0.7 / (1.3 * 0.4)
        springs = oedometric / thickness * np.maximum(depth - paraboloid(radius), 0)
        excess.append(contact.peak_pressure_pa / springs.max() - 1)
        assert contact.force_n == pytest.approx(springs.sum() * PITCH[0] * PITCH[1], rel=0.015)
    # The next term is of the order of the squared thickness over the contact radius.
    assert abs(excess[2]) < 0.003
    assert excess[1] / excess[2] == pytest.approx(4, rel=0.25)


def test_a_thin_incompressible_layer_follows_its_asymptote() -> None:
    """Force = pi E a^6 / (96 R h^3), a = 2 sqrt(R d) (Johnson 1985, equation 5.75), as the layer thins."""
    radius, excess = 0.5, []
    for thickness in (0.002, 0.001, 0.0005):
        depth = 0.00003
        a = 2 * np.sqrt(radius * depth)
        gel = Elastomer(1e5, 0.5, thickness)
        contact = solve_contact(paraboloid(radius), PITCH, gel, indentation_m=depth)
        excess.append(contact.force_n / (np.pi * 1e5 * a**6 / (96 * radius * thickness**3)) - 1)
    # The thickness over the contact radius is 0.26, 0.13, 0.06.
    assert excess[0] > excess[1] > excess[2] > 0
    assert excess[2] < 0.1


def test_an_incompressible_layer_bulges_out_by_the_volume_pressed_in() -> None:
    # Ten thicknesses from the rim to the border of the grid: no bulge is missing.
    gel = Elastomer(2e5, 0.5, 0.0005)
    contact = solve_contact(paraboloid(0.006), PITCH, gel, indentation_m=0.0005)
    pressed_in = contact.displacement_m[contact.displacement_m > 0].sum()
    assert contact.displacement_m.min() < -0.1 * 0.0005
    assert contact.displacement_m.sum() == pytest.approx(0, abs=1e-4 * pressed_in)
    compressible = solve_contact(paraboloid(0.006), PITCH, Elastomer(2e5, 0.3, 0.0005), indentation_m=0.0005)
    assert compressible.displacement_m.sum() > 0.5 * pressed_in


def test_the_bulge_can_touch_what_the_undeformed_gel_does_not() -> None:
    gap = paraboloid(0.006)
    alone = solve_contact(gap, PITCH, Elastomer(2e5, 0.5, 0.002), indentation_m=0.0005)
    row, column = np.unravel_index(np.argmin(alone.displacement_m), SHAPE)
    gap[row, column] = 0.0005 - alone.displacement_m.min() / 3
    contact = solve_contact(gap, PITCH, Elastomer(2e5, 0.5, 0.002), indentation_m=0.0005)
    assert gap[row, column] > 0.0005
    assert contact.pressure_pa[row, column] > 0
    assert contact.gap_m.min() > -1e-5 * 0.0005


def test_the_layers_correction_ends_where_the_half_space_is_cancelled() -> None:
    for poisson_ratio in (0.0, 0.3, 0.5):
        end = np.array([0.8 * REACH, REACH])
        assert np.abs(1 / end + bonding_correction(poisson_ratio)(end)).max() < 1e-6


def test_cells_too_coarse_for_the_layer_are_refused() -> None:
    with pytest.raises(InputError, match="finer grid"):
        influence_coefficients(Elastomer(1e5, 0.5, 0.0001), (8, 8), (0.001, 0.001))
