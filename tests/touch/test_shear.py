"""Shear of the gel against Cattaneo and Mindlin, a dense solution, and waves integrated through the layer."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.special import ellipe, ellipk, j0, j1, jv
from shear_reference import cerruti, sheared

from objectfolder.errors import InputError, SimulationError
from objectfolder.touch.elastic.contact_problem import Contact, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.shear import solve_shear, unsheared
from objectfolder.touch.elastic.tangential_influence import (
    TangentialCompliance,
    relative_compliances,
    tangential_compliance,
)

MODULUS_PA, RADIUS_M, FRICTION, FORCE_N = 2e5, 0.02, 0.8, 0.35
CELLS, PITCH_M = 96, 0.008 / 96


def squared_radii() -> np.ndarray:
    x = (np.arange(CELLS) - (CELLS - 1) / 2) * PITCH_M
    return x[:, None] ** 2 + x**2


def ball(gel: Elastomer) -> Contact:
    return solve_contact(squared_radii() / (2 * RADIUS_M), PITCH_M, gel, force_n=FORCE_N)


def hertz_radius(gel: Elastomer) -> float:
    return float((3 * FORCE_N * RADIUS_M / (4 * gel.contact_modulus_pa)) ** (1 / 3))


def along_wave(a: float, n: float, load: np.ndarray) -> np.ndarray:
    """U and W at the surface of a layer of thickness and modulus of rigidity 1 under T sin ax, S cos ax."""
    through = np.zeros((4, 4))
    through[0, 1:3] = a, 1
    through[1, 0], through[1, 3] = -a * n / (1 - n), (1 - 2 * n) / (2 * (1 - n))
    through[2, 0], through[2, 3], through[3, 2] = 2 * a * a / (1 - n), a * n / (1 - n), -a
    transfer = expm(through)
    return transfer[:2, 2:] @ np.linalg.solve(transfer[2:, 2:], load)


@pytest.mark.parametrize("n", [0.0, 0.3, 0.48, 0.5])
def test_waves_move_a_layer_as_elasticity_integrates_to(n: float) -> None:
    a = np.geomspace(0.01, 9, 20)
    along, across, pressed = relative_compliances(a, n)
    sheared = np.array([along_wave(k, n, np.array([1.0, 0.0]))[0] * k / (1 - n) for k in a])
    sideways = np.array([along_wave(k, n, np.array([0.0, -1.0]))[0] * 2 * k for k in a])
    assert along == pytest.approx(sheared, rel=1e-10)
    assert pressed == pytest.approx(sideways, rel=1e-8, abs=1e-12)
    # Out of plane: G v'' = a^2 G v, clamped below.
    shaken = np.array([-expm(np.array([[0.0, 1.0], [k * k, 0.0]]) * -1)[0, 1] for k in a])
    clamped = np.array([expm(np.array([[0.0, 1.0], [k * k, 0.0]]) * -1)[0, 0] for k in a])
    assert across == pytest.approx(a * shaken / clamped, rel=1e-10)


@pytest.mark.parametrize("thickness", [None, 0.002])
@pytest.mark.parametrize("n", [0.0, 0.3, 0.48])
def test_a_soft_patch_moves_the_surface_as_its_hankel_transform_says(
    thickness: float | None, n: float
) -> None:
    pitch, count, width = 0.0002, 96, 0.0015
    x = (np.arange(count) - (count - 1) / 2) * pitch
    patch = np.exp(-(x[:, None] ** 2 + x**2) / (2 * width**2))
    grid = TangentialCompliance(Elastomer(MODULUS_PA, n, thickness), (count, count), (pitch, pitch))
    moved = grid.displacement(np.stack([patch, np.zeros_like(patch)]))
    pressed = grid.displacement_by_pressure(patch)
    node, weight = np.polynomial.legendre.leggauss(1000)
    k, weight = (1 + node) * 4 / width, weight * 4 / width
    shear = MODULUS_PA / (2 * (1 + n))
    along, across, sideways = (1 - n) / k, 1 / k, (2 * n - 1) / (2 * k)
    if thickness:
        factors = relative_compliances(k * thickness, n)
        along, across, sideways = along * factors[0], across * factors[1], factors[2] / (2 * k)
    amplitude = weight * k * width**2 * np.exp(-((k * width) ** 2) / 2) / shear
    for i, j in ((48, 60), (70, 30), (40, 41)):
        r = np.hypot(x[i], x[j])
        cosine, sine = x[i] / r, x[j] / r
        even = amplitude * (along + across) / 2 @ j0(k * r)
        turned = amplitude * (across - along) / 2 @ jv(2, k * r)
        outward = amplitude * sideways @ j1(k * r)
        expected = even + turned * (cosine**2 - sine**2), turned * 2 * cosine * sine
        steps = (pitch / width) ** 2 / 6  # of a patch that is constant on each cell
        assert moved[:, i, j] == pytest.approx(expected, abs=steps * even)
        # A layer's is what is left of the half-space's by what bonding takes off.
        largest = abs(amplitude * (2 * n - 1) / (2 * k) @ j1(k * r)) + abs(outward)
        assert pressed[:, i, j] == pytest.approx([outward * cosine, outward * sine], abs=steps * largest)


def test_columns_are_moved_as_rows_are() -> None:
    gel = Elastomer(MODULUS_PA, 0.4, 0.002)
    compliance = TangentialCompliance(gel, (9, 14), (3e-4, 5e-4))
    transpose = TangentialCompliance(gel, (14, 9), (5e-4, 3e-4))
    traction = np.random.default_rng(0).normal(size=(2, 9, 14))
    turned = transpose.displacement(traction[::-1].swapaxes(1, 2))
    np.testing.assert_allclose(compliance.displacement(traction), turned[::-1].swapaxes(1, 2), rtol=1e-12)


@pytest.mark.parametrize("n", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_ball_follows_cattaneo_and_mindlin(n: float, share: float) -> None:
    """Johnson 1985, section 7.2: stick radius, shift and tractions under a share of the friction."""
    gel = Elastomer(MODULUS_PA, n)
    contact = ball(gel)
    radius = (3 * FORCE_N * RADIUS_M / (4 * gel.contact_modulus_pa)) ** (1 / 3)
    stick = radius * (1 - share) ** (1 / 3)
    shear = solve_shear(contact, gel, FRICTION, (0.0, share * FRICTION * FORCE_N))
    stick_radius = np.sqrt(shear.sticking.sum() * PITCH_M**2 / np.pi)
    assert abs(stick_radius - stick) < 0.02 * radius
    rigidity = MODULUS_PA / (2 * (1 + n))
    shift = 3 * FRICTION * FORCE_N * (2 - n) / (16 * rigidity * radius) * (1 - (1 - share) ** (2 / 3))
    assert shear.shift_m[1] == pytest.approx(shift, rel=0.005)
    assert shear.shift_m[0] == pytest.approx(0, abs=1e-9 * shift)
    peak, r = 1.5 * FORCE_N / (np.pi * radius**2), squared_radii()
    inner = np.sqrt(np.maximum(1 - r / stick**2, 0)) * stick / radius
    traction = FRICTION * peak * (np.sqrt(np.maximum(1 - r / radius**2, 0)) - inner)
    smooth = (r < (stick - 2 * PITCH_M) ** 2) | ((r > (stick + 2 * PITCH_M) ** 2) & (r < 0.9 * radius**2))
    assert np.abs(shear.traction_pa[1] - traction)[smooth].max() < 0.02 * FRICTION * peak
    # The closed form lets all of the traction point along the force.
    assert np.abs(shear.traction_pa[0]).max() <= 0.11 * FRICTION * peak
    assert shear.traction_pa[1].sum() * PITCH_M**2 == pytest.approx(share * FRICTION * FORCE_N, rel=1e-6)


@pytest.mark.parametrize("n", [0.0, 0.5])
@pytest.mark.parametrize("stick", [0.9, 0.4])
def test_a_ball_twists_as_lubkin_says(n: float, stick: float) -> None:
    """J. L. Lubkin 1951, J. Appl. Mech. 18: rigid discs of all radii from the stick radius on are twisted."""
    gel = Elastomer(MODULUS_PA, n)
    contact = ball(gel)
    radius, rigidity = hertz_radius(gel), MODULUS_PA / (2 * (1 + n))
    peak = 1.5 * FORCE_N / (np.pi * radius**2)

    def twist(t: float) -> float:
        square = 1 - (t / radius) ** 2
        return FRICTION * peak / (2 * rigidity) * (ellipk(square) - ellipe(square))

    inner = stick * radius
    discs = inner**3 * twist(inner) + 3 * quad(lambda t: t * t * twist(t), inner, radius)[0]
    torque = 16 * rigidity / 3 * discs
    shear = solve_shear(contact, gel, FRICTION, (0.0, 0.0), torque_nm=torque)
    assert shear.twist_rad == pytest.approx(twist(inner), rel=0.002)
    assert np.abs(shear.shift_m).max() < 1e-6 * radius * shear.twist_rad
    assert abs(np.sqrt(shear.sticking.sum() / np.pi) * PITCH_M - inner) < 0.01 * radius
    x = (np.arange(CELLS) - (CELLS - 1) / 2) * PITCH_M
    borne = (x[:, None] * shear.traction_pa[1] - x * shear.traction_pa[0]).sum() * PITCH_M**2
    assert borne == pytest.approx(torque, rel=1e-6)
    # From the rows' order towards the columns': what lies further down moves to the right.
    assert shear.displacement_m[1, CELLS // 2 + 5, CELLS // 2] > 0


def test_force_and_torque_slide_together_before_either_would() -> None:
    gel = Elastomer(MODULUS_PA, 0.3)
    contact, force = ball(gel), 0.8 * FRICTION * FORCE_N
    limit = 3 * np.pi / 16 * FRICTION * FORCE_N * hertz_radius(gel)
    for sign in (1, -1):
        shear = solve_shear(contact, gel, FRICTION, (force, 0.0), torque_nm=sign * 0.3 * limit)
        assert not shear.sliding
        sliding = solve_shear(contact, gel, FRICTION, (force, 0.0), torque_nm=sign * 0.8 * limit)
        assert sliding.sliding
        assert sign * shear.twist_rad > 0
        np.testing.assert_allclose(
            np.hypot(*sliding.traction_pa)[contact.mask], FRICTION * contact.pressure_pa[contact.mask]
        )
        x = (np.arange(CELLS) - (CELLS - 1) / 2) * PITCH_M
        torque = (x[:, None] * sliding.traction_pa[1] - x * sliding.traction_pa[0]).sum() * PITCH_M**2
        across = sliding.traction_pa[0].sum() * PITCH_M**2
        assert torque / across == pytest.approx(sign * 0.8 * limit / force, rel=1e-3)
    assert not solve_shear(contact, gel, FRICTION, (0.0, 0.0), torque_nm=0.999 * limit).sliding
    assert solve_shear(contact, gel, FRICTION, (0.0, 0.0), torque_nm=1.001 * limit).sliding


def test_a_force_that_falls_leaves_what_slipped() -> None:
    """R. D. Mindlin & H. Deresiewicz 1953, J. Appl. Mech. 20: unloaded, and pulled back to where it stood."""
    gel = Elastomer(MODULUS_PA, 0.3)
    contact, most = ball(gel), FRICTION * FORCE_N
    pushed = solve_shear(contact, gel, FRICTION, (0.0, 0.9 * most))
    scale = float(pushed.shift_m[1]) / (1 - 0.1 ** (2 / 3))
    for share in (0.0, -0.9):
        shear = solve_shear(contact, gel, FRICTION, (0.0, share * most), before=pushed)
        closed = 2 * (1 - (0.9 - share) / 2) ** (2 / 3) - 0.1 ** (2 / 3) - 1
        assert shear.shift_m[1] == pytest.approx(scale * closed, abs=0.005 * scale)
        again = solve_shear(contact, gel, FRICTION, (0.0, 0.9 * most), before=shear)
        assert again.shift_m[1] == pytest.approx(pushed.shift_m[1], abs=0.002 * scale)
    halfway = solve_shear(contact, gel, FRICTION, (0.0, 0.4 * most), before=pushed)
    released = solve_shear(contact, gel, FRICTION, (0.0, 0.0), before=halfway)
    assert released.shift_m[1] == pytest.approx(0.127 * scale, abs=0.003 * scale)


def test_friction_while_it_is_pressed_holds_what_has_been_touched() -> None:
    gel = Elastomer(MODULUS_PA, 0.3, 0.004)
    state, gap = unsheared((CELLS, CELLS)), squared_radii() / (2 * RADIUS_M)
    for force in (0.1, 0.2, 0.35):
        contact, before = solve_contact(gap, PITCH_M, gel, force_n=force), state
        state = solve_shear(contact, gel, 5.0, (0.0, 0.0), before=before)
        assert np.count_nonzero(state.sticking) > 0.9 * np.count_nonzero(contact.mask)
        change = np.abs(state.displacement_m - before.displacement_m)[:, state.sticking]
        assert change.max() < 2e-3 * np.abs(state.displacement_m).max()
    slipping = solve_shear(contact, gel, FRICTION, (0.0, 0.0))
    middle = CELLS // 2, CELLS // 2 + 12
    assert abs(state.displacement_m[1][middle]) < 0.6 * abs(slipping.displacement_m[1][middle])


def test_beyond_friction_all_slides_and_bears_no_more() -> None:
    gel = Elastomer(MODULUS_PA, 0.3)
    contact = ball(gel)
    shear = solve_shear(contact, gel, FRICTION, (-3.0, 0.0))
    assert shear.sliding
    assert not shear.sticking.any()
    np.testing.assert_allclose(shear.traction_pa[0], -FRICTION * contact.pressure_pa)
    radius = (3 * FORCE_N * RADIUS_M / (4 * gel.contact_modulus_pa)) ** (1 / 3)
    rigidity = MODULUS_PA / 2.6
    shift = 3 * FRICTION * FORCE_N * 1.7 / (16 * rigidity * radius)
    assert shear.shift_m == pytest.approx([-shift, 0], rel=0.002)


@pytest.mark.parametrize("share", [1e-9, 0.5, 1 - 1e-3, 1 - 1e-6, 1 - 1e-9, 1 - 1e-15])
@pytest.mark.parametrize("cells", [1, 2, 8])
def test_any_share_of_the_friction_is_borne_by_any_number_of_cells(cells: int, share: float) -> None:
    gel, gap = Elastomer(MODULUS_PA, 0.48, 0.004), np.full((16, 16), 1e-3)
    gap[5, 4 : 4 + cells] = 0.0
    contact = solve_contact(gap, 4e-4, gel, force_n=0.01)
    assert np.count_nonzero(contact.mask) == cells
    limit_n = FRICTION * contact.force_n
    shear = solve_shear(contact, gel, FRICTION, (0.6 * share * limit_n, 0.8 * share * limit_n))
    borne = shear.traction_pa.sum(axis=(1, 2)) * 4e-4**2
    assert borne == pytest.approx([0.6 * share * limit_n, 0.8 * share * limit_n], abs=2e-9 * limit_n)
    assert (np.hypot(*shear.traction_pa) <= FRICTION * contact.pressure_pa * (1 + 1e-12)).all()
    assert np.isfinite(shear.displacement_m).all()


def test_where_poissons_ratio_is_0_shear_is_the_difference_of_two_contacts() -> None:
    """M. Ciavarella 1998, Int. J. Solids Structures 35; J. Jaeger 1998: exact for any profile there."""
    x = (np.arange(64) - 31.5) * 2e-4
    rough = np.random.default_rng(1).normal(size=(6, 3))
    waves = sum(a * np.cos(2e3 * (b * x[:, None] + c * x) + a) for a, b, c in rough)
    gap, gel = (x[:, None] ** 2 + x**2) / 0.04 + 6e-6 * waves, Elastomer(MODULUS_PA, 0.0)
    whole, share = solve_contact(gap, 2e-4, gel, force_n=0.3), 0.55
    inner = solve_contact(gap, 2e-4, gel, force_n=(1 - share) * 0.3)
    shear = solve_shear(whole, gel, FRICTION, (share * FRICTION * 0.3, 0.0), tolerance=1e-5)
    expected = FRICTION * (whole.pressure_pa - inner.pressure_pa)
    assert np.count_nonzero(inner.mask) < 0.8 * np.count_nonzero(whole.mask)
    assert np.abs(shear.traction_pa[0] - expected).max() < 0.005 * expected.max()
    assert np.abs(shear.traction_pa[1]).max() < 1e-6 * expected.max()
    assert shear.shift_m[0] == pytest.approx(FRICTION * (whole.indentation_m - inner.indentation_m), rel=1e-3)


def test_without_a_push_all_sticks_and_without_friction_all_slides() -> None:
    gel = Elastomer(MODULUS_PA, 0.48, 0.004)
    contact = ball(gel)
    still = solve_shear(contact, gel, FRICTION, (0.0, 0.0))
    assert not still.sliding
    np.testing.assert_array_equal(still.sticking, contact.mask)
    pressed = tangential_compliance(gel, contact.mask.shape, contact.pitch_m)
    np.testing.assert_allclose(
        still.displacement_m, pressed.displacement_by_pressure(contact.pressure_pa), atol=1e-15
    )
    assert solve_shear(contact, gel, 0.0, (0.0, 1e-9)).sliding
    assert not solve_shear(contact, gel, 0.0, (0.0, 0.0)).sliding
    lifted = solve_contact(squared_radii() / (2 * RADIUS_M), PITCH_M, gel, force_n=0.0)
    assert solve_shear(lifted, gel, FRICTION, (1.0, 0.0)).sliding


@pytest.mark.parametrize("n", [0.0, 0.48])
def test_a_rough_object_shears_the_surface_as_the_dense_solution(n: float) -> None:
    """Two bumps of unequal height, pushed askew: stick, slip and the field of markers."""
    pitch, cells = 0.0004, 24
    x = (np.arange(cells) - (cells - 1) / 2) * pitch
    bumps = [(-0.0016, -0.001, 0.0), (0.0018, 0.0014, 3e-5)]
    gap = np.min([(x[:, None] - a) ** 2 / 0.016 + (x - b) ** 2 / 0.02 + c for a, b, c in bumps], axis=0)
    gel = Elastomer(MODULUS_PA, n)
    contact = solve_contact(gap, pitch, gel, force_n=0.15)
    row, column = np.nonzero(contact.mask)
    assert 60 < len(row) < 300
    matrix = cerruti(np.stack([x[row], x[column]], axis=1), pitch, n, MODULUS_PA)
    limit, shift = FRICTION * contact.pressure_pa[row, column], np.array([6e-5, 3e-5])
    expected = sheared(matrix, limit, shift)
    stuck = np.hypot(*expected.T) < limit * (1 - 1e-6)
    assert 0.2 < stuck.mean() < 0.9
    shear = solve_shear(contact, gel, FRICTION, expected.sum(axis=0) * pitch**2, tolerance=1e-6)
    assert shear.shift_m == pytest.approx(shift, rel=0.003)
    tractions = shear.traction_pa[:, row, column].T
    assert np.abs(tractions - expected).max() < 0.01 * limit.max()
    assert np.count_nonzero(shear.sticking[row, column] != stuck) <= 2
    pressed = tangential_compliance(gel, gap.shape, contact.pitch_m)
    moved = shear.displacement_m - pressed.displacement_by_pressure(contact.pressure_pa)
    by_matrix = np.einsum("mnij,nj->mi", matrix, expected)
    assert np.abs(moved[:, row, column].T - by_matrix).max() < 0.003 * np.abs(by_matrix).max()


def test_a_layer_shears_stiffer_than_the_half_space_and_as_a_block_where_it_is_thin() -> None:
    shifts = []
    for thickness in (None, 0.004, 0.00025):
        gel = Elastomer(MODULUS_PA, 0.48, thickness)
        contact = solve_contact(np.where(squared_radii() < 0.003**2, 0.0, 1e-3), PITCH_M, gel, force_n=1.0)
        shear = solve_shear(contact, gel, 50.0, (0.2, 0.0))
        shifts.append(shear.shift_m[0])
    assert shifts[0] > shifts[1] > shifts[2]
    block = 0.2 * 0.00025 / (MODULUS_PA / 2.96 * np.pi * 0.003**2)
    assert shifts[2] == pytest.approx(block, rel=0.12)
    assert shifts[2] < block  # what lies round it is dragged along


def test_no_answer_without_numbers_or_iterations() -> None:
    gel = Elastomer(MODULUS_PA, 0.48)
    contact = ball(gel)
    for friction in (-0.1, np.nan, np.inf):
        with pytest.raises(InputError, match=r"friction: .* 0 or more"):
            solve_shear(contact, gel, friction, (0.0, 0.1))
    for force in ((np.nan, 0.0), (1.0, 2.0, 3.0), 1.0):
        with pytest.raises(InputError, match=r"force_n: .* Give two numbers"):
            solve_shear(contact, gel, 1.0, force)
    with pytest.raises(InputError, match=r"torque_nm: nan"):
        solve_shear(contact, gel, 1.0, (0.0, 0.1), torque_nm=np.nan)
    with pytest.raises(InputError, match=r"before: .* one grid"):
        solve_shear(contact, gel, 1.0, (0.0, 0.1), before=unsheared((4, 4)))
    with pytest.raises(SimulationError, match=r"shear: what sticks is wrong by .* after 3 iterations"):
        solve_shear(contact, gel, 1.0, (0.0, 0.1), maximum_iterations=3)
