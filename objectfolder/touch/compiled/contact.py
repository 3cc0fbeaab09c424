"""Mean normals, poses of first touch and indentations.

Each as its namesake in `objectfolder.touch.contact.pose` or `objectfolder.touch.contact.gel_contact`,
which say what and why.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel
from objectfolder.touch.contact.gel_contact import ON_EDGE
from objectfolder.touch.sensor.sensor import Sensor


def gel_constants(sensor: Sensor) -> np.ndarray:
    """What the kernels know of a gel (10,): apex, half extents along y and z, radius, stretch, camera, near.

    The camera and its near plane by their x; last, `contact.ON_EDGE`.
    """
    camera = sensor.camera_position_m[0]
    half = (sensor.gel_width_m / 2, sensor.gel_height_m / 2)
    shape = (sensor.gel_radius_m, sensor.gel_stretch)
    return np.array([*sensor.gel_apex_m, *half, *shape, camera, camera + sensor.near_m, ON_EDGE])


@kernel
def _angle(px, py, pz, qx, qy, qz, normal):
    x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    return np.arctan2(x * normal[0] + y * normal[1] + z * normal[2], px * qx + py * qy + pz * qz)


@kernel
def _disc_overlap(triangle, height, normal, point, squared_radius):
    """Area that a triangle shares with the disc, in its plane, of the ball round a point."""
    area = 0.0
    cx, cy, cz = point[0] + height * normal[0], point[1] + height * normal[1], point[2] + height * normal[2]
    for start in range(3):
        p, q = triangle[start], triangle[(start + 1) % 3]
        px, py, pz = p[0] - cx, p[1] - cy, p[2] - cz
        qx, qy, qz = q[0] - cx, q[1] - cy, q[2] - cz
        dx, dy, dz = qx - px, qy - py, qz - pz
        a = dx * dx + dy * dy + dz * dz
        half_b = dx * px + dy * py + dz * pz
        c = px * px + py * py + pz * pz - squared_radius
        root = np.sqrt(max(half_b * half_b - a * c, 0.0))
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


@kernel
def contact_normals(points, shading_normals, starts, faces, triangles, face_normals, radius, other_side):
    """Mean normals (n, 3) of the faces in balls, as `pose.contact_normal`.

    Parameters
    ----------
    points, shading_normals
        (n, 3).
    starts, faces
        As of `FaceTree.in_balls`.
    triangles, face_normals
        (F, 3, 3), (F, 3).
    radius
        Metres.
    other_side
        Cosine from which on a face is another side of a thin part.
    """
    count = len(points)
    normals = np.empty((count, 3))
    for i in range(count):
        point, normal = points[i], shading_normals[i]
        x, y, z = 0.0, 0.0, 0.0
        for position in range(starts[i], starts[i + 1]):
            flat = face_normals[faces[position]]
            facing = flat[0] * normal[0] + flat[1] * normal[1] + flat[2] * normal[2]
            side = min(max(1 - facing / other_side, 0.0), 1.0)
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
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-3 * radius * radius:
            normals[i, 0], normals[i, 1], normals[i, 2] = x / length, y / length, z / length
        else:
            normals[i] = normal
    return normals


@kernel
def _contact_frame(normal, pole, frame):
    x, y, z = normal[0], normal[1], normal[2]
    frame[0, 0], frame[1, 0], frame[2, 0] = -x, -y, -z
    if z < 0 and x * x + y * y < pole * pole:
        turn = 1 / (1 - z)
        frame[0, 1], frame[1, 1], frame[2, 1] = 1 - turn * x * x, -turn * x * y, x
        frame[0, 2], frame[1, 2], frame[2, 2] = -turn * x * y, 1 - turn * y * y, y
        return
    lateral = np.hypot(x, y)
    cosine, sine = 1.0, 0.0
    if lateral > 0:
        cosine, sine = x / lateral, y / lateral
    turn = lateral * lateral / (1 + z) if z > 0 else 1 - z
    frame[0, 1], frame[1, 1], frame[2, 1] = turn * cosine * cosine - 1, turn * cosine * sine, x
    frame[0, 2], frame[1, 2], frame[2, 2] = -turn * cosine * sine, 1 - turn * sine * sine, -y


@kernel
def _tilt(frame, tilt, azimuth):
    """Lean a contact frame (3, 3) in place by Rodrigues' rotation."""
    tx = np.sin(azimuth) * frame[0, 2] - np.cos(azimuth) * frame[0, 1]
    ty = np.sin(azimuth) * frame[1, 2] - np.cos(azimuth) * frame[1, 1]
    tz = np.sin(azimuth) * frame[2, 2] - np.cos(azimuth) * frame[2, 1]
    bx, by, bz = -frame[0, 0], -frame[1, 0], -frame[2, 0]
    ax, ay, az = by * tz - bz * ty, bz * tx - bx * tz, bx * ty - by * tx
    cosine, sine = np.cos(tilt), np.sin(tilt)
    for column in range(3):
        x, y, z = frame[0, column], frame[1, column], frame[2, column]
        along = ax * x + ay * y + az * z
        frame[0, column] = cosine * (x - ax * along) + sine * (ay * z - az * y) + ax * along
        frame[1, column] = cosine * (y - ay * along) + sine * (az * x - ax * z) + ay * along
        frame[2, column] = cosine * (z - az * along) + sine * (ax * y - ay * x) + az * along


@kernel
def first_touch_poses(points, normals, tilt, azimuth, gel, pole):
    """Poses (n, 4, 4) of first touch, as `pose.first_touch_pose`; angles in radians."""
    count = len(points)
    radius, stretch = gel[5], gel[6]
    poses = np.zeros((count, 4, 4))
    for i in range(count):
        pose, normal = poses[i], normals[i]
        pose[3, 3] = 1.0
        _contact_frame(normal, pole, pose)
        if tilt[i] != 0:
            _tilt(pose, tilt[i], azimuth[i])
        inward = np.zeros(3)
        for axis in range(3):
            for k in range(3):
                inward[axis] -= normal[k] * pose[k, axis]
        y, z = inward[1] / inward[0], inward[2] / inward[0]
        scale = radius / np.sqrt(stretch * stretch + (y * y + z * z)) if stretch > 0 else 0.0
        y, z = y * scale, z * scale
        sag = stretch * (radius - np.sqrt(max(radius * radius - (y * y + z * z), 0.0)))
        x, y, z = gel[0] - sag, gel[1] + y, gel[2] + z
        for axis in range(3):
            pose[axis, 3] = points[i, axis] - (pose[axis, 0] * x + pose[axis, 1] * y + pose[axis, 2] * z)
    return poses


@kernel
def _cut(low, high, value, slope):
    """Shrink an interval to where value + t slope >= 0."""
    if slope > 0:
        return max(low, -value / slope), high
    if slope < 0:
        return low, min(high, -value / slope)
    return low, -1.0 if value < 0 else high


@kernel
def _sag(gel, y, z):
    return gel[6] * (gel[5] - np.sqrt(max(gel[5] * gel[5] - (y * y + z * z), 0.0)))


@kernel
def _segment_maximum(sx, sy, sz, ax, ay, az, low, high, gel):
    """Largest indentation on s + t a, t in low..high, from the apex."""
    if not low <= high:
        return -np.inf
    radius, stretch = gel[5], gel[6]
    squared = ay * ay + az * az
    if squared > 0:
        safe = max(squared, 1e-300)
        middle = (sy * ay + sz * az) / safe
        cross = sy * az - sz * ay
        chord = np.sqrt(max(radius * radius - cross * cross / safe, 0.0))
        length = np.sqrt(safe)
        slope = ax / length
        t = -slope * chord / np.sqrt(max(stretch * stretch + slope * slope, 1e-300)) / length - middle
    else:
        t = low if ax > 0 else high
    t = min(max(t, low), high)
    x, y, z = sx + t * ax, sy + t * ay, sz + t * az
    return -_sag(gel, y, z) - x


@kernel
def _doubled_area(ay, az, by, bz, y, z):
    return (ay - y) * (bz - z) - (az - z) * (by - y)


@kernel
def _parallel_maximum(corners, gel):
    """Indentation where the gel is parallel to the triangle, if the triangle reaches there."""
    a, b, c = corners[0], corners[1], corners[2]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    radius, stretch = gel[5], gel[6]
    p, q = -ny / nx, -nz / nx
    scale = radius / np.sqrt(stretch * stretch + (p * p + q * q))
    y, z = -p * scale, -q * scale
    first = _doubled_area(b[1], b[2], c[1], c[2], y, z) / nx
    second = _doubled_area(c[1], c[2], a[1], a[2], y, z) / nx
    third = _doubled_area(a[1], a[2], b[1], b[2], y, z) / nx
    x = first * a[0] + second * b[0] + third * c[0]
    inside = first >= 0 and second >= 0 and third >= 0 and abs(y) <= gel[3] and abs(z) <= gel[4]
    if inside and x >= gel[8] - gel[0]:
        return -_sag(gel, y, z) - x
    return -np.inf


@kernel
def _border_maximum(corners, gel, axis, side):
    """Largest indentation on the part of the triangle above one border of the gel's extent."""
    sy, sz, ay, az = side * gel[3], -gel[4], 0.0, 2 * gel[4]
    if axis == 1:
        sy, sz, ay, az = -gel[3], side * gel[4], 2 * gel[3], 0.0
    a, b, c = corners[0], corners[1], corners[2]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    area, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if abs(area) <= gel[9] * np.sqrt(area * area + ny * ny + nz * nz):
        return -np.inf
    low, high, x, towards = 0.0, 1.0, 0.0, 0.0
    for opposite in range(3):
        p, q = corners[(opposite + 1) % 3], corners[(opposite + 2) % 3]
        value = _doubled_area(p[1], p[2], q[1], q[2], sy, sz) / area
        slope = _doubled_area(p[1], p[2], q[1], q[2], sy + ay, sz + az) / area - value
        low, high = _cut(low, high, value, slope)
        x += value * corners[opposite, 0]
        towards += slope * corners[opposite, 0]
    low, high = _cut(low, high, x - (gel[8] - gel[0]), towards)
    return _segment_maximum(x, sy, sz, towards, ay, az, low, high, gel)


@kernel
def _indentation(triangle, gel):
    corners = np.empty((3, 3))
    crossing = False
    for corner in range(3):
        for axis in range(3):
            corners[corner, axis] = triangle[corner, axis] - gel[axis]
        crossing |= abs(corners[corner, 1]) > gel[3] or abs(corners[corner, 2]) > gel[4]
    best = _parallel_maximum(corners, gel)
    for start in range(3):
        s, e = corners[start], corners[(start + 1) % 3]
        ax, ay, az = e[0] - s[0], e[1] - s[1], e[2] - s[2]
        low, high = _cut(0.0, 1.0, s[0] - (gel[8] - gel[0]), ax)
        low, high = _cut(low, high, gel[3] - s[1], -ay)
        low, high = _cut(low, high, gel[3] + s[1], ay)
        low, high = _cut(low, high, gel[4] - s[2], -az)
        low, high = _cut(low, high, gel[4] + s[2], az)
        best = max(best, _segment_maximum(s[0], s[1], s[2], ax, ay, az, low, high, gel))
    if crossing:
        for axis in range(2):
            for side in (-1.0, 1.0):
                best = max(best, _border_maximum(corners, gel, axis, side))
    return best


@kernel
def indentations(triangles, gel):
    """Largest indentation (m,) of the gel by each triangle, as `contact.indentations`."""
    found = np.empty(len(triangles))
    for i in range(len(triangles)):
        found[i] = _indentation(triangles[i], gel)
    return found


@kernel
def deepest(triangles, bounds, gel):
    """Largest indentation by any of the triangles (m, 3, 3), sensor frame, at least 0.

    `bounds` (m,) are as of `FaceTree.near_gel`, and `gel` as of `gel_constants`.
    """
    greatest = 0.0
    for i in range(len(triangles)):
        if bounds[i] > greatest:
            greatest = max(greatest, _indentation(triangles[i], gel))
    return greatest
