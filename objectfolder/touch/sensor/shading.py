"""Appearance of a surface to the sensor's camera: Cook-Torrance under point lights, or a photometric table.

Cook-Torrance is the glTF 2.0 metallic-roughness model as pyrender 0.1.45, and therefore TACTO, evaluates
it: GGX distribution, Schlick's Fresnel term and Smith's geometry term in Schlick's form, 1/d^2 falloff, no
shadows.
"""

import numpy as np

from objectfolder.touch.sensor.photometric_table import PhotometricTable
from objectfolder.touch.sensor.sensor import Sensor

DIELECTRIC_REFLECTANCE = 0.04


def shade(sensor: Sensor, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Pixel values of surface points.

    Parameters
    ----------
    positions
        (3, n) in the sensor frame, metres.
    normals
        (3, n), need not be unit.

    Returns
    -------
    np.ndarray
        (n, 3) float32 in 0..1, gamma-encoded. Single precision, as on a graphics processor.
    """
    if sensor.photometric_table is not None:
        return look_up(sensor, sensor.photometric_table, positions, normals)
    return cook_torrance(sensor, positions, normals)


def look_up(
    sensor: Sensor, table: PhotometricTable, positions: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Pixel values (n, 3) of a membrane by its table; arguments as of `shade`, normals towards the camera."""
    slope = np.arctan2(np.hypot(normals[1], normals[2]), -normals[0])
    direction = np.arctan2(normals[2], -normals[1])
    apex = sensor.gel_apex_m
    across = (apex[1] - positions[1]) / (sensor.gel_width_m / 2)
    up = (positions[2] - apex[2]) / (sensor.gel_height_m / 2)
    return table.values(slope, direction, across, up)


def cook_torrance(sensor: Sensor, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Pixel values (n, 3) under the sensor's lights; arguments as of `shade`."""
    positions = positions.astype(np.float32)
    normals = _unit(normals.astype(np.float32))
    camera = np.asarray(sensor.camera_position_m, dtype=np.float32)
    view = _unit(camera[:, None] - positions)
    nv = np.clip(np.abs(_dot(normals, view)), np.float32(0.001), np.float32(1))
    alpha2 = np.float32(sensor.roughness**4)
    k = np.float32((sensor.roughness + 1) ** 2 / 8)
    dielectric = 1 - sensor.metallic
    base = np.float32(dielectric * DIELECTRIC_REFLECTANCE + sensor.metallic * sensor.base_colour)
    diffuse = np.float32(dielectric * sensor.base_colour * (1 - DIELECTRIC_REFLECTANCE) / np.pi)
    one = np.float32(1)
    visible = nv / (nv * (one - k) + k)
    radiance = np.zeros((3, positions.shape[1]), dtype=np.float32)
    for light, colour in zip(sensor.light_positions_m, sensor.light_colours, strict=True):
        towards = np.asarray(light, dtype=np.float32)[:, None] - positions
        squared = _dot(towards, towards)
        towards /= np.sqrt(squared)
        half = _unit(towards + view)
        nl = np.clip(_dot(normals, towards), np.float32(0.001), one)
        nh = np.clip(_dot(normals, half), np.float32(0), one)
        vh = np.clip(_dot(view, half), np.float32(0), one)
        miss = one - vh
        fresnel = base + (one - base) * (miss * miss) * (miss * miss) * miss
        lobe = nh * nh * (alpha2 - one) + one
        lit = nl / (nl * (one - k) + k)
        specular = fresnel * visible * lit * (alpha2 / np.float32(np.pi)) / (lobe * lobe)
        specular /= np.float32(4) * nl * nv + np.float32(0.001)
        reflected = nl / squared * ((one - fresnel) * diffuse + specular)
        for channel in range(3):
            if colour[channel] != 0:
                radiance[channel] += np.float32(colour[channel]) * reflected
    return np.minimum(radiance ** np.float32(1 / sensor.display_gamma), one).T


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.sqrt(_dot(vectors, vectors)))
