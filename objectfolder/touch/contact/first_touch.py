"""Where the sensor stands: contact normal, roll convention, tilt."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections.abc import Sequence

import numpy as np

from objectfolder.jit import arrayless, inner, kernel

# Faces turned away from the touched point's normal by more than 135 degrees are another side of a thin
# part; those within 90 degrees count fully, smoothly less between, so that no small change switches one off.
OTHER_SIDE_COSINE = -0.7071067811865476
# Flat undersides of scans, and of quantised surfaces, are flat to about this angle.
POLE_RAD = 1e-3
# Rows and columns of a rotation, or of a pose.
Frame = list[list[float]]


@inner(arrayless(kernel))
def _angle(px, py, pz, qx, qy, qz, normal):
    x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    return math.atan2(x * normal[0] + y * normal[1] + z * normal[2], px * qx + py * qy + pz * qz)


@inner(arrayless(kernel))
def _disc_overlap(triangle, height, normal, point, squared_radius):
    """Area that a triangle shares with the disc, in its plane, of the ball round a point."""
    area = 0.0
    cx, cy, cz = point[0] + height * normal[0], point[1] + height * normal[1], point[2] + height * normal[2]
    for start in range(3):
        end = (start + 1) % 3
        px, py, pz = triangle[start, 0] - cx, triangle[start, 1] - cy, triangle[start, 2] - cz
        qx, qy, qz = triangle[end, 0] - cx, triangle[end, 1] - cy, triangle[end, 2] - cz
        dx, dy, dz = qx - px, qy - py, qz - pz
        a = dx * dx + dy * dy + dz * dz
        half_b = dx * px + dy * py + dz * pz
        c = px * px + py * py + pz * pz - squared_radius
        root = math.sqrt(max(half_b * half_b - a * c, 0.0))
        safe = max(a, 1e-300)
        first = min(max((-half_b - root) / safe, 0.0), 1.0)
        last = min(max((-half_b + root) / safe, 0.0), 1.0)
        fx, fy, fz = px + first * dx, py + first * dy, pz + first * dz
        lx, ly, lz = px + last * dx, py + last * dy, pz + last * dz
        sectors = 0.0
        if first > 0:
            sectors += _angle(px, py, pz, fx, fy, fz, normal)
        if last < 1:
            sectors += _angle(lx, ly, lz, qx, qy, qz, normal)
        x, y, z = fy * lz - fz * ly, fz * lx - fx * lz, fx * ly - fy * lx
        chord = x * normal[0] + y * normal[1] + z * normal[2]
        area += (squared_radius * sectors + chord) / 2
    return max(area, 0.0)


@arrayless(kernel)
def contact_normals(points, shading_normals, starts, faces, triangles, face_normals, radius, normals):
    """Write unit mean normals (n, 3) of a surface in the balls of `radius` metres round points (n, 3) on it.

    The integral of the normal over the faces in the ball, each weighted by the exact area of its
    intersection with the ball (a disc in its plane). The other side of a blade is left out: faces turned
    more than 135 degrees from the shading normal at the point.

    Parameters
    ----------
    points, shading_normals
        (n, 3).
    starts, faces
        As of `FacePatches.in_balls`.
    triangles, face_normals
        (F, 3, 3), (F, 3).
    radius
        Metres.
    normals
        (n, 3), changed.
    """
    for i in range(len(points)):
        point, normal = points[i], shading_normals[i]
        x, y, z = 0.0, 0.0, 0.0
        for position in range(starts[i], starts[i + 1]):
            flat = face_normals[faces[position]]
            facing = flat[0] * normal[0] + flat[1] * normal[1] + flat[2] * normal[2]
            side = min(max(1 - facing / OTHER_SIDE_COSINE, 0.0), 1.0)
            if not side > 0:
                continue
            triangle = triangles[faces[position]]
            height = (
                flat[0] * (triangle[0, 0] - point[0])
                + flat[1] * (triangle[0, 1] - point[1])
                + flat[2] * (triangle[0, 2] - point[2])
            )
            squared = radius * radius - height * height
            if not squared > 0:
                continue
            area = _disc_overlap(triangle, height, flat, point, squared)
            weight = area * side * side * (3 - 2 * side)
            x, y, z = x + weight * flat[0], y + weight * flat[1], z + weight * flat[2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 1e-3 * radius * radius:
            normals[i, 0], normals[i, 1], normals[i, 2] = x / length, y / length, z / length
        else:
            normals[i, 0], normals[i, 1], normals[i, 2] = normal[0], normal[1], normal[2]


def _contact_frame(normal: Sequence[float], frame: Frame) -> None:
    """Write a rotation (3, 3), columns the sensor's axes in the object frame, for a press against `normal`.

    The sensor's x axis is -normal. Its roll is that of the shortest rotation from the object's +z to the
    normal: for a normal of +z the image's right (-y of the sensor) is the object's +x and its top (+z of
    the sensor) the object's +y. It is smooth but round the normal -z, where no convention can be: there
    the roll would turn twice round within a rounding error. Within `POLE_RAD` of -z it is that of -z
    approached from +x, carried on by the shortest rotation, so that a flat underside has one roll.
    """
    x, y, z = normal[0], normal[1], normal[2]
    frame[0][0], frame[1][0], frame[2][0] = -x, -y, -z
    if z < 0 and x * x + y * y < POLE_RAD * POLE_RAD:
        turn = 1 / (1 - z)
        frame[0][1], frame[1][1], frame[2][1] = 1 - turn * x * x, -turn * x * y, x
        frame[0][2], frame[1][2], frame[2][2] = -turn * x * y, 1 - turn * y * y, y
        return
    lateral = math.hypot(x, y)
    cosine, sine = 1.0, 0.0
    if lateral > 0:
        cosine, sine = x / lateral, y / lateral
    # 1 - z without cancellation: above, lateral^2 / (1 + z).
    turn = lateral * lateral / (1 + z) if z > 0 else 1 - z
    frame[0][1], frame[1][1], frame[2][1] = turn * cosine * cosine - 1, turn * cosine * sine, x
    frame[0][2], frame[1][2], frame[2][2] = -turn * cosine * sine, 1 - turn * sine * sine, -y


def _tilt(frame: Frame, tilt: float, azimuth: float) -> None:
    """Lean a contact frame (3, 3) in place by Rodrigues' rotation; the roll follows.

    The sensor's back moves towards the azimuth, counted from the image's right towards its top.
    """
    tx = math.sin(azimuth) * frame[0][2] - math.cos(azimuth) * frame[0][1]
    ty = math.sin(azimuth) * frame[1][2] - math.cos(azimuth) * frame[1][1]
    tz = math.sin(azimuth) * frame[2][2] - math.cos(azimuth) * frame[2][1]
    bx, by, bz = -frame[0][0], -frame[1][0], -frame[2][0]
    ax, ay, az = by * tz - bz * ty, bz * tx - bx * tz, bx * ty - by * tx
    cosine, sine = math.cos(tilt), math.sin(tilt)
    for column in range(3):
        x, y, z = frame[0][column], frame[1][column], frame[2][column]
        along = ax * x + ay * y + az * z
        frame[0][column] = cosine * (x - ax * along) + sine * (ay * z - az * y) + ax * along
        frame[1][column] = cosine * (y - ay * along) + sine * (az * x - ax * z) + ay * along
        frame[2][column] = cosine * (z - az * along) + sine * (ax * y - ay * x) + az * along


def _roll(frame: Frame, roll: float) -> None:
    """Turn a frame (3, 3) in place about the sensor's axis: the image's right moves towards its top."""
    cosine, sine = math.cos(roll), math.sin(roll)
    for row in range(3):
        y, z = frame[row][1], frame[row][2]
        frame[row][1], frame[row][2] = cosine * y - sine * z, sine * y + cosine * z


def first_touch_poses(
    points: np.ndarray, normals: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray, roll: np.ndarray,
    gel: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Poses (n, 4, 4), sensor_to_object, in which the undeformed gel just touches a flat surface at points.

    A tilted sensor rolls over the point on its curved gel: the gel's normal there opposes the surface's.
    Where it would roll beyond the gel's border, or the gel is flat, the apex is at the point.

    Parameters
    ----------
    points, normals
        (n, 3).
    tilt, azimuth, roll
        (n,) radians; the roll is about the axis of the leaning sensor, and turns no lean.
    gel
        As of `gel.gel_constants`.
    """
    rows = zip(points.tolist(), normals.tolist(), tilt.tolist(), azimuth.tolist(), roll.tolist(), strict=True)
    constants = gel.tolist()
    poses = [[[0.0] * 4, [0.0] * 4, [0.0] * 4, [0.0, 0.0, 0.0, 1.0]] for _ in points]
    for row, pose in zip(rows, poses, strict=True):
        _first_touch_pose(*row, constants, pose)
    return np.array(poses).reshape(-1, 4, 4)


def _first_touch_pose(
    point: Sequence[float], normal: Sequence[float], tilt: float, azimuth: float, roll: float,
    gel: Sequence[float], pose: Frame,
) -> None:  # fmt: skip
    """Write the pose of one touch over the identity's last row."""
    radius, stretch = gel[5], gel[6]
    _contact_frame(normal, pose)
    if tilt != 0:
        _tilt(pose, tilt, azimuth)
    if roll != 0:
        _roll(pose, roll)
    x = -(normal[0] * pose[0][0] + normal[1] * pose[1][0] + normal[2] * pose[2][0])
    y = -(normal[0] * pose[0][1] + normal[1] * pose[1][1] + normal[2] * pose[2][1])
    z = -(normal[0] * pose[0][2] + normal[1] * pose[1][2] + normal[2] * pose[2][2])
    y, z = y / x, z / x
    scale = radius / math.sqrt(stretch * stretch + (y * y + z * z)) if stretch > 0 else 0.0
    y, z = y * scale, z * scale
    # Too flat a gel leans less than this at its border: its apex touches, as that of a flat one.
    if abs(y) > gel[3] or abs(z) > gel[4]:
        y, z = 0.0, 0.0
    sag = stretch * (radius - math.sqrt(max(radius * radius - (y * y + z * z), 0.0)))
    x, y, z = gel[0] - sag, gel[1] + y, gel[2] + z
    for axis in range(3):
        pose[axis][3] = point[axis] - (pose[axis][0] * x + pose[axis][1] * y + pose[axis][2] * z)
