"""Views by numpy and the network as it was trained: the reference of the compiled kernels."""

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import torch

from objectfolder.making.visionnet.reflectance import (
    Mirrored,
    Reflectance,
    angle_inputs,
    fifth_power_of_rim,
    surrounding_inputs,
)
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.network_layout import has_mirrors
from objectfolder.vision.network.sparse_grid import SparseGrid
from tests.references.pixel_integration import integrate_pixels

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
    """

    def __init__(
        self,
        surface: UnitSurface,
        grid: SparseGrid,
        weights: Mapping[str, np.ndarray],
        radiance_scale: float,
    ) -> None:
        self._surface = surface
        self._radiance_scale = radiance_scale
        self._grid = grid
        network = Reflectance(grid.sizes, mirrors=has_mirrors(weights.keys()))
        network.load_state_dict(
            {name: torch.from_numpy(value.astype(np.float32)) for name, value in weights.items()}
        )
        self._network = network.eval()
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

        Arguments and answer are those of `CompiledRenderer.render`.
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
        """Return (n, 4) float32 premultiplied RGBA along (n, 3) rays of unit directions.

        A ray's answer depends on the others by rounding: libraries round a matrix product by its rows.
        """
        result = np.zeros((len(directions), 4), dtype=np.float32)
        face, barycentric = self._surface.first_hits(origins, directions)
        hits = np.flatnonzero(face >= 0)
        result[hits, 3] = 1.0
        shining = light_colour.any(axis=1)
        lights = light_position[shining]
        factors = (light_colour[shining] * self._radiance_scale).astype(np.float32)
        for start in range(0, len(hits), POINTS):
            rows = hits[start : start + POINTS]
            shown = self._lit(face[rows], barycentric[rows], directions[rows], lights)
            for factor, radiance in zip(factors, shown, strict=True):
                result[rows, :3] += factor * radiance
        return result

    @torch.inference_mode()
    def _lit(
        self, face: np.ndarray, barycentric: np.ndarray, directions: np.ndarray, lights: np.ndarray
    ) -> Iterator[np.ndarray]:
        """Yield the radiance (n, 3) over P / (4 pi^2) that each of the lights (k, 3) causes at points.

        What no light changes, the features and what is seen in mirrors, is found once.
        """
        network, surface = self._network, self._surface
        position = surface.seen(face, barycentric, directions)[0]
        levels = self._levels(position)
        again = None
        for light in lights:
            points = surface.incidence(face, barycentric, directions, light)
            angles = self._tensor(angle_inputs(points))
            mirrored = None
            if network.mirrors:
                if again is None:
                    hits = surface.mirrored(face, points)
                    met_at, _ = surface.seen(hits.face, hits.barycentric, hits.direction)
                    again = hits, torch.cat(self._levels(met_at), dim=1)
                hits, features = again
                met = surface.incidence(hits.face, hits.barycentric, hits.direction, light)
                camera = np.einsum("ij,ij->i", points.normal[hits.row], points.to_camera[hits.row])
                mirrored = Mirrored(
                    torch.from_numpy(hits.row),
                    self._tensor(fifth_power_of_rim(camera)[:, None]),
                    features,
                    self._tensor(angle_inputs(met)),
                    self._tensor(met.irradiance),
                )
            radiance = network.radiance(
                levels,
                network.base(torch.cat(levels, dim=1), angles),
                angles,
                self._tensor(surrounding_inputs(points, light)),
                self._tensor(points.irradiance),
                mirrored,
            )
            yield radiance.numpy()

    def _levels(self, position: np.ndarray) -> list[torch.Tensor]:
        return self._network.levels(self._grid.interpolation(position.astype(np.float32)))

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(values.astype(np.float32))
