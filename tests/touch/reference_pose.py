"""Where the sensor stands, by array arithmetic: the oracle of the compiled kernels."""

import numpy as np
from reference_contact import near
from scipy.spatial.transform import Rotation

from objectfolder.touch.contact.first_touch import OTHER_SIDE_COSINE, POLE_RAD
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.gel import gel_sag
from objectfolder.touch.sensor.sensor import Sensor


def contact_normal(patches: FacePatches, point: np.ndarray, normal: np.ndarray, radius: float) -> np.ndarray:
    """Unit mean normal (3,) of the surface in the ball of `radius` metres round a point (3,) on it.

    The integral of the normal over the faces in the ball, each weighted by the exact area of its
    intersection with the ball (a disc in its plane). The other side of a blade is left out: faces turned
    more than 135 degrees from `normal`, the shading normal (3,) at the point.
    """
    faces = near(patches, point, radius)
    side = np.clip(1 - (patches.face_normals[faces] @ normal) / OTHER_SIDE_COSINE, 0.0, 1.0)
    faces, side = faces[side > 0], side[side > 0]
    face_normals = patches.face_normals[faces]
    triangles = patches.triangles[faces] - point
    height = np.einsum("ij,ij->i", face_normals, triangles[:, 0])
    corners = triangles - (height[:, None] * face_normals)[:, None]
    area = _disc_overlap(corners, face_normals, np.maximum(radius**2 - height**2, 0.0))
    total = (area * side * side * (3 - 2 * side)) @ face_normals
    length = np.linalg.norm(total)
    return np.asarray(total / length if length > 1e-3 * radius**2 else normal)


def _disc_overlap(corners: np.ndarray, normals: np.ndarray, squared_radius: np.ndarray) -> np.ndarray:
    """Area (m,) that triangles (m, 3, 3), in planes through the origin, share with a disc round it."""
    area = np.zeros(len(corners))
    for start, end in ((0, 1), (1, 2), (2, 0)):
        p, q = corners[:, start], corners[:, end]
        along = q - p
        a = np.einsum("ij,ij->i", along, along)
        half_b = np.einsum("ij,ij->i", along, p)
        c = np.einsum("ij,ij->i", p, p) - squared_radius
        root = np.sqrt(np.maximum(half_b**2 - a * c, 0.0))
        safe = np.maximum(a, 1e-300)
        first = p + np.clip((-half_b - root) / safe, 0.0, 1.0)[:, None] * along
        last = p + np.clip((-half_b + root) / safe, 0.0, 1.0)[:, None] * along
        sectors = _angle(p, first, normals) + _angle(last, q, normals)
        chord = np.einsum("ij,ij->i", np.cross(first, last), normals)
        area += (squared_radius * sectors + chord) / 2
    return np.maximum(area, 0.0)


def _angle(p: np.ndarray, q: np.ndarray, normals: np.ndarray) -> np.ndarray:
    return np.arctan2(np.einsum("ij,ij->i", np.cross(p, q), normals), np.einsum("ij,ij->i", p, q))


def contact_frame(normal: np.ndarray) -> np.ndarray:
    """Rotation (3, 3), columns the sensor's x, y, z axes in the object frame, for a press against `normal`.

    The sensor's x axis is -normal. Its roll is that of the shortest rotation from the object's +z to the
    normal: for a normal of +z the image's right (-y of the sensor) is the object's +x and its top (+z of
    the sensor) the object's +y. It is smooth but round the normal -z, where no convention can be: there
    the roll would turn twice round within a rounding error. Within `POLE_RAD` of -z it is that of -z
    approached from +x, carried on by the shortest rotation, so that a flat underside has one roll.
    """
    x, y, z = (float(part) for part in normal)
    if z < 0 and x * x + y * y < POLE_RAD**2:
        turn = 1 / (1 - z)
        right = np.array([turn * x * x - 1, turn * x * y, -x])
        up = np.array([-turn * x * y, 1 - turn * y * y, y])
    else:
        lateral = float(np.hypot(x, y))
        cosine, sine = (x / lateral, y / lateral) if lateral > 0 else (1.0, 0.0)
        # 1 - z without cancellation: above, lateral^2 / (1 + z).
        turn = lateral * lateral / (1 + z) if z > 0 else 1 - z
        right = np.array([1 - turn * cosine * cosine, -turn * cosine * sine, -x])
        up = np.array([-turn * cosine * sine, 1 - turn * sine * sine, -y])
    return np.stack([-np.array([x, y, z]), -right, up], axis=1)


def tilted(frame: np.ndarray, tilt_rad: float, azimuth_rad: float) -> np.ndarray:
    """Turn a contact frame (3, 3) so that the sensor's axis leans by `tilt_rad`.

    The sensor's back moves towards the azimuth, counted from the image's right towards its top; the
    roll follows by the shortest rotation.
    """
    towards = np.sin(azimuth_rad) * frame[:, 2] - np.cos(azimuth_rad) * frame[:, 1]
    axis = np.cross(-frame[:, 0], towards)
    parallel = np.outer(axis, axis @ frame)
    turned = np.cross(axis, frame.T).T
    return np.asarray(np.cos(tilt_rad) * (frame - parallel) + np.sin(tilt_rad) * turned + parallel)


def first_touch_pose(
    sensor: Sensor,
    point: np.ndarray,
    normal: np.ndarray,
    tilt_rad: float,
    azimuth_rad: float,
    roll_rad: float,
) -> np.ndarray:
    """Pose sensor_to_object (4, 4) in which the undeformed gel just touches a flat surface at `point`.

    A tilted sensor rolls over the point on its curved gel: the gel's normal there opposes the surface's.
    """
    rotation = contact_frame(normal)
    if tilt_rad != 0:
        rotation = tilted(rotation, tilt_rad, azimuth_rad)
    # About the sensor's axis, from right (-y) towards top (z).
    rotation = rotation @ Rotation.from_rotvec([-roll_rad, 0.0, 0.0]).as_matrix()
    inward = -(normal @ rotation)
    on_gel = gel_point_with_slope(sensor, inward[1] / inward[0], inward[2] / inward[0])
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = point - rotation @ on_gel
    return pose


def gel_point_with_slope(sensor: Sensor, slope_y: np.ndarray, slope_z: np.ndarray) -> np.ndarray:
    """Point (n, 3) of the gel whose outward normal is along (1, slope_y, slope_z).

    A gel without curvature has one normal; its apex is returned.
    """
    stretch, radius = sensor.gel_stretch, sensor.gel_radius_m
    slope = np.stack([slope_y, slope_z], axis=-1)
    scale = radius / np.sqrt(stretch**2 + np.sum(slope**2, axis=-1, keepdims=True)) if stretch > 0 else 0.0
    lateral = slope * scale
    sag = gel_sag(sensor, np.sum(lateral**2, axis=-1))
    return np.asarray(sensor.gel_apex_m) + np.concatenate([-sag[..., None], lateral], axis=-1)
