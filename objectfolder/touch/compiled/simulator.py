"""Touches by kernels: boxes over the faces, a z-buffer over the patch, shading where there is contact."""

from functools import lru_cache

import numpy as np

from objectfolder.touch.compiled.contact import contact_normals, deepest, first_touch_poses, gel_constants
from objectfolder.touch.compiled.rasterise import gather_samples, rasterise
from objectfolder.touch.compiled.resolve import resolve
from objectfolder.touch.compiled.shading import lighting
from objectfolder.touch.compiled.table_shading import table_lighting
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.contact.pose import OTHER_SIDE_COSINE, POLE_RAD
from objectfolder.touch.rendering.backends import Near
from objectfolder.touch.rendering.image import DEPTH_STEPS_PER_M
from objectfolder.touch.sensor.camera import CoverageGrid, coverage_grid, no_contact_image
from objectfolder.touch.sensor.sensor import Sensor


class CompiledSimulator:
    """Compiled counterpart of `objectfolder.touch.rendering.reference_simulator.ReferenceSimulator`.

    Labels agree with it to 1e-9. Images agree but for rays that pass within rounding of an edge between
    faces, and for a grey level where the mean of a pixel lies within 1e-3 of the middle between two.
    """

    def __init__(self, patches: FacePatches, sensor: Sensor, samples: int) -> None:
        self._patches, self._tree = patches, patches.tree
        self._sensor = sensor
        self._camera = _Camera.of(sensor, samples)
        self._gel = gel_constants(sensor)
        self._housing = np.asarray(sensor.housing_low_m), np.asarray(sensor.housing_high_m)

    def stand(
        self, points: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `backends.Simulator`."""
        patches, radius = self._patches, self._sensor.contact_radius_m
        face, barycentric = self._tree.closest(points)
        closest = patches.surface.points_at(face, barycentric)
        shading = patches.surface.normals_at(face, barycentric)
        starts, faces = self._tree.in_balls(closest, radius)
        normals = contact_normals(
            closest,
            shading,
            starts,
            faces,
            patches.triangles,
            patches.face_normals,
            radius,
            OTHER_SIDE_COSINE,
        )
        poses = first_touch_poses(closest, normals, tilt, azimuth, self._gel, POLE_RAD)
        return closest, normals, poses

    def approach(self, pose: np.ndarray, least: float) -> Near:
        """See `backends.Simulator`."""
        faces, triangles, bounds = self._tree.near_gel(pose, self._gel, least)
        return Near(faces, triangles, bounds, deepest(triangles, bounds, self._gel))

    def meets_housing(self, pose: np.ndarray) -> bool:
        """See `backends.Simulator`."""
        return self._tree.enters_box(pose, *self._housing)

    def see(
        self, pose: np.ndarray, near: Near, rgb: np.ndarray, depth: np.ndarray, mask: np.ndarray
    ) -> float:
        """See `backends.Simulator`."""
        camera, grid = self._camera, self._camera.grid
        rays = grid.samples**2
        rgb[:], depth[:], mask[:] = camera.no_contact, 0.0, False
        owner, nearness, extent, edges, inverse = rasterise(
            near.triangles,
            near.bounds,
            camera.position,
            grid.u,
            grid.shift,
            grid.v,
            camera.gel_nearness,
            grid.near,
            rays,
        )
        count, positions, normals, sample_depth, area = gather_samples(
            owner,
            nearness,
            extent,
            edges,
            inverse,
            self._patches.corner_normals,
            near.faces,
            pose,
            camera.position,
            self._gel,
            grid.u,
            grid.shift,
            grid.v,
            rays,
        )
        values = camera.shading.shade(count, positions, normals)
        resolve(
            owner,
            extent,
            values,
            sample_depth,
            camera.gel_values,
            rays,
            DEPTH_STEPS_PER_M,
            rgb,
            depth,
            mask,
        )
        return float(area) * grid.cell


class _Camera:
    """What is the same for all touches of a sensor at a number of samples."""

    def __init__(self, sensor: Sensor, samples: int) -> None:
        self.grid: CoverageGrid = coverage_grid(sensor, samples)
        self.position = np.asarray(sensor.camera_position_m, dtype=np.float64)
        shape = (len(self.grid.v), len(self.grid.u))
        # The next number: what is as near as the gel is not before it.
        self.gel_nearness = np.nextafter(1 / self.grid.gel_depth, np.inf).reshape(shape)
        self.gel_values = self.grid.gel_values.reshape(sensor.image_height, sensor.image_width, 3)
        self.no_contact = no_contact_image(sensor, samples)
        table = sensor.photometric_table
        self.shading = lighting(sensor) if table is None else table_lighting(sensor, table)

    @staticmethod
    @lru_cache(maxsize=8)
    def of(sensor: Sensor, samples: int) -> "_Camera":
        return _Camera(sensor, samples)
