"""What the sensor's camera sees at a pose: colour, depth in the gel, contact."""

from dataclasses import dataclass

import numpy as np

from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.gel_contact import may_indent
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.rendering.backends import make_simulator
from objectfolder.touch.rendering.rasterise import rasterise
from objectfolder.touch.sensor.camera import CoverageGrid, to_bytes
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade

# Depth maps are multiples of 2^-23 m (0.12 micrometres), exact in float32, so that they compress.
DEPTH_STEPS_PER_M = 2.0**23


@dataclass(frozen=True)
class ContactImage:
    """One image; the fields are those of `press.Touches`, without the first axis."""

    rgb: np.ndarray
    depth: np.ndarray
    mask: np.ndarray
    contact_area_m2: float


def render_poses(
    surface: Surface | FacePatches,
    sensor: Sensor,
    sensor_to_object: np.ndarray,
    samples: int = 2,
    backend: str | None = None,
) -> list[ContactImage]:
    """See through the gel at poses (n, 4, 4), wherever they are: one image a pose.

    `backend` is chosen as `backends.choose_backend` says.
    """
    patches = surface if isinstance(surface, FacePatches) else FacePatches(surface)
    simulator = make_simulator(backend, patches, sensor, samples)
    results = []
    for pose in np.asarray(sensor_to_object, dtype=np.float64).reshape(-1, 4, 4):
        shape = sensor.image_height, sensor.image_width
        rgb = np.empty((*shape, 3), dtype=np.uint8)
        depth, mask = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=bool)
        area = simulator.see(pose, simulator.approach(pose, 0.0), rgb, depth, mask)
        results.append(ContactImage(rgb, depth, mask, area))
    return results


def near_gel(
    patches: FacePatches, sensor: Sensor, pose: np.ndarray, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Faces that may reach deeper into the gel than `least` metres, and their corners in the sensor frame."""
    apex = np.asarray(sensor.gel_apex_m)
    half = np.array([0.0, sensor.gel_width_m / 2, sensor.gel_height_m / 2])
    low, high = apex - half, apex + half
    low[0], high[0] = sensor.camera_position_m[0], apex[0] - least
    near = patches.in_box(pose, low, high)
    triangles = patches.corners_in(pose, near)
    kept = np.flatnonzero(may_indent(triangles, sensor, least))
    return near[kept], triangles[kept]


def contact_image(
    patches: FacePatches,
    sensor: Sensor,
    grid: CoverageGrid,
    pose: np.ndarray,
    faces: np.ndarray,
    triangles: np.ndarray,
) -> ContactImage:
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
    return ContactImage(
        rgb=to_bytes(values).reshape(*shape, 3),
        depth=(np.floor(mean(indentation) * DEPTH_STEPS_PER_M) / DEPTH_STEPS_PER_M)
        .astype(np.float32)
        .reshape(shape),
        mask=(contact >= 0.5).reshape(shape),
        contact_area_m2=float(np.sum(covered * depth**2 / np.abs(facing)) * grid.cell),
    )
