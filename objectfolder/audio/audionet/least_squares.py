"""Least squares for the coefficients of fields, with a covariance kernel as prior."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.blas import dsyrk, dtrmm

from objectfolder.audio.audionet.audionet import control_barycentric
from objectfolder.audio.audionet.surface_kernel import SurfaceKernel, solve_triangular, triangular_factor
from objectfolder.errors import SimulationError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Controls = tuple[Integers, NDArray[np.uint8]]  # faces (n,) and stored barycentric coordinates (n, 2)
# Normal matrix (n, n), right side (n, columns) and prior (n, n).
Equations = tuple[Floats, Floats, Floats]
MOST_POINTS_A_CONTROL = 6  # more add next to nothing
# Variance of what training values have beyond the kernel's fields, of a kernel of variance 1: it holds
# functions that hardly any point has seen.
NOISE = 1e-5


@dataclass(frozen=True)
class Data:
    """Training points on the stored surface: face (n,), barycentric (n, 3), values (n, columns)."""

    face: Integers
    barycentric: Floats
    values: Floats

    def part(self, chosen: Flags | Integers | slice) -> "Data":
        """Some of the points."""
        return Data(self.face[chosen], self.barycentric[chosen], self.values[chosen])

    def joined(self, other: "Data") -> "Data":
        """Both."""
        return Data(
            np.concatenate([self.face, other.face]),
            np.concatenate([self.barycentric, other.barycentric]),
            np.concatenate([self.values, other.values]),
        )


def equations(kernel: SurfaceKernel, controls: Controls, data: Data) -> Equations:
    """Normal matrix, right side and prior of least squares; of the normal matrix the upper triangle."""
    centres, factor = _functions(kernel, controls)
    count = len(centres)
    data = data.part(slice(None, None, max(1, len(data.values) // (MOST_POINTS_A_CONTROL * count))))
    inverse = solve_triangular(factor, np.eye(count))
    normal = np.zeros((count, count), order="F")
    right = np.zeros((count, data.values.shape[1]))
    for start in range(0, len(data.values), 2048):
        part = data.part(np.arange(start, min(start + 2048, len(data.values))))
        covariance = kernel.covariance(kernel.features(part.face, part.barycentric), centres)
        # (covariance @ inverse)^T, at half of the work: the inverse is upper triangular.
        columns = dtrmm(1.0, inverse.T, covariance.T, lower=1, overwrite_b=1)
        normal = dsyrk(1.0, columns, beta=1.0, c=normal, overwrite_c=1)
        right += columns @ part.values
    return normal, right, NOISE * inverse.T @ kernel.covariance(centres, centres) @ inverse


def solve(normal: Floats, right: Floats, prior: Floats) -> Floats:
    """Coefficients (controls, columns).

    Raises
    ------
    SimulationError
        Equations that are not positive definite.
    """
    try:
        return np.asarray(cho_solve(cho_factor(normal + prior), right))
    except np.linalg.LinAlgError as error:
        raise SimulationError("AudioNet", f"least squares: {error}", "Check the mode shapes.") from error


def predict(
    kernel: SurfaceKernel,
    controls: Controls,
    coefficients: Floats,
    data: Data,
) -> Floats:
    """Values (n, columns) of the fields at the points of `data`."""
    centres, factor = _functions(kernel, controls)
    weights = solve_triangular(factor, coefficients)
    result = np.empty((len(data.face), coefficients.shape[1]))
    for start in range(0, len(result), 4096):
        stop = start + 4096
        features = kernel.features(data.face[start:stop], data.barycentric[start:stop])
        result[start:stop] = kernel.covariance(features, centres) @ weights
    return result


def relative_error(kernel: SurfaceKernel, controls: Controls, coefficients: Floats, data: Data) -> float:
    """Rms error over the rms value."""
    residual = predict(kernel, controls, coefficients, data) - data.values
    return float(np.linalg.norm(residual) / np.linalg.norm(data.values))


def _functions(kernel: SurfaceKernel, controls: Controls) -> tuple[Floats, Floats]:
    """Features of the control points and the triangular factor of their covariance."""
    centres = kernel.features(controls[0], control_barycentric(controls[1]))
    return centres, triangular_factor(kernel.covariance(centres, centres), kernel.parameters.ridge)
