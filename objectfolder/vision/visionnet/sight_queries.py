"""What an Object File answers when it is looked at."""

import reprlib
from collections.abc import Collection
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import QueryError
from objectfolder.forks import hold_forks
from objectfolder.query_values import MOST_SAMPLED, generator, point_rows, real, whole
from objectfolder.renaming import renamed_keywords
from objectfolder.signatures import same_arguments
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import (
    CAMERA_RADIUS,
    FIELD_OF_VIEW_DEG,
    LIGHT_RADIUS,
    lamps_at_cameras,
    look_at,
    uniform_on_sphere,
)
from objectfolder.vision.compositing import on_white
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import Lamps
from objectfolder.vision.rendering.view_query import LARGEST_COORDINATE, pass_names, ray_query, view_query
from objectfolder.vision.studio import STUDIOS, exposed, exposure, studio_lights, turntable
from objectfolder.vision.visionnet.earlier_lights import earlier_lights
from objectfolder.vision.visionnet.visionnet import PASSES, VisionNet

Lights = ArrayLike | Lamps | Environment  # a string, the name of an environment, is array-like


class SightQueries:
    """Images of an object: `ObjectFile.sight`.

    Parameters
    ----------
    surface
        The stored surface, metres.
    frame
        The unit frame of the data set's cameras and lights.
    net
        The encoder of sight.
    """

    def __init__(self, surface: Surface, frame: UnitFrame, net: VisionNet) -> None:
        self.surface = surface
        self.frame = frame
        self.net = net

    @renamed_keywords(camera_to_world="camera_to_object", field_of_view="field_of_view_deg")
    @earlier_lights(
        "camera_to_object", "lights", "resolution", "field_of_view_deg", "linear", "sub_rays", stacklevel=3
    )
    def render(
        self,
        camera_to_object: ArrayLike,
        lights: Lights | None = None,
        resolution: int | tuple[int, int] = 256,
        field_of_view_deg: float = FIELD_OF_VIEW_DEG,
        *,
        sub_rays: int | None = None,
        crop: tuple[int, int, int, int] | None = None,
    ) -> NDArray[np.uint8]:
        """Render views under one or several point lights each, or in an environment.

        `render_linear` takes the same and returns radiance, `render_passes` also depth, normals and more.

        Parameters
        ----------
        camera_to_object
            (4, 4) or (n, 4, 4) rigid poses in the object frame, metres; the camera looks along -z, +y is up.
        lights
            Positions of point lights, metres, object frame: (3,), one light for all views; (n, 3), one a
            view; or (n, k, 3), k a view. Their power is that of the data set, whose lights lie at one
            `frame.scale` from the centre, and falls off with the square of the distance. `Lamps` have
            colours, too.

            Or light from all round, infinitely far, with soft shadows: ``"studio"``, ``"sky"``, ``"window"``,
            or an `Environment`; `Environment.of` makes one of an equirectangular map of linear radiance
            (h, 2 h, 3) in the object's frame, +z in row 0, +x in the middle, +y a quarter to the left of it.
            Image and map are in one unit of radiance.

            None stands for one of the data set's lamps a view, on the camera's side: to the left of the
            camera and above it.
        resolution, field_of_view_deg
            Pixels of a side, or (height, width); of the longer side, degrees.
        sub_rays
            Rays in a pixel where something ends (others get an eighth); the stored default, 64, if None. More
            is slower and closer to the truth.
        crop
            (top, left, height, width) in pixels: that part of the image, equal to it bit for bit.

        Returns
        -------
        ndarray
            (n, h, w, 3) uint8, sRGB on white.

        Raises
        ------
        QueryError
            Poses that are not rigid, values that are not finite, numbers of poses, lights and colours that
            differ, a crop outside the image.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> cameras, lights = bar.sample_views(4, seed=0)
        >>> images = bar.render(cameras, lights, resolution=64)
        >>> images.shape, images.dtype.name, images[0, 0, 0].tolist()  # white beside the bar
        ((4, 64, 64, 3), 'uint8', [255, 255, 255])
        >>> bar.render(cameras, resolution=64).shape, bar.render(cameras, "sky", resolution=64).shape
        ((4, 64, 64, 3), (4, 64, 64, 3))
        """
        image: NDArray[np.uint8] = self.render_passes(
            camera_to_object, ("image",), lights, resolution,
            field_of_view_deg=field_of_view_deg, sub_rays=sub_rays, crop=crop,
        )["image"]  # fmt: skip
        return image

    @same_arguments(render)
    def render_linear(self, *arguments: Any, **keywords: Any) -> NDArray[np.float32]:
        """Render views as `render` does, as radiance.

        Returns
        -------
        ndarray
            (n, h, w, 4) float32, premultiplied scene-linear RGBA.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> cameras, lights = bar.sample_views(1)
        >>> bar.render_linear(cameras, lights, resolution=64)[0, 0, 0].tolist()  # nothing beside the bar
        [0.0, 0.0, 0.0, 0.0]
        """
        named = dict(
            zip(("camera_to_object", "lights", "resolution", "field_of_view_deg"), arguments, strict=False)
        )
        image: NDArray[np.float32] = self.render_passes(passes=("linear",), **named, **keywords)["linear"]
        return image

    @hold_forks
    def render_passes(
        self,
        camera_to_object: ArrayLike,
        passes: Collection[str],
        lights: Lights | None = None,
        resolution: int | tuple[int, int] = 256,
        *,
        field_of_view_deg: float = FIELD_OF_VIEW_DEG,
        sub_rays: int | None = None,
        crop: tuple[int, int, int, int] | None = None,
    ) -> dict[str, NDArray[Any]]:
        """Render views as `render` does, and what is known of each pixel's surface.

        All but ``image`` and ``linear`` is of the pixel's centre, as in the ground truth, and does not depend
        on light or sub-rays.

        Parameters
        ----------
        passes
            Any of ``image`` (n, h, w, 3) uint8, as of `render`; ``linear`` (n, h, w, 4) float32, as of
            `render_linear`; ``depth`` (n, h, w) float32, metres along the camera's -z axis (not along the
            ray), infinity where the object is not; ``normal`` (n, h, w, 3) float32, the unit shading normal
            on the camera's side, object frame, 0 where the object is not; ``mask`` (n, h, w) bool;
            ``albedo`` (n, h, w, 3) float32, the scene-linear base colour, ``roughness`` and ``metallic``
            (n, h, w) float32 as of `Appearance`, 0 where the object is not.
        camera_to_object, lights, resolution, field_of_view_deg, sub_rays, crop
            As for `render`.

        Returns
        -------
        dict
            An array by the name of each pass.

        Raises
        ------
        QueryError
            An unknown pass, or one of the last three of an Object File without them; what `render` refuses.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> cameras, lights = bar.sample_views(4, seed=0)
        >>> depth = bar.render_passes(cameras, ["depth"], lights, resolution=64)["depth"]
        >>> round(float(depth[0].min()), 1)  # metres
        0.3
        """
        chosen = pass_names(passes, ("image", "linear", *(name for name in PASSES if name != "rgba")))
        cameras = camera_to_object
        if lights is None:
            cameras = view_query(camera_to_object, np.zeros(3)).cameras
            lights = self.frame.to_object(lamps_at_cameras(cameras))
        around = Environment.of(lights) if isinstance(lights, str | Environment) else None
        lamps = lights if isinstance(lights, Lamps) else Lamps(np.zeros(3) if around else cast("Any", lights))
        query = view_query(cameras, lamps.positions_m, lamps.colours)
        drawn = self.net.render(
            self.frame.camera_to_unit(query.cameras),
            self.frame.to_unit(query.lights) if around is None else around,
            resolution,
            field_of_view_deg,
            sub_rays,
            light_colour=query.colours,
            crop=crop,
            passes=sorted({"rgba" if name in ("image", "linear") else name for name in chosen}),
        )
        if "depth" in drawn:
            drawn["depth"] = drawn["depth"] * np.float32(self.frame.scale)
        if "linear" in chosen:
            drawn["linear"] = drawn["rgba"]
        if "image" in chosen:
            drawn["image"] = on_white(drawn["rgba"])
        return {name: drawn[name] for name in chosen}

    @earlier_lights("origins", "directions", "lights")
    @hold_forks
    def radiance(
        self, origins: ArrayLike, directions: ArrayLike, lights: ArrayLike | Lamps
    ) -> NDArray[np.float32]:
        """Return the radiance along rays; a ray's answer does not depend on the others.

        Parameters
        ----------
        origins, directions
            (n, 3) metres, object frame, directions of any length; or one origin (3,) for all.
        lights
            (3,) or (k, 3) point lights that shine on all of them, metres, object frame, or `Lamps` of these
            shapes, as for `render`.

        Returns
        -------
        ndarray
            (n, 4) float32 scene-linear RGBA: alpha is 1 where the ray meets the object, all is 0 elsewhere.

        Raises
        ------
        QueryError
            Shapes that do not match, values that are not finite, a direction without length.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> down = bar.radiance([[0, 0, 0.1], [1, 1, 0.1]], [[0, 0, -1], [0, 0, -1]], [0, 0, 0.2])
        >>> down[:, 3].tolist()  # the first ray meets the bar, the second does not
        [1.0, 0.0]
        """
        starts, along = ray_query(origins, directions)
        lamps = lights if isinstance(lights, Lamps) else Lamps(lights)
        positions = point_rows(lamps.positions_m, "lights")
        radiance: NDArray[np.float32] = self.net.radiance(
            self.frame.to_unit(starts), along, self.frame.to_unit(positions), light_colour=lamps.colours
        )
        return radiance

    @renamed_keywords(count="n")
    @hold_forks
    def sample_views(
        self, n: int = 1, seed: int = 0, camera_radius: float = CAMERA_RADIUS, *, lit: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw valid views: camera_to_object (n, 4, 4) and positions of lights (n, 3), object frame, metres.

        Distributed as the data set's: cameras uniform on the sphere of `camera_radius` (unit frame), lights
        on the unit sphere; with `lit` on its half at the camera's side.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> cameras, lights = bar.sample_views(4, seed=0)
        >>> cameras.shape, lights.shape
        ((4, 4, 4), (4, 3))
        """
        count, random = whole("n", n, 0, MOST_SAMPLED), generator(seed)
        radius = real("camera_radius", camera_radius, 1e-3, LARGEST_COORDINATE)
        cameras = look_at(uniform_on_sphere(count, radius, random))
        lights = uniform_on_sphere(count, LIGHT_RADIUS, random)
        if lit:
            behind = np.einsum("ij,ij->i", lights, cameras[:, :3, 3]) < 0
            lights[behind] = -lights[behind]
        return self.frame.camera_to_object(cameras), self.frame.to_object(lights)

    @hold_forks
    def pictures(
        self,
        cameras: int | ArrayLike,
        resolution: int | tuple[int, int] = 256,
        *,
        studio: str = "studio",
        sub_rays: int | None = None,
        crop: tuple[int, int, int, int] | None = None,
    ) -> NDArray[np.uint8]:
        """Show the object in a studio's light, as bright as shows it best.

        For people: `render` answers views of the data set's single lamp, which this is not. The lamps stand
        with the camera. All pictures of an object have one exposure.

        Parameters
        ----------
        cameras
            A number of cameras all round the object, so near that it fills the images, or their poses as for
            `render`.
        studio
            ``studio`` (key, fill, rim and sky) or ``window`` (panes on the left, and sky).
        resolution, sub_rays, crop
            As for `render`.

        Returns
        -------
        ndarray
            (n, h, w, 3) uint8, sRGB on white.

        Raises
        ------
        QueryError
            Another studio; what `render` refuses.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> pictures = bar.pictures(3, resolution=64)
        >>> pictures.shape, pictures[0, 0, 0].tolist()  # white beside the bar
        ((3, 64, 64, 3), [255, 255, 255])
        """
        if not isinstance(studio, str) or studio not in STUDIOS:
            raise QueryError("studio", reprlib.repr(studio), f"Use {' or '.join(STUDIOS)}.")
        if isinstance(cameras, int | np.integer):
            poses = self._all_round(whole("cameras", cameras, 1, MOST_SAMPLED))
        else:
            poses = view_query(cameras, np.zeros(3), None).cameras
        if studio not in self._exposures:
            self._exposures[studio] = exposure(self._in_studio(studio, self._all_round(3), 64, 4))
        return exposed(self._in_studio(studio, poses, resolution, sub_rays, crop), self._exposures[studio])

    @cached_property
    def _exposures(self) -> dict[str, float]:
        return {}

    def _all_round(self, count: int) -> np.ndarray:
        return self.frame.camera_to_object(turntable(count, self.frame.to_unit(self.surface.vertices)))

    def _in_studio(
        self,
        studio: str,
        poses: NDArray[np.float64],
        resolution: int | tuple[int, int],
        sub_rays: int | None,
        crop: tuple[int, int, int, int] | None = None,
    ) -> NDArray[np.float32]:
        positions, colours = studio_lights(poses, studio)
        lamps = Lamps(self.frame.to_object(positions), colours)
        return self.render_linear(poses, lamps, resolution, sub_rays=sub_rays, crop=crop)
