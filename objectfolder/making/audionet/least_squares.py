"""Least squares for the coefficients of fields, with a covariance kernel as prior."""

from dataclasses import dataclass
from functools import cached_property

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
NOISE_VARIANCE = 1e-6
# Points that move less than this share of the rms count as if they moved by it: some hardly move at all.
STILL_SHARE = 0.1
# A point weighs as 1 over its motion to this power: 0 is for the mean over all, 1 for each point's own.
EVENNESS = 0.5


@dataclass(frozen=True)
class Data:
    """Training points on the stored surface.

    Attributes
    ----------
    face, barycentric : (n,) and (n, 3), where they are
    values : (n, columns)
    weights : (n,) of their misfits in least squares
    """

    face: Integers
    barycentric: Floats
    values: Floats
    weights: Floats

    @classmethod
    def weighted(cls, face: Integers, barycentric: Floats, values: Floats) -> "Data":
        """Points that move less than the rms weigh more, all together 1 in the mean square."""
        size = sizes(values)
        size /= size.max()
        weights = np.minimum(size, np.sqrt(np.mean(size**2))) ** -EVENNESS
        return cls(face, barycentric, values, weights / np.sqrt(np.mean(weights**2)))

    def part(self, chosen: Flags | Integers | slice) -> "Data":
        """Some of the points."""
        return Data(self.face[chosen], self.barycentric[chosen], self.values[chosen], self.weights[chosen])

    def joined(self, data: "Data") -> "Data":
        """Both."""
        return Data(
            np.concatenate([self.face, data.face]),
            np.concatenate([self.barycentric, data.barycentric]),
            np.concatenate([self.values, data.values]),
            np.concatenate([self.weights, data.weights]),
        )


def sizes(values: Floats) -> Floats:
    """Norms of the values (n, columns) at each point (n,), those of quiet points as if not so quiet."""
    size = np.linalg.norm(values, axis=1)
    return np.maximum(size, max(STILL_SHARE * float(np.sqrt(np.mean(size**2))), 1e-300))


@dataclass(frozen=True)
class Basis:
    """Smooth functions on a surface, as many as there are control points."""

    kernel: SurfaceKernel
    controls: Controls

    @cached_property
    def centres(self) -> Floats:
        """Features of the control points."""
        return self.kernel.features(self.controls[0], control_barycentric(self.controls[1]))

    @cached_property
    def factor(self) -> Floats:
        """Triangular factor of their covariance."""
        covariance = self.kernel.covariance(self.centres, self.centres)
        return triangular_factor(covariance, self.kernel.parameters.ridge)


def equations(basis: Basis, data: Data) -> Equations:
    """Normal matrix, right side and prior of least squares; of the normal matrix the upper triangle."""
    kernel, centres = basis.kernel, basis.centres
    count = len(centres)
    data = data.part(slice(None, None, max(1, len(data.values) // (MOST_POINTS_A_CONTROL * count))))
    inverse = solve_triangular(basis.factor, np.eye(count))
    normal = np.zeros((count, count), order="F")
    right = np.zeros((count, data.values.shape[1]))
    for start in range(0, len(data.values), 2048):
        part = data.part(np.arange(start, min(start + 2048, len(data.values))))
        covariance = kernel.covariance(kernel.features(part.face, part.barycentric), centres)
        covariance *= part.weights[:, None]
        # (covariance @ inverse)^T, at half of the work: the inverse is upper triangular.
        columns = dtrmm(1.0, inverse.T, covariance.T, lower=1, overwrite_b=1)
        normal = dsyrk(1.0, columns, beta=1.0, c=normal, overwrite_c=1)
        right += columns @ (part.values * part.weights[:, None])
    return normal, right, NOISE_VARIANCE * inverse.T @ kernel.covariance(centres, centres) @ inverse


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


def predict(basis: Basis, coefficients: Floats, data: Data) -> Floats:
    """Values (n, columns) of the fields at the points of `data`."""
    weights = solve_triangular(basis.factor, coefficients)
    result = np.empty((len(data.face), coefficients.shape[1]))
    for start in range(0, len(result), 4096):
        stop = start + 4096
        features = basis.kernel.features(data.face[start:stop], data.barycentric[start:stop])
        result[start:stop] = basis.kernel.covariance(features, basis.centres) @ weights
    return result
