"""Views of a stored surface by numpy and torch: on a GPU, and for tests of the compiled renderer."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from objectfolder.vision.network.incidence import Incidence, MirrorHits, UnitSurface
from objectfolder.vision.network.sparse_grid import SparseGrid
from objectfolder.vision.rendering.pixel_integration import integrate_pixels
from objectfolder.vision.rendering.shading import Described, Shading

# Points lit at a time: what a render holds at once does not grow with its lights or its rays.
POINTS = 1 << 14


class TorchRenderer:
    """First hits, traced light and the network, in the unit frame.

    Parameters
    ----------
    surface
        The stored surface.
    grid, weights
        Feature grid, and arrays of `reflectance.Reflectance` by name.
    radiance_scale
        P / (4 pi^2) of the data set's light, watts.
    device
        Where the network and its features are, ``"cpu"`` or ``"cuda"``; rays are traced on the CPU.
    """

    def __init__(
        self,
        surface: UnitSurface,
        grid: SparseGrid,
        weights: Mapping[str, np.ndarray],
        radiance_scale: float,
        device: str = "cpu",
    ) -> None:
        self._surface = surface
        self._radiance_scale = radiance_scale
        self._shading = Shading(grid, weights, device)
        self._corners = surface.triangles.reshape(-1, 3)

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
        size: tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int,
        crop: tuple[int, int, int, int] | None = None,
    ) -> np.ndarray:
        """Render one view under k lights.

        Parameters
        ----------
        camera_to_world
            (4, 4) pose.
        light_position, light_colour
            (k, 3) positions, and factors of the data set's light in each channel.
        size
            (height, width), pixels.
        field_of_view_deg
            Angle over the longer side.
        sub_rays
            Rays in a pixel where something ends, and an eighth of them elsewhere.
        crop
            (top, left, height, width) of the part that is wanted, pixels.

        Returns
        -------
        np.ndarray
            (h, w, 4) float32 scene-linear, premultiplied.
        """
        return integrate_pixels(
            partial(self.radiance, light_position=light_position, light_colour=light_colour),
            camera_to_world,
            size,
            field_of_view_deg,
            sub_rays,
            self._corners,
            crop=crop,
        )

    def radiance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
    ) -> np.ndarray:
        """Return (n, 4) float32 premultiplied RGBA along (n, 3) rays of unit directions."""
        result = np.zeros((len(directions), 4), dtype=np.float32)
        face, barycentric = self._surface.first_hits(origins, directions)
        hits = np.flatnonzero(face >= 0)
        result[hits, 3] = 1.0
        shining = np.flatnonzero(light_colour.any(axis=1))
        factors = (light_colour * self._radiance_scale).astype(np.float32)
        for start in range(0, len(hits), POINTS):
            rows = hits[start : start + POINTS]
            described = None
            for index in shining:
                light = light_position[index]
                points = self._surface.incidence(face[rows], barycentric[rows], directions[rows], light)
                if described is None:
                    described = self._shading.describe(points.position, points.normal)
                    met = self._met_in_mirrors(face[rows], points) if self._shading.mirrors else None
                result[rows, :3] += factors[index] * self._shading.radiance(described, points, light)
                if met is not None:
                    hits_again, known = met
                    lit = self._surface.incidence(
                        hits_again.face, hits_again.barycentric, hits_again.direction, light
                    )
                    shown = self._shading.mirrored(described, points, hits_again.row, known, lit)
                    result[rows[hits_again.row], :3] += factors[index] * shown
        return result

    def _met_in_mirrors(self, face: np.ndarray, points: Incidence) -> tuple[MirrorHits, Described] | None:
        """Return where the mirror rays of points on faces (n,) meet the surface, and what is known there.

        None where no ray does.
        """
        hits = self._surface.mirrored(face, points)
        if len(hits.row) == 0:
            return None
        position, normal = self._surface.seen(hits.face, hits.barycentric, hits.direction)
        return hits, self._shading.describe(position, normal)
