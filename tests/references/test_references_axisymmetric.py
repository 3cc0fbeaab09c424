"""The axisymmetric solver against a Cartesian Ritz solution of a cylinder, and its own convergence."""

from itertools import product

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import eigh

from tests.references import axisymmetric
from tests.references.axisymmetric import Discretisation, body_of_revolution
from tests.references.bodies import BODIES, constant
from tests.references.meridian import Meridian, Path, Wall

pytestmark = pytest.mark.release("tests.references")

RADIUS, HEIGHT = 1.0, 1.3


def cylinder(radius: float = RADIUS, height: float = HEIGHT, element: float = 1.0) -> Meridian:
    half = constant(height / 2)
    wall = Wall(Path((0.0, 0.0), ((radius, 0.0),)), half, half, (), element)
    return wall.meridian("cylinder", round_rim=False)


def cartesian_ritz(poisson_ratio: float, across: int, along: int) -> np.ndarray:
    """Elastic wavenumbers of the cylinder by polynomials of x, y and z, displacements along x, y and z.

    W. M. Visscher et al., J. Acoust. Soc. Am. 90, 1991, with Legendre polynomials for their conditioning.
    """
    lame = 2 * poisson_ratio / (1 - 2 * poisson_ratio)
    nodes, weights = legendre.leggauss(across + 4)
    angle = np.arange(2 * across + 6) * 2 * np.pi / (2 * across + 6)
    r, w = (nodes + 1) / 2, weights * (nodes + 1) / 4 * 2 * np.pi / len(angle)
    x, y = np.outer(r, np.cos(angle)).ravel() * RADIUS, np.outer(r, np.sin(angle)).ravel() * RADIUS
    disc = np.repeat(w, len(angle)) * RADIUS**2
    z, line = legendre.leggauss(along + 2)
    z, line = z * HEIGHT / 2, line * HEIGHT / 2

    def tables(points: np.ndarray, scale: float, degree: int) -> list[np.ndarray]:
        slopes = [legendre.legval(points / scale, legendre.legder(row)) / scale for row in np.eye(degree + 1)]
        return [legendre.legvander(points / scale, degree).T, np.array(slopes)]

    in_x, in_y, in_z = tables(x, RADIUS, across), tables(y, RADIUS, across), tables(z, HEIGHT / 2, along)
    squares = []
    for parity in product((0, 1), repeat=3):
        plane, axial = [], []
        for a in range(3):
            p, q, s = ((parity[d] + (a == d)) % 2 for d in range(3))
            pairs = [(i, j) for i in range(p, across + 1, 2) for j in range(q, across + 1 - i, 2)]
            i, j = np.array(pairs).T
            k = np.arange(s, along + 1, 2)
            # Derivative along x, y or none.
            plane.append([in_x[1][i] * in_y[0][j], in_x[0][i] * in_y[1][j], in_x[0][i] * in_y[0][j]])
            axial.append([in_z[0][k], in_z[1][k]])

        def integral(
            a: int, da: int, b: int, db: int, plane: list = plane, axial: list = axial
        ) -> np.ndarray:
            flat = (plane[a][min(da, 2)] * disc) @ plane[b][min(db, 2)].T
            return np.kron(flat, (axial[a][da == 2] * line) @ axial[b][db == 2].T)

        blocks = [[lame * integral(a, a, b, b) + integral(a, b, b, a) for b in range(3)] for a in range(3)]
        sizes = [len(blocks[a][a]) for a in range(3)]
        mass = np.zeros((sum(sizes), sum(sizes)))
        for a in range(3):
            blocks[a][a] = blocks[a][a] + sum(integral(a, d, a, d) for d in range(3))
            span = slice(sum(sizes[:a]), sum(sizes[: a + 1]))
            mass[span, span] = integral(a, 3, a, 3)
        values = eigh(np.block(blocks), mass, eigvals_only=True)
        squares.append(values[1 if sum(parity) in (1, 2) else 0 :])
    return np.sqrt(np.sort(np.concatenate(squares)))


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.499])
def test_cylinder_has_the_modes_of_a_cartesian_ritz_solution(poisson_ratio: float) -> None:
    solved = body_of_revolution(cylinder(), poisson_ratio, 4.2, orders=(9, 9), finer=(12, 12))
    ritz = cartesian_ritz(poisson_ratio, 14, 13)
    assert solved.convergence < 1e-5
    assert len(solved) == int(np.count_nonzero(ritz < 4.2))
    np.testing.assert_allclose(solved.repeated, ritz[: len(solved)], rtol=1e-5)


def test_torsion_of_a_cylinder_is_exact() -> None:
    """Rods twist at omega / c_s = m pi / height, whatever their section's radius."""
    solved = body_of_revolution(cylinder(0.2, 2.0, 0.3), 0.3, 8.5, orders=(4, 18), finer=None)
    torsion = [
        w for w, name in zip(solved.wavenumbers, solved.families, strict=True) if name == "n = 0 torsion"
    ]
    np.testing.assert_allclose(torsion, np.arange(1, 6) * np.pi / 2, rtol=1e-9)


def test_mass_is_that_of_the_volume() -> None:
    body = Discretisation.of(cylinder(), (6, 6))
    assert body.volume() == pytest.approx(np.pi * RADIUS**2 * HEIGHT, rel=1e-12)
    _, mass = body.matrices(0.3)
    lift = np.zeros(3 * len(body.positions))
    lift[2::3] = 1
    assert 2 * np.pi * lift @ (mass @ lift) == pytest.approx(np.pi * RADIUS**2 * HEIGHT, rel=1e-12)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_rigid_motions_are_those_of_orders_zero_and_one(n: int) -> None:
    body = Discretisation.of(BODIES["bowl"]().meridian, (5, 3))
    (constant_part, linear, square), mass = body.matrices(0.3)
    columns = body.admissible(n)
    stiffness = (columns.T @ (constant_part + n * linear + n**2 * square) @ columns).toarray()
    values = eigh(stiffness, (columns.T @ mass @ columns).toarray(), eigvals_only=True)
    rigid = {0: 2, 1: 2, 2: 0}[n]
    assert np.count_nonzero(values < 1e-6 * values[rigid]) == rigid


def test_a_motion_about_another_axis_costs_no_energy() -> None:
    """Rotation about y in cylindrical components, order 1: U = z, V = -z, W = -r."""
    body = Discretisation.of(BODIES["cup"]().meridian, (6, 4))
    (constant_part, linear, square), _ = body.matrices(0.3)
    r, z = body.positions.T
    motion = np.stack([z, -z, -r], axis=1).ravel()
    stiffness = constant_part + linear + square
    assert motion @ (stiffness @ motion) < 1e-12 * (abs(motion) @ (abs(stiffness) @ abs(motion)))


def test_elements_need_not_follow_the_wall_evenly() -> None:
    """Two meshes of one body have the same modes."""
    half = constant(0.05)
    path = Path((0.0, 0.0), ((0.4, 0.0), (0.5, 1.2), (0.3, -0.3)))
    spectra = []
    for element, cuts in ((0.2, (1.05, 1.15)), (0.15, (0.03, 1.02, 1.14))):
        meridian = Wall(path, half, half, cuts, element).meridian("dish")
        spectra.append(body_of_revolution(meridian, 0.3, 1.5, finer=None))
    np.testing.assert_allclose(spectra[0].repeated, spectra[1].repeated, rtol=1e-6)


def test_a_wrong_count_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    solver = axisymmetric.eigsh

    def one_missing(*arguments, **options):
        values = np.sort(solver(*arguments, **options))
        values[3] = values[4:].max() * 1.01
        return values

    monkeypatch.setattr(axisymmetric, "eigsh", one_missing)
    with pytest.raises(axisymmetric.SimulationError, match="counted"):
        body_of_revolution(cylinder(), 0.3, 4.2, orders=(14, 14), finer=None)
