import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.errors import InputError, SimulationError
from objectfolder.touch.elastic.contact_problem import Contact, force_depth_curve, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from tests.drawn_examples import few_examples

SHAPE = (40, 28)
PITCH = (0.0005, 0.0006)


def bumps(seed: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """Smooth random heights of about a millimetre, lowest near 0."""
    random = np.random.default_rng(seed)
    y, x = np.meshgrid(np.linspace(-1, 1, shape[0]), np.linspace(-1, 1, shape[1]), indexing="ij")
    gap = 0.001 * (random.uniform(0.2, 1) * y * y + random.uniform(0.2, 1) * x * x)
    for _ in range(5):
        ky, kx, phase = random.uniform(1, 12), random.uniform(1, 12), random.uniform(0, 7)
        gap += random.uniform(0, 0.00015) * np.sin(ky * y + kx * x + phase)
    return np.asarray(gap - gap.min())


elastomers = st.builds(
    Elastomer,
    st.floats(1e3, 1e9),
    st.sampled_from([0.0, 0.3, 0.48, 0.4999, 0.5]),
    st.one_of(st.none(), st.floats(0.001, 0.1)),
)
seeds = st.integers(0, 10_000)
depths = st.floats(1e-5, 0.0008)


def assert_complementary(contact: Contact, gap: np.ndarray, tolerance: float) -> None:
    scale = contact.indentation_m - gap.min()
    assert (contact.pressure_pa >= 0).all()
    assert contact.gap_m.min() >= -tolerance * scale
    assert np.abs(contact.gap_m[contact.mask]).max() <= tolerance * scale
    assert contact.relative_residual <= tolerance
    finite = np.isfinite(gap)
    remaining = contact.displacement_m[finite] + gap[finite] - contact.indentation_m
    assert np.allclose(contact.gap_m[finite], remaining, rtol=0, atol=1e-12 * scale)


@given(elastomers, seeds, depths)
def test_pressure_never_pulls_the_gap_never_closes_past_zero_and_one_of_them_is_zero(
    elastomer: Elastomer, seed: int, depth: float
) -> None:
    gap = bumps(seed)
    contact = solve_contact(gap, PITCH, elastomer, indentation_m=depth)
    assert_complementary(contact, gap, 1.01e-5)
    assert contact.force_n > 0


@given(elastomers, seeds, st.floats(1e-5, 1e-1))
def test_a_force_is_carried_to_rounding(elastomer: Elastomer, seed: int, share: float) -> None:
    gap = bumps(seed)
    force = share * elastomer.contact_modulus_pa * 1e-5
    contact = solve_contact(gap, PITCH, elastomer, force_n=force)
    assert_complementary(contact, gap, 1.01e-5)
    assert contact.force_n == pytest.approx(force, rel=1e-12)
    back = solve_contact(gap, PITCH, elastomer, indentation_m=contact.indentation_m)
    assert back.force_n == pytest.approx(force, rel=1e-3)


@given(elastomers, seeds, depths, st.floats(1e-3, 1e3))
def test_force_is_linear_in_the_modulus(elastomer: Elastomer, seed: int, depth: float, factor: float) -> None:
    stiffer = Elastomer(elastomer.youngs_modulus_pa * factor, elastomer.poisson_ratio, elastomer.thickness_m)
    first = solve_contact(bumps(seed), PITCH, elastomer, indentation_m=depth)
    second = solve_contact(bumps(seed), PITCH, stiffer, indentation_m=depth)
    assert second.force_n == pytest.approx(factor * first.force_n, rel=1e-9)
    assert np.allclose(second.displacement_m, first.displacement_m, rtol=0, atol=1e-9 * depth)


@given(elastomers, seeds, depths, st.floats(1e-3, 1e3))
def test_lengths_scale_the_force_by_their_square(
    elastomer: Elastomer, seed: int, depth: float, factor: float
) -> None:
    thickness = None if elastomer.thickness_m is None else factor * elastomer.thickness_m
    larger = Elastomer(elastomer.youngs_modulus_pa, elastomer.poisson_ratio, thickness)
    first = solve_contact(bumps(seed), PITCH, elastomer, indentation_m=depth)
    pitch = (PITCH[0] * factor, PITCH[1] * factor)
    second = solve_contact(bumps(seed) * factor, pitch, larger, indentation_m=depth * factor)
    assert second.force_n == pytest.approx(factor**2 * first.force_n, rel=1e-6)
    assert np.allclose(second.pressure_pa, first.pressure_pa, rtol=0, atol=1e-5 * first.peak_pressure_pa)


@given(elastomers, seeds, depths, st.booleans(), st.booleans(), st.booleans())
def test_a_reflected_or_turned_object_makes_the_reflected_or_turned_contact(
    elastomer: Elastomer, seed: int, depth: float, rows: bool, columns: bool, turned: bool
) -> None:
    def moved(field: np.ndarray) -> np.ndarray:
        field = field[:: -1 if rows else 1, :: -1 if columns else 1]
        return field.T if turned else field

    gap = bumps(seed)
    first = solve_contact(gap, PITCH, elastomer, indentation_m=depth, tolerance=1e-8)
    pitch = PITCH[::-1] if turned else PITCH
    second = solve_contact(moved(gap), pitch, elastomer, indentation_m=depth, tolerance=1e-8)
    assert second.force_n == pytest.approx(first.force_n, rel=1e-6)
    assert np.abs(second.pressure_pa - moved(first.pressure_pa)).max() < 1e-4 * first.peak_pressure_pa


@given(elastomers, seeds, st.integers(0, 20), st.integers(0, 20))
def test_a_shifted_object_makes_the_shifted_contact(
    elastomer: Elastomer, seed: int, down: int, right: int
) -> None:
    gap = bumps(seed)
    large = np.full((SHAPE[0] + 20, SHAPE[1] + 20), np.inf)
    home = large.copy()
    home[: SHAPE[0], : SHAPE[1]] = gap
    large[down : down + SHAPE[0], right : right + SHAPE[1]] = gap
    first = solve_contact(home, PITCH, elastomer, indentation_m=0.0003, tolerance=1e-8)
    second = solve_contact(large, PITCH, elastomer, indentation_m=0.0003, tolerance=1e-8)
    part = second.pressure_pa[down : down + SHAPE[0], right : right + SHAPE[1]]
    assert np.abs(part - first.pressure_pa[: SHAPE[0], : SHAPE[1]]).max() < 1e-4 * first.peak_pressure_pa


@given(elastomers, seeds)
@few_examples(10)
def test_force_never_falls_with_depth(elastomer: Elastomer, seed: int) -> None:
    curve = force_depth_curve(bumps(seed), PITCH, elastomer, np.linspace(0, 0.0008, 9))
    assert (np.diff([contact.force_n for contact in curve]) > 0).all()


@given(seeds, st.floats(-0.001, 0.001))
@few_examples(10)
def test_heights_count_from_where_the_caller_says(seed: int, offset: float) -> None:
    gel = Elastomer(2e5, 0.48, 0.004)
    first = solve_contact(bumps(seed), PITCH, gel, indentation_m=0.0003)
    second = solve_contact(bumps(seed) + offset, PITCH, gel, indentation_m=0.0003 + offset)
    assert second.force_n == pytest.approx(first.force_n, rel=1e-6)


def test_no_depth_no_force_and_no_force_no_depth() -> None:
    gap, gel = bumps(0) + 0.0001, Elastomer(2e5, 0.48, 0.004)
    for contact in (
        solve_contact(gap, PITCH, gel, indentation_m=0.0001),
        solve_contact(gap, PITCH, gel, indentation_m=-0.01),
        solve_contact(np.full(SHAPE, np.inf), PITCH, gel, indentation_m=0.001),
        solve_contact(gap, PITCH, gel, force_n=0.0),
    ):
        assert contact.force_n == contact.peak_pressure_pa == contact.contact_area_m2 == 0
        assert not contact.displacement_m.any()
    assert contact.indentation_m == pytest.approx(0.0001)


def test_a_needle_as_wide_as_a_cell_is_a_square_punch() -> None:
    gap = np.full(SHAPE, np.inf)
    gap[7, 9] = 0.0
    gel = Elastomer(2e5, 0.3)
    contact = solve_contact(gap, PITCH[0], gel, indentation_m=0.0001)
    side = PITCH[0]
    uniform = 0.0001 * np.pi * gel.contact_modulus_pa / (4 * np.log(1 + np.sqrt(2)) * side)
    assert contact.peak_pressure_pa == pytest.approx(uniform, rel=1e-9)
    assert contact.mask.sum() == 1


def test_a_start_where_the_object_is_not_is_set_aside() -> None:
    gap, gel = bumps(3), Elastomer(2e5, 0.48, 0.004)
    start = np.where(gap > 0.0008, 1e4, 0.0)
    contact = solve_contact(gap, PITCH, gel, indentation_m=0.0002, initial_pressure_pa=start)
    plain = solve_contact(gap, PITCH, gel, indentation_m=0.0002)
    assert contact.force_n == pytest.approx(plain.force_n, rel=1e-4)


def test_two_distant_contacts_press_on_each_other() -> None:
    gap = np.full((60, 20), np.inf)
    gap[5:10, 5:10] = 0.0
    gel = Elastomer(2e5, 0.3)
    alone = solve_contact(gap, PITCH, gel, indentation_m=0.0001)
    gap[50:55, 5:10] = 0.0
    both = solve_contact(gap, PITCH, gel, indentation_m=0.0001)
    distance = 45 * PITCH[0]
    lowered = alone.force_n / (np.pi * gel.contact_modulus_pa * distance)
    assert both.force_n == pytest.approx(2 * alone.force_n / (1 + lowered / 0.0001), rel=0.001)


def test_a_start_that_is_right_where_it_presses_takes_in_what_else_the_object_overlaps() -> None:
    block, both, gel = np.full(SHAPE, np.inf), np.full(SHAPE, np.inf), Elastomer(2e5, 0.48, 0.004)
    block[5:10, 5:10] = both[5:10, 5:10] = both[30:35, 15:20] = 0.0
    start = solve_contact(block, PITCH, gel, indentation_m=0.0001).pressure_pa
    contact = solve_contact(both, PITCH, gel, indentation_m=0.0001, initial_pressure_pa=start)
    assert_complementary(contact, both, 1.01e-5)
    assert contact.force_n == pytest.approx(
        solve_contact(both, PITCH, gel, indentation_m=0.0001).force_n, rel=1e-4
    )


def test_what_does_not_converge_is_an_error_with_a_remedy() -> None:
    with pytest.raises(SimulationError, match=r"after 2 iterations.*Allow more iterations"):
        solve_contact(bumps(1), PITCH, Elastomer(2e5, 0.5, 0.002), indentation_m=0.0005, maximum_iterations=2)


def test_impossible_requests_are_refused(subtests: pytest.Subtests) -> None:
    for arguments, message in [
        ({}, "Give one of them"),
        ({"indentation_m": 0.001, "force_n": 1.0}, "Give one of them"),
        ({"force_n": -1.0}, "cannot be carried"),
        ({"force_n": np.nan}, "must be a number"),
        ({"indentation_m": np.inf}, "must be a number"),
        ({"indentation_m": 0.001, "initial_pressure_pa": np.zeros((2, 2))}, "Use the gap's"),
    ]:
        with subtests.test(arguments=arguments), pytest.raises(InputError, match=message):
            solve_contact(bumps(0), PITCH, Elastomer(2e5, 0.3), **arguments)


def test_gaps_that_are_no_heights_are_refused(subtests: pytest.Subtests) -> None:
    for gap in [np.zeros(5), np.zeros((0, 3)), np.full((3, 3), np.nan), np.full((3, 3), -np.inf)]:
        with subtests.test(gap=gap), pytest.raises(InputError, match="gap_m"):
            solve_contact(gap, PITCH, Elastomer(2e5, 0.3), indentation_m=0.001)


def test_a_force_on_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="cannot be carried"):
        solve_contact(np.full(SHAPE, np.inf), PITCH, Elastomer(2e5, 0.3), force_n=1.0)


@pytest.mark.parametrize(
    ("modulus", "ratio", "thickness"), [(0, 0.3, None), (1e5, 0.51, None), (1e5, 0.3, 0)]
)
def test_elastomers_that_cannot_be_are_refused(modulus: float, ratio: float, thickness: float | None) -> None:
    with pytest.raises(InputError):
        Elastomer(modulus, ratio, thickness)


@pytest.mark.parametrize("pitch", [0.0, (0.001, -0.001), np.nan])
def test_pitches_that_are_not_positive_are_refused(pitch: float) -> None:
    with pytest.raises(InputError, match="pitch_m"):
        solve_contact(bumps(0), pitch, Elastomer(2e5, 0.3), indentation_m=0.001)
