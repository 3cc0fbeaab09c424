"""Images of touches by rays that are each looked up: the oracle of `objectfolder.touch.rendering`."""

import numpy as np

from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.rendering.simulator import Near, Simulator, TouchImage
from objectfolder.touch.sensor.camera import DEPTH_STEPS_PER_M, RayGrid, coverage_grid, to_bytes
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade


class ReferenceSimulator(Simulator):
    """What `Simulator` answers, with images of its own."""

    def __init__(self, patches: FacePatches, sensor: Sensor, samples: int) -> None:
        super().__init__(patches, sensor, samples)
        self._grid = coverage_grid(sensor, samples)

    def see(self, pose: np.ndarray, near: Near) -> TouchImage:
        pressed = near.bounds > 0
        faces, triangles = near.faces[pressed], near.triangles[pressed]
        return contact_image(self._patches, self._sensor, self._grid, pose, faces, triangles)


def first_faces(
    triangles: np.ndarray, grid: RayGrid
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rays that meet a face before the gel: their numbers, and face, weights (k, 3) and depth (k,) of each.

    Corners of `triangles` (m, 3, 3) are from the camera, in the sensor's axes, metres.
    """
    if len(triangles) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0)
    u = (grid.u + grid.shift[:, None]).ravel()
    rays = np.stack([np.ones_like(u), u, np.repeat(grid.v, len(grid.u))], axis=1)
    met = Surface(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    hits = met.ray_hits(grid.near * rays, rays)
    depth = grid.near + hits.distance
    sample = np.flatnonzero((hits.face >= 0) & (depth < grid.gel_depth))
    return sample, hits.face[sample], hits.barycentric[sample], depth[sample]


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
    sample, met, weights, near = first_faces(triangles - camera, grid)
    row, column = np.divmod(sample, len(grid.u))
    part, group, covered = np.unique(
        (row // count * len(grid.u) + column) * len(faces) + met,
        return_inverse=True,
        return_counts=True,
    )
    pixel, face = np.divmod(part, max(len(faces), 1))

    def middle(values: np.ndarray) -> np.ndarray:
        return np.bincount(group, values, len(part)) / covered

    u, v = middle(grid.u[column] + grid.shift[row]), middle(grid.v[row])
    # One over the depth is linear over a face, and so are barycentric coordinates over the depth.
    depth = 1 / middle(1 / near)
    barycentric = np.stack([middle(weight / near) for weight in weights.T]) * depth
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
