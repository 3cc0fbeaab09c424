"""What a surface is made of at each of its points, as an Object File states it."""

from dataclasses import dataclass

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.compositing import srgb_decode
from objectfolder.vision.network.surface_maps import SurfaceMaps


@dataclass(frozen=True)
class Material:
    """Albedo, roughness and metallic of a surface.

    Parameters
    ----------
    maps
        On the surface's faces; None without any.
    appearance
        Roughness and metallic where no map says more; None where that is not known.
    """

    maps: SurfaceMaps | None
    appearance: Appearance | None

    def mapped(self, name: str) -> bool:
        """Whether a map states it point by point."""
        return self.maps is not None and name in self.maps

    def states(self, name: str) -> bool:
        """Whether albedo, roughness or metallic is known."""
        return self.mapped(name) or (name != "albedo" and self.appearance is not None)

    def value(self, name: str, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return linear albedo (n, 3), roughness or metallic (n,) of points of the stored surface.

        Raises
        ------
        QueryError
            Something that is not known.
        """
        if not self.states(name):
            raise QueryError("passes", f"{name} is not stated by this Object File", "Build it again.")
        if self.maps is None or name not in self.maps:
            return np.full(len(face), float(getattr(self.appearance, name)))
        values = self.maps.value(name, face, barycentric)
        return srgb_decode(values) if name == "albedo" else values[:, 0]
