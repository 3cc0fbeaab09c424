"""Geometry of the undeformed gel: a spherical cap, stretched along the sensor's axis.

x = apex - s (R - sqrt(R^2 - r^2)), r^2 = y^2 + z^2 from the apex, s the stretch.
"""

import numpy as np

from objectfolder.touch.sensor.sensor import Sensor


def gel_constants(sensor: Sensor) -> np.ndarray:
    """What the kernels know of a gel (9,): apex, half extents along y and z, radius, stretch, camera, near.

    The camera and its near plane by their x.
    """
    camera = sensor.camera_position_m[0]
    half = (sensor.gel_width_m / 2, sensor.gel_height_m / 2)
    shape = (sensor.gel_radius_m, sensor.gel_stretch)
    return np.array([*sensor.gel_apex_m, *half, *shape, camera, camera + sensor.near_m])


def gel_sag(sensor: Sensor, squared_radius: np.ndarray) -> np.ndarray:
    """Metres that the gel lies behind its apex at squared distances r^2 (m^2) from the axis."""
    radius = sensor.gel_radius_m
    return sensor.gel_stretch * (radius - np.sqrt(np.maximum(radius**2 - squared_radius, 0.0)))


def gel_surface(sensor: Sensor, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Coordinate x of the gel at (y, z), all in the sensor frame, metres."""
    apex = sensor.gel_apex_m
    return apex[0] - gel_sag(sensor, (y - apex[1]) ** 2 + (z - apex[2]) ** 2)


def gel_along_rays(sensor: Sensor, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Depth x - x_camera at which rays camera + depth (1, u, v) meet the gel from inside, metres."""
    stretch, radius = sensor.gel_stretch, sensor.gel_radius_m
    x, y, z = np.asarray(sensor.camera_position_m) - np.asarray(sensor.gel_apex_m)
    # (x + d + s R)^2 = s^2 (R^2 - (y + u d)^2 - (z + v d)^2), a quadratic in d.
    a = 1 + stretch**2 * (u**2 + v**2)
    half_b = x + stretch * radius + stretch**2 * (u * y + v * z)
    c = (x + stretch * radius) ** 2 - stretch**2 * (radius**2 - y**2 - z**2)
    return np.asarray((-half_b + np.sqrt(half_b**2 - a * c)) / a)


def gel_normals(sensor: Sensor, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Unit normals (3, n) of the gel at (y, z), towards the camera."""
    stretch, radius = sensor.gel_stretch, sensor.gel_radius_m
    y, z = y - sensor.gel_apex_m[1], z - sensor.gel_apex_m[2]
    sphere = np.sqrt(radius**2 - y**2 - z**2)
    normal = np.stack([-np.ones_like(y), -stretch * y / sphere, -stretch * z / sphere])
    return np.asarray(normal / np.sqrt(np.sum(normal**2, axis=0)))


def gel_slopes(sensor: Sensor, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes dx/dy and dx/dz of the undeformed gel."""
    y, z = y - sensor.gel_apex_m[1], z - sensor.gel_apex_m[2]
    scale = -sensor.gel_stretch / np.sqrt(sensor.gel_radius_m**2 - y * y - z * z)
    return scale * y, scale * z
