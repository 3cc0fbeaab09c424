"""What a renderer is asked for, and how the request travels to the process that renders it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.lamps import LIGHT_POWER_W

# Diffuse and glossy bounces off the object itself after the first hit. One matters; the fourth changes
# an image by less than its noise.
BOUNCES = 3
# Faces that a path may pass through by their holes or their glass; the next one stops it.
FACES_WITH_HOLES = 64
# See `Shots.noise_threshold`.
NOISE_THRESHOLD = 0.003
# Fields of a scene that hold something for some of its textures.
BY_TEXTURE = ("alpha_cutoffs", "roughness_maps", "metallic_maps", "normal_maps")


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
        (h, w, 4) uint8 images, sRGB-encoded, row 0 on top. Alpha is straight coverage, not encoded.
    appearance
        Reflectance, where no map gives another value.
    alpha_cutoffs, roughness_maps, metallic_maps, normal_maps
        By index of a texture, as in `TexturedMesh`.
    """

    vertices: np.ndarray
    faces: np.ndarray
    corner_normals: np.ndarray
    texture_coordinates: np.ndarray
    face_texture: np.ndarray
    textures: tuple[np.ndarray, ...]
    appearance: Appearance
    alpha_cutoffs: Mapping[int, float] = field(default_factory=dict)
    roughness_maps: Mapping[int, np.ndarray] = field(default_factory=dict)
    metallic_maps: Mapping[int, np.ndarray] = field(default_factory=dict)
    normal_maps: Mapping[int, np.ndarray] = field(default_factory=dict)

    @property
    def has_holes(self) -> bool:
        """Whether a ray may pass through a face."""
        return any(bool((texture[..., 3] < 255).any()) for texture in self.textures)

    @property
    def lets_through(self) -> bool:
        """Whether light may pass through a face: by a hole, or through thin glass."""
        return self.has_holes or self.appearance.thin


def unit_scene(mesh: TexturedMesh, appearance: Appearance, frame: UnitFrame) -> Scene:
    """Return a mesh brought into its unit frame."""
    return Scene(
        vertices=frame.to_unit(mesh.vertices),
        faces=mesh.faces,
        corner_normals=mesh.surface.corner_normals,
        texture_coordinates=mesh.texture_coordinates,
        face_texture=mesh.face_texture,
        textures=mesh.textures,
        appearance=appearance,
        alpha_cutoffs=mesh.alpha_cutoffs,
        roughness_maps=mesh.roughness_maps,
        metallic_maps=mesh.metallic_maps,
        normal_maps=mesh.normal_maps,
    )


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
    environment
        (h, w, 3) radiance from all round, as of `environment.py`, in place of the point light; or None.
    most_samples
        Paths of a pixel that is still noisy after `samples`; None asks no pixel for more.
    noise_threshold
        Cycles' estimate of a pixel's error over the root of its radiance below which it is not noisy.
    parts
        (n, 4) top, left, height and width in pixels of the part of each image that is rendered; the rest is
        left at 0. None renders all.
    alpha_alone
        Whether thin glass shows nothing, and alpha alone is to be taken from the images.
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
    environment: np.ndarray | None = None
    most_samples: int | None = None
    parts: np.ndarray | None = None
    alpha_alone: bool = False
    noise_threshold: float = NOISE_THRESHOLD

    def views(self, part: slice) -> "Shots":
        """Return some of the views."""
        names = ("camera_to_world", "light_position", "seeds", "parts")
        each = {name: values for name in names if (values := getattr(self, name)) is not None}
        return replace(self, **{name: values[part] for name, values in each.items()})


def save_request(path: Path, scene: Scene, shots: Shots) -> None:
    """Write a scene and its shots as one ``.npz`` file."""
    given = {name: value for name, value in vars(shots).items() if value is not None}
    arrays: dict[str, Any] = {f"shots.{name}": value for name, value in given.items()}
    for part in fields(scene):
        if part.name not in ("textures", "appearance", *BY_TEXTURE):
            arrays[f"scene.{part.name}"] = getattr(scene, part.name)
    for name in BY_TEXTURE:
        for index, value in getattr(scene, name).items():
            arrays[f"{name}.{index}"] = value
    for index, texture in enumerate(scene.textures):
        arrays[f"texture.{index}"] = texture
    for name, value in scene.appearance.to_dict().items():
        arrays[f"appearance.{name}"] = value
    np.savez(path, **arrays)


def load_request(path: Path) -> tuple[Scene, Shots]:
    """Read what `save_request` wrote."""
    with np.load(path, allow_pickle=False) as file:
        names = ("shots", "scene", "texture", "appearance", *BY_TEXTURE)
        groups: dict[str, dict[str, Any]] = {name: {} for name in names}
        for key in file.files:
            group, name = key.split(".")
            value = file[key]
            groups[group][name] = value if value.ndim else value.item()
    textures = tuple(groups["texture"][str(index)] for index in range(len(groups["texture"])))
    by_texture: dict[str, Any] = {
        name: {int(index): value for index, value in groups[name].items()} for name in BY_TEXTURE
    }
    scene = Scene(
        **groups["scene"], textures=textures, appearance=Appearance(**groups["appearance"]), **by_texture
    )
    return scene, Shots(**groups["shots"])
