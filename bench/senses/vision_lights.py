"""Lights for which training views do not prepare a VisionNet."""

import numpy as np

from objectfolder.vision.cameras import uniform_on_sphere

LIGHTS = ("radius_0.8", "radius_2", "grazing", "behind")
GRAZING_DEG, BEHIND_DEG = 100.0, 160.0


def light_positions(light: str, cameras: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return (n, 3) lights: on a sphere about the origin, or at an angle from the camera's direction."""
    if light.startswith("radius_"):
        return uniform_on_sphere(len(cameras), float(light.removeprefix("radius_")), random)
    around = uniform_on_sphere(len(cameras), 1.0, random)
    if light == "sphere":
        return around
    towards = cameras[:, :3, 2]
    around -= np.einsum("ij,ij->i", around, towards)[:, None] * towards
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    angle = np.deg2rad({"grazing": GRAZING_DEG, "behind": BEHIND_DEG}[light])
    result: np.ndarray = np.cos(angle) * towards + np.sin(angle) * around
    return result
