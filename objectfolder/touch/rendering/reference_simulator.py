"""Touches by array arithmetic: the reference that needs nothing but numpy."""

import numpy as np

from objectfolder.touch.contact.gel_contact import indentations, meets_housing
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.contact.pose import contact_normal, first_touch_pose
from objectfolder.touch.rendering.backends import Near
from objectfolder.touch.rendering.image import contact_image, near_gel
from objectfolder.touch.sensor.camera import coverage_grid
from objectfolder.touch.sensor.sensor import Sensor


class ReferenceSimulator:
    """What `backends.Simulator` states, a touch at a time."""

    def __init__(self, patches: FacePatches, sensor: Sensor, samples: int) -> None:
        self._patches, self._sensor = patches, sensor
        self._grid = coverage_grid(sensor, samples)

    def stand(
        self, points: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `backends.Simulator`."""
        surface, sensor = self._patches.surface, self._sensor
        closest = surface.closest_points(points)
        shading_normals = surface.normals_at(closest.face, closest.barycentric)
        normals, poses = np.empty((len(points), 3)), np.empty((len(points), 4, 4))
        for i, (point, shading_normal) in enumerate(zip(closest.points, shading_normals, strict=True)):
            normals[i] = contact_normal(self._patches, point, shading_normal, sensor.contact_radius_m)
            poses[i] = first_touch_pose(sensor, point, normals[i], tilt[i], azimuth[i])
        return closest.points, normals, poses

    def approach(self, pose: np.ndarray, least: float) -> Near:
        """See `backends.Simulator`."""
        faces, triangles = near_gel(self._patches, self._sensor, pose, least)
        reach = indentations(triangles, self._sensor)
        return Near(faces, triangles, reach, float(reach.max(initial=0.0)))

    def meets_housing(self, pose: np.ndarray) -> bool:
        """See `backends.Simulator`."""
        low, high = np.asarray(self._sensor.housing_low_m), np.asarray(self._sensor.housing_high_m)
        near = self._patches.in_box(pose, low, high)
        return meets_housing(self._patches.corners_in(pose, near), self._sensor)

    def see(
        self, pose: np.ndarray, near: Near, rgb: np.ndarray, depth: np.ndarray, mask: np.ndarray
    ) -> float:
        """See `backends.Simulator`."""
        pressed = near.bounds > 0
        image = contact_image(
            self._patches, self._sensor, self._grid, pose, near.faces[pressed], near.triangles[pressed]
        )
        rgb[:], depth[:], mask[:] = image.rgb, image.depth, image.mask
        return image.contact_area_m2
