"""glTF, GLB, PLY and STL, read with trimesh and its silences turned into errors."""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PIL import Image

from objectfolder.errors import InputError
from objectfolder.geometry.material_library import DEFAULT_COLOUR
from objectfolder.geometry.mesh import TexturedMesh
from objectfolder.geometry.textures import (
    corner_colour_atlas,
    opaque,
    read_texture,
    rgba_of,
    scaled_map,
    srgb_encode,
    tint,
    uniform_map,
    uniform_texture,
)

Value = TypeVar("Value")

FORMATS = {".gltf": "glTF", ".glb": "binary glTF", ".ply": "PLY", ".stl": "STL"}

_HARMLESS_EXTENSIONS = ("KHR_materials_", "KHR_lights_", "EXT_texture_webp", "KHR_xmp")


def read_scene(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read a glTF, GLB, PLY or STL file as it is, uncleaned; corners without texture coordinates get NaN.

    All nodes of a glTF scene are joined with their transforms applied (a mirrored node keeps its outside);
    its up axis stays y. Texture and base colour factor are multiplied; vertex and face colours become a
    texture where there is no other. Alpha counts as the material's `alphaMode` says (OPAQUE ignores it, MASK
    cuts at `alphaCutoff`, BLEND blends); that of vertex colours is ignored. Roughness is the green, metallic
    the blue channel of `metallicRoughnessTexture`, each times its factor; a factor that is written counts
    without a texture, and where neither is, the object's material has its say rather than glTF's default, a
    rough metal.

    Parameters
    ----------
    with_textures
        False leaves materials and textures out (they may then be missing).

    Raises
    ------
    InputError
        Not a file of its kind, no faces, a missing or broken texture, a texture on other coordinates than the
        first, an extension that is not supported.
    """
    import trimesh

    kind = FORMATS[path.suffix.lower()]
    header = gltf_header(path) if path.suffix.lower() in (".gltf", ".glb") else None
    # Textures of PLY are read here, as trimesh only logs one that is missing.
    options = {"skip_materials": True} if path.suffix.lower() == ".ply" else {}
    try:
        scene = trimesh.load_scene(str(path), process=False, **options)
        nodes = [scene.graph[name] for name in sorted(scene.graph.nodes_geometry)]
        parts = [(np.asarray(transform), scene.geometry[name]) for transform, name in nodes]
    except Exception as problem:
        raise InputError(
            str(path),
            f"cannot be read as {kind} ({problem})",
            "Check that the file is complete and what it says",
        ) from problem
    parts = [part for part in parts if len(getattr(part[1], "faces", ()))]
    if not parts:
        raise InputError(str(path), "holds no faces", f"Use a {kind} file with triangles")
    meshes = [_textured(path, transform, geometry, header, with_textures) for transform, geometry in parts]
    return _joined(meshes)


def _textured(
    path: Path, transform: np.ndarray, geometry: Any, header: dict[str, Any] | None, with_textures: bool
) -> TexturedMesh:
    faces = np.array(geometry.faces, dtype=np.int64)
    local = np.array(geometry.vertices, dtype=np.float64)
    # Written out so that equal positions stay bitwise equal, which a BLAS product does not promise.
    columns = [local[:, [axis]] * transform[:3, axis] for axis in range(3)]
    vertices = columns[0] + columns[1] + columns[2] + transform[:3, 3]
    coordinates = np.full((len(faces), 3, 2), np.nan)
    uv = getattr(geometry.visual, "uv", None)
    if uv is not None and np.shape(uv) == (len(vertices), 2):
        coordinates = np.asarray(uv, dtype=np.float64)[faces]
    material = _Material(uniform_texture(DEFAULT_COLOUR))
    if with_textures:
        material = _material(path, geometry, header)
    if with_textures and geometry.visual.kind in ("vertex", "face"):
        colours = _corner_colours(geometry, faces)
        if header is not None:
            colours[..., :3] = srgb_encode(colours[..., :3])  # glTF's vertex colours are scene-linear
        atlas, coordinates = corner_colour_atlas(colours)
        material = _Material(opaque(atlas))
    if np.linalg.det(transform[:3, :3]) < 0:
        faces, coordinates = faces[:, ::-1], coordinates[:, ::-1]
    return TexturedMesh(
        vertices,
        faces,
        coordinates,
        (material.texture,),
        np.zeros(len(faces), dtype=np.int32),
        alpha_cutoffs={} if material.alpha_cutoff is None else {0: material.alpha_cutoff},
        roughness_maps={} if material.roughness is None else {0: material.roughness},
        metallic_maps={} if material.metallic is None else {0: material.metallic},
    )


def _corner_colours(geometry: Any, faces: np.ndarray) -> np.ndarray:
    """RGBA (F, 3, 4) in 0..1 of vertex or face colours."""
    if geometry.visual.kind == "vertex":
        return np.asarray(geometry.visual.vertex_colors, dtype=np.float64)[faces] / 255
    return np.repeat(np.asarray(geometry.visual.face_colors, dtype=np.float64)[:, None] / 255, 3, axis=1)


@dataclass(frozen=True)
class _Material:
    """Base colour (h, w, 4), the alpha from which it is there, and its maps (h, w), where it has them."""

    texture: np.ndarray
    alpha_cutoff: float | None = None
    roughness: np.ndarray | None = None
    metallic: np.ndarray | None = None


def _material(path: Path, geometry: Any, header: dict[str, Any] | None) -> _Material:
    if header is None:
        return _Material(opaque(_ply_texture(path)))
    material = getattr(geometry.visual, "material", None)
    if material is None:
        return _Material(uniform_texture(DEFAULT_COLOUR))
    base = _image(path, material, "baseColorTexture", header)
    texture = tint(uniform_texture(np.ones(4)) if base is None else base, _factor(material, header))
    mode = getattr(material, "alphaMode", None) or "OPAQUE"
    cutoff = getattr(material, "alphaCutoff", None)
    cutoff = 0.5 if cutoff is None else float(cutoff)
    least = int(texture[..., 3].min()) / 255
    if mode == "OPAQUE" or (mode == "MASK" and least >= cutoff):
        texture = opaque(texture)
    masked = mode == "MASK" and least < cutoff
    levels = _image(path, material, "metallicRoughnessTexture", header)
    return _Material(
        texture,
        cutoff if masked else None,
        _map(levels, 1, getattr(material, "roughnessFactor", None)),
        _map(levels, 2, getattr(material, "metallicFactor", None)),
    )


def _map(levels: np.ndarray | None, channel: int, factor: float | None) -> np.ndarray | None:
    if levels is not None:
        return scaled_map(levels[..., channel], 1.0 if factor is None else float(factor))
    return None if factor is None else uniform_map(float(factor))


def _image(path: Path, material: Any, key: str, header: dict[str, Any]) -> np.ndarray | None:
    """RGBA of one of a material's textures; None where it has none."""
    image = getattr(material, key, None)
    if not isinstance(image, Image.Image):
        _refuse_missing_texture(path, getattr(material, "name", None), key, header)
        return None
    named = [entry for entry in header.get("materials", []) if entry.get("name") == material.name]
    if any(entry.get("pbrMetallicRoughness", {}).get(key, {}).get("texCoord", 0) for entry in named):
        raise InputError(
            str(path),
            f"{key} of material {material.name!r} uses a second set of texture coordinates",
            "Bake it to the first set",
        )
    try:
        return rgba_of(image, str(path))
    except (OSError, SyntaxError) as problem:
        raise InputError(
            str(path), f"its texture cannot be read ({problem})", "Repair the texture, or name another one"
        ) from problem


def _factor(material: Any, header: dict[str, Any]) -> np.ndarray:
    """Scene-linear base colour factor RGBA in 0..1.

    Read from the file where the material's name is unique: trimesh rounds it to 8 bits, coarse in the dark.
    """
    named = [entry for entry in header.get("materials", []) if entry.get("name") == material.name]
    if len(named) == 1:
        factor = named[0].get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1, 1])
        return np.asarray(factor, dtype=np.float64)
    rounded = material.baseColorFactor
    return np.ones(4) if rounded is None else np.append(np.asarray(rounded) / 255, 1.0)[:4]


def _ply_texture(path: Path) -> np.ndarray:
    """Texture that a PLY header names, or the default colour (which STL always has)."""
    name = ply_texture_name(path) if path.suffix.lower() == ".ply" else None
    return uniform_texture(DEFAULT_COLOUR) if name is None else read_texture(path.parent / name)


def ply_texture_name(path: Path) -> str | None:
    """Return what the `comment TextureFile` of a PLY header names."""
    with path.open("rb") as lines:
        for line in lines:
            if line.startswith(b"comment TextureFile"):
                return line[len(b"comment TextureFile") :].strip().decode(errors="replace")
            if line.startswith(b"end_header") or not line.isascii():
                break
    return None


def gltf_header(path: Path) -> dict[str, Any]:
    """Read the JSON of a glTF or GLB file; InputError where it is none or needs an unknown extension."""
    data = path.read_bytes()
    try:
        if path.suffix.lower() == ".glb":
            magic, _, _, length, chunk = struct.unpack_from("<4sIII4s", data)
            if magic != b"glTF" or chunk != b"JSON":
                raise ValueError("the first bytes are not those of a GLB file")
            data = data[20 : 20 + length]
        header = json.loads(data.decode("utf-8"))
        if not isinstance(header, dict) or "asset" not in header:
            raise ValueError("no glTF asset in it")
    except (ValueError, struct.error) as problem:
        kind = FORMATS[path.suffix.lower()]
        raise InputError(
            str(path), f"cannot be read as {kind} ({problem})", "Export the mesh again"
        ) from problem
    required = [
        name for name in header.get("extensionsRequired", []) if not name.startswith(_HARMLESS_EXTENSIONS)
    ]
    if required:
        raise InputError(
            str(path),
            f"needs the glTF extension {', '.join(required)}, which is not supported",
            "Export it without compression, quantisation and texture transforms",
        )
    return header


def _refuse_missing_texture(path: Path, material: str | None, key: str, header: dict[str, Any]) -> None:
    """Raise where the file gives a material a texture `key` that trimesh could not read."""
    named = [entry for entry in header.get("materials", []) if entry.get("name") == material]
    textured = [entry.get("pbrMetallicRoughness", {}).get(key) for entry in named]
    if not textured or any(entry is None for entry in textured):
        return
    source = header.get("textures", [])[textured[0]["index"]].get("source")
    image = (
        header.get("images", [])[source].get("uri", "in the file") if source is not None else "in the file"
    )
    kind = {"baseColorTexture": "base colour texture"}.get(key, key)
    raise InputError(
        str(path),
        f"its {kind} {image!r} of material {material!r} is missing or cannot be read",
        "Put it where the file says, or name a texture for the object",
    )


def _joined(meshes: list[TexturedMesh]) -> TexturedMesh:
    vertex_offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return TexturedMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, vertex_offsets, strict=False)]),
        np.concatenate([mesh.texture_coordinates for mesh in meshes]),
        tuple(mesh.textures[0] for mesh in meshes),
        np.concatenate(
            [np.full(len(mesh.faces), index, dtype=np.int32) for index, mesh in enumerate(meshes)]
        ),
        alpha_cutoffs=_of_each([mesh.alpha_cutoffs for mesh in meshes]),
        roughness_maps=_of_each([mesh.roughness_maps for mesh in meshes]),
        metallic_maps=_of_each([mesh.metallic_maps for mesh in meshes]),
    )


def _of_each(parts: list[Mapping[int, Value]]) -> dict[int, Value]:
    """What the only textures of meshes have, by the number of the mesh."""
    return {index: part[0] for index, part in enumerate(parts) if 0 in part}
