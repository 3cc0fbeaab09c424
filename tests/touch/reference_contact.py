"""Contact of faces with the gel and the housing by array arithmetic: the oracle of the compiled kernels."""

import numpy as np

from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.gel import gel_sag
from objectfolder.touch.sensor.sensor import Sensor

_EDGES = ((0, 1), (1, 2), (2, 0))
# A face seen along the sensor's axis with less than this share of its area is on edge: where it lies above a
# border is then rounding, and its edges, which are looked at by themselves, are all there is of it.
ON_EDGE = 1e-9


def near(patches: FacePatches, centre: np.ndarray, radius: float) -> np.ndarray:
    """Faces whose bounding sphere meets the ball (centre (3,), radius), metres."""
    low, high = patches.triangles.min(axis=1), patches.triangles.max(axis=1)
    centres = (low + high) / 2
    radii = np.linalg.norm(patches.triangles - centres[:, None], axis=2).max(axis=1)
    return np.flatnonzero(np.linalg.norm(centres - centre, axis=1) <= radii + radius)


def in_box(patches: FacePatches, pose: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Faces that may meet a box, given by its corners (3,) in the frame of `pose` (4, 4)."""
    local = corners_in(patches, pose, np.arange(len(patches.triangles)))
    meets = (local.min(axis=1) <= high).all(axis=1) & (local.max(axis=1) >= low).all(axis=1)
    return np.flatnonzero(meets)


def corners_in(patches: FacePatches, pose: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corners (m, 3, 3) of `faces` (m,) in the frame of `pose`; shared corners get equal bits."""
    triangles = patches.triangles[faces]
    x, y, z = (triangles[..., axis] - pose[axis, 3] for axis in range(3))
    return np.stack([x * r[0] + y * r[1] + z * r[2] for r in pose[:3, :3].T], axis=-1)


def near_gel(
    patches: FacePatches, sensor: Sensor, pose: np.ndarray, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Faces that may reach deeper into the gel than `least` metres, and their corners in the sensor frame."""
    apex = np.asarray(sensor.gel_apex_m)
    half = np.array([0.0, sensor.gel_width_m / 2, sensor.gel_height_m / 2])
    low, high = apex - half, apex + half
    low[0], high[0] = sensor.camera_position_m[0], apex[0] - least
    near = in_box(patches, pose, low, high)
    triangles = corners_in(patches, pose, near)
    kept = np.flatnonzero(may_indent(triangles, sensor, least))
    return near[kept], triangles[kept]


def may_indent(triangles: np.ndarray, sensor: Sensor, least: float) -> np.ndarray:
    """Whether (m,) triangles (m, 3, 3), sensor frame, may reach deeper into the gel than `least` metres."""
    low, high = _bounds(triangles)
    apex = np.asarray(sensor.gel_apex_m)
    half = np.array([sensor.gel_width_m, sensor.gel_height_m]) / 2
    nearest = np.maximum(0.0, np.maximum(low[:, 1:] - apex[1:], apex[1:] - high[:, 1:]))
    indentation = apex[0] - gel_sag(sensor, np.einsum("ij,ij->i", nearest, nearest)) - low[:, 0]
    in_body = high[:, 0] >= sensor.camera_position_m[0] + sensor.near_m
    return np.asarray((indentation > least) & (nearest <= half).all(axis=1) & in_body)


def _bounds(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def indentations(triangles: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Largest indentation (m,) of the gel by each triangle, along the sensor's axis, metres.

    The indentation gel_x(y, z) - x is concave over a triangle, so its maximum over the part of the
    triangle under the gel and ahead of the camera is at the one point where the gel is parallel to the
    triangle, or on a border: an edge of the triangle, or of the gel. All have closed forms. Of a face
    that crosses the camera's near plane, and so fills the sensor, only the ends of the cut are tried.

    Parameters
    ----------
    triangles
        (m, 3, 3), sensor frame, metres.

    Returns
    -------
    np.ndarray
        (m,); -infinity for a triangle outside the gel's extent.
    """
    apex = np.asarray(sensor.gel_apex_m)
    corners = triangles - apex
    rear = sensor.camera_position_m[0] + sensor.near_m - apex[0]
    half = np.array([sensor.gel_width_m, sensor.gel_height_m]) / 2
    best = np.full(len(corners), -np.inf)
    for start, end in _EDGES:
        interval = _clip_to_gel(corners[:, start], corners[:, end] - corners[:, start], half, rear)
        reach = _segment_maximum(corners[:, start], corners[:, end] - corners[:, start], interval, sensor)
        best = np.maximum(best, reach)
    best = np.maximum(best, _parallel_maximum(corners, sensor, half, rear))
    crossing = np.flatnonzero((np.abs(corners[:, :, 1:]) > half).any(axis=(1, 2)))
    for axis in (0, 1):
        for side in (-1.0, 1.0):
            reach = _border_maximum(corners[crossing], sensor, half, axis, side, rear)
            best[crossing] = np.maximum(best[crossing], reach)
    return best


def _clip_to_gel(
    start: np.ndarray, along: np.ndarray, half: np.ndarray, rear: float
) -> tuple[np.ndarray, np.ndarray]:
    """Interval of t in which start + t along, t in 0..1, lies under the gel and ahead of the camera."""
    low, high = np.zeros(len(start)), np.ones(len(start))
    margins = [(start[:, 0] - rear, along[:, 0])]
    for axis in (0, 1):
        margins += [(half[axis] - start[:, 1 + axis], -along[:, 1 + axis])]
        margins += [(half[axis] + start[:, 1 + axis], along[:, 1 + axis])]
    for value, slope in margins:
        _cut(low, high, value, slope)
    return low, high


def _cut(low: np.ndarray, high: np.ndarray, value: np.ndarray, slope: np.ndarray) -> None:
    """Shrink intervals in place to where value + t slope >= 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        root = -value / slope
    np.maximum(low, root, out=low, where=slope > 0)
    np.minimum(high, root, out=high, where=slope < 0)
    high[(slope == 0) & (value < 0)] = -1.0


def _segment_maximum(
    start: np.ndarray, along: np.ndarray, interval: tuple[np.ndarray, np.ndarray], sensor: Sensor
) -> np.ndarray:
    """Largest indentation on start + t along, t in `interval`, from the apex; -infinity if it is empty."""
    low, high = interval
    stretch, radius = sensor.gel_stretch, sensor.gel_radius_m
    squared = along[:, 1] ** 2 + along[:, 2] ** 2
    safe = np.maximum(squared, 1e-300)
    middle = (start[:, 1] * along[:, 1] + start[:, 2] * along[:, 2]) / safe
    cross = start[:, 1] * along[:, 2] - start[:, 2] * along[:, 1]
    chord = np.sqrt(np.maximum(radius**2 - cross**2 / safe, 0.0))
    # d/dt of the indentation vanishes where stretch w / sqrt(chord^2 - w^2) = -slope, w = (t + middle) |d|.
    length = np.sqrt(safe)
    slope = along[:, 0] / length
    with np.errstate(over="ignore"):
        best = -slope * chord / np.sqrt(np.maximum(stretch**2 + slope**2, 1e-300)) / length - middle
    best = np.where(squared > 0, best, np.where(along[:, 0] > 0, low, high))
    t = np.clip(best, low, np.maximum(low, high))
    at = start + t[:, None] * along
    value = -gel_sag(sensor, at[:, 1] ** 2 + at[:, 2] ** 2) - at[:, 0]
    return np.where(low <= high, value, -np.inf)


def _parallel_maximum(corners: np.ndarray, sensor: Sensor, half: np.ndarray, rear: float) -> np.ndarray:
    """Indentation where the gel is parallel to each triangle, if the triangle reaches there."""
    stretch, radius = sensor.gel_stretch, sensor.gel_radius_m
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = -normal[:, 1:] / normal[:, :1]
        scale = radius / np.sqrt(stretch**2 + np.einsum("ij,ij->i", slope, slope))
        at = -slope * scale[:, None]
        first = _doubled_area(b, c, at) / normal[:, 0]
        second = _doubled_area(c, a, at) / normal[:, 0]
        third = _doubled_area(a, b, at) / normal[:, 0]
        x = first * a[:, 0] + second * b[:, 0] + third * c[:, 0]
        value = -gel_sag(sensor, np.einsum("ij,ij->i", at, at)) - x
        inside = (first >= 0) & (second >= 0) & (third >= 0)
        inside &= (np.abs(at) <= half).all(axis=1) & (x >= rear)
    return np.where(inside, value, -np.inf)


def _doubled_area(a: np.ndarray, b: np.ndarray, at: np.ndarray) -> np.ndarray:
    return np.asarray(
        (a[:, 1] - at[:, 0]) * (b[:, 2] - at[:, 1]) - (a[:, 2] - at[:, 1]) * (b[:, 1] - at[:, 0])
    )


def _border_maximum(
    corners: np.ndarray, sensor: Sensor, half: np.ndarray, axis: int, side: float, rear: float
) -> np.ndarray:
    """Largest indentation on the part of each triangle above one border of the gel's extent."""
    other = 1 - axis
    start, along = np.zeros(2), np.zeros(2)
    start[axis] = side * half[axis]
    start[other], along[other] = -half[other], 2 * half[other]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    area = normal[:, 0]
    usable = np.abs(area) > ON_EDGE * np.linalg.norm(normal, axis=1)
    area = np.where(usable, area, 1.0)
    low, high = np.zeros(len(corners)), np.where(usable, 1.0, -1.0)
    at = np.zeros((len(corners), 3))
    towards = np.zeros((len(corners), 3))
    at[:, 1:], towards[:, 1:] = start, along
    for (p, q), opposite in zip(((b, c), (c, a), (a, b)), (a, b, c), strict=True):
        value = _doubled_area(p, q, np.broadcast_to(start, (len(corners), 2))) / area
        slope = _doubled_area(p, q, np.broadcast_to(start + along, (len(corners), 2))) / area - value
        _cut(low, high, value, slope)
        at[:, 0] += value * opposite[:, 0]
        towards[:, 0] += slope * opposite[:, 0]
    _cut(low, high, at[:, 0] - rear, towards[:, 0])
    return _segment_maximum(at, towards, (low, high), sensor)


def meets_housing(triangles: np.ndarray, sensor: Sensor) -> bool:
    """Whether any triangle (m, 3, 3), sensor frame, enters the housing's box.

    Separating axes of a triangle and a box (Akenine-Möller 2001); touching is not entering.
    """
    low, high = np.asarray(sensor.housing_low_m), np.asarray(sensor.housing_high_m)
    half = (high - low) / 2
    lowest, highest = _bounds(triangles)
    overlapping = ((lowest < high) & (highest > low)).all(axis=1)
    corners = triangles[overlapping] - (low + high) / 2
    if len(corners) == 0:
        return False
    edges = corners[:, [1, 2, 0]] - corners
    axes = [np.cross(edges[:, 0], edges[:, 1])]
    axes += [np.cross(np.eye(3)[axis], edges[:, edge]) for axis in range(3) for edge in range(3)]
    apart = np.zeros(len(corners), dtype=bool)
    for axis in axes:
        projected = np.einsum("ijk,ik->ij", corners, axis)
        reach = np.abs(axis) @ half
        separates = (projected.min(axis=1) >= reach) | (projected.max(axis=1) <= -reach)
        apart |= separates & (reach > 0)
    return bool((~apart).any())
