"""Base colour of points of the surface: from the source's texture, or from what a VisionNet has learned."""

from typing import TYPE_CHECKING

import numpy as np

from objectfolder.extras import needs_extra
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.cameras import GOLDEN_RATIO
from objectfolder.vision.compositing import srgb_encode
from objectfolder.vision.network.incidence import Incidence
from objectfolder.vision.network.network_layout import has_mirrors
from objectfolder.vision.network.sparse_grid import SparseGrid
from objectfolder.vision.visionnet.visionnet import PREFIX, VisionNet

if TYPE_CHECKING:
    from objectfolder.making.visionnet.reflectance import Reflectance

# Directions of light over which the reflectance is summed.
LIGHT_DIRECTIONS = 24
# Reflectance at normal incidence of a dielectric of index 1.5, which the base colour does not have.
DIELECTRIC_F0 = 0.04
# An irradiance so large that bounced light, which does not grow with it, drops out.
DIRECT = 1e4
# How far along the normal the source's surface is looked for, in object lengths.
ALONG_NORMAL = 1e-3
POINTS_AT_ONCE = 1 << 16


def texture_colour(mesh: TexturedMesh, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Return (n, 4) RGBA in 0..1, sRGB-encoded, at barycentric coordinates (n, 3) of faces (n,) of a mesh.

    Bilinear in encoded values, repeating outside 0..1, as Cycles looks up an 8-bit texture.
    """
    coordinates = np.einsum("ij,ijk->ik", barycentric, mesh.texture_coordinates[face])
    result = np.empty((len(face), 4))
    for index, texture in enumerate(mesh.textures):
        own = mesh.face_texture[face] == index
        result[own] = bilinear(texture, coordinates[own])
    return result


def nearest_texture_colour(mesh: TexturedMesh, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return (n, 4) RGBA, sRGB-encoded, of the mesh at (n, 3) points that lie close to it, metres.

    Where the mesh is met along the (n, 3) unit normals within a thousandth of its size that place is taken,
    elsewhere the nearest point: rays are fast and nearest points are not.
    """
    surface = mesh.surface
    reach = ALONG_NORMAL * float(np.ptp(surface.bounds, axis=0).max())
    face = np.full(len(points), -1, dtype=np.int64)
    barycentric = np.zeros((len(points), 3))
    gap = np.full(len(points), reach)
    # From either side: between the layers of a thin wall one of the two meets the near layer first.
    for side in (1.0, -1.0):
        hits = surface.ray_hits(points + side * reach * normals, -side * reach * normals)
        away = np.abs(hits.distance - 1.0) * reach
        nearer = away < gap
        face[nearer], barycentric[nearer], gap[nearer] = (
            hits.face[nearer],
            hits.barycentric[nearer],
            away[nearer],
        )
    far = np.flatnonzero(face < 0)
    if len(far):
        nearest = surface.closest_points(points[far])
        face[far], barycentric[far] = nearest.face, nearest.barycentric
    return texture_colour(mesh, face, barycentric)


def network_colour(
    network: VisionNet,
    surface: Surface,
    frame: UnitFrame,
    face: np.ndarray,
    barycentric: np.ndarray,
    metallic: float,
    directions: int = LIGHT_DIRECTIONS,
) -> np.ndarray:
    """Return (n, 4) opaque RGBA, sRGB-encoded, that a VisionNet states, or amounts to.

    It is the albedo that the file states. Of a file that states none, the network's factors have no meaning
    apart (its albedo head is free up to what multiplies it), but their product has: the share of
    light from all directions that leaves along the normal, rho = 1/pi * integral of f cos. A conductor's base
    colour is rho; a dielectric's is rho without its clear coat, (rho - 0.04) / 0.96.

    Parameters
    ----------
    surface, frame
        The surface that the network was fitted on, and its unit frame.
    face, barycentric
        (n,), (n, 3) points of it.
    metallic
        0 a dielectric, 1 a conductor, between them the share.
    directions
        Of light, that the integral is summed over.
    """
    if network.states("albedo"):
        srgb = srgb_encode(network.reflectance("albedo", face, barycentric))
        return np.concatenate([srgb, np.ones((len(srgb), 1))], axis=1)
    grid, reflectance = _network_of(network)
    parts = [np.zeros((0, 3))]
    for start in range(0, len(face), POINTS_AT_ONCE):
        of_part = face[start : start + POINTS_AT_ONCE], barycentric[start : start + POINTS_AT_ONCE]
        position, normal = frame.to_unit(surface.points_at(*of_part)), surface.normals_at(*of_part)
        parts.append(_reflectance_along_normal(grid, reflectance, position, normal, directions))
    coat = DIELECTRIC_F0 * (1.0 - metallic)
    srgb = srgb_encode((np.concatenate(parts) - coat) / (1.0 - coat))
    return np.concatenate([srgb, np.ones((len(srgb), 1))], axis=1)


def _network_of(network: VisionNet) -> "tuple[SparseGrid, Reflectance]":
    """Return the feature grid of a VisionNet and its network, from the tensors it stores."""
    with needs_extra("factory"):
        import torch

    from objectfolder.making.visionnet.reflectance import Reflectance

    tensors = {name.removeprefix(PREFIX): value for name, value in network.tensors().items()}
    grid = SparseGrid.from_bytes(tensors.pop("grid"), int(network.metadata()["grid_resolution"]))
    reflectance = Reflectance(grid.sizes, mirrors=has_mirrors(tensors))
    reflectance.load_state_dict(
        {name: torch.from_numpy(np.asarray(value, dtype=np.float32)) for name, value in tensors.items()}
    )
    return grid, reflectance.eval()


def _reflectance_along_normal(
    grid: SparseGrid, reflectance: "Reflectance", position: np.ndarray, normal: np.ndarray, directions: int
) -> np.ndarray:
    """Return rho (n, 3) at (n, 3) unit-frame points.

    With t = sin of the angle from the normal, rho = integral of 2 t f over t in 0..1 and the mean over
    azimuth: the midpoint rule in t, so that the highlight, which lies near t = 0, is resolved.
    """
    with needs_extra("factory"):
        import torch

    from objectfolder.making.visionnet.reflectance import angle_inputs, surrounding_inputs

    features = grid.interpolation(position.astype(np.float32))
    aside = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(normal, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    rho = np.zeros((len(position), 3))
    irradiance = torch.full((len(position),), DIRECT)
    for index in range(directions):
        t = (index + 0.5) / directions
        azimuth = 2.0 * np.pi * GOLDEN_RATIO * index
        to_light = t * (np.cos(azimuth) * first + np.sin(azimuth) * second) + np.sqrt(1.0 - t * t) * normal
        points = Incidence(position, normal, normal, to_light, np.ones(len(position)), np.ones(len(position)))
        with torch.inference_mode():
            radiance = reflectance(
                features,
                torch.from_numpy(angle_inputs(points)),
                torch.from_numpy(surrounding_inputs(points, position + to_light)),
                irradiance,
            )
        rho += 2.0 * t / directions / DIRECT * radiance.numpy()
    return rho
