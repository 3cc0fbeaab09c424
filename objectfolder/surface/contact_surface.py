"""Contacts as a query gives them, brought onto a surface."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import QueryError
from objectfolder.query_values import point_rows
from objectfolder.surface.surface import ClosestPoints, Surface


class ContactSurface:
    """A surface that contacts are projected onto; all senses of an Object File share one.

    Parameters
    ----------
    surface
        Metres, object frame.
    tolerance_m
        How far from the surface a contact may be given.
    """

    def __init__(self, surface: Surface, tolerance_m: float) -> None:
        self.surface = surface
        self.tolerance_m = tolerance_m

    def project(self, points: ArrayLike, *, name: str = "points") -> ClosestPoints:
        """Bring contacts onto the surface; see `ObjectFile.project`."""
        contacts = point_rows(points, name)
        closest = self.surface.closest_points(contacts)
        worst = int(np.argmax(closest.distance)) if len(contacts) else 0
        if len(contacts) and closest.distance[worst] > self.tolerance_m:
            raise QueryError(
                f"{name}[{worst}]",
                f"{closest.distance[worst] * 1e3:.3g} mm off the surface",
                f"Contacts lie within {self.tolerance_m * 1e3:.3g} mm, in metres, object frame; "
                "`sample_contacts` gives valid ones.",
            )
        return closest

    def normals(self, points: NDArray[np.float64] | ClosestPoints) -> NDArray[np.float64]:
        """Return the outward unit normals (n, 3) at places of the surface, or nearest to points (n, 3)."""
        places = points if isinstance(points, ClosestPoints) else self.surface.closest_points(points)
        return self.surface.normals_at(places.face, places.barycentric)
