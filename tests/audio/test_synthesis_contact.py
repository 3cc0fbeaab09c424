"""Hertz contact against the integrated collision, and the mass a body offers against its motion."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from objectfolder.audio.synthesis import ContactBody, HertzContact, mass_at_contact
from objectfolder.errors import QueryError

STEEL = {"youngs_modulus_pa": 2.0e11, "poisson_ratio": 0.29}
CERAMIC = {"youngs_modulus_pa": 7.2e10, "poisson_ratio": 0.19}


def contact() -> HertzContact:
    ball = ContactBody(**STEEL, radius_m=0.005, mass_kg=0.0041)
    cup = ContactBody(**CERAMIC, radius_m=0.04, mass_kg=0.3)
    return HertzContact.between(ball, cup)


@pytest.mark.parametrize("speed", [0.05, 1.0, 6.0])
def test_duration_approach_and_peak_are_those_of_the_integrated_collision(speed: float) -> None:
    """m x'' = -k x^(3/2) from x = 0 at a speed until it is 0 again."""
    hertz = contact()

    def motion(t, state):
        return [state[1], -hertz.stiffness / hertz.mass_kg * max(state[0], 0.0) ** 1.5]

    def part(t, state):
        return state[0] if t > 0 else 1.0

    def turned(t, state):
        return state[1]

    part.terminal, part.direction = True, -1
    solved = solve_ivp(
        motion,
        (0, 1e-2),
        [0.0, speed],
        "DOP853",
        events=(part, turned),
        rtol=1e-12,
        atol=1e-16,
        max_step=1e-6,
    )
    assert hertz.duration_s(speed) == pytest.approx(solved.t_events[0][0], rel=1e-6)
    deepest = solved.y_events[1][0][0]
    assert hertz.approach_m(speed) == pytest.approx(deepest, rel=1e-8)
    assert hertz.peak_force_n(speed) == pytest.approx(hertz.stiffness * deepest**1.5, rel=1e-8)


def test_published_values() -> None:
    """Two 10 mm steel balls at 1 m/s: Johnson's 2.87 (m^2 / (R E*^2 v))^(1/5)."""
    ball = ContactBody(**STEEL, radius_m=0.005, mass_kg=4.1e-3)
    hertz = HertzContact.between(ball, ball)
    assert hertz.mass_kg == pytest.approx(2.05e-3)
    assert hertz.radius_m == pytest.approx(2.5e-3)
    expected = 2.87 * (hertz.mass_kg**2 / (hertz.radius_m * hertz.modulus_pa**2 * 1.0)) ** 0.2
    assert hertz.duration_s(1.0) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(
    ("youngs_modulus_pa", "poisson_ratio", "density_kg_m3"),
    [(2.0e11, 0.29, 7850.0), (6.2e10, 0.20, 2600.0), (1.1e10, 0.25, 750.0)],
    ids=["steel", "glass", "wood"],
)
@pytest.mark.parametrize(("radius_m", "speed_m_s"), [(0.002, 0.1), (0.01, 1.0), (0.05, 3.0)])
def test_a_sphere_on_a_plate_touches_as_long_as_hertz_says(
    youngs_modulus_pa: float, poisson_ratio: float, density_kg_m3: float, radius_m: float, speed_m_s: float
) -> None:
    """6.71 (rho (1 - nu^2) / E)^(2/5) R v^(-1/5) for a sphere on a thick plate of its own material.

    From 2.87 (m^2 / (R E*^2 v))^(1/5) with m = 4/3 pi rho R^3 and E* = E / (2 (1 - nu^2)).
    """
    mass_kg = 4 / 3 * np.pi * density_kg_m3 * radius_m**3
    sphere = ContactBody(youngs_modulus_pa, poisson_ratio, radius_m, mass_kg)
    plate = ContactBody(youngs_modulus_pa, poisson_ratio, np.inf, np.inf)
    softness = density_kg_m3 * (1 - poisson_ratio**2) / youngs_modulus_pa
    factor = 2.87 * (8 / 3 * np.pi) ** 0.4
    expected = factor * softness**0.4 * radius_m * speed_m_s**-0.2
    assert HertzContact.between(sphere, plate).duration_s(speed_m_s) == pytest.approx(expected, rel=0.003)


def test_the_patch_of_a_pressed_sphere_is_the_root_of_approach_and_radius() -> None:
    """a^2 = R d (Johnson, 4.23), with k d^(3/2) the force."""
    hertz = contact()
    force_n = hertz.stiffness * 1e-6**1.5
    assert hertz.patch_radius_m(force_n) == pytest.approx(np.sqrt(hertz.radius_m * 1e-6), rel=1e-12)


def test_a_half_sine_of_the_same_impulse_and_duration_has_nearly_the_same_peak() -> None:
    hertz = contact()
    impulse = hertz.impulse_n_s(2.0)
    peak = np.pi * impulse / (2 * hertz.duration_s(2.0))  # of half a sine
    # 2 m v pi / (2 T) over k d^(3/2), whose ratio is a number: pi / 2.9432 * 2 / 2.5
    assert peak / hertz.peak_force_n(2.0) == pytest.approx(np.pi / 2.9432 / 1.25, rel=1e-4)


def test_speed_and_impulse_are_inverse_with_any_restitution() -> None:
    hertz = contact()
    for restitution in (0.0, 0.4, 1.0):
        speeds = np.array([0.1, 3.0])
        impulses = hertz.impulse_n_s(speeds, restitution)
        np.testing.assert_allclose(hertz.speed_m_s(impulses, restitution), speeds)
        np.testing.assert_allclose(impulses, (1 + restitution) * hertz.mass_kg * speeds)


def test_a_support_that_is_flat_and_does_not_move() -> None:
    table = ContactBody(**CERAMIC, radius_m=np.inf, mass_kg=np.inf)
    ball = ContactBody(**STEEL, radius_m=0.005, mass_kg=0.0041)
    hertz = HertzContact.between(ball, table)
    assert hertz.radius_m == pytest.approx(0.005)
    assert hertz.mass_kg == pytest.approx(0.0041)
    with pytest.raises(QueryError, match="flat"):
        HertzContact.between(table, table)


def test_the_mass_at_a_contact_is_impulse_over_the_velocity_it_gives_that_point() -> None:
    mass, inertia = 0.3, np.array([[2e-4, 1e-5, 0], [1e-5, 3e-4, -2e-5], [0, -2e-5, 1.5e-4]])
    centre, point = np.array([0.01, 0.0, 0.02]), np.array([0.05, -0.02, 0.03])
    normal = np.array([0.6, 0.0, -0.8])
    impulse = 0.02 * normal
    spin = np.linalg.solve(inertia, np.cross(point - centre, impulse))
    velocity = impulse / mass + np.cross(spin, point - centre)
    expected = 0.02 / (velocity @ normal)
    assert mass_at_contact(
        mass, inertia_kg_m2=inertia, centre_of_mass_m=centre, point_m=point, normal=3 * normal
    ) == pytest.approx(expected, rel=1e-12)
    assert mass_at_contact(
        mass, inertia_kg_m2=inertia, centre_of_mass_m=centre, point_m=centre + 0.1 * normal, normal=normal
    ) == pytest.approx(mass)
    assert expected < mass


def test_impossible_bodies_are_refused(subtests: pytest.Subtests) -> None:
    for change in [
        {"youngs_modulus_pa": 0.0},
        {"youngs_modulus_pa": np.nan},
        {"youngs_modulus_pa": np.inf},
        {"radius_m": -1.0},
        {"mass_kg": np.nan},
        {"poisson_ratio": 0.6},
        {"poisson_ratio": np.nan},
    ]:
        with subtests.test(change=change), pytest.raises(QueryError, match="contact"):
            ContactBody(**({**STEEL, "radius_m": 0.005, "mass_kg": 0.0041} | change))


def test_speeds_that_part_and_foreign_restitution_are_refused() -> None:
    for speed in (0.0, -1.0, np.nan):
        with pytest.raises(QueryError, match="contact"):
            contact().duration_s(speed)
    with pytest.raises(QueryError, match="restitution"):
        contact().impulse_n_s(1.0, 1.5)
