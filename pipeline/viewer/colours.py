"""The colour of a surface, as fine as a static player draws it."""

import numpy as np
import torch

from objectfolder.object_file import ObjectFile
from objectfolder.vision.cameras import GOLDEN_RATIO
from objectfolder.vision.compositing import srgb_encode
from objectfolder.vision.export.base_colour import DIELECTRIC_F0
from objectfolder.vision.incidence import Incidence
from objectfolder.vision.network_layout import has_mirrors
from objectfolder.vision.reflectance import Reflectance, angle_inputs, surrounding_inputs
from objectfolder.vision.sparse_grid import SparseGrid
from objectfolder.vision.visionnet import PREFIX

# Directions of light that the reflectance is summed over. `vision.export.base_colour`, which has 24, is for
# files that are lit anew elsewhere; here a colour differs from it by less than what is left out.
LIGHTS = 4
# An irradiance so large that bounced light, which does not grow with it, drops out.
DIRECT = 1e4


def surface_colours(file: ObjectFile) -> np.ndarray:
    """Return (vertices + edges, 3) uint8 sRGB at the vertices and in the middle of the edges.

    It is the share of light from all directions that leaves along the normal, by the VisionNet, without what
    a clear coat reflects.
    """
    faces = file.surface.faces
    sides = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    code = np.sort(sides, axis=1) @ np.array([faces.max() + 1, 1])
    _, first = np.unique(code, return_index=True)
    edge_face, edge_corner = np.divmod(np.sort(first), 3)
    corners = np.zeros(len(file.surface.vertices), dtype=np.int64)
    corners[faces.ravel()] = np.arange(faces.size)
    vertex_face, vertex_corner = np.divmod(corners, 3)
    middles = (np.eye(3) + np.roll(np.eye(3), 1, axis=1)) / 2
    face = np.concatenate([vertex_face, edge_face])
    barycentric = np.concatenate([np.eye(3)[vertex_corner], middles[edge_corner]])
    position = file.frame.to_unit(file.surface.points_at(face, barycentric))
    share = _share_along_normal(file, position, file.surface.normals_at(face, barycentric))
    metallic = float((file.description["material"] or {}).get("metallic", 0.0))
    coat = DIELECTRIC_F0 * (1 - metallic)
    share = (share - coat) / (1 - coat)
    return np.asarray(np.rint(srgb_encode(share) * 255), dtype=np.uint8)


def _share_along_normal(file: ObjectFile, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return (n, 3), 1/pi times the integral of the reflectance times the cosine; midpoint rule."""
    tensors = {name.removeprefix(PREFIX): value for name, value in file.vision.tensors().items()}
    grid = SparseGrid.from_bytes(tensors.pop("grid"), int(file.vision.metadata()["grid_resolution"]))
    reflectance = Reflectance(grid.sizes, mirrors=has_mirrors(tensors.keys()))
    reflectance.load_state_dict(
        {name: torch.from_numpy(np.asarray(value, dtype=np.float32)) for name, value in tensors.items()}
    )
    features = grid.interpolation(position.astype(np.float32))
    aside = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(normal, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    share = np.zeros((len(position), 3))
    irradiance = torch.full((len(position),), DIRECT)
    one = np.ones(len(position))
    for index in range(LIGHTS):
        t = (index + 0.5) / LIGHTS
        azimuth = 2 * np.pi * GOLDEN_RATIO * index
        to_light = t * (np.cos(azimuth) * first + np.sin(azimuth) * second) + np.sqrt(1 - t * t) * normal
        points = Incidence(position, normal, normal, to_light, one, one)
        with torch.inference_mode():
            radiance = reflectance(
                features,
                torch.from_numpy(angle_inputs(points)),
                torch.from_numpy(surrounding_inputs(points, position + to_light)),
                irradiance,
            )
        share += 2 * t / LIGHTS / DIRECT * radiance.numpy()
    return share
