"""Displacement of an elastic surface by pressures that are constant on each cell of a grid.

Half-space: Love 1929, Phil. Trans. R. Soc. A 228 (Johnson 1985, equation 3.25). Layer: the same, plus the
smooth correction of an elastic layer that is bonded to a rigid base, integrated over the cell.

A pressure of wave number k on a half-space displaces its surface by 2 p / (E* k); on a bonded layer of
thickness h by M(k h) times as much (frictionless; O'Sullivan & King 1988, J. Tribology 110; Johnson
1985, Contact Mechanics, section 5.8), with a = k h and Poisson's ratio n:

M(a) = [(3 - 4n) sinh 2a - 2a] / [(3 - 4n) cosh 2a + 2a^2 + 5 - 12n + 8n^2]
"""

from functools import lru_cache

import numpy as np
import scipy.fft
from scipy.interpolate import CubicSpline
from scipy.special import j0

from objectfolder.errors import InputError
from objectfolder.touch.elastic.elastomer import Elastomer

# M - 1 decays as a^2 exp(-2a): below 1e-17 from here on.
HIGHEST_WAVE_NUMBER = 24.0
# Thicknesses from a load beyond which a layer moves less than 1e-7 of what it does near the load.
REACH = 20.0
_SERIES_BELOW = 0.3


def relative_compliance(wave_number: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """M(k h): displacement of a bonded layer over that of the half-space under the same wave of pressure.

    Exact to rounding from k h = 0, where M is 0, up to infinity, where it is 1, and up to nu = 0.5.

    Parameters
    ----------
    wave_number
        k h >= 0, dimensionless, any shape.
    """
    a = np.asarray(wave_number, dtype=np.float64)
    stiff = 3 - 4 * poisson_ratio
    decay = np.exp(-2 * a)
    # Twice numerator and denominator times exp(-2a); 2 sinh 2a - 4a alone by its series where it cancels.
    squared = np.where(a < _SERIES_BELOW, 4 * a * a, 0.0)
    series = np.ones_like(squared)
    for order in (11, 9, 7, 5):
        series = 1 + series * squared / (order * (order - 1))
    cubic = np.where(a < _SERIES_BELOW, 8 / 3 * a**3 * series * decay, -np.expm1(-4 * a) - 4 * a * decay)
    linear = (1 - 2 * poisson_ratio) * 2 * -np.expm1(-4 * a)
    constant = 5 - 12 * poisson_ratio + 8 * poisson_ratio**2
    below = stiff * (1 + decay * decay) + 2 * (2 * a * a + constant) * decay
    return np.asarray((cubic + linear) / below)


@lru_cache(maxsize=16)
def bonding_correction(poisson_ratio: float) -> CubicSpline:
    """What bonding adds to the displacement by a point load, as a function of distance / thickness.

    D(s) = integral over a from 0 of (M(a) - 1) J0(a s): a unit force displaces the surface of the layer at
    a distance s h by (1/s + D(s)) / (pi E* h). D is smooth, and tends to -1/s: use it up to `REACH`.
    """
    node, weight = np.polynomial.legendre.leggauss(32)
    panels = np.linspace(0.0, HIGHEST_WAVE_NUMBER, 61)
    half = (panels[1] - panels[0]) / 2
    a = (panels[:-1, None] + half * (1 + node)).ravel()
    amplitude = (relative_compliance(a, poisson_ratio) - 1) * np.tile(weight * half, len(panels) - 1)
    distance = np.linspace(0.0, REACH, 501)
    value = np.array([amplitude @ j0(a * s) for s in distance])
    return CubicSpline(distance, value)


# In thicknesses. An incompressible layer hardly yields to long waves: coarser cells, which always let some
# short waves through, would make it softer than it is, by 4 % where they are 1.25 thicknesses long.
_COARSEST_CELL = 1.0


@lru_cache(maxsize=16)
def influence_coefficients(
    elastomer: Elastomer, shape: tuple[int, int], pitch_m: tuple[float, float]
) -> np.ndarray:
    """Displacement at the centre of a cell by a unit pressure on another, by their distance in cells.

    Parameters
    ----------
    elastomer
        What is loaded.
    shape
        Rows and columns of the grid.
    pitch_m
        Distance of rows and of columns.

    Returns
    -------
    np.ndarray
        `shape` float64, m/Pa, read-only; [i, j] for cells i rows and j columns apart, either way.

    Raises
    ------
    InputError
        Cells longer than the layer is thick.
    """
    rows = np.arange(shape[0])[:, None] * pitch_m[0]
    columns = np.arange(shape[1])[None, :] * pitch_m[1]
    scale = 1 / (np.pi * elastomer.contact_modulus_pa)
    coefficients = scale * _love(rows, columns, pitch_m)
    if elastomer.thickness_m is not None:
        if max(pitch_m) > _COARSEST_CELL * elastomer.thickness_m:
            raise InputError(
                "pitch_m",
                f"cells of {max(pitch_m)} m on a layer of {elastomer.thickness_m} m",
                "Use a finer grid.",
            )
        coefficients += scale * _bonding(rows, columns, pitch_m, elastomer)
        far = np.hypot(rows - pitch_m[0] / 2, columns - pitch_m[1] / 2) > REACH * elastomer.thickness_m
        coefficients[far] = 0.0
    coefficients.flags.writeable = False
    return np.asarray(coefficients)


def _love(y: np.ndarray, x: np.ndarray, pitch: tuple[float, float]) -> np.ndarray:
    """Integral of 1 / distance over a cell, metres."""
    total = np.zeros(np.broadcast(y, x).shape)
    for side_y in (-0.5, 0.5):
        for side_x in (-0.5, 0.5):
            b, a = y + side_y * pitch[0], x + side_x * pitch[1]
            corner = a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))
            total += np.sign(side_x * side_y) * corner
    return total


def _bonding(y: np.ndarray, x: np.ndarray, pitch: tuple[float, float], elastomer: Elastomer) -> np.ndarray:
    """Integral over a cell of the layer's correction D(distance / h) / h, metres, by Gauss quadrature."""
    thickness = elastomer.thickness_m or 0.0
    correction = bonding_correction(elastomer.poisson_ratio)
    order = 3 + int(np.ceil(2 * max(pitch) / thickness))
    node, weight = np.polynomial.legendre.leggauss(order)
    total = np.zeros(np.broadcast(y, x).shape)
    for node_y, weight_y in zip(node, weight, strict=True):
        for node_x, weight_x in zip(node, weight, strict=True):
            s = np.hypot(y + node_y * pitch[0] / 2, x + node_x * pitch[1] / 2) / thickness
            total += weight_y * weight_x * np.where(s < REACH, correction(s), -1 / np.maximum(s, REACH))
    return total * (pitch[0] * pitch[1] / 4 / thickness)


class Compliance:
    """The displacement of a grid by the pressures on it, not periodic: convolution with zero padding.

    Parameters
    ----------
    coefficients
        (rows, columns) of `influence_coefficients`.
    """

    def __init__(self, coefficients: np.ndarray) -> None:
        self.shape = coefficients.shape
        self._padded = tuple(scipy.fft.next_fast_len(2 * count - 1, real=True) for count in self.shape)
        # The kernel is even along both axes, so that its spectrum is real.
        self._spectrum = scipy.fft.rfft2(_wrapped(coefficients, self._padded)).real.copy()

    def displacement(self, pressure_pa: np.ndarray) -> np.ndarray:
        """Metres (rows, columns), into the body, by pressures (rows, columns)."""
        rows, columns = self.shape
        # The padding's rows are zero before, and not wanted after: they are not transformed along.
        spectrum = scipy.fft.rfft(pressure_pa, self._padded[1], axis=1)
        spectrum = scipy.fft.fft(spectrum, self._padded[0], axis=0, overwrite_x=True)
        spectrum *= self._spectrum
        spectrum = scipy.fft.ifft(spectrum, axis=0, overwrite_x=True)[:rows]
        return np.asarray(scipy.fft.irfft(spectrum, self._padded[1], axis=1)[:, :columns])


def _wrapped(quadrant: np.ndarray, padded: tuple[int, ...]) -> np.ndarray:
    """Kernel of a circular convolution from its quadrant of distances >= 0."""
    rows, columns = quadrant.shape
    kernel = np.zeros(padded)
    kernel[:rows, :columns] = quadrant
    kernel[padded[0] - rows + 1 :, :columns] = quadrant[:0:-1]
    kernel[:, padded[1] - columns + 1 :] = kernel[:, columns - 1 : 0 : -1]
    return kernel


@lru_cache(maxsize=64)
def compliance(
    elastomer: Elastomer, grid: tuple[int, int], pitch_m: tuple[float, float], shape: tuple[int, int]
) -> Compliance:
    """A `Compliance` of a part, `shape`, of a grid, kept from one solve to the next."""
    return Compliance(influence_coefficients(elastomer, grid, pitch_m)[: shape[0], : shape[1]])
