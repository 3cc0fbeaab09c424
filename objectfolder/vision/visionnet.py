"""VisionNet: an object's appearance under any point light, from any camera."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from objectfolder.errors import FormatError, QueryError
from objectfolder.geometry.frames import UnitFrame
from objectfolder.geometry.surface import Surface
from objectfolder.store import Product
from objectfolder.vision.cameras import image_size
from objectfolder.vision.incidence import UnitSurface
from objectfolder.vision.network_layout import weight_shapes
from objectfolder.vision.pixel_integration import integrate_pixels
from objectfolder.vision.sparse_grid import SparseGrid, covering_points

PREFIX = "vision."
SUB_RAYS = 64


class VisionNet:
    """First hit on the Object File's surface, traced direct light, learned reflectance and bounced light.

    Parameters
    ----------
    surface
        The surface that the Object File holds.
    frame
        Its unit frame.
    grid
        Cells of the feature grid.
    weights
        Arrays of `reflectance.Reflectance` by name, float16.
    radiance_scale
        P / (4 pi^2), watts: what one unit of the network's output is in scene-linear radiance.
    camera_radius
        Distance from the origin of the cameras it was trained on, unit frame.
    sub_rays
        Rays a pixel that `render` shoots unless asked otherwise.
    """

    def __init__(
        self,
        surface: Surface,
        frame: UnitFrame,
        grid: SparseGrid,
        weights: Mapping[str, np.ndarray],
        *,
        radiance_scale: float,
        camera_radius: float,
        sub_rays: int = SUB_RAYS,
    ) -> None:
        self.camera_radius = camera_radius
        self.sub_rays = sub_rays
        self._surface = UnitSurface(surface, frame)
        self._grid = grid
        self._weights = dict(weights)
        self._radiance_scale = radiance_scale
        self._network: Any = None

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays of an Object File, names beginning with ``vision.``."""
        return {PREFIX + "grid": self._grid.to_bytes()} | {
            f"{PREFIX}{name}": value for name, value in self._weights.items()
        }

    def metadata(self) -> dict[str, Any]:
        """Return what the tensors do not say, as JSON."""
        return {
            "grid_resolution": self._grid.resolution,
            "radiance_scale": self._radiance_scale,
            "camera_radius": self.camera_radius,
            "sub_rays": self.sub_rays,
        }

    @classmethod
    def from_tensors(
        cls,
        tensors: Mapping[str, np.ndarray],
        metadata: Mapping[str, Any],
        surface: Surface,
        frame: UnitFrame,
    ) -> "VisionNet":
        """Return the VisionNet that `tensors` and `metadata` describe.

        Raises
        ------
        FormatError
            A tensor that is missing or of the wrong shape.
        """
        own = {key.removeprefix(PREFIX): value for key, value in tensors.items() if key.startswith(PREFIX)}
        if "grid" not in own:
            raise FormatError(PREFIX + "grid", "missing")
        grid = SparseGrid.from_bytes(own.pop("grid"), int(metadata["grid_resolution"]))
        expected = weight_shapes(grid.sizes)
        for name in sorted(expected.keys() | own.keys()):
            found = own[name].shape if name in own else None
            if found != expected.get(name):
                raise FormatError(PREFIX + name, f"shape {found}, expected {expected.get(name)}")
        return cls(
            surface,
            frame,
            grid,
            own,
            radiance_scale=float(metadata["radiance_scale"]),
            camera_radius=float(metadata["camera_radius"]),
            sub_rays=int(metadata["sub_rays"]),
        )

    def _reflectance(self) -> Any:
        """Build the network at the first render: importing torch is slow."""
        if self._network is None:
            import torch

            from objectfolder.vision.reflectance import Reflectance

            network = Reflectance(self._grid.sizes)
            state = {
                name: torch.from_numpy(value.astype(np.float32)) for name, value in self._weights.items()
            }
            try:
                network.load_state_dict(state)
            except RuntimeError as error:
                raise FormatError("vision", f"tensors do not fit the network: {error}") from error
            self._network = network.eval()
        return self._network

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        resolution: int | tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int | None = None,
    ) -> np.ndarray:
        """Render views; each is computed alone, so a batch equals its views one by one, bit for bit.

        Parameters
        ----------
        camera_to_world
            (n, 4, 4) or (4, 4) poses, unit frame.
        light_position
            (n, 3) or (3,) positions of the point light, unit frame.
        resolution
            Pixels a side, or (height, width).
        field_of_view_deg
            Angle over the longer side.
        sub_rays
            Rays in a pixel where something ends, and an eighth of them elsewhere; by default the
            `sub_rays` of this VisionNet.

        Returns
        -------
        np.ndarray
            (n, height, width, 4) float32 scene-linear premultiplied RGBA; alpha 0 where the object is not.

        Raises
        ------
        QueryError
            Shapes that do not match, values that are not finite, no pixels, no sub-rays.
        """
        cameras = np.asarray(camera_to_world, dtype=np.float64).reshape(-1, 4, 4)
        lights = np.asarray(light_position, dtype=np.float64).reshape(-1, 3)
        if len(cameras) != len(lights):
            raise QueryError(
                "render", f"{len(cameras)} cameras but {len(lights)} lights", "Give one light a camera."
            )
        if not (np.isfinite(cameras).all() and np.isfinite(lights).all()):
            raise QueryError("render", "a camera or light is not finite")
        size = image_size(resolution)
        rays = self.sub_rays if sub_rays is None else sub_rays
        corners = self._surface.triangles.reshape(-1, 3)
        images = [
            integrate_pixels(
                partial(self.radiance, light=light), camera, size, field_of_view_deg, rays, corners
            )
            for camera, light in zip(cameras, lights, strict=True)
        ]
        return np.stack(images) if images else np.zeros((0, *size, 4), dtype=np.float32)

    def radiance(self, origins: np.ndarray, directions: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return (n, 4) float32 scene-linear premultiplied RGBA along (n, 3) rays, unit frame."""
        import torch

        from objectfolder.vision.reflectance import angle_inputs, surrounding_inputs

        network = self._reflectance()
        rgba = np.zeros((len(directions), 4), dtype=np.float32)
        face, barycentric = self._surface.first_hits(origins, directions)
        hit = np.flatnonzero(face >= 0)
        if len(hit) == 0:
            return rgba
        points = self._surface.incidence(face[hit], barycentric[hit], directions[hit], light)
        with torch.inference_mode():
            colour = network(
                self._grid.interpolation(points.position.astype(np.float32)),
                torch.from_numpy(angle_inputs(points)),
                torch.from_numpy(surrounding_inputs(points, light)),
                torch.from_numpy(points.irradiance.astype(np.float32)),
            ).numpy()
        rgba[hit, :3] = colour * np.float32(self._radiance_scale)
        rgba[hit, 3] = 1.0
        return rgba


def fit_visionnet(
    surface: Surface,
    frame: UnitFrame,
    views: Product,
    *,
    steps: int = 1200,
    batch_pixels: int = 1024,
    training_sub_rays: int = 4,
    training_pixels: int = 600_000,
    learning_rate: float = 1e-2,
    grid_corners: int = 110_000,
    grid_resolution: int = 128,
    seed: int = 0,
) -> VisionNet:
    """Fit a VisionNet to the views that are not held out.

    Equal arguments give equal weights on the same number of torch threads.

    Parameters
    ----------
    surface
        The decoded surface that the Object File will hold.
    frame
        Its unit frame.
    views
        Product of `views.simulate_views`.
    steps, batch_pixels, learning_rate
        Steps of Adam, pixels a step, and its rate.
    training_sub_rays, training_pixels
        Rays through each training pixel, and how many pixels to choose from all training views at most.
    grid_corners, grid_resolution
        At most this many corners at the finest level, and at most this many cells a side (a multiple of 8).
    seed
        Of initial weights, batches and rays.

    Raises
    ------
    InputError
        No training view shows the object.
    """
    from objectfolder.vision.training import trace_training_rays, train

    unit_surface = UnitSurface(surface, frame)
    rays = trace_training_rays(unit_surface, views, training_sub_rays, training_pixels, seed)
    points = covering_points(surface, frame.to_unit(surface.vertices), grid_resolution)
    grid = SparseGrid.within_budget(np.concatenate([points, rays.position]), grid_corners, grid_resolution)
    scale = float(views.attributes["light_power_w"]) / (4 * np.pi**2)
    network = train(
        grid, rays, radiance_scale=scale, steps=steps, batch_pixels=batch_pixels,
        learning_rate=learning_rate, seed=seed,
    )  # fmt: skip
    weights = {name: value.numpy().astype(np.float16) for name, value in network.state_dict().items()}
    return VisionNet(
        surface,
        frame,
        grid,
        weights,
        radiance_scale=scale,
        camera_radius=float(views.attributes["camera_radius"]),
    )
