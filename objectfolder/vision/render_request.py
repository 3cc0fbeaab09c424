"""What a renderer is asked for, and how the request travels to the process that renders it."""

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.vision.appearance import Appearance

# An albedo of 0.8 that faces the light from 0.5 reaches a radiance of 0.97, so that only surfaces very
# close to the lamp clip: radiance = albedo P cos / (4 pi^2 d^2).
LIGHT_POWER_W = 12.0
# Diffuse and glossy bounces off the object itself after the first hit. One matters; the fourth changes
# an image by less than its noise.
BOUNCES = 3


@dataclass(frozen=True)
class Scene:
    """A textured mesh in the unit frame, as plain arrays.

    Parameters
    ----------
    vertices
        (v, 3) positions.
    faces
        (f, 3) vertex indices.
    corner_normals
        (f, 3, 3) unit shading normals.
    texture_coordinates
        (f, 3, 2) u, v a corner, v up.
    face_texture
        (f,) index into `textures`.
    textures
        (h, w, 4) uint8 images, sRGB-encoded, row 0 on top. Alpha is ignored: objects are opaque.
    appearance
        Reflectance.
    """

    vertices: np.ndarray
    faces: np.ndarray
    corner_normals: np.ndarray
    texture_coordinates: np.ndarray
    face_texture: np.ndarray
    textures: tuple[np.ndarray, ...]
    appearance: Appearance


@dataclass(frozen=True)
class Shots:
    """Views of a scene.

    Parameters
    ----------
    camera_to_world
        (n, 4, 4) poses, unit frame.
    light_position
        (n, 3) positions of the point light, unit frame.
    seeds
        (n,) seeds of the sampling pattern.
    samples
        Paths a pixel.
    height, width
        Image size, pixels.
    field_of_view_deg
        Angle over the longer side.
    light_power_w
        Radiant power of the point light.
    bounces
        Diffuse and glossy bounces after the first hit.
    threads
        Render threads; the image does not depend on it.
    """

    camera_to_world: np.ndarray
    light_position: np.ndarray
    seeds: np.ndarray
    samples: int
    height: int
    width: int
    field_of_view_deg: float
    light_power_w: float = LIGHT_POWER_W
    bounces: int = BOUNCES
    threads: int = 1


def save_request(path: Path, scene: Scene, shots: Shots) -> None:
    """Write a scene and its shots as one ``.npz`` file."""
    arrays: dict[str, Any] = {f"shots.{name}": value for name, value in asdict(shots).items()}
    for field in fields(scene):
        if field.name not in ("textures", "appearance"):
            arrays[f"scene.{field.name}"] = getattr(scene, field.name)
    for index, texture in enumerate(scene.textures):
        arrays[f"texture.{index}"] = texture
    for name, value in scene.appearance.to_dict().items():
        arrays[f"appearance.{name}"] = value
    np.savez(path, **arrays)


def load_request(path: Path) -> tuple[Scene, Shots]:
    """Read what `save_request` wrote."""
    with np.load(path, allow_pickle=False) as file:
        groups: dict[str, dict[str, Any]] = {"shots": {}, "scene": {}, "texture": {}, "appearance": {}}
        for key in file.files:
            group, name = key.split(".")
            value = file[key]
            groups[group][name] = value if value.ndim else value.item()
    textures = tuple(groups["texture"][str(index)] for index in range(len(groups["texture"])))
    scene = Scene(**groups["scene"], textures=textures, appearance=Appearance(**groups["appearance"]))
    return scene, Shots(**groups["shots"])
