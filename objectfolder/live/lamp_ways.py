"""Ways from what a camera sees to the lamps, on which other objects may stand."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class WaysToLamp:
    """Ways (n, 3) from points (n, 3) to a lamp, with what is asked for each object in turn.

    Parameters
    ----------
    squared, point_squared, along : (n,) of ways and of points, and the product of both
    """

    points: Floats
    way: Floats
    squared: Floats
    point_squared: Floats
    along: Floats

    @classmethod
    def of(cls, points: Floats, lamp: Floats) -> "WaysToLamp":
        """Return the ways to a lamp (3,)."""
        way = lamp - points
        products = (np.einsum("ij,ij->i", a, b) for a, b in ((way, way), (points, points), (points, way)))
        return cls(points, way, *products)

    def within(self, centre: Floats, radius: float) -> NDArray[np.bool_]:
        """Return which (n,) pass a ball: how far its centre is from each way's nearest point."""
        across = self.way @ centre - self.along
        share = np.clip(across / np.maximum(self.squared, 1e-12), 0.0, 1.0)
        away = self.point_squared - 2 * (self.points @ centre) + centre @ centre
        return np.asarray(away + share * (share * self.squared - 2 * across) < radius**2)


@dataclass(frozen=True)
class LitPoints:
    """Points of pixels that lamps may light: which pixels (h, w) have one, and the ways to each lamp."""

    present: NDArray[np.bool_]
    ways: tuple[WaysToLamp, ...]

    @classmethod
    def of(cls, points: Floats, lamps: Floats) -> "LitPoints":
        """Return points (h, w, 3), NaN for none, under lamps (k, 3)."""
        present = np.isfinite(points[..., 0])
        return cls(present, tuple(WaysToLamp.of(points[present], lamp) for lamp in lamps))
