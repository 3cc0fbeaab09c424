"""Sideways displacement of an elastic surface by tractions and pressures constant on each cell of a grid.

Half-space: Cerruti's and Boussinesq's point loads (Johnson 1985, Contact Mechanics, equations 3.75 and 3.18),
integrated over the cell. Bonded layer: the same, plus a smooth correction. Waves of wave number k move a
layer of thickness h by the following, with a = k h, n Poisson's ratio, G the modulus of rigidity, and
B = (3 - 4n) cosh 2a + 2a^2 + 5 - 12n + 8n^2:

traction along the wave:   (1 - n) / (G k) T(a),  T = [(3 - 4n) sinh 2a + 2a] / B
traction across the wave:  1 / (G k) tanh a
pressure:                  1 / (2 G k) C(a) sideways,  C = [2a^2 - (1 - 2n)(3 - 4n)(cosh 2a - 1)] / B
"""

from functools import lru_cache

import numpy as np
import scipy.fft
from scipy.interpolate import CubicSpline
from scipy.special import j0, j1, jv

from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.influence import HIGHEST_WAVE_NUMBER, REACH

GAUSS_NODES = 4  # along a cell, which is no longer than the layer is thick


def relative_compliances(wave_number: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """T, tanh and C (3, ...) of a bonded layer, see above, at k h >= 0; 1, 1, 2n - 1 where it is thick."""
    a, n = np.asarray(wave_number, dtype=np.float64), poisson_ratio
    stiff, decay = 3 - 4 * n, np.exp(-2 * a)
    below = stiff * (1 + decay**2) + 2 * (2 * a * a + 5 - 12 * n + 8 * n * n) * decay
    along = (stiff * (1 - decay**2) + 4 * a * decay) / below
    pressed = (4 * a * a * decay - (1 - 2 * n) * stiff * (1 - decay) ** 2) / below
    return np.stack([along, np.tanh(a), pressed])


@lru_cache(maxsize=16)
def bonding_corrections(poisson_ratio: float) -> CubicSpline:
    """What bonding adds to the displacement by point loads, as three functions of s = distance / thickness.

    A unit traction moves what lies a distance s h away, in a direction e, by (f0 + f1 (2 e e - 1)) /
    (2 pi G h) more, and a unit pressure by f2 e / (4 pi G h); Hankel transforms of order 0, 2 and 1.
    """
    node, weight = np.polynomial.legendre.leggauss(32)
    panels = np.linspace(0.0, HIGHEST_WAVE_NUMBER, 61)
    half = (panels[1] - panels[0]) / 2
    a, weight = (panels[:-1, None] + half * (1 + node)).ravel(), np.tile(weight * half, len(panels) - 1)
    along, across, pressed = relative_compliances(a, poisson_ratio)
    along, across = (1 - poisson_ratio) * (along - 1), across - 1
    amplitudes = weight * np.stack(
        [(along + across) / 2, (across - along) / 2, pressed + 1 - 2 * poisson_ratio]
    )
    distance = np.linspace(0.0, REACH, 501)
    waves = np.outer(a, distance)
    orders = j0(waves), jv(2, waves), j1(waves)
    return CubicSpline(distance, np.stack([f @ j for f, j in zip(amplitudes, orders, strict=True)], axis=1))


class TangentialCompliance:
    """Sideways displacement of a grid by what acts on it, not periodic: convolution with zero padding.

    Directions are 0 along the rows' order and 1 along the columns'.

    Parameters
    ----------
    elastomer, shape, pitch_m
        As of `influence.influence_coefficients`.
    """

    def __init__(self, elastomer: Elastomer, shape: tuple[int, int], pitch_m: tuple[float, float]) -> None:
        self.shape = shape
        self._padded = tuple(scipy.fft.next_fast_len(2 * count - 1, real=True) for count in shape)
        row, column = ((np.arange(size) + size // 2) % size - size // 2 for size in self._padded)
        rows, columns = row[:, None] * pitch_m[0], column[None, :] * pitch_m[1]
        kernels = _half_space(rows, columns, pitch_m, elastomer.poisson_ratio)
        if elastomer.thickness_m is not None:
            kernels += _bonding(rows, columns, pitch_m, elastomer.poisson_ratio, elastomer.thickness_m)
        modulus_pa = elastomer.youngs_modulus_pa / (2 * (1 + elastomer.poisson_ratio))
        kernels /= 2 * np.pi * modulus_pa
        spectra = scipy.fft.rfft2(kernels)
        # Even, or odd along both axes: real.
        self._tractions = np.array([[spectra[0], spectra[1]], [spectra[1], spectra[2]]]).real
        self._pressure = spectra[3:]

    @property
    def greatest(self) -> float:
        """Displacement per traction, m/Pa, that no pattern of tractions exceeds in the root mean square."""
        (xx, xy), (_, yy) = self._tractions
        return float(((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)).max())

    def displacement(self, traction_pa: np.ndarray) -> np.ndarray:
        """Metres (2, rows, columns) by tractions (2, rows, columns)."""
        first, second = scipy.fft.rfft2(traction_pa, self._padded)
        return self._inside(self._tractions[0] * first + self._tractions[1] * second)

    def displacement_by_pressure(self, pressure_pa: np.ndarray) -> np.ndarray:
        """Metres (2, rows, columns) by pressures (rows, columns)."""
        return self._inside(self._pressure * scipy.fft.rfft2(pressure_pa, self._padded))

    def _inside(self, spectra: np.ndarray) -> np.ndarray:
        return np.asarray(scipy.fft.irfft2(spectra, self._padded)[:, : self.shape[0], : self.shape[1]])


@lru_cache(maxsize=64)
def tangential_compliance(
    elastomer: Elastomer, shape: tuple[int, int], pitch_m: tuple[float, float]
) -> TangentialCompliance:
    """A `TangentialCompliance`, kept from one solve to the next."""
    return TangentialCompliance(elastomer, shape, pitch_m)


def _half_space(
    rows: np.ndarray, columns: np.ndarray, pitch: tuple[float, float], poisson_ratio: float
) -> np.ndarray:
    """Kernels (5, ...), metres: row by row, row by column, column by column, row and column by pressure."""
    total = np.zeros((5, *np.broadcast(rows, columns).shape))
    for side_row in (-0.5, 0.5):
        for side_column in (-0.5, 0.5):
            x, y = np.broadcast_arrays(rows + side_row * pitch[0], columns + side_column * pitch[1])
            distance = np.hypot(x, y)
            over_x, over_y = x * np.arcsinh(y / np.abs(x)), y * np.arcsinh(x / np.abs(y))
            log = np.log(distance / max(pitch))
            corner = [
                (1 - poisson_ratio) * over_x + over_y,
                -poisson_ratio * distance,
                (1 - poisson_ratio) * over_y + over_x,
                (poisson_ratio - 0.5) * (y * log + x * np.arctan(y / x)),
                (poisson_ratio - 0.5) * (x * log + y * np.arctan(x / y)),
            ]
            total += np.sign(side_row * side_column) * np.stack(corner)
    return total


def _bonding(
    rows: np.ndarray, columns: np.ndarray, pitch: tuple[float, float], poisson_ratio: float, thickness: float
) -> np.ndarray:
    """What bonding adds to the kernels (5, ...), by Gauss quadrature over the cell; metres."""
    corrections = bonding_corrections(poisson_ratio)
    node, weight = np.polynomial.legendre.leggauss(GAUSS_NODES)
    total = np.zeros((5, *np.broadcast(rows, columns).shape))
    for node_row, weight_row in zip(node, weight, strict=True):
        for node_column, weight_column in zip(node, weight, strict=True):
            x, y = np.broadcast_arrays(rows + node_row * pitch[0] / 2, columns + node_column * pitch[1] / 2)
            distance = np.maximum(np.hypot(x, y), 1e-300)
            even, turned, pressed = np.moveaxis(corrections(np.minimum(distance / thickness, REACH)), -1, 0)
            x, y = x / distance, y / distance
            values = [
                even + turned * (x * x - y * y),
                turned * 2 * x * y,
                even - turned * (x * x - y * y),
                pressed * x / 2,
                pressed * y / 2,
            ]
            total += weight_row * weight_column * np.stack(values)
    return total * (pitch[0] * pitch[1] / 4 / thickness)
