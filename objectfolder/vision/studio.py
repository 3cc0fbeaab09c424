"""Views for people: cameras round an object, a studio's lamps that stand with the camera, and an exposure.

A lamp's colour is a factor of the power of the data set's light.
"""

import numpy as np

from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, GOLDEN_RATIO, look_at
from objectfolder.vision.compositing import on_white

ELEVATION_DEG = 25.0
IMAGE_SHARE = 0.92  # share of half an image that the object's farthest point is from the middle
LAMP_RADIUS = 3.0  # unit-frame lengths from the centre: far, so that no side of the object is burnt
# Lamps by studio: directions in the camera's axes (right, up, towards it), and powers.
STUDIOS = {
    "studio": ((-0.6, 0.7, 0.8, 1.0), (0.9, 0.2, 0.6, 0.35), (0.2, 0.9, -0.7, 0.5)),  # key, fill, rim
    "window": tuple((-1.0, up, near, 0.35) for up in (0.1, 0.7) for near in (0.1, 0.8)),  # its panes
}
# The sky around them: lamps spread over a sphere, from its ground to its top.
SKY = 6
GROUND_POWER, TOP_POWER = 0.06, 0.2
WHITE_SHARE = 0.95  # of the object's pixels are darker than the level below
WHITE_LEVEL = 0.79  # linear; 0.9 as displayed


def turntable(count: int, points: np.ndarray) -> np.ndarray:
    """Return (count, 4, 4) poses on a circle about the z axis, unit frame, looking slightly down.

    Parameters
    ----------
    points
        (n, 3), unit frame: all of them are in every image, as large as they then can be.
    """
    angles = np.deg2rad(-60.0) + 2 * np.pi * np.arange(count) / max(1, count)
    elevation = np.deg2rad(ELEVATION_DEG)
    around = [np.cos(elevation) * np.cos(angles), np.cos(elevation) * np.sin(angles)]
    poses = look_at(np.stack([*around, np.full(count, np.sin(elevation))], axis=1))
    right, up, near = np.moveaxis(points @ poses[:, :3, :3], -1, 0)
    spread = IMAGE_SHARE * np.tan(np.deg2rad(FIELD_OF_VIEW_DEG) / 2)
    poses[:, :3, 3] *= (np.maximum(abs(right), abs(up)) / spread + near).max(initial=0.0)
    return poses


def studio_lights(poses: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, k, 3) of a studio's lamps for (n, 4, 4) poses, unit frame, and colours (k, 3)."""
    index = np.arange(SKY)
    height, angle = 1 - (2 * index + 1) / SKY, 2 * np.pi * GOLDEN_RATIO * index
    ring = np.sqrt(1 - height**2)
    sky = np.stack([ring * np.cos(angle), height, ring * np.sin(angle)], axis=1)
    own = np.array(STUDIOS[name])
    lamps = np.concatenate([own[:, :3] / np.linalg.norm(own[:, :3], axis=1, keepdims=True), sky])
    powers = np.concatenate([own[:, 3], GROUND_POWER + (TOP_POWER - GROUND_POWER) * (height + 1) / 2])
    positions = np.einsum("nij,kj->nki", poses[:, :3, :3], LAMP_RADIUS * lamps)
    return positions, np.repeat(LAMP_RADIUS**2 * powers[:, None], 3, axis=1)


def exposure(rgba: np.ndarray) -> float:
    """Return the factor of linear images (n, h, w, 4) of one object that shows it best."""
    brightness = rgba[..., :3].max(axis=-1)[rgba[..., 3] > 0.5]
    level = float(np.quantile(brightness, WHITE_SHARE)) if len(brightness) else 0.0
    return WHITE_LEVEL / level if level > 0 else 1.0


def exposed(rgba: np.ndarray, factor: float) -> np.ndarray:
    """Return (n, h, w, 3) uint8 on white of linear images times a factor."""
    return on_white(rgba * np.array([factor, factor, factor, 1.0]))
