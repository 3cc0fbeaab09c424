"""A surface or a mesh to a GLB: what is baked, and how finely."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.export.atlas import Atlas, pack
from objectfolder.vision.export.files import Credit
from objectfolder.vision.export.gltf import Part, write_glb

# sRGB-encoded RGBA (n, 4) in 0..1 at barycentric coordinates (n, 3) of faces (n,) of the surface.
ColourOf = Callable[[np.ndarray, np.ndarray], np.ndarray]


def write_mesh(path: Path, mesh: TexturedMesh, appearance: Appearance, credit: Credit) -> dict[str, Any]:
    """Write a mesh with its own textures, nothing resampled; return what was written as JSON."""
    said = {"colour": "the source's own textures"}
    write_glb(path, mesh_parts(mesh, appearance), appearance, credit, mipmaps=True, extras=said)
    return {"triangles": len(mesh.faces), **said, "bytes": path.stat().st_size}


def mesh_parts(mesh: TexturedMesh, appearance: Appearance) -> list[Part]:
    """Return the faces of each texture of a mesh."""
    normals = mesh.surface.corner_normals
    parts = []
    for index in np.unique(mesh.face_texture).tolist():
        own = mesh.face_texture == index
        parts.append(
            Part(
                mesh.vertices[mesh.faces[own]],
                normals[own],
                mesh.texture_coordinates[own],
                mesh.textures[index],
                alpha_cutoff=mesh.alpha_cutoffs.get(index),
                metallic_roughness=_metallic_roughness(mesh, index, appearance),
                normal_map=mesh.normal_maps.get(index),
            )
        )
    return parts


def _metallic_roughness(mesh: TexturedMesh, index: int, appearance: Appearance) -> np.ndarray | None:
    """Return the (h, w, 3) map of a texture as glTF has it; None where the factors say all."""
    roughness, metallic = mesh.roughness_maps.get(index), mesh.metallic_maps.get(index)
    if roughness is None and metallic is None:
        return None
    height, width = np.max([image.shape for image in (roughness, metallic) if image is not None], axis=0)
    channels = [np.zeros((height, width), dtype=np.uint8)]
    for image, factor in ((roughness, appearance.roughness), (metallic, appearance.metallic)):
        if image is None:
            image = np.array([[round(255 * factor)]], dtype=np.uint8)
        resized = Image.fromarray(image).resize((int(width), int(height)), Image.Resampling.BILINEAR)
        channels.append(np.asarray(resized))
    return np.stack(channels, axis=-1)


def write_surface(
    path: Path,
    surface: Surface,
    colour_of: ColourOf,
    appearance: Appearance,
    credit: Credit,
    *,
    colour: str,
    side: int = 1024,
    finest_m: float = 0.0,
    vertex_colours: bool = False,
) -> dict[str, Any]:
    """Write a surface without texture coordinates, its colours baked; return what was written as JSON.

    Parameters
    ----------
    colour_of
        The colours.
    colour
        In words, what the colours are.
    side
        Texels a side of the atlas.
    finest_m
        Texels need lie no closer than this, metres.
    vertex_colours
        Colours at the corners of the faces in place of an atlas.
    """
    positions, normals = surface.vertices[surface.faces], surface.corner_normals
    said: dict[str, Any] = {"triangles": len(surface.faces), "colour": colour}
    if vertex_colours:
        face = np.repeat(np.arange(len(surface.faces)), 3)
        colours = colour_of(face, np.tile(np.eye(3), (len(surface.faces), 1)))
        parts = [Part(positions, normals, colours=colours.reshape(-1, 3, 4))]
    else:
        part, baked = baked_part(surface, colour_of, side, finest_m)
        parts = [part]
        said |= baked
    write_glb(path, parts, appearance, credit, mipmaps=False, extras=dict(said))
    return {**said, "bytes": path.stat().st_size}


def baked_part(
    surface: Surface, colour_of: ColourOf, side: int = 1024, finest_m: float = 0.0
) -> tuple[Part, dict[str, Any]]:
    """Return a surface with its colours in an atlas (see `write_surface`), and what was baked as JSON."""
    positions = surface.vertices[surface.faces]
    atlas = pack(positions, side, finest_m)
    image, baked = bake(atlas, colour_of)
    return Part(positions, surface.corner_normals, atlas.texture_coordinates(), image), {
        "texture_side": side,
        "texels_baked": baked,
        "texel_pitch_m": atlas.pitch_m,
        "texels_per_m2": baked / surface.area,
    }


def bake(atlas: Atlas, colour_of: ColourOf) -> tuple[np.ndarray, int]:
    """Return the atlas's texture (side, side, 4) uint8 and how many of its texels are used."""
    row, column, face, barycentric = atlas.texels()
    image = np.zeros((atlas.side, atlas.side, 4), dtype=np.uint8)
    image[..., 3] = 255
    image[row, column] = np.round(np.clip(colour_of(face, barycentric), 0.0, 1.0) * 255.0).astype(np.uint8)
    return image, len(row)
