"""What an Object File answers when it is looked at."""

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.geometry.frames import UnitFrame
from objectfolder.vision.cameras import CAMERA_RADIUS, LIGHT_RADIUS, look_at, uniform_on_sphere
from objectfolder.vision.compositing import on_white
from objectfolder.vision.visionnet import VisionNet


class SightQueries:
    """Images of an object; a part of `ObjectFile`, which has the attributes named here."""

    frame: UnitFrame
    vision: VisionNet

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        resolution: int | tuple[int, int] = 256,
        field_of_view: float = 39.6,
        linear: bool = False,
        sub_rays: int | None = None,
    ) -> np.ndarray:
        """Render views under one point light each.

        Parameters
        ----------
        camera_to_world
            (4, 4) or (n, 4, 4) rigid poses in the object frame, metres; the camera looks along -z, +y is up.
        light_position
            (3,) or (n, 3) metres, object frame. The lamp's power is that of the data set, whose lights lie
            at one `frame.scale` from the centre.
        resolution
            Pixels of a side, or (height, width).
        field_of_view
            Of the width, degrees.
        linear
            Return premultiplied scene-linear RGBA instead of 8-bit sRGB on white.
        sub_rays
            Rays in a pixel where something ends (others get an eighth); the stored default, 64, if None. More
            is slower and closer to the truth.

        Returns
        -------
        ndarray
            (n, h, w, 3) uint8, or (n, h, w, 4) float32 if `linear`.

        Raises
        ------
        QueryError
            Poses that are not rigid, values that are not finite, numbers of poses and lights that differ.
        """
        cameras = np.asarray(camera_to_world, dtype=np.float64)
        lights = np.asarray(light_position, dtype=np.float64)
        if cameras.ndim == 2:
            cameras = cameras[None]
        if lights.ndim == 1:
            lights = np.broadcast_to(lights, (len(cameras), 3))
        if cameras.ndim != 3 or cameras.shape[1:] != (4, 4):
            raise QueryError("camera_to_world", f"shape {cameras.shape}", "Give (n, 4, 4) poses.")
        if lights.shape != (len(cameras), 3):
            raise QueryError("light_position", f"shape {lights.shape}", f"Give ({len(cameras)}, 3) points.")
        if not (np.isfinite(cameras).all() and np.isfinite(lights).all()):
            raise QueryError("camera_to_world, light_position", "not finite")
        rotation = cameras[:, :3, :3]
        if np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0) > 1e-4:
            raise QueryError(
                "camera_to_world",
                "not a rigid pose",
                "Give an orthonormal rotation and a translation in metres.",
            )
        if not 0 < field_of_view < 180:
            raise QueryError("field_of_view", f"{field_of_view}", "Give degrees between 0 and 180.")
        rgba = self.vision.render(
            self.frame.camera_to_unit(cameras),
            self.frame.to_unit(lights),
            resolution,
            field_of_view,
            **({} if sub_rays is None else {"sub_rays": sub_rays}),
        )
        return rgba if linear else on_white(rgba)

    def sample_views(
        self, count: int, seed: int, camera_radius: float = CAMERA_RADIUS
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw valid views: camera_to_world (n, 4, 4) and light_position (n, 3), object frame, metres.

        Distributed as the data set's: cameras uniform on the sphere of `camera_radius` (unit frame), lights
        on the unit sphere.
        """
        random = np.random.default_rng(seed)
        cameras = look_at(uniform_on_sphere(count, camera_radius, random))
        lights = uniform_on_sphere(count, LIGHT_RADIUS, random)
        return self.frame.camera_to_object(cameras), self.frame.to_object(lights)
