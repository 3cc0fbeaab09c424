"""What the camera sees at the centre of each pixel besides light: depth, normal, reflectance, mask.

They are cast through the pixel centres here rather than taken from Cycles, whose passes are of another kind:
depth is that of one random sample of the pixel, normal and colour are means over its samples, which at
silhouettes and creases belong to no point of the surface. Casting costs about a hundredth of a render.

How much of a pixel the object covers is cast by many rays, too: the renderer's own share is the noise of
silhouettes. At 256 paths nine tenths of the squared error of a bell of metal lie in the alpha of its outline.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from objectfolder.making.mesh.normal_maps import MappedNormals
from objectfolder.making.views.render_request import FACES_WITH_HOLES, Scene
from objectfolder.surface.surface import Surface
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.vision.cameras import image_box, pixel_rays, sub_ray_offsets
from objectfolder.vision.compositing import srgb_decode

# A surface that blends counts from this coverage on, and one that is cut from its cutoff on.
SEEN_FROM_ALPHA = 0.5
PIXEL_CENTRE = np.array([[0.5, 0.5]])
# Two casts of a chain and a clamp agree within 56 dB at their outlines; 256 paths have 45.
COVERAGE_RAYS = 1024
# Pixels cast at a time: 100 MB.
PIXELS_AT_ONCE = 512


@dataclass(frozen=True)
class Passes:
    """Passes of n views of h x w pixels.

    Parameters
    ----------
    mask
        (n, h, w) bool: the ray through the pixel's centre meets the surface.
    depth
        (n, h, w) float32 distance along the camera's -z axis, unit-frame lengths; infinity off the mask.
    normal
        (n, h, w, 3) float16 unit shading normal, bent by maps, on the camera's side, axes of the unit
        frame; 0 off the mask.
    albedo
        (n, h, w, 3) float16 scene-linear base colour: diffuse reflectance of a dielectric, reflectance at
        normal incidence of a metal; 0 off the mask.
    roughness, metallic
        (n, h, w) float16 as of `Appearance`, of the maps where there are some; 0 off the mask.
    """

    mask: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray


def cast_passes(
    scene: Scene, camera_to_world: np.ndarray, resolution: tuple[int, int], field_of_view_deg: float
) -> Passes:
    """Cast a ray through the centre of every pixel of views with poses (n, 4, 4).

    Rays go through holes: where alpha is below the texture's cutoff, or below 1/2 where it blends.
    """
    height, width = resolution
    count = len(camera_to_world)
    mask = np.zeros((count, height * width), dtype=bool)
    depth = np.full(mask.shape, np.inf, dtype=np.float32)
    normal = np.zeros((*mask.shape, 3), dtype=np.float16)
    albedo = np.zeros((*mask.shape, 3), dtype=np.float16)
    roughness, metallic = (np.zeros(mask.shape, dtype=np.float16) for _ in range(2))
    surface = Surface(scene.vertices, scene.faces)
    mapped = mapped_normals(scene)
    corners = scene.vertices[np.unique(scene.faces)]
    for view, pose in enumerate(camera_to_world):
        pixels = _pixels_around(corners, pose, resolution, field_of_view_deg)
        origins, directions = pixel_rays(pose, pixels, PIXEL_CENTRE, resolution, field_of_view_deg)
        distance, face, barycentric, colour = _first_seen(scene, surface, origins, directions)
        hit_rays = np.flatnonzero(face >= 0)
        hit_pixels, face, barycentric = pixels[hit_rays], face[hit_rays], barycentric[hit_rays]
        mask[view, hit_pixels] = True
        depth[view, hit_pixels] = distance[hit_rays] * -(directions[hit_rays] @ pose[:3, 2])
        normal[view, hit_pixels] = _shading_normals(mapped, surface, face, barycentric, directions[hit_rays])
        albedo[view, hit_pixels] = srgb_decode(colour[hit_rays])
        roughness[view, hit_pixels] = _mapped(
            scene, scene.roughness_maps, scene.appearance.roughness, face, barycentric
        )
        metallic[view, hit_pixels] = _mapped(
            scene, scene.metallic_maps, scene.appearance.metallic, face, barycentric
        )
    shape = (count, height, width)
    return Passes(
        mask.reshape(shape), depth.reshape(shape), normal.reshape(*shape, 3), albedo.reshape(*shape, 3),
        roughness.reshape(shape), metallic.reshape(shape),
    )  # fmt: skip


def _pixels_around(
    corners: np.ndarray, camera_to_world: np.ndarray, resolution: tuple[int, int], field_of_view_deg: float
) -> np.ndarray:
    """Flat indices of the pixels in the box around the image of (n, 3) points."""
    top, left, height, width = image_box(corners, camera_to_world, resolution, field_of_view_deg)
    rows, columns = np.arange(top, top + height), np.arange(left, left + width)
    return (rows[:, None] * resolution[1] + columns).ravel()


def _first_seen(
    scene: Scene, surface: Surface, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Distance (n,), face (n,) (-1: none), barycentric (n, 3) and encoded base colour (n, 3) of each ray."""
    distance = np.full(len(origins), np.inf)
    face = np.full(len(origins), -1, dtype=np.int64)
    barycentric, colour = np.zeros((len(origins), 3)), np.zeros((len(origins), 3))
    pending, passed = np.arange(len(origins)), np.zeros(len(origins))
    for _ in range(FACES_WITH_HOLES):
        hits = surface.ray_hits(
            origins[pending] + passed[pending, None] * directions[pending], directions[pending]
        )
        met = hits.face >= 0
        rays, weights = pending[met], hits.barycentric[met]
        rgba, opaque = _base_colour(scene, hits.face[met], weights)
        stopped = rays[opaque]
        distance[stopped] = passed[stopped] + hits.distance[met][opaque]
        face[stopped], barycentric[stopped], colour[stopped] = (
            hits.face[met][opaque],
            weights[opaque],
            rgba[opaque, :3],
        )
        pending = rays[~opaque]
        if len(pending) == 0:
            break
        # Twice the single precision of the search beyond the face.
        passed[pending] += hits.distance[met][~opaque] + 1e-6
    return distance, face, barycentric, colour


def _base_colour(scene: Scene, face: np.ndarray, barycentric: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Encoded RGBA (n, 4) of points of faces, and whether the surface is there (n,)."""
    coordinates = np.einsum("ij,ijk->ik", barycentric, scene.texture_coordinates[face])
    texture_of = scene.face_texture[face]
    rgba = np.zeros((len(face), 4), dtype=np.float32)
    cutoff = np.full(len(scene.textures), SEEN_FROM_ALPHA)
    for index, texture in enumerate(scene.textures):
        cutoff[index] = scene.alpha_cutoffs.get(index, SEEN_FROM_ALPHA)
        own = np.flatnonzero(texture_of == index)
        rgba[own] = bilinear(texture, coordinates[own])
    return rgba, rgba[:, 3] >= cutoff[texture_of]


def _mapped(
    scene: Scene, maps: Mapping[int, np.ndarray], constant: float, face: np.ndarray, barycentric: np.ndarray
) -> np.ndarray:
    """What maps say (n,) at points of faces, and the constant where there is none."""
    coordinates = np.einsum("ij,ijk->ik", barycentric, scene.texture_coordinates[face])
    values = np.full(len(face), constant)
    for texture, image in maps.items():
        own = np.flatnonzero(scene.face_texture[face] == texture)
        values[own] = bilinear(image[..., None], coordinates[own])[:, 0]
    return values


def mapped_normals(scene: Scene) -> MappedNormals:
    """Return the shading normals of a scene, bent by its maps."""
    return MappedNormals(
        scene.vertices, scene.faces, scene.corner_normals, scene.texture_coordinates, scene.face_texture,
        scene.normal_maps,
    )  # fmt: skip


def _shading_normals(
    mapped: MappedNormals, surface: Surface, face: np.ndarray, barycentric: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    facet = surface.face_normals[face]
    bent = mapped.at(face, barycentric)
    bent = np.where(bent.any(axis=1, keepdims=True), bent, facet)
    # The side seen decides where a normal points, as in Cycles.
    return np.where(np.einsum("ij,ij->i", facet, directions)[:, None] > 0, -bent, bent)


def with_cast_coverage(
    scene: Scene, rgba: np.ndarray, camera_to_world: np.ndarray, seeds: np.ndarray, field_of_view_deg: float
) -> np.ndarray:
    """Return rendered views with the alpha of pixels that the object covers in part cast anew.

    The straight colour of a pixel stays. A texture's alpha is the renderer's to judge, so a scene with
    holes, or of thin glass, stays as it is.

    Parameters
    ----------
    scene
        What was rendered.
    rgba
        (n, h, w, 4) premultiplied.
    camera_to_world, field_of_view_deg
        (n, 4, 4) poses in the unit frame, and the angle over the longer side.
    seeds
        (n,) of the lattices of rays: equal views with other seeds are cast independently.
    """
    if scene.lets_through:
        return rgba
    surface, offsets = Surface(scene.vertices, scene.faces), sub_ray_offsets(COVERAGE_RAYS)
    height, width = rgba.shape[1:3]
    result = rgba.copy()
    for view, pose in enumerate(camera_to_world):
        random = np.random.default_rng(int(seeds[view]))
        pixels = result[view].reshape(-1, 4)
        partly = np.flatnonzero((pixels[:, 3] > 0) & (pixels[:, 3] < 1))
        for places in np.split(partly, range(PIXELS_AT_ONCE, len(partly), PIXELS_AT_ONCE)):
            shifted = (offsets + random.random((len(places), 1, 2))) % 1.0
            hits = surface.ray_hits(*pixel_rays(pose, places, shifted, (height, width), field_of_view_deg))
            alpha = (hits.face >= 0).reshape(-1, COVERAGE_RAYS).mean(axis=1)
            rendered = pixels[places].astype(np.float64)
            # What no ray meets is thinner than the rays are apart: the renderer's share is all that is known.
            alpha = np.where(alpha > 0, alpha, rendered[:, 3])
            pixels[places] = rendered * (alpha / rendered[:, 3])[:, None]
    return result
