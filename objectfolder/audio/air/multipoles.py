"""Sound outside a sphere as a sum of outgoing multipoles, and the sum that a vibrating surface makes.

With time exp(-i omega t) the field is p(x) = sum_lm c_lm h_l(k r) Y_lm, h_l the spherical Hankel function of
the first kind and Y_lm the orthonormal spherical harmonics. Green's third identity and the addition theorem
give the coefficients of any surface within the sphere,

    c_lm = i k int (p d/dn - q) j_l(k r) conj(Y_lm) dS,

without a fit (Colton and Kress, "Inverse Acoustic and Electromagnetic Scattering Theory", section 2.4).
Coefficients are in the order of l^2 + l + m.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import sph_harm_y_all, spherical_jn, spherical_yn

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
HIGHEST_MULTIPOLE = 48
DENSITY_KG_M3, SOUND_SPEED_M_S = 1.204, 343.2  # of air at 20 degrees Celsius and 1013 hPa


@dataclass(frozen=True)
class Radiation:
    """Outgoing multipoles of modes.

    Attributes
    ----------
    centre_m, radius_m : (3,) and the radius of the sphere round the surface outside which they hold
    wavenumbers : (modes,) of the air, radians a metre, at which each was solved; 0: it does not ring
    multipoles : (modes, multipoles) complex128, Pa for a unit of modal velocity (m/s kg^1/2); beyond a
        mode's own order 0
    residuals : (modes,) estimated relative error of the far field, rms over all directions: 1.5 times what
        elements 1.4 times as long answer differently
    """

    centre_m: Floats
    radius_m: float
    wavenumbers: Floats
    multipoles: Complexes
    residuals: Floats


def count_of(order: int) -> int:
    """How many multipoles there are up to an order."""
    return (order + 1) ** 2


def order_for(wavenumber_radius: float) -> int:
    """Highest order that a surface within a radius radiates to 1e-3 of the whole."""
    return min(HIGHEST_MULTIPOLE, int(np.ceil(wavenumber_radius + 2.5 * np.cbrt(wavenumber_radius) + 3)))


def orders_of(count: int) -> NDArray[np.int64]:
    """Order l (count,) of each multipole."""
    return np.sqrt(np.arange(count)).astype(np.int64)


def hankel(order: int, argument: Floats) -> Complexes:
    """Spherical Hankel functions of the first kind (order + 1, ...) of positive arguments (...)."""
    degree = np.arange(order + 1).reshape(-1, *(1,) * np.ndim(argument))
    return np.asarray(spherical_jn(degree, argument) + 1j * spherical_yn(degree, argument))


def harmonics(order: int, offsets: Floats) -> Complexes:
    """Spherical harmonics (multipoles, n) of the directions of offsets (n, 3)."""
    polar = np.arctan2(np.hypot(offsets[:, 0], offsets[:, 1]), offsets[:, 2])
    every = sph_harm_y_all(order, order, polar, np.arctan2(offsets[:, 1], offsets[:, 0]))
    # Columns of negative orders m are at the end.
    return np.concatenate([every[degree, np.arange(-degree, degree + 1)] for degree in range(order + 1)])


def outgoing(order: int, wavenumber: float, offsets: Floats) -> Complexes:
    """Outgoing waves h_l(k r) Y_lm (multipoles, n) at offsets (n, 3) metres from the centre."""
    radial = hankel(order, wavenumber * np.linalg.norm(offsets, axis=1))
    return np.asarray(radial[orders_of(count_of(order))] * harmonics(order, offsets))


def regular_waves(order: int, arguments: Floats, angular: NDArray[Any]) -> NDArray[Any]:
    """Regular waves j_l Y_lm (multipoles, n) of arguments k r (n,) from harmonics of at least that order."""
    # Miller's recurrence downwards, which converges from any start above order and argument.
    start = int(max(order, arguments.max(initial=0.0))) + 20
    x = np.maximum(arguments, 1e-3)  # nearer the centre all but j_0 are nil
    radial = np.zeros((start + 2, len(x)))
    radial[start] = 1e-100
    for degree in range(start, 0, -1):
        radial[degree - 1] = (2 * degree + 1) / x * radial[degree] - radial[degree + 1]
        radial[degree - 1 :] /= np.maximum(np.abs(radial[degree - 1]) / 1e100, 1.0)
    norm = np.sqrt(((2 * np.arange(start + 2)[:, None] + 1) * radial**2).sum(axis=0))
    sign = np.sign(radial[0] * np.sin(x) + radial[1] * (np.sin(x) / x - np.cos(x)))
    count = count_of(order)
    return np.asarray((radial * sign / norm)[orders_of(count)].astype(angular.real.dtype) * angular[:count])


def of_surface(
    regular: NDArray[Any], wavenumber: float, vectors: Floats, pressure: NDArray[Any], flux: NDArray[Any]
) -> Complexes:
    """Multipoles (multipoles, m) of what surface elements radiate.

    Parameters
    ----------
    regular
        (wider, n) regular waves at the elements, to one order more than is asked.
    vectors
        (n, 3) their vector areas, square metres.
    pressure, flux
        (n, m) pressure, and its normal derivative times the area.
    """
    order = int(orders_of(len(regular))[-1]) - 1
    parts = [*(vectors[:, axis, None] * pressure for axis in range(3)), flux]
    columns = np.concatenate(parts, axis=1).astype(regular.dtype)
    # Of the conjugate waves; a product with them as they are saves their copy.
    *along, sources = np.split((regular @ columns.conj()).conj().astype(np.complex128), 4, axis=1)
    return 1j * wavenumber * (_slope(order, wavenumber, along) - sources[: count_of(order)])


def _slope(order: int, wavenumber: float, moments: list[Complexes]) -> Complexes:
    """Moments of the gradient of the conjugate regular waves from moments of the waves up to one order more.

    d/dz and d/dx +- i d/dy take a regular wave to its neighbours of order l - 1 and l + 1 (Gumerov and
    Duraiswami, "Fast Multipole Methods for the Helmholtz Equation", section 2.2).
    """
    x, y, z = moments
    degree = orders_of(count_of(order))
    m = np.arange(len(degree)) - degree * (degree + 1)

    def at(values: Complexes, degree: NDArray[np.int64], m: NDArray[np.int64]) -> Complexes:
        inside = np.abs(m) <= degree
        return np.where(inside[:, None], values[np.where(inside, degree * (degree + 1) + m, 0)], 0)

    def root(numerator: NDArray[np.int64], low: NDArray[np.int64]) -> Floats:
        return np.sqrt(np.maximum(numerator, 0) / np.maximum(low * (low + 2), 1))[:, None]

    below, above = degree - 1, degree + 1
    odd_below, odd_above = 2 * degree - 1, 2 * degree + 1
    total = root(degree**2 - m**2, odd_below) * at(z, below, m)
    total -= root(above**2 - m**2, odd_above) * at(z, above, m)
    for sign, turned in ((1, x + 1j * y), (-1, x - 1j * y)):
        n = sign * m
        # Of d/dx +- i d/dy half each; conjugate waves are turned the other way.
        total += sign / 2 * root((degree - n) * (degree - n - 1), odd_below) * at(turned, below, m + sign)
        total += sign / 2 * root((degree + n + 1) * (degree + n + 2), odd_above) * at(turned, above, m + sign)
    return wavenumber * total
