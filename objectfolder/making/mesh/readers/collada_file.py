"""COLLADA (.dae): the geometries of its scene in their places, with the colours of their materials."""

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.making.mesh.readers.files import (
    find_file,
    read_bytes,
    refuse_unusable,
    shortened,
    unreadable,
    usual_places,
)
from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.making.mesh.readers.parts import joined_meshes
from objectfolder.making.mesh.readers.polygons import triangulated
from objectfolder.making.mesh.readers.textures import (
    corner_colour_atlas,
    opaque,
    read_texture,
    uniform_texture,
)
from objectfolder.making.mesh.readers.xml_tree import xml_tree
from objectfolder.surface.textured_mesh import TexturedMesh

_BLACK = 0.02
"""A colour, sRGB-encoded, that is nowhere brighter comes out black."""
_OPAQUE = 0.99


def read_collada(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read a COLLADA file in metres, by the unit that it states; which axis is up is left as it is.

    Diffuse colours, pictures and colours of vertices are read, without transparency; emission where the
    diffuse colour is black.

    Parameters
    ----------
    with_textures
        False leaves colours out; pictures may then be missing.

    Raises
    ------
    InputError
        Not COLLADA, no faces, a mesh that a skeleton poses, a missing or broken picture.
    """
    document = _document(path)
    if document.scene is None:
        raise InputError(str(path), "has no scene", "Export the mesh again")
    if any(True for _ in document.scene.objects("controller")):
        finding = "is posed by a skeleton, which is not supported"
        raise InputError(str(path), finding, "Apply the armature before it is exported")
    remarks: dict[str, None] = {}
    materials = {material.id: material for material in document.materials} if with_textures else None
    try:
        unit_m = document.assetInfo.unitmeter
        parts = [
            part
            for bound in document.scene.objects("geometry")
            for primitive in bound.primitives()
            for part in _parts(path, primitive, bound.matrix, unit_m, materials, remarks)
        ]
    except (ValueError, KeyError, IndexError, TypeError, AttributeError) as problem:
        raise unreadable(path, "COLLADA", problem) from problem
    if not parts:
        raise InputError(str(path), "holds no faces", "Use a COLLADA file with polygons in its scene")
    mesh = joined_meshes(parts)
    refuse_unusable(path, mesh.vertices)
    return replace(mesh, remarks=tuple(remarks))


def collada_files(path: Path) -> list[Path]:
    """Return the pictures that a COLLADA file names and that are there."""
    pictures = [_picture(path, image.path) for image in _document(path).images]
    return [picture for picture in pictures if picture is not None]


def _document(path: Path) -> Any:
    with needs_extra("factory"):
        import collada
    data = read_bytes(path)
    try:
        xml_tree(data)  # refuses what a parser of XML should not be given
        return collada.Collada(io.BytesIO(data), ignore=[collada.common.DaeUnsupportedError])
    except (collada.common.DaeError, ValueError, KeyError, IndexError, TypeError, AttributeError) as problem:
        raise unreadable(path, "COLLADA", problem) from problem


def _parts(
    path: Path,
    primitive: Any,
    matrix: np.ndarray,
    unit_m: float,
    materials: dict[str, Any] | None,
    remarks: dict[str, None],
) -> Iterator[TexturedMesh]:
    """Yield the polygons of a primitive as a mesh, without colours for None as `materials`.

    Nothing of lines and of what is empty is there.
    """
    original = primitive.original
    if not hasattr(primitive, "shapes") or not len(original.index) or hasattr(primitive, "lines"):
        return
    indices = original.index.reshape(-1, original.nindices)  # a row for a corner, a column for an input
    counts = original.vcounts if hasattr(original, "vcounts") else np.full(len(indices) // 3, 3)
    corners = indices[:, original.sources["VERTEX"][0][0]].astype(np.int64)
    vertices = np.asarray(primitive.vertex, dtype=np.float64) * (unit_m or 1.0)
    if corners.min() < 0 or corners.max() >= len(vertices) or min(counts) < 3:
        raise ValueError("a polygon has fewer than three corners, or names a vertex that is not there")
    loops = np.split(corners, np.cumsum(counts)[:-1])
    places, _ = triangulated(vertices, [loop.tolist() for loop in loops])
    faces = corners[places]
    texture, coordinates = uniform_texture(DEFAULT_COLOUR), np.full((len(faces), 3, 2), np.nan)
    if materials is not None:
        material = _material(primitive, materials, remarks)
        texture, coordinates = _looks(path, primitive, material, indices[places.reshape(-1)], remarks)
    if np.linalg.det(matrix[:3, :3]) < 0:
        faces, coordinates = faces[:, ::-1], coordinates[:, ::-1]
    of_face = np.zeros(len(faces), dtype=np.int32)
    yield TexturedMesh(vertices, faces, coordinates, (texture,), of_face, np.zeros((len(faces), 3, 3)))


def _material(primitive: Any, materials: dict[str, Any], remarks: dict[str, None]) -> Any:
    """Return the material that a node binds to a primitive, else that whose id the primitive names.

    The format wants a binding (`bind_material`); exporters leave it out, and then mean the id. None where
    there is neither.
    """
    symbol = primitive.original.material
    material = primitive.material or materials.get(symbol)
    if material is None and symbol:
        remarks[f"its material {shortened(symbol)} is bound to none (bind_material): it is drawn grey"] = None
    elif material is None and materials:
        remarks["some of its faces name no material: they are drawn grey"] = None
    return material


def _looks(
    path: Path, primitive: Any, material: Any, corners: np.ndarray, remarks: dict[str, None]
) -> tuple[np.ndarray, np.ndarray]:
    """Texture, and its coordinates (F, 3, 2), of faces by the rows (3 F, inputs) of their corners."""
    effect = getattr(material, "effect", None)
    looks: Any = getattr(effect, "diffuse", None)
    emission = getattr(effect, "emission", None)
    if emission is not None and _is_black(looks) and not _is_black(emission):
        looks = emission
        remarks["emission is taken for the colour (diffuse), which is black"] = None
    if _lets_light_through(effect):
        remarks["its transparency is not read: it is drawn opaque"] = None
    sources = primitive.original.sources
    sampler = getattr(looks, "sampler", None)
    if sampler is not None:
        name = sampler.surface.image.path
        picture = _picture(path, name)
        if picture is None:
            remedy = "Add the file, or name the texture"
            raise InputError(str(path), f"names the picture {name[:100]!r}, which is not there", remedy)
        _, chosen = (primitive.inputmap or {}).get(looks.texcoord, ("TEXCOORD", None))
        sets = sources.get("TEXCOORD", [])
        source = next((source for source in sets if chosen is None or str(source[3]) == str(chosen)), None)
        coordinates = np.full((len(corners) // 3, 3, 2), np.nan)
        if source is not None:
            coordinates = source[4].data[corners[:, source[0]], :2].reshape(-1, 3, 2).astype(np.float64)
        return opaque(read_texture(picture)), coordinates
    colours = np.ones((len(corners), 4))
    if sources.get("COLOR"):
        source = sources["COLOR"][0]
        colours[:, :3] = np.clip(source[4].data[corners[:, source[0]], :3], 0, 1)
    if (colours < 1).any():
        if looks is not None:
            remarks["the colours of its vertices are taken, and not those of its materials"] = None
        texture, coordinates = corner_colour_atlas(colours.reshape(-1, 3, 4))
        return opaque(texture), coordinates
    colour = DEFAULT_COLOUR if looks is None else np.clip(np.asarray(looks[:3], dtype=np.float64), 0, 1)
    return uniform_texture(colour), np.full((len(corners) // 3, 3, 2), np.nan)


def _is_black(looks: Any) -> bool:
    """Whether a colour is absent or comes out black; a picture does not."""
    return looks is None or (isinstance(looks, tuple) and max(looks[:3]) <= _BLACK)


def _lets_light_through(effect: Any) -> bool:
    """Whether an effect states a transparency, by the alpha or by the colour of `transparent`."""
    transparent, share = getattr(effect, "transparent", None), getattr(effect, "transparency", None)
    if not isinstance(transparent, tuple):
        return transparent is not None
    share = share if isinstance(share, float) else 1.0
    by_alpha = effect.opaque_mode == "A_ONE"
    opacity = transparent[3] * share if by_alpha else 1 - max(transparent[:3]) * share
    return opacity < _OPAQUE


def _picture(path: Path, name: str) -> Path | None:
    """Find a picture in the folder of the mesh, by its place or by its name alone."""
    return find_file(path.parent, usual_places(unquote(name.removeprefix("file://"))), within=path.parent)
