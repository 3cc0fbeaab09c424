"""Touches of a surface: where the sensor stands, what is near its gel, what its camera sees."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from objectfolder.touch.contact.first_touch import contact_normals, first_touch_poses
from objectfolder.touch.contact.indentation import deepest
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.rendering.gather import Picture, gather_samples, resolve
from objectfolder.touch.rendering.rasterise import Rays, rasterise
from objectfolder.touch.rendering.surroundings import surroundings
from objectfolder.touch.sensor.camera import DEPTH_STEPS_PER_M, coverage_grid, no_contact_image
from objectfolder.touch.sensor.gel import gel_constants
from objectfolder.touch.sensor.point_lights import point_lights
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.table_lighting import table_lighting


@dataclass(frozen=True)
class Near:
    """Faces near the gel at a pose.

    Parameters
    ----------
    faces, triangles
        (m,) indices and (m, 3, 3) corners in the sensor frame, metres.
    bounds
        (m,) what the indentation of the gel by each face does not exceed, metres.
    greatest
        Largest indentation by any of them, at least 0.
    """

    faces: np.ndarray
    triangles: np.ndarray
    bounds: np.ndarray
    greatest: float

    def advanced(self, distance: float) -> "Near":
        """What they are after the sensor has moved on along its axis by `distance` metres."""
        triangles = self.triangles - np.array([distance, 0.0, 0.0])
        return Near(self.faces, triangles, self.bounds + distance, self.greatest + distance)


@dataclass(frozen=True)
class TouchImage:
    """What the camera sees of one touch; the fields are those of `Touches`, without the first axis."""

    rgb: np.ndarray
    depth: np.ndarray
    mask: np.ndarray
    contact_area_m2: float


class Simulator:
    """One surface, one sensor, and `samples`^2 rays a pixel."""

    def __init__(self, patches: FacePatches, sensor: Sensor, samples: int) -> None:
        self._patches, self._sensor = patches, sensor
        self._camera = _Camera.of(sensor, samples)
        self._gel = gel_constants(sensor)

    def stand(
        self, points: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray, roll: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the touched points (n, 3), mean normals (n, 3) and poses of first touch (n, 4, 4).

        `tilt`, `azimuth` and `roll` are (n,) radians.
        """
        patches, radius = self._patches, self._sensor.contact_radius_m
        face, barycentric = patches.closest(points)
        closest = patches.surface.points_at(face, barycentric)
        shading = patches.surface.normals_at(face, barycentric)
        starts, faces = patches.in_balls(closest, radius)
        normals = np.empty_like(closest)
        contact_normals(
            closest, shading, starts, faces, patches.triangles, patches.face_normals, radius, normals
        )
        return closest, normals, first_touch_poses(closest, normals, tilt, azimuth, roll, self._gel)

    def approach(self, pose: np.ndarray, least: float) -> Near:
        """Return the faces that may reach deeper into the gel than `least` metres, 0 or less, at a pose."""
        faces, triangles, bounds = self._patches.near_gel(pose, self._gel, least)
        return Near(faces, triangles, bounds, deepest(triangles, bounds, self._gel, np.empty((3, 3))))

    def meets_housing(self, pose: np.ndarray) -> bool:
        """Whether the object enters the housing at a pose, or on its straight way there along its axis."""
        low, high = np.array(self._sensor.housing_low_m), np.asarray(self._sensor.housing_high_m)
        low[0] -= self._patches.diagonal_m
        return self._patches.enters_box(pose, low, high)

    def see(self, pose: np.ndarray, near: Near) -> TouchImage:
        """Return the image of the faces whose bound is above 0, and the area seen in the gel."""
        camera = self._camera
        rgb = camera.no_contact.copy()
        shape = rgb.shape[:2]
        picture = Picture(rgb, np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=bool))
        raster = rasterise(near.triangles, near.bounds, camera.rays, camera.gel_nearness)
        count, points, area = gather_samples(
            raster, self._patches.corner_normals, near.faces, pose, self._gel, camera.rays
        )
        values = camera.lighting.shade(count, points.positions, points.normals)
        resolve(
            raster.owner, raster.extent, values, points.depth, camera.gel_values, camera.rays.of_pixel,
            DEPTH_STEPS_PER_M, picture,
        )  # fmt: skip
        if camera.surroundings is not None:
            camera.surroundings.cast(picture.rgb, picture.depth)
        return TouchImage(*picture, float(area) * camera.ray_area)


class _Camera:
    """What is the same for all touches of a sensor at a number of samples."""

    def __init__(self, sensor: Sensor, samples: int) -> None:
        grid = coverage_grid(sensor, samples)
        position = np.asarray(sensor.camera_position_m, dtype=np.float64)
        self.rays = Rays(position, grid.u, grid.shift, grid.v, grid.near, grid.samples**2)
        self.ray_area = grid.cell
        # The next number: what is as near as the gel is not before it.
        self.gel_nearness = np.nextafter(1 / grid.gel_depth, np.inf).reshape(len(grid.v), len(grid.u))
        self.gel_values = grid.gel_values.reshape(sensor.image_height, sensor.image_width, 3)
        self.no_contact = no_contact_image(sensor, samples)
        self.surroundings = surroundings(sensor)
        table = sensor.photometric_table
        self.lighting = point_lights(sensor) if table is None else table_lighting(sensor, table)

    @staticmethod
    @lru_cache(maxsize=8)
    def of(sensor: Sensor, samples: int) -> "_Camera":
        return _Camera(sensor, samples)
