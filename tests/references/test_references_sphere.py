"""Lamb's sphere: published roots, and the sphere as a body of revolution."""

import numpy as np
import pytest

from tests.references.axisymmetric import body_of_revolution
from tests.references.meridian import Block, Meridian, half_disc
from tests.references.sphere import radial_ritz, sphere, torsional_traction

pytestmark = pytest.mark.release("tests.references")


def solid_sphere() -> Meridian:
    blocks = half_disc(np.array([0.0, -1.0]), np.array([0.0, 1.0]))
    return Meridian("sphere", tuple(Block(block, True) for block in blocks), lambda _: np.zeros((0, 2)))


def test_published_roots_come_with_their_multiplicities() -> None:
    spectrum = sphere(1.0, 0.25, 4.5)
    assert spectrum.families == (
        "torsional 2",
        "spheroidal 2",
        "spheroidal 1",
        "torsional 3",
        "spheroidal 3",
        "spheroidal 0",
    )
    assert spectrum.multiplicities.tolist() == [5, 5, 3, 7, 7, 1]
    published = [2.501133, 2.639869, 3.42453, 3.864700, 3.916337, 4.439998]
    np.testing.assert_allclose(spectrum.wavenumbers, published, rtol=2e-7)


def test_breathing_mode_is_that_of_the_closed_form() -> None:
    """Radial modes: x cot x = 1 - (x c_p / 2 c_s)^2, x = omega R / c_p."""
    for poisson_ratio in (0.0, 0.3, 0.45):
        spectrum = sphere(1.0, poisson_ratio, 11.0)
        ratio = np.sqrt((1 - 2 * poisson_ratio) / (2 * (1 - poisson_ratio)))
        radial = [
            w for w, name in zip(spectrum.wavenumbers, spectrum.families, strict=True) if name.endswith(" 0")
        ]
        assert radial
        for wavenumber in radial:
            x = wavenumber * ratio
            assert x / np.tan(x) == pytest.approx(1 - (wavenumber / 2) ** 2, abs=1e-9)


@pytest.mark.parametrize("poisson_ratio", [0.25, 0.45, 0.499])
def test_it_agrees_with_the_axisymmetric_solver(poisson_ratio: float) -> None:
    closed = sphere(1.0, poisson_ratio, 4.0)
    solved = body_of_revolution(solid_sphere(), poisson_ratio, 4.0, orders=(10, 10), finer=None)
    assert len(solved) == len(closed)
    np.testing.assert_allclose(solved.repeated, closed.repeated, rtol=1e-6)


def test_every_root_up_to_a_high_limit_is_found() -> None:
    """A scan of the closed form in small steps finds no further torsional root."""
    spectrum = sphere(1.0, 0.3, 14.0)
    steps = np.arange(0.05, 14.0, 0.01)
    for degree in range(1, 14):
        values = np.array([torsional_traction(y, degree) for y in steps])
        scale = np.abs(values) > 1e-200
        changes = int(np.count_nonzero(np.diff(np.sign(values[scale]))))
        assert changes == sum(name == f"torsional {degree}" for name in spectrum.families)


def test_radial_polynomials_are_upper_bounds_that_meet_the_roots() -> None:
    spectrum = sphere(1.0, 0.3, 10.0)
    roots = [
        w for w, name in zip(spectrum.wavenumbers, spectrum.families, strict=True) if name == "spheroidal 3"
    ]
    bounds = radial_ritz("spheroidal", 3, 0.3)[: len(roots)]
    np.testing.assert_allclose(bounds, roots, rtol=1e-8)


def test_wavenumbers_are_inverse_to_the_radius() -> None:
    np.testing.assert_allclose(
        sphere(1e-3, 0.3, 8e3).repeated * 1e-3, sphere(1.0, 0.3, 8.0).repeated, rtol=1e-12
    )


def test_what_it_cannot_answer_it_refuses() -> None:
    with pytest.raises(ValueError, match="outside"):
        sphere(1.0, 0.5, 5.0)
    with pytest.raises(ValueError, match="beyond"):
        sphere(1.0, 0.3, 40.0)
