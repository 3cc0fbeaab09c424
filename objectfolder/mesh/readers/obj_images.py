"""Images of a material of a Wavefront library: base colour and alpha, roughness, metallic, normals."""

import numpy as np

from objectfolder.mesh.readers.material_library import ObjMaterial, ScalarMap
from objectfolder.mesh.readers.textures import (
    TextureReader,
    holds_normals,
    opaque,
    scaled_map,
    scaled_normals,
    uniform_map,
    uniform_texture,
    with_alpha,
)


def colour_image(material: ObjMaterial, reader: TextureReader) -> np.ndarray:
    """Base colour RGBA, opaque but where the material asks for transparency."""
    if material.texture is not None:
        texture = opaque(reader.file(material.texture))
    else:
        texture = uniform_texture(material.colour)
    factor = 1.0 if material.opacity is None else material.opacity
    if material.opacity_map is not None:
        alpha = _levels(material.opacity_map, reader, of_opacity=True)
        return with_alpha(texture, scaled_map(alpha, factor))
    return texture if factor == 1.0 else with_alpha(texture, uniform_map(factor))


def scalar_image(image: ScalarMap | None, value: float | None, reader: TextureReader) -> np.ndarray | None:
    """Roughness or metallic (h, w) of an image, else of a value; None where there is neither."""
    if image is not None:
        return reader.count(_levels(image, reader, of_opacity=False))
    return None if value is None else uniform_map(value)


def normal_image(material: ObjMaterial, reader: TextureReader) -> np.ndarray | None:
    """Normals (h, w, 3) in tangent space; None where the material has none, or heights."""
    image = None
    if material.normal_map is not None:
        image = reader.file(material.normal_map)
    elif material.bump_map is not None and holds_normals(bumps := reader.file(material.bump_map)):
        image = bumps
    normals = None if image is None else scaled_normals(image, material.bump_scale)
    return None if normals is None else reader.count(normals)


def _levels(image: ScalarMap, reader: TextureReader, *, of_opacity: bool) -> np.ndarray:
    """(h, w) uint8 of the channel that holds the quantity."""
    rgba = reader.file(image.file)
    if image.channel is not None:
        return np.ascontiguousarray(rgba[..., image.channel])
    in_alpha = of_opacity and bool((rgba[..., 3] < 255).any())
    return np.ascontiguousarray(rgba[..., 3 if in_alpha else 0])
