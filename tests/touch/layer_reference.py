"""Independent solutions for a rigid paraboloid on an elastic layer bonded to a rigid base.

Nothing here is shared with the solver: the layer's response to waves of pressure comes from integrating the
equations of elasticity through its thickness, and the contact from the Fredholm equation of the dual
integral equations (Lebedev & Ufliand 1958, PMM 22; Sneddon 1966, Mixed Boundary Value Problems).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq


def layer_compliance(wave_number: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """Displacement of a layer of thickness 1 over that of the half-space, under waves k (n,) of pressure.

    State (U, W, T, S): displacements U sin kx and W cos kx, shear stress T sin kx and normal stress
    S cos kx, modulus of rigidity 1; bonded at the base, T = 0 and S = -1 at the surface.
    """
    k = np.asarray(wave_number, dtype=np.float64)
    n = poisson_ratio
    through = np.zeros((len(k), 4, 4))
    through[:, 0, 1] = k
    through[:, 0, 2] = 1
    through[:, 1, 0] = -k * n / (1 - n)
    through[:, 1, 3] = (1 - 2 * n) / (2 * (1 - n))
    through[:, 2, 0] = 2 * k * k / (1 - n)
    through[:, 2, 3] = k * n / (1 - n)
    through[:, 3, 2] = -k
    transfer = expm(through)
    base = np.linalg.solve(transfer[:, 2:, 2:], np.broadcast_to([[0.0], [-1.0]], (len(k), 2, 1)))
    displacement = -(transfer[:, 1:2, 2:] @ base)[:, 0, 0]
    return np.asarray(displacement * k / (1 - n))


@dataclass(frozen=True)
class Paraboloid:
    """Contact with the surface r^2 / (2 R): in units of the contact modulus E*."""

    indentation_m: float
    contact_radius_m: float
    force_over_modulus_m2: float
    peak_pressure_over_modulus: float


class LayerContact:
    """A layer, prepared for contacts with paraboloids."""

    def __init__(self, thickness_m: float, poisson_ratio: float) -> None:
        node, weight = np.polynomial.legendre.leggauss(240)
        self.thickness_m = thickness_m
        self.wave_number = 5.5 * (1 + node)
        self.amplitude = 5.5 * weight * (layer_compliance(self.wave_number, poisson_ratio) - 1)

    def at_radius(self, contact_radius_m: float, radius_m: float) -> Paraboloid:
        """Contact of a given radius.

        phi(t) + 2/pi int K(t, s) phi(s) ds = (indentation - t^2 / R) E*/pi, pressure = -int phi' / sqrt;
        the indentation is that at which phi, and with it the pressure, vanishes at the rim.
        """
        a, h = contact_radius_m, self.thickness_m
        node, weight = np.polynomial.legendre.leggauss(40)
        t, weight = a * (1 + node) / 2, a * weight / 2
        cosine = np.cos(np.outer(t, self.wave_number) / h)
        kernel = 2 / np.pi / h * (cosine * self.amplitude) @ cosine.T
        system = np.eye(len(t)) + kernel * weight
        constants, squares = (
            np.linalg.solve(system, np.stack([np.ones_like(t), t * t / radius_m], axis=1)).T / np.pi
        )
        rim = 2 / np.pi / h * (np.cos(a * self.wave_number / h) * self.amplitude) @ cosine.T * weight
        indentation = (a * a / radius_m / np.pi - rim @ squares) / (1 / np.pi - rim @ constants)
        phi = indentation * constants - squares
        even = np.polynomial.Polynomial.fit(t * t, phi, 10)
        peak = -2 * float(weight @ even.deriv()(t * t))
        return Paraboloid(float(indentation), a, float(2 * np.pi * weight @ phi), peak)

    def at_indentation(self, indentation_m: float, radius_m: float) -> Paraboloid:
        """Contact at a given indentation; its radius lies between Hertz's and the thin layer's."""
        hertz = np.sqrt(radius_m * indentation_m)
        radius = brentq(
            lambda a: self.at_radius(a, radius_m).indentation_m - indentation_m, 0.9 * hertz, 2.1 * hertz
        )
        return self.at_radius(float(radius), radius_m)
