"""Materials of a glTF file: base colour, transparency, roughness, metallic, normals, and their places."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import shortened
from objectfolder.making.mesh.readers.gltf_file import (
    GLOSSINESS,
    TEXTURE_TRANSFORM,
    WEBP,
    Gltf,
    Json,
    extensions,
    number,
    numbers,
    whole,
)
from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.making.mesh.readers.textures import (
    TextureReader,
    opaque,
    resized,
    scaled_map,
    scaled_normals,
    srgb_decode,
    srgb_encode,
    tint,
    uniform_map,
    uniform_texture,
)

NORMALS = "normalTexture"

EMISSION = "emissiveTexture"
_EMITTED = "emissiveFactor"

_BLACK = 0.002
"""A factor of the base colour, scene-linear, that is nowhere brighter comes out black."""

_DIELECTRIC = 0.04
"""What all that is no metal reflects."""

_BRIGHTNESS = np.array([0.299, 0.587, 0.114])
"""Weights of squared red, green and blue in brightness as it is perceived."""

REPEAT = 10497
"""The only value of a sampler's `wrapS` and `wrapT` that textures here have."""


@dataclass(frozen=True)
class Placement:
    """Where a texture lies: its set of coordinates, and what becomes of them.

    The coordinates (v down, as in glTF) are scaled, turned by an angle in radians, and shifted. `repeats` is
    False where the sampler clamps or mirrors outside 0..1.
    """

    coordinate_set: int = 0
    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
    repeats: bool = True

    def applied(self, coordinates: np.ndarray) -> np.ndarray:
        """Coordinates (n, 2) in the image, v down.

        The sense of the rotation is that of Blender, Cesium and Khronos' own viewer.
        """
        if (self.shift, self.angle, self.scale) == ((0.0, 0.0), 0.0, (1.0, 1.0)):
            return coordinates
        u, v = coordinates[:, 0] * self.scale[0], coordinates[:, 1] * self.scale[1]
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        turned = [u * cosine + v * sine + self.shift[0], v * cosine - u * sine + self.shift[1]]
        return np.stack(turned, axis=1)


@dataclass(frozen=True)
class Material:
    """What a primitive looks like.

    Parameters
    ----------
    texture
        Base colour (h, w, 4).
    factor
        Scene-linear RGBA (4,) that vertex colours are multiplied by; the texture already is.
    alpha_cutoff
        The alpha from which the surface is there; None blends.
    roughness, metallic, normals
        Maps (h, w) and of normals (h, w, 3), where the file has them.
    placement
        Of all its textures.
    """

    texture: np.ndarray
    factor: np.ndarray
    alpha_cutoff: float | None = None
    roughness: np.ndarray | None = None
    metallic: np.ndarray | None = None
    normals: np.ndarray | None = None
    placement: Placement = Placement()


PLAIN = Material(uniform_texture(DEFAULT_COLOUR), np.ones(4))
"""Of primitives without a material."""


def read_material(file: Gltf, index: Any, reader: TextureReader) -> Material:
    """Read a material by its index.

    Texture and factor of the base colour are multiplied. Alpha counts as `alphaMode` says (OPAQUE ignores it,
    MASK cuts at `alphaCutoff`, BLEND blends). Roughness is the green, metallic the blue channel of
    `metallicRoughnessTexture`, each times its factor; a factor that is written counts without a texture, and
    where neither is, the object's material has its say rather than glTF's default, a rough metal. Normals
    are those of `normalTexture`, its `scale` applied. Of
    KHR_materials_pbrSpecularGlossiness diffuse and specular colours become base colour and metallic as
    Khronos converts them, and what is not glossy is rough. Where the base colour is black and has no picture,
    that of `emissiveTexture` shows in its place, or else `emissiveFactor`, and the file's remarks say so.

    Raises
    ------
    InputError
        A texture that is missing, broken, or on other coordinates than the base colour; a material that is
        wholly transparent.
    ValueError, KeyError, TypeError
        The material is not as glTF has it.
    """
    material = file.entry("materials", index)
    name = shortened(str(material.get("name", index)))
    glossy = extensions(material).get(GLOSSINESS)
    parts = material.get("pbrMetallicRoughness", {}) if glossy is None else glossy
    keys = _GLOSSY_KEYS if glossy is not None else _METALLIC_KEYS
    base, placement = _image(file, parts, keys.base, name, reader)
    factor = np.array(numbers(parts.get(keys.factor, [1, 1, 1, 1]), 4, 0, 1))
    emission = np.array(numbers(material.get(_EMITTED, [0, 0, 0]), 3, 0))
    if EMISSION in material:
        if base is None and float(factor[:3].max()) <= _BLACK:
            base, placement = _image(file, material, EMISSION, name, reader)
            factor[:3] = 1.0
            file.remark(f"{EMISSION} of material {name} is taken for its base colour, which is black")
        else:
            file.remark(f"{EMISSION} of material {name} is not used: bake it into the base colour")
    elif base is None and float(factor[:3].max()) <= _BLACK < float(emission.max()):
        factor[:3] = np.minimum(emission, 1.0)
        file.remark(f"{_EMITTED} of material {name} is taken for its base colour, which is black")
    elif base is not None and float(factor[:3].max()) <= _BLACK:
        file.remark(f"{keys.factor} of material {name} makes its picture black")
    layers, layers_placement = _image(file, parts, keys.layers, name, reader)
    bumps, bumps_placement = _image(file, material, NORMALS, name, reader)
    placed = [
        (key, placement)
        for key, image, placement in (
            (keys.base, base, placement),
            (keys.layers, layers, layers_placement),
            (NORMALS, bumps, bumps_placement),
        )
        if image is not None
    ]
    for key, place in placed[1:]:
        if place != placed[0][1]:
            raise InputError(
                str(file.path),
                f"{key} of material {name} lies otherwise than {placed[0][0]}: on a second set of texture "
                "coordinates, or shifted",
                "Bake both to one set",
            )
    texture = tint(uniform_texture(np.ones(4)) if base is None else base, factor)
    mode = material.get("alphaMode", "OPAQUE")
    cutoff = number(material.get("alphaCutoff", 0.5))
    least = int(texture[..., 3].min()) / 255
    if mode == "OPAQUE" or (mode == "MASK" and least >= cutoff):
        texture = opaque(texture)
    elif not texture[..., 3].any():
        finding = f"material {name} is wholly transparent ({mode} with an alpha of 0)"
        raise InputError(str(file.path), finding, "Make it OPAQUE, or leave its faces out")
    if glossy is not None:
        roughness = _roughness_of_glossiness(layers, glossy.get("glossinessFactor"))
        texture, metallic = metal_of_gloss(
            texture, layers, np.array(numbers(glossy.get("specularFactor", [1, 1, 1]), 3, 0, 1))
        )
    else:
        roughness = _map(layers, 1, parts.get("roughnessFactor"))
        metallic = _map(layers, 2, parts.get("metallicFactor"))
    normals = None
    if bumps is not None:
        normals = scaled_normals(bumps, number(material[NORMALS].get("scale", 1.0), -1e3, 1e3))
    for image in (texture, roughness, metallic, normals):
        if image is not None:
            reader.count(image)
    return Material(
        texture,
        factor,
        cutoff if mode == "MASK" and least < cutoff else None,
        roughness,
        metallic,
        normals,
        placed[0][1] if placed else Placement(),
    )


@dataclass(frozen=True)
class _Keys:
    base: str
    factor: str
    layers: str


_METALLIC_KEYS = _Keys("baseColorTexture", "baseColorFactor", "metallicRoughnessTexture")
_GLOSSY_KEYS = _Keys("diffuseTexture", "diffuseFactor", "specularGlossinessTexture")


def _map(layers: np.ndarray | None, channel: int, factor: Any) -> np.ndarray | None:
    if layers is not None:
        return scaled_map(layers[..., channel], 1.0 if factor is None else number(factor, 0, 1))
    return None if factor is None else uniform_map(number(factor, 0, 1))


def metal_of_gloss(
    diffuse: np.ndarray, layers: np.ndarray | None, factor: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Base colour and metallic of diffuse and specular colours, as Khronos' conversion has them.

    Metallic is what makes one base colour give both: the root of a quadratic in the colours' brightness.

    Parameters
    ----------
    diffuse
        (h, w, 4) uint8.
    layers
        (h, w, 4) uint8 with the specular colour, sRGB-encoded, of any size; None without.
    factor
        (3,) scene-linear, that the specular colour is multiplied by.

    Returns
    -------
    texture
        (h, w, 4) uint8, at the larger size of the two.
    metallic
        (h, w) uint8; None where nothing is metal.
    """
    glossy = uniform_texture(np.ones(4)) if layers is None else layers
    size = np.maximum(diffuse.shape[:2], glossy.shape[:2])
    base = resized(diffuse, *size)
    specular = srgb_decode(resized(glossy, *size)[..., :3] / 255) * factor
    colour = srgb_decode(base[..., :3] / 255)
    strongest = specular.max(axis=-1)
    bright, shine = (np.sqrt(rgb**2 @ _BRIGHTNESS) for rgb in (colour, specular))
    linear = bright * (1 - strongest) / (1 - _DIELECTRIC) + shine - 2 * _DIELECTRIC
    root = np.sqrt(np.maximum(linear**2 - 4 * _DIELECTRIC * (_DIELECTRIC - shine), 0))
    metallic = np.clip((root - linear) / (2 * _DIELECTRIC), 0, 1) * (shine >= _DIELECTRIC)
    metal = metallic[..., None]
    of_diffuse = colour * (1 - strongest[..., None]) / (1 - _DIELECTRIC) / np.maximum(1 - metal, 1e-6)
    of_specular = (specular - _DIELECTRIC * (1 - metal)) / np.maximum(metal, 1e-6)
    mixed = of_diffuse + (of_specular - of_diffuse) * metal**2
    result = base.copy()
    result[..., :3] = np.rint(255 * srgb_encode(mixed))
    levels = np.rint(255 * metallic).astype(np.uint8)
    return result, levels if levels.any() else None


def _roughness_of_glossiness(layers: np.ndarray | None, factor: Any) -> np.ndarray | None:
    """Roughness is one less glossiness, which is in the alpha channel."""
    glossiness = _map(layers, 3, factor)
    return None if glossiness is None else np.ascontiguousarray(255 - glossiness)


def _image(
    file: Gltf, parts: Json, key: str, name: str, reader: TextureReader
) -> tuple[np.ndarray | None, Placement]:
    """RGBA of one of a material's textures and where it lies; None where it has none."""
    if key not in parts:
        return None, Placement()
    entry = parts[key]
    texture = file.entry("textures", entry["index"])
    described = extensions(texture)
    source = described[WEBP]["source"] if WEBP in described else texture.get("source")
    if source is None:
        raise file.unsupported(*(described or ["of no name"]))
    image = file.entry("images", source)
    where = f"{file.path}, image {source}"
    if "bufferView" in image:
        rgba = reader.data(("image", source), bytes(file.view(image["bufferView"])), where)
    else:
        data = file.named(image["uri"])
        if data is None:
            kind = {"baseColorTexture": "base colour texture"}.get(key, key)
            raise InputError(
                str(file.path),
                f"its {kind} {shortened(str(image['uri']))} of material {name} is missing in its folder",
                "Put it where the file says, or name a texture for the object",
            )
        rgba = reader.data(("image", source), data, where)
    sampler = file.entry("samplers", texture["sampler"]) if "sampler" in texture else {}
    repeats = {sampler.get("wrapS", REPEAT), sampler.get("wrapT", REPEAT)} == {REPEAT}
    return rgba, _placement(entry, repeats)


def _placement(entry: Json, repeats: bool) -> Placement:
    moved = extensions(entry).get(TEXTURE_TRANSFORM, {})
    shift, scale = numbers(moved.get("offset", [0, 0]), 2), numbers(moved.get("scale", [1, 1]), 2)
    return Placement(
        whole(moved.get("texCoord", entry.get("texCoord", 0))),
        (shift[0], shift[1]),
        number(moved.get("rotation", 0.0)),
        (scale[0], scale[1]),
        repeats,
    )
