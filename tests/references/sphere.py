"""Free vibrations of a homogeneous sphere (H. Lamb, Proc. London Math. Soc. 13, 1882).

Torsional modes of degree l >= 1:  (l - 1) j_l(y) = y j_{l+1}(y),  y = omega R / c_s. Spheroidal modes: no
traction of u = grad phi + curl curl (r psi) with phi = j_l(h r) Y, psi = j_l(k r) Y; see
`spheroidal_traction`. Every degree has 2 l + 1 modes at each root. Roots are isolated by a radial
Rayleigh-Ritz solution, which cannot leave one out, and then found in the closed form.
"""

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import spherical_jn

from objectfolder.errors import SimulationError
from tests.references.spectrum import ReferenceSpectrum

Floats = NDArray[np.float64]
RITZ_TERMS = 24


def sphere(radius: float, poisson_ratio: float, limit: float) -> ReferenceSpectrum:
    """Every elastic mode of a free sphere with omega / c_s below `limit`.

    Parameters
    ----------
    radius
        In the unit of length.
    poisson_ratio
        In (-1, 0.5).
    limit
        Radians per unit of length; up to about 25 / radius.

    Raises
    ------
    ValueError
        For a Poisson ratio outside (-1, 0.5), or a limit beyond the reach of the radial polynomials.
    SimulationError
        When a root of the closed form is not where the radial solution puts it.
    """
    if not -1 < poisson_ratio < 0.5:
        raise ValueError(f"Poisson ratio {poisson_ratio} is outside (-1, 0.5)")
    if limit * radius > RITZ_TERMS + 1:
        raise ValueError(f"a limit of {limit * radius:.1f} radii is beyond {RITZ_TERMS + 1}")
    modes: list[tuple[float, int, str]] = []
    degree = 0
    while True:
        modes_of_degree: list[tuple[float, int, str]] = []
        for family in ("spheroidal", "torsional") if degree else ("spheroidal",):
            roots = _roots(family, degree, poisson_ratio, limit * radius)
            modes_of_degree += [(root / radius, 2 * degree + 1, f"{family} {degree}") for root in roots]
        if degree >= 2 and not modes_of_degree:
            return ReferenceSpectrum.collect(modes, limit)
        modes += modes_of_degree
        degree += 1


def torsional_traction(y: float, degree: int) -> float:
    """Shear traction at the surface of the torsional solution of wavenumber y = omega R / c_s."""
    bessel, after = spherical_jn([degree, degree + 1], y)
    return float((degree - 1) * bessel - y * after)


def spheroidal_traction(y: float, degree: int, poisson_ratio: float) -> float:
    """Determinant of the tractions of the two spheroidal solutions, columns scaled by positive numbers.

    With x = y c_s / c_p, L = l (l + 1), radial and tangential traction over mu are
    (2 L - y^2) j(x) - 4 x j'(x) and 2 (x j'(x) - j(x)) of the first, and
    2 L (y j'(y) - j(y)) and (2 L - 2 - y^2) j(y) - 2 y j'(y) of the second.
    """
    x = y * np.sqrt((1 - 2 * poisson_ratio) / (2 * (1 - poisson_ratio)))
    product = degree * (degree + 1)
    at_x, slope_x = spherical_jn(degree, x), x * spherical_jn(degree, x, derivative=True)
    at_y, slope_y = spherical_jn(degree, y), y * spherical_jn(degree, y, derivative=True)
    first = np.array([(2 * product - y**2) * at_x - 4 * slope_x, 2 * (slope_x - at_x)])
    if degree == 0:
        return float(first[0])
    second = np.array([2 * product * (slope_y - at_y), (2 * product - 2 - y**2) * at_y - 2 * slope_y])
    first, second = first / np.abs(first).max(), second / np.abs(second).max()
    return float(first[0] * second[1] - first[1] * second[0])


def radial_ritz(family: str, degree: int, poisson_ratio: float) -> Floats:
    """Wavenumbers omega R / c_s of one degree by polynomials in the radius, ascending, rigid ones left out.

    The energy is that of F. A. Dahlen and J. Tromp, Theoretical Global Seismology, 8.6: for a displacement
    U Y r + V grad_s Y, with F = (2 U - L V) / r,
    kappa (U' + F)^2 + mu / 3 (2 U' - F)^2 + mu L (V' - V / r + U / r)^2 + mu L (L - 2) V^2 / r^2;
    for a toroidal one only the last two terms, with U = 0.
    """
    nodes, weights = np.polynomial.legendre.leggauss(2 * RITZ_TERMS + degree + 8)
    r, weight = (nodes + 1) / 2, weights / 2 * ((nodes + 1) / 2) ** 2
    product = degree * (degree + 1)
    # Regular at the centre: r^(l-1) (r for l = 0, r^l for torsion) times a polynomial in r^2.
    power = max(degree - 1, 0) if family == "spheroidal" and degree else max(degree, 1)
    leading = r**power
    variable = 2 * r**2 - 1
    value, slope = np.empty((RITZ_TERMS, len(r))), np.empty((RITZ_TERMS, len(r)))
    for term in range(RITZ_TERMS):
        series = np.eye(RITZ_TERMS)[term]
        polynomial = legendre.legval(variable, series)
        value[term] = leading * polynomial
        slope[term] = power * r ** (power - 1) * polynomial if power else 0.0
        slope[term] += leading * legendre.legval(variable, legendre.legder(series)) * 4 * r
    nothing = np.zeros_like(value)
    if family == "torsional":
        radial, radial_slope, tangential, tangential_slope = nothing, nothing, value, slope
    elif degree == 0:
        radial, radial_slope, tangential, tangential_slope = value, slope, nothing, nothing
    else:
        radial, radial_slope = np.concatenate([value, nothing]), np.concatenate([slope, nothing])
        tangential, tangential_slope = np.concatenate([nothing, value]), np.concatenate([nothing, slope])
    bulk = 2 * (1 + poisson_ratio) / (3 * (1 - 2 * poisson_ratio))  # kappa / mu
    spread = (2 * radial - product * tangential) / r
    terms: list[tuple[float, Floats]] = [
        (product, tangential_slope + (radial - tangential) / r),
        (product * (product - 2), tangential / r),
    ]
    if family == "spheroidal":
        terms += [(bulk, radial_slope + spread), (1 / 3, 2 * radial_slope - spread)]
    stiffness = sum(factor * (term * weight) @ term.T for factor, term in terms if factor)
    mass = (radial * weight) @ radial.T + product * (tangential * weight) @ tangential.T
    scale = 1 / np.sqrt(np.diag(mass))
    values, vectors = eigh(scale[:, None] * mass * scale)
    # Near r = 1 high powers are nearly dependent; what is below rounding is left out.
    independent = values > 1e-13 * values[-1]
    basis = scale[:, None] * vectors[:, independent] / np.sqrt(values[independent])
    squared = eigh(basis.T @ stiffness @ basis, eigvals_only=True)
    return np.sqrt(np.maximum(squared[1 if degree == 1 else 0 :], 0.0))


def _roots(family: str, degree: int, poisson_ratio: float, limit: float) -> list[float]:
    """Roots of the closed form below `limit`, one between each two midpoints of the radial solution."""
    guesses = radial_ritz(family, degree, poisson_ratio)

    def traction(y: float) -> float:
        if family == "torsional":
            return torsional_traction(y, degree)
        return spheroidal_traction(y, degree, poisson_ratio)

    edges = np.concatenate([[guesses[0] / 2], (guesses[1:] + guesses[:-1]) / 2])
    roots = []
    for index in range(int(np.count_nonzero(guesses < limit * (1 + 1e-6)))):
        if traction(edges[index]) * traction(edges[index + 1]) >= 0:
            raise SimulationError(
                f"sphere, {family} {degree}",
                f"no single root in ({edges[index]:.6g}, {edges[index + 1]:.6g})",
                "Lower the limit.",
            )
        root = float(brentq(traction, edges[index], edges[index + 1], xtol=1e-13, rtol=1e-13))
        if abs(root / guesses[index] - 1) > 1e-4:
            raise SimulationError(
                f"sphere, {family} {degree}",
                f"the root {root:.9g} is not where the radial solution is, {guesses[index]:.9g}",
                "Lower the limit.",
            )
        roots.append(root)
    return roots
