"""A covariance on a surface for fields of displacement.

    k(x, y) = matern_7/2(sqrt(|x - y|^2 + w^2 |e(x) - e(y)|^2) / l) (1 + g n(x) . n(y))

of position x, detour coordinates e (`geodesic_embedding`) and normal n. Detours part what is
near in space and far apart in the body. The last factor lets the two sides of a wall move by a common part
plus a part that turns with the normal, as the cross-section of a bent wall does; positions alone would need
points closer together than the wall is thick.

The normal is the mean of all faces around a vertex, by angle, and linear across each face. It is continuous
across creases, as the detours are: a point on an edge or a vertex has one answer, whichever of its
faces it is taken to lie on.

Fields are coefficients of functions that are orthonormal and ordered from smooth to fine. The space is
spanned by the covariances with the control points, in an order in which every leading part of them is spread
out. Orthonormalised in that order over the control points (covariance matrix G = Q R, values V = G a = Q c),
the first functions are the smoothest. Errors of the coefficients c are errors of the field of the same size,
wherever they are: they may be rounded with one step. A field is recovered by a = R^-1 c; Q is never needed.
"""

from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.surface import Surface, corner_angles

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class KernelParameters:
    """Parameters of the covariance.

    Parameters
    ----------
    length
        l over the object's longest side.
    normal_weight
        g.
    detour_weight
        w.
    ridge
        Added to the diagonal of the control points' covariance.
    """

    length: float = 0.15
    normal_weight: float = 0.02
    detour_weight: float = 0.0
    ridge: float = 1e-6

    def __post_init__(self) -> None:
        """Refuse what is no covariance.

        Raises
        ------
        ValueError
            A length or ridge that is not positive, or a negative weight.
        """
        if not (min(self.length, self.ridge) > 0 and min(self.normal_weight, self.detour_weight) >= 0):
            raise ValueError(f"impossible kernel {asdict(self)}")


class SurfaceKernel:
    """The covariance on one surface.

    Parameters
    ----------
    surface
        Metres.
    detours
        (vertices, dimensions) metres.
    parameters
        See `KernelParameters`.
    """

    def __init__(self, surface: Surface, detours: Floats, parameters: KernelParameters) -> None:
        self.parameters = parameters
        self.surface = surface
        self._detours = np.asarray(detours, dtype=np.float64)

    @cached_property
    def _vertex_features(self) -> Floats:
        """Scaled position and detour, normal: (vertices, 6 + dimensions)."""
        size = float(np.ptp(self.surface.bounds, axis=0).max())
        scale = np.sqrt(7.0) / (self.parameters.length * size)
        centred = self.surface.vertices - self.surface.bounds.mean(axis=0)
        return np.concatenate(
            [
                vertex_normals(self.surface) * np.sqrt(self.parameters.normal_weight),
                centred * scale,
                self._detours * (scale * self.parameters.detour_weight),
            ],
            axis=1,
        )

    def features(self, face: Integers, barycentric: Floats) -> Floats:
        """Features (n, 6 + dimensions) of points at barycentric coordinates (n, 3) of faces (n,)."""
        corners = self.surface.faces[face]
        result = barycentric[:, :1] * self._vertex_features[corners[:, 0]]
        for corner in (1, 2):
            result = result + barycentric[:, corner : corner + 1] * self._vertex_features[corners[:, corner]]
        return result

    @staticmethod
    def covariance(a: Floats, b: Floats) -> Floats:
        """Covariance (n, m) of points with features a (n, .) and b (m, .)."""
        first, second = a[:, 3:], b[:, 3:]
        r = first @ (-2 * second.T)
        r += np.sum(first**2, axis=1)[:, None]
        r += np.sum(second**2, axis=1)
        # Equal points come out a rounding error apart, of which the covariance is a smooth function.
        r = np.sqrt(np.maximum(r, 0.0, out=r), out=r)
        result = np.exp(-r)
        result *= ((r / 15 + 0.4) * r + 1) * r + 1
        result *= a[:, :3] @ b[:, :3].T + 1
        return np.asarray(result)


def vertex_normals(surface: Surface) -> Floats:
    """Unit normals (vertices, 3): the mean of all faces at a vertex, by angle; zero where they cancel."""
    total = np.zeros_like(surface.vertices)
    angles = corner_angles(surface.vertices, surface.faces)
    for corner in range(3):
        weighted = surface.face_normals * angles[:, corner, None]
        for axis in range(3):
            total[:, axis] += np.bincount(
                surface.faces[:, corner], weighted[:, axis], minlength=len(surface.vertices)
            )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 1e-9)


def triangular_factor(covariance: Floats, ridge: float) -> Floats:
    """R (k, k) of the covariance of control points plus ridge, with a positive diagonal: it is unique."""
    regular = covariance + ridge * np.eye(len(covariance))
    factor = np.linalg.qr(regular, mode="r")
    return np.asarray(factor * np.where(np.diag(factor) < 0, -1.0, 1.0)[:, None])


def solve_triangular(factor: Floats, right: Floats) -> Floats:
    """R^-1 right for upper triangular R (k, k), by halves: products do nearly all of the work."""
    if len(factor) <= 96:
        return np.asarray(np.linalg.solve(factor, right))
    half = len(factor) // 2
    lower = solve_triangular(factor[half:, half:], right[half:])
    upper = solve_triangular(factor[:half, :half], right[:half] - factor[:half, half:] @ lower)
    return np.concatenate([upper, lower])
