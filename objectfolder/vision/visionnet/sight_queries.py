"""What an Object File answers when it is looked at."""

import reprlib
from collections.abc import Collection
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.query_values import MOST_SAMPLED, generator, point_rows, real, whole
from objectfolder.renaming import renamed_keywords
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import (
    CAMERA_RADIUS,
    LIGHT_RADIUS,
    lamps_at_cameras,
    look_at,
    uniform_on_sphere,
)
from objectfolder.vision.compositing import on_white
from objectfolder.vision.environment import Environment
from objectfolder.vision.rendering.view_query import FARTHEST, pass_names, ray_query, view_query
from objectfolder.vision.studio import STUDIOS, exposed, exposure, studio_lights, turntable
from objectfolder.vision.visionnet.visionnet import PASSES, VisionNet


class SightQueries:
    """Images of an object; a part of `ObjectFile`, which has the attributes named here.

    Passes beside the image are of the pixel's centre, as in the ground truth, and do not depend on light or
    sub-rays: ``depth`` (n, h, w) float32, metres along the camera's -z axis (not along the ray), infinity
    where the object is not; ``normal`` (n, h, w, 3) float32, the unit shading normal on the camera's side,
    object frame, 0 where the object is not; ``mask`` (n, h, w) bool; ``albedo`` (n, h, w, 3) float32, the
    scene-linear base colour, ``roughness`` and ``metallic`` (n, h, w) float32 as of `Appearance`, 0 where the
    object is not. An Object File made before these, or from views without passes, refuses the last three.
    """

    frame: UnitFrame
    surface: Surface
    vision: VisionNet

    @overload
    def render(
        self, camera_to_world: np.ndarray, light_position: np.ndarray | None = ...,
        resolution: int | tuple[int, int] = ..., field_of_view: float = ..., linear: bool = ...,
        sub_rays: int | None = ..., *, light: str | np.ndarray | None = ...,
        light_colour: np.ndarray | None = ..., crop: tuple[int, int, int, int] | None = ...,
        passes: None = ...,
    ) -> np.ndarray: ...  # fmt: skip

    @overload
    def render(
        self, camera_to_world: np.ndarray, light_position: np.ndarray | None = ...,
        resolution: int | tuple[int, int] = ..., field_of_view: float = ..., linear: bool = ...,
        sub_rays: int | None = ..., *, light: str | np.ndarray | None = ...,
        light_colour: np.ndarray | None = ..., crop: tuple[int, int, int, int] | None = ...,
        passes: Collection[str],
    ) -> dict[str, np.ndarray]: ...  # fmt: skip

    def render(
        self, camera_to_world: np.ndarray, light_position: np.ndarray | None = None,
        resolution: int | tuple[int, int] = 256, field_of_view: float = 39.6, linear: bool = False,
        sub_rays: int | None = None, *, light: str | np.ndarray | None = None,
        light_colour: np.ndarray | None = None, crop: tuple[int, int, int, int] | None = None,
        passes: Collection[str] | None = None,
    ) -> np.ndarray | dict[str, np.ndarray]:  # fmt: skip
        """Render views under one or several point lights each, or in an environment.

        Parameters
        ----------
        camera_to_world
            (4, 4) or (n, 4, 4) rigid poses in the object frame, metres; the camera looks along -z, +y is up.
        light_position
            (3,), one light for all views; (n, 3), one a view; or (n, k, 3), k a view; metres, object frame.
            Their power is that of the data set, whose lights lie at one `frame.scale` from the centre, and
            falls off with the square of the distance. None, without a `light`, stands for one of the data
            set's lamps a view, on the camera's side: to the left of the camera and above it.
        light
            In place of lamps, light from all round, infinitely far, with soft shadows: ``"studio"``,
            ``"sky"``, ``"window"``, or an equirectangular map of linear radiance (h, 2 h, 3) in the object's
            frame, +z in row 0, +x in the middle, +y a quarter to the left of it. Image and map are in one
            unit of radiance.
        resolution, field_of_view
            Pixels of a side, or (height, width); of the longer side, degrees.
        linear
            Return premultiplied scene-linear RGBA instead of 8-bit sRGB on white.
        sub_rays
            Rays in a pixel where something ends (others get an eighth); the stored default, 64, if None. More
            is slower and closer to the truth.
        light_colour
            (3,), (k, 3) or (n, k, 3) linear factors of that power, red, green, blue; 1 if None.
        crop
            (top, left, height, width) in pixels: that part of the image, equal to it bit for bit.
        passes
            Any of ``image`` and the others that the class names.

        Returns
        -------
        ndarray or dict
            The image: (n, h, w, 3) uint8, or (n, h, w, 4) float32 if `linear`. With `passes` a dict of them.

        Raises
        ------
        QueryError
            Poses that are not rigid, values that are not finite, numbers of poses, lights and colours that
            differ, a crop outside the image, an unknown pass, lamps beside an environment.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> cameras, lights = bar.sample_views(4, seed=0)
        >>> images = bar.render(cameras, lights, resolution=64)
        >>> images.shape, images.dtype.name, images[0, 0, 0].tolist()  # white beside the bar
        ((4, 64, 64, 3), 'uint8', [255, 255, 255])
        >>> bar.render(cameras, resolution=64).shape, bar.render(cameras, light="sky", resolution=64).shape
        ((4, 64, 64, 3), (4, 64, 64, 3))
        >>> depth = bar.render(cameras, lights, resolution=64, passes=["depth"])["depth"]
        >>> round(float(depth[0].min()), 1)  # metres
        0.3
        """
        names = {"image": "rgba"} | {name: name for name in PASSES if name != "rgba"}
        wanted = pass_names(passes, tuple(names))
        if light is not None and (light_position is not None or light_colour is not None):
            remedy = "Give lamps, with their colours or without, or one light for all views."
            raise QueryError("light", "lamps beside light from all round", remedy)
        if light_position is None:
            poses = view_query(camera_to_world, np.zeros(3)).cameras
            light_position = self.frame.to_object(lamps_at_cameras(poses))
        query = view_query(camera_to_world, light_position, light_colour)
        drawn = self.vision.render(
            self.frame.camera_to_unit(query.cameras),
            self.frame.to_unit(query.lights) if light is None else Environment.of(light),
            resolution, field_of_view, sub_rays, light_colour=query.colours, crop=crop,
            passes=[names[name] for name in wanted],
        )  # fmt: skip
        if "depth" in drawn:
            drawn["depth"] = drawn["depth"] * np.float32(self.frame.scale)
        if "rgba" in drawn:
            drawn["image"] = drawn["rgba"] if linear else on_white(drawn["rgba"])
        return drawn["image"] if passes is None else {name: drawn[name] for name in wanted}

    def radiance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        light_position: np.ndarray,
        *,
        light_colour: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the radiance along rays; a ray's answer does not depend on the others.

        Parameters
        ----------
        origins, directions
            (n, 3) metres, object frame, directions of any length; or one origin (3,) for all.
        light_position
            (3,) or (k, 3) point lights that shine on all of them, metres, object frame, as for `render`.
        light_colour
            (3,) or (k, 3) linear factors of the data set's light; 1 if None.

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
        lights = point_rows(light_position, "light_position")
        return self.vision.radiance(
            self.frame.to_unit(starts), along, self.frame.to_unit(lights), light_colour=light_colour
        )

    @renamed_keywords(count="n")
    def sample_views(
        self, n: int = 1, seed: int = 0, camera_radius: float = CAMERA_RADIUS, *, lit: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw valid views: camera_to_world (n, 4, 4) and light_position (n, 3), object frame, metres.

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
        radius = real("camera_radius", camera_radius, 1e-3, FARTHEST)
        cameras = look_at(uniform_on_sphere(count, radius, random))
        lights = uniform_on_sphere(count, LIGHT_RADIUS, random)
        if lit:
            behind = np.einsum("ij,ij->i", lights, cameras[:, :3, 3]) < 0
            lights[behind] = -lights[behind]
        return self.frame.camera_to_object(cameras), self.frame.to_object(lights)

    def pictures(
        self,
        cameras: int | np.ndarray,
        resolution: int | tuple[int, int] = 256,
        *,
        studio: str = "studio",
        sub_rays: int | None = None,
        crop: tuple[int, int, int, int] | None = None,
    ) -> np.ndarray:
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
        self, studio: str, poses: np.ndarray, resolution: int | tuple[int, int], sub_rays: int | None,
        crop: tuple[int, int, int, int] | None = None,
    ) -> np.ndarray:  # fmt: skip
        lamps, colours = studio_lights(poses, studio)
        return self.render(
            poses, self.frame.to_object(lamps), resolution, linear=True, sub_rays=sub_rays,
            light_colour=colours, crop=crop,
        )  # fmt: skip
