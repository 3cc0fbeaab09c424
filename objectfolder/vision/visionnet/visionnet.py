"""VisionNet: an object's appearance under any point light, from any camera."""

import math
from collections.abc import Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from objectfolder.errors import FormatError, QueryError
from objectfolder.products.stored_values import number, whole_number
from objectfolder.products.tensor_file import REMEDY
from objectfolder.query_values import point_rows, require_room
from objectfolder.renaming import renamed_keywords
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import GLASSES, OPAQUE, THIN, Appearance
from objectfolder.vision.cameras import image_crop, image_size
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.network_layout import has_mirrors, weight_shapes
from objectfolder.vision.network.sparse_grid import LARGEST_RESOLUTION, SparseGrid
from objectfolder.vision.network.surface_maps import SurfaceMaps
from objectfolder.vision.rendering.pixel_centres import cast_pixel_centres
from objectfolder.vision.rendering.view_query import (
    image_query,
    light_colours,
    pass_names,
    ray_query,
    require_near,
    view_query,
)

if TYPE_CHECKING:
    from objectfolder.vision.compiled import CompiledRenderer, GlassRenderer

PREFIX = "vision."
MAP = "map."
SUB_RAYS = 64
MOST_SUB_RAYS = 4096  # a pixel, that a file or a query may ask for
MOST_RAYS = 1 << 33  # of all images of a query: some half an hour
# Views rendered at a time: a third of their work is Python's, of which one thread does some at a time.
MOST_THREADS = 4
BAND_PIXELS = 1 << 21  # rendered at once: working memory does not grow with the image
# Shape of a pixel, and type, of what a view can show.
PASSES: dict[str, tuple[tuple[int, ...], type]] = {
    "rgba": ((4,), np.float32),
    "depth": ((), np.float32),
    "normal": ((3,), np.float32),
    "mask": ((), np.bool_),
    "albedo": ((3,), np.float32),
    "roughness": ((), np.float32),
    "metallic": ((), np.float32),
}
REFLECTANCE = ("albedo", "roughness", "metallic")


class VisionNet:
    """First hit on the Object File's surface, traced direct light, learned reflectance and bounced light.

    Parameters
    ----------
    surface
        The surface that the Object File holds.
    frame
        Its unit frame.
    grid
        Cells of the feature grid; None where light is computed from the material.
    weights
        Arrays of `reflectance.Reflectance` by name, float16; none without a grid.
    radiance_scale
        P / (4 pi^2), watts: what one unit of the network's output is in scene-linear radiance.
    camera_radius
        Distance from the origin of the cameras it was trained on, unit frame.
    sub_rays
        Rays a pixel that `render` shoots unless asked otherwise.
    maps
        Of normals, holes, roughness and metallic on the surface's faces, where the source has some.
    appearance
        Roughness and metallic where no map says more; None where that is not known.

    Attributes
    ----------
    computed
        Whether light is computed from the material, and nothing is learned.
    glass
        Whether it is ``"opaque"``, or glass with ``"thin"`` walls that light passes (`appearance.GLASSES`).
    radiance_scale, camera_radius, sub_rays
        As given.
    """

    def __init__(
        self,
        surface: Surface,
        frame: UnitFrame,
        grid: SparseGrid | None,
        weights: Mapping[str, np.ndarray],
        *,
        radiance_scale: float,
        camera_radius: float,
        sub_rays: int = SUB_RAYS,
        maps: SurfaceMaps | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        self.camera_radius = camera_radius
        self.sub_rays = sub_rays
        self._surface = UnitSurface(surface, frame, maps)
        self._maps, self._appearance = maps, appearance
        self._material = Material(maps, appearance)
        self._grid = grid
        self._weights = dict(weights)
        self.computed = grid is None
        self.glass = OPAQUE if appearance is None else appearance.glass
        self.radiance_scale = radiance_scale
        self._renderer: CompiledRenderer | GlassRenderer | None = None
        if self.glass == THIN and grid is not None:
            raise FormatError("vision", "thin glass that is learned", "Build it with material: known.")

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays of an Object File, names beginning with ``vision.``."""
        maps = {} if self._maps is None else self._maps.tensors()
        grid = {} if self._grid is None else {PREFIX + "grid": self._grid.to_bytes()}
        return (
            grid
            | {f"{PREFIX}{name}": value for name, value in self._weights.items()}
            | {f"{PREFIX}{MAP}{name}": stream for name, stream in maps.items()}
        )

    def metadata(self) -> dict[str, Any]:
        """Return what the tensors do not say, as JSON."""
        return {
            **({} if self._grid is None else {"grid_resolution": self._grid.resolution}),
            "radiance_scale": self.radiance_scale,
            "camera_radius": self.camera_radius,
            "sub_rays": self.sub_rays,
            **({} if self._maps is None else {"maps": self._maps.metadata()}),
            **({} if self._appearance is None else {"appearance": self._appearance.to_dict()}),
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
            A tensor that is missing or of the wrong shape, or a number of sub-rays that nobody stores.
        """
        own = {key.removeprefix(PREFIX): value for key, value in tensors.items() if key.startswith(PREFIX)}
        streams = {name.removeprefix(MAP): own.pop(name) for name in list(own) if name.startswith(MAP)}
        maps = None
        if streams or "maps" in metadata:
            triangles = frame.to_unit(surface.vertices)[surface.faces]
            maps = SurfaceMaps.from_tensors(surface, triangles, metadata.get("maps", {}), streams)
        appearance = _appearance(metadata.get("appearance"))
        computed = appearance is not None and Material(maps, appearance).states("albedo")
        grid = None if computed and not own else _grid_of(own, metadata)
        return cls(
            surface,
            frame,
            grid,
            own,
            radiance_scale=number("vision.radiance_scale", metadata["radiance_scale"], 1e-6, 1e6),
            camera_radius=number("vision.camera_radius", metadata["camera_radius"], 0.1, 1e3),
            sub_rays=whole_number("vision.sub_rays", metadata["sub_rays"], 1, MOST_SUB_RAYS),
            maps=maps,
            appearance=appearance,
        )

    def _rendering(self) -> "CompiledRenderer | GlassRenderer":
        """Make the renderer at the first query: importing numba is slow."""
        if self._renderer is None:
            from objectfolder.vision.compiled import CompiledRenderer, GlassRenderer

            if self.glass == THIN:
                self._renderer = GlassRenderer(self._surface, self._material, self.radiance_scale)
            elif self._grid is None:
                computed = self._surface, self._material, self.radiance_scale
                self._renderer = CompiledRenderer.of_material(*computed)
            else:
                learned = self._surface, self._grid, self._weights, self.radiance_scale
                self._renderer = CompiledRenderer(*learned)
        return self._renderer

    @overload
    def render(
        self, camera_to_world: np.ndarray, lights: np.ndarray | Environment,
        resolution: int | tuple[int, int], field_of_view_deg: float, sub_rays: int | None = ..., *,
        light_colour: np.ndarray | None = ..., crop: tuple[int, int, int, int] | None = ...,
        passes: None = ...,
    ) -> np.ndarray: ...  # fmt: skip

    @overload
    def render(
        self, camera_to_world: np.ndarray, lights: np.ndarray | Environment,
        resolution: int | tuple[int, int], field_of_view_deg: float, sub_rays: int | None = ..., *,
        light_colour: np.ndarray | None = ..., crop: tuple[int, int, int, int] | None = ...,
        passes: Collection[str],
    ) -> dict[str, np.ndarray]: ...  # fmt: skip

    @renamed_keywords(light_position="lights")
    def render(
        self, camera_to_world: np.ndarray, lights: np.ndarray | Environment,
        resolution: int | tuple[int, int], field_of_view_deg: float, sub_rays: int | None = None, *,
        light_colour: np.ndarray | None = None, crop: tuple[int, int, int, int] | None = None,
        passes: Collection[str] | None = None,
    ) -> np.ndarray | dict[str, np.ndarray]:  # fmt: skip
        """Render views; each is computed alone, so a batch equals its views one by one, bit for bit.

        Up to `MOST_THREADS` views are rendered at a time, on as many threads as numba is given
        (``NUMBA_NUM_THREADS``, all processors if it is not set).

        Arguments, passes and errors are as of `SightQueries.render_passes`, in the unit frame. Light adds up:
        along a ray the radiance under several lights is the sum of that under each. In an image each pixel's
        share of the rays follows from what all lights together show. Memory does not grow with the lights.
        An environment, in place of positions of `lights`, has the directions of both frames.

        Returns
        -------
        np.ndarray or dict
            (n, height, width, 4) float32 scene-linear premultiplied RGBA; alpha 0 where the object is not.
            With `passes`, any of `PASSES`, a dict of them.
        """
        names = pass_names(passes, tuple(PASSES))
        around = lights if isinstance(lights, Environment) else None
        lamps = np.zeros(3) if isinstance(lights, Environment) else lights
        query = view_query(camera_to_world, lamps, light_colour)
        require_near("camera_to_object", query.cameras[:, :3, 3])
        require_near("lights", query.lights)
        rays = self.sub_rays if sub_rays is None else sub_rays
        resolution, field_of_view_deg, rays = image_query(resolution, field_of_view_deg, rays, MOST_SUB_RAYS)
        size = image_size(resolution)
        part = image_crop(crop, size)
        _require_room(len(query.cameras) * part[2] * part[3], names, rays)
        stacked: dict[str, np.ndarray] = {
            name: np.zeros((len(query.cameras), *part[2:], *PASSES[name][0]), PASSES[name][1])
            for name in names
        }

        def draw(index: int) -> None:
            camera = query.cameras[index]
            if "rgba" in names:
                lamp = query.lights[index], query.colours[index]
                for rows, band in _bands(part):
                    stacked["rgba"][index, rows] = (
                        self._rendering().render(camera, *lamp, size, field_of_view_deg, rays, band)
                        if around is None
                        else self._in_environment(camera, around, size, field_of_view_deg, rays, band)
                    )
            if set(names) - {"rgba"}:
                centres = cast_pixel_centres(self._surface, camera, size, field_of_view_deg, part)
                places = self._surface.in_stored(centres.face, centres.barycentric)
                for name in set(names) - {"rgba", *REFLECTANCE}:
                    stacked[name][index] = getattr(centres, name)
                for name in set(names) & set(REFLECTANCE):
                    stacked[name][index][centres.mask] = self.reflectance(name, *places)

        threads = self._threads(len(query.cameras)) if "rgba" in names else 1
        if threads > 1:
            with ThreadPoolExecutor(threads) as pool:
                for _ in pool.map(draw, range(len(query.cameras))):
                    pass
        else:
            for index in range(len(query.cameras)):
                draw(index)
        return stacked["rgba"] if passes is None else stacked

    def _threads(self, views: int) -> int:
        """Make the renderer, and return how many views are rendered at a time: as numba is given threads."""
        self._rendering()
        from numba import config

        return int(min(views, MOST_THREADS, config.NUMBA_NUM_THREADS))

    def states(self, name: str) -> bool:
        """Whether the file states albedo, roughness or metallic, one of `REFLECTANCE`."""
        return self._material.states(name)

    def reflectance(self, name: str, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return linear albedo (n, 3), roughness or metallic (n,) of points of the stored surface.

        Parameters
        ----------
        name
            One of `REFLECTANCE`.
        face, barycentric
            (n,), (n, 3) the points; those in holes have some, too.

        Raises
        ------
        QueryError
            Something that the file does not state.
        """
        return self._material.value(name, face, barycentric)

    def _in_environment(self, camera: np.ndarray, *arguments: Any) -> np.ndarray:
        return self._rendering().surrounded(camera, *arguments)

    @property
    def drafts(self) -> bool:
        """Whether `draft` answers: of all but thin glass."""
        return self.glass != THIN

    def draft(
        self, origins: np.ndarray, directions: np.ndarray, environment: Environment, turn: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return about the radiance (n, 4) along rays in an environment, see `CompiledRenderer.draft`."""
        renderer = self._rendering()
        if not hasattr(renderer, "draft"):
            raise QueryError("draft", "a draft of thin glass", "Render it.")
        return renderer.draft(origins, directions, environment, turn)

    @renamed_keywords(light_position="lights")
    def radiance(
        self, origins: np.ndarray, directions: np.ndarray, lights: np.ndarray, *,
        light_colour: ArrayLike | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return the radiance (n, 4) along rays as `SightQueries.radiance`, in the unit frame."""
        starts, along = ray_query(origins, directions)
        positions = point_rows(lights, "lights")
        require_near("origins", starts)
        require_near("lights", positions)
        colours = light_colours(light_colour, positions.shape)
        return self._rendering().radiance(starts, along, positions, colours)


def _appearance(record: Any) -> Appearance | None:
    if record is None:
        return None
    names = ("roughness", "metallic", "specular")
    values = {name: number(f"vision.appearance.{name}", record[name], 0, 1) for name in names}
    glass = record.get("glass", OPAQUE)
    if glass not in GLASSES or (glass == THIN and values["metallic"] > 0):
        raise FormatError("vision.appearance.glass", f"{glass!r}, or of a metal", REMEDY)
    return Appearance(**values, glass=glass)


def _require_room(pixels: int, names: Collection[str], rays: int) -> None:
    """Refuse answers that do not fit into memory, and images that would take hours."""
    size = sum(math.prod(PASSES[name][0]) * np.dtype(PASSES[name][1]).itemsize for name in names)
    remedy = "Ask for fewer views, fewer pixels, or one crop after another."
    require_room("camera_to_world, resolution", pixels * size, remedy)
    if "rgba" in names and pixels * rays > MOST_RAYS:
        finding = f"{pixels} pixels of {rays} rays, more than {MOST_RAYS} rays"
        raise QueryError("sub_rays, resolution", finding, "Ask for fewer rays a pixel or fewer pixels.")


def _bands(part: tuple[int, int, int, int]) -> Iterator[tuple[slice, tuple[int, int, int, int]]]:
    """Yield rows of a part of an image, and that band (top, left, height, width), of about `BAND_PIXELS`."""
    top, left, height, width = part
    step = max(1, BAND_PIXELS // width)
    for start in range(0, height, step):
        rows = min(step, height - start)
        yield slice(start, start + rows), (top + start, left, rows, width)


def _grid_of(own: dict[str, np.ndarray], metadata: Mapping[str, Any]) -> SparseGrid:
    """Take the grid from the tensors of a network, and check what is left, its weights."""
    if "grid" not in own:
        raise FormatError(PREFIX + "grid", "missing")
    resolution = whole_number("vision.grid_resolution", metadata["grid_resolution"], 8, LARGEST_RESOLUTION)
    grid = SparseGrid.from_bytes(own.pop("grid"), resolution)
    expected = weight_shapes(grid.sizes, mirrors=has_mirrors(own))
    for name in sorted(expected.keys() | own.keys()):
        shape = own[name].shape if name in own else None
        if shape != expected.get(name):
            raise FormatError(PREFIX + name, f"shape {shape}, expected {expected.get(name)}")
        if not np.isfinite(own[name]).all():
            raise FormatError(PREFIX + name, "not finite", REMEDY)
    return grid
