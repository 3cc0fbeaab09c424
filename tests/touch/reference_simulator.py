"""Touches by array arithmetic: the oracle of `objectfolder.touch.rendering.simulator`."""

from dataclasses import replace

import numpy as np
from reference_contact import corners_in, in_box, indentations, meets_housing, near_gel
from reference_pose import contact_normal, first_touch_pose
from reference_rasterise import rasterise

from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.rendering.simulator import Near, TouchImage
from objectfolder.touch.sensor.camera import DEPTH_STEPS_PER_M, RayGrid, coverage_grid, to_bytes
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade


class ReferenceSimulator:
    """What `Simulator` answers, a touch at a time."""

    def __init__(self, patches: FacePatches, sensor: Sensor, samples: int) -> None:
        self._patches, self._sensor = patches, sensor
        self._grid = coverage_grid(sensor, samples)

    def stand(
        self, points: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray, roll: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        surface, sensor = self._patches.surface, self._sensor
        closest = surface.closest_points(points)
        shading_normals = surface.normals_at(closest.face, closest.barycentric)
        normals, poses = np.empty((len(points), 3)), np.empty((len(points), 4, 4))
        for i, (point, shading_normal) in enumerate(zip(closest.points, shading_normals, strict=True)):
            normals[i] = contact_normal(self._patches, point, shading_normal, sensor.contact_radius_m)
            poses[i] = first_touch_pose(sensor, point, normals[i], tilt[i], azimuth[i], roll[i])
        return closest.points, normals, poses

    def approach(self, pose: np.ndarray, least: float) -> Near:
        faces, triangles = near_gel(self._patches, self._sensor, pose, least)
        reach = indentations(triangles, self._sensor)
        return Near(faces, triangles, reach, float(reach.max(initial=0.0)))

    def meets_housing(self, pose: np.ndarray) -> bool:
        low, high = np.array(self._sensor.housing_low_m), np.asarray(self._sensor.housing_high_m)
        low[0] -= np.linalg.norm(np.ptp(self._patches.surface.vertices, axis=0))  # its way there
        swept = replace(self._sensor, housing_low_m=tuple(low))
        return meets_housing(corners_in(self._patches, pose, in_box(self._patches, pose, low, high)), swept)

    def see(self, pose: np.ndarray, near: Near) -> TouchImage:
        pressed = near.bounds > 0
        faces, triangles = near.faces[pressed], near.triangles[pressed]
        return contact_image(self._patches, self._sensor, self._grid, pose, faces, triangles)


def contact_image(
    patches: FacePatches,
    sensor: Sensor,
    grid: RayGrid,
    pose: np.ndarray,
    faces: np.ndarray,
    triangles: np.ndarray,
) -> TouchImage:
    """One image of faces, whose corners are `triangles` (m, 3, 3) in the sensor frame, through the gel.

    As a graphics processor does, each face is shaded once in each pixel it covers, at the middle of the rays
    that it covers there, and counts with their number.
    """
    camera = np.asarray(sensor.camera_position_m)
    shape, count = (sensor.image_height, sensor.image_width), grid.samples**2
    seen = rasterise(triangles - camera, grid)
    row = seen.sample // len(grid.u)
    column = seen.sample - row * len(grid.u)
    part, group, covered = np.unique(
        (row // count * len(grid.u) + column) * len(faces) + seen.face,
        return_inverse=True,
        return_counts=True,
    )
    pixel, face = np.divmod(part, max(len(faces), 1))

    def middle(values: np.ndarray) -> np.ndarray:
        return np.bincount(group, values, len(part)) / covered

    u, v = middle(grid.u[column] + grid.shift[row]), middle(grid.v[row])
    # One over the depth is linear over a face, and so are barycentric coordinates over the depth.
    depth = 1 / middle(1 / seen.depth)
    barycentric = np.stack([middle(weight / seen.depth) for weight in seen.barycentric]) * depth
    positions = camera[:, None] + depth * np.stack([np.ones_like(u), u, v])
    normals = np.einsum("ki,ikj->ji", barycentric, patches.corner_normals[faces[face]])
    flat = pose[:3, :3].T @ patches.face_normals[faces[face]].T
    facing = flat[0] + flat[1] * u + flat[2] * v
    # Whichever side is seen is lit: a shell turned inside out looks as the shell does.
    normals = (pose[:3, :3].T @ normals) * -np.sign(facing)
    indentation = np.maximum(gel_surface(sensor, positions[1], positions[2]) - positions[0], 0.0)

    def mean(values: np.ndarray | float) -> np.ndarray:
        return np.bincount(pixel, covered * values, shape[0] * shape[1]) / count

    contact = mean(1.0)
    shown = np.stack([mean(value) for value in shade(sensor, positions, normals).T], axis=1)
    values = shown.astype(np.float32) + grid.gel_values * (1 - contact).astype(np.float32)[:, None]
    return TouchImage(
        rgb=to_bytes(values).reshape(*shape, 3),
        depth=(np.floor(mean(indentation) * DEPTH_STEPS_PER_M) / DEPTH_STEPS_PER_M)
        .astype(np.float32)
        .reshape(shape),
        mask=(contact >= 0.5).reshape(shape),
        contact_area_m2=float(np.sum(covered * depth**2 / np.abs(facing)) * grid.cell),
    )
