"""3MF: a zip archive with meshes, their places and colours in XML."""

import posixpath
import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import LARGEST_FILE_BYTES, refuse_unusable, shortened, unreadable
from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.making.mesh.readers.parts import joined_meshes
from objectfolder.making.mesh.readers.textures import (
    corner_colour_atlas,
    decode_texture,
    opaque,
    uniform_texture,
)
from objectfolder.making.mesh.readers.vertex_colours import alpha_remark
from objectfolder.making.mesh.readers.xml_tree import xml_tree
from objectfolder.surface.textured_mesh import TexturedMesh

_UNITS_M = {
    "micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0,
}  # fmt: skip
_MODEL_RELATION = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_USUAL_MODEL = "3D/3dmodel.model"
_DEEPEST = 32
_EXTENSIONS = ("core", "material", "production", "trianglesets")
"""Of the standard, by their names in the addresses of namespaces; others add to the shape or take from it."""
_NAMESPACES = re.compile(rb"xmlns:(\w+)\s*=\s*[\"']([^\"']*)")
_SUPPORTS = ("support", "solidsupport", "other")
"""Types of objects that hold others while they are printed, and are no part of them."""
_SETTINGS = ("metadata/model_settings.config", "metadata/slic3r_pe_model.config")
_NOT_SOLID = re.compile(
    rb"(modifier_part|negative_part|support_blocker|support_enforcer|ParameterModifier|NegativeVolume"
    rb"|SupportBlocker|SupportEnforcer)"
)
"""What slicers write of meshes that are no part of the solid: Orca, Bambu Studio, PrusaSlicer."""
_PAINTED = {"paint_color", "mmu_segmentation"}
MOST_TRIANGLES = 10_000_000
"""Of all places together: few bytes may ask for very many by naming one object often."""


@dataclass(frozen=True)
class _Body:
    """A mesh with an index of a property for each corner, or other objects in their places."""

    vertices: np.ndarray
    faces: np.ndarray
    property_ids: list[str]
    property_indices: np.ndarray
    is_support: bool
    components: list[tuple[str, str, np.ndarray]]


@dataclass(frozen=True)
class _Model:
    """A part of the archive: objects, colours (n, 4), and pictures with coordinates (n, 2), by their ids."""

    unit_m: float
    bodies: dict[str, _Body] = field(default_factory=dict)
    colours: dict[str, np.ndarray] = field(default_factory=dict)
    pictures: dict[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    items: list[tuple[str, str, np.ndarray]] = field(default_factory=list)
    all_printed: bool = True


def read_three_mf(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read a 3MF file in metres, by the unit that it states: all objects in the places of its plate.

    Colours are those of base materials, colour groups and textures, without their alpha. Supports for
    printing are left out, and so are items that are not printed.

    Parameters
    ----------
    with_textures
        False leaves colours out.

    Raises
    ------
    InputError
        Not 3MF, encrypted or cut short, no faces, an index out of range, a broken picture, an extension that
        adds to the shape, a mesh that a slicer takes for no part of the solid.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > LARGEST_FILE_BYTES:
                raise ValueError(f"it unpacks to more than {LARGEST_FILE_BYTES} bytes")
            reader = _Reader(path, archive, with_textures)
            parts = list(reader.parts())
    except (
        zipfile.BadZipFile, zlib.error, ValueError, KeyError, IndexError, RuntimeError, EOFError, OSError,
        OverflowError,
    ) as problem:  # fmt: skip
        raise unreadable(path, "3MF", problem) from problem
    if not parts:
        raise InputError(str(path), "holds no faces", "Use a 3MF file with meshes on its plate")
    mesh = joined_meshes(parts)
    refuse_unusable(path, mesh.vertices)
    return replace(mesh, remarks=tuple(reader.remarks))


class _Reader:
    """Meshes of an archive in their places."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, with_textures: bool) -> None:
        self.path, self.archive, self.with_textures = path, archive, with_textures
        self.names = {name.lower().lstrip("/"): name for name in archive.namelist()}
        self.models: dict[str, _Model] = {}
        self.textures: dict[str, np.ndarray] = {}
        self.remarks: dict[str, None] = {}
        self.triangles = 0

    def parts(self) -> Iterator[TexturedMesh]:
        """Yield meshes of one texture each."""
        self.refuse_modifiers()
        first = self.first_model()
        model = self.model(first)
        if not model.all_printed:
            self.remarks["items that are not to be printed are left out"] = None
        for place, object_id, transform in model.items:
            yield from self.placed(place or first, object_id, transform, model.unit_m, 0)

    def refuse_modifiers(self) -> None:
        """Refuse what a slicer's settings take from the solid, or lay around it."""
        for name in _SETTINGS:
            if name in self.names and (kind := _NOT_SOLID.search(self.read(name))):
                raise InputError(
                    str(self.path),
                    f"has a mesh that is no part of the solid ({kind[1].decode()} of a slicer)",
                    "Export the object alone, as STL or 3MF",
                )

    def first_model(self) -> str:
        """Name of the part that the archive begins with."""
        if "_rels/.rels" in self.names:
            for relation in xml_tree(self.read("_rels/.rels")):
                if relation.get("Type") == _MODEL_RELATION:
                    return relation.get("Target", _USUAL_MODEL)
        return _USUAL_MODEL

    def read(self, name: str) -> bytes:
        """Bytes of a part; KeyError where there is none."""
        return self.archive.read(self.names[posixpath.normpath(name).lower().lstrip("/")])

    def model(self, name: str) -> _Model:
        """Return a part, read once."""
        if name not in self.models:
            data = self.read(name)
            root = xml_tree(data)
            _refuse_extensions(self.path, root, data)
            self.models[name] = _model(root)
            if self.with_textures:
                _say_what_is_not_read(root, self.models[name], self.remarks)
        return self.models[name]

    def placed(
        self, name: str, object_id: str, transform: np.ndarray, unit_m: float, depth: int
    ) -> Iterator[TexturedMesh]:
        """Yield an object, and those that it is made of, transformed by (4, 3) and scaled to metres."""
        model = self.model(name)
        body = model.bodies[object_id]
        if body.is_support:
            self.remarks["supports for printing are left out"] = None
            return
        if depth > _DEEPEST:
            raise ValueError("objects are made of one another")
        for place, component, local in body.components:
            around = local @ transform[:3]
            around[3] += transform[3]
            yield from self.placed(place or name, component, around, unit_m, depth + 1)
        self.triangles += len(body.faces)
        if self.triangles > MOST_TRIANGLES:
            raise ValueError(f"it has more than {MOST_TRIANGLES} triangles in all")
        if not len(body.faces):
            return
        if not 0 <= body.faces.min() <= body.faces.max() < len(body.vertices):
            raise ValueError("a triangle names a vertex that is not there")
        # Written out so that equal positions stay bitwise equal, which a BLAS product does not promise.
        columns = [body.vertices[:, [axis]] * transform[axis] for axis in range(3)]
        vertices = (columns[0] + columns[1] + columns[2] + transform[3]) * unit_m
        turned = np.linalg.det(transform[:3]) < 0
        by_id: dict[str, list[int]] = {}
        for face, property_id in enumerate(
            body.property_ids if self.with_textures else [""] * len(body.faces)
        ):
            by_id.setdefault(property_id, []).append(face)
        for property_id, rows in by_id.items():
            faces = body.faces[rows]
            texture, coordinates = self.looks(model, property_id, body.property_indices[rows])
            if turned:
                faces, coordinates = faces[:, ::-1], coordinates[:, ::-1]
            yield TexturedMesh(
                vertices,
                faces,
                coordinates,
                (texture,),
                np.zeros(len(faces), dtype=np.int32),
                np.zeros((len(faces), 3, 3)),
            )

    def looks(self, model: _Model, property_id: str, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Texture, and its coordinates (F, 3, 2), of faces with these indices (F, 3) of one property."""
        if property_id in model.pictures:
            name, coordinates = model.pictures[property_id]
            if name not in self.textures:
                self.textures[name] = opaque(decode_texture(self.read(name), f"{self.path}, {name}"))
            return self.textures[name], coordinates[indices]
        if property_id in model.colours:
            texture, coordinates = corner_colour_atlas(model.colours[property_id][indices])
            return opaque(texture), coordinates
        if property_id:
            self.remarks["it has composite or mixed properties, which are not read and are drawn grey"] = None
        return uniform_texture(DEFAULT_COLOUR), np.full((len(indices), 3, 2), np.nan)


def _refuse_extensions(path: Path, root: Element, data: bytes) -> None:
    """Raise `InputError` where a part needs an extension of 3MF that is not read, such as a beam lattice."""
    spaces = {prefix.decode(): space.decode() for prefix, space in _NAMESPACES.findall(data)}
    needed = [spaces.get(prefix, prefix) for prefix in root.get("requiredextensions", "").split()]
    if foreign := [space for space in needed if not any(f"/{name}/" in space for name in _EXTENSIONS)]:
        finding = f"needs the extension of 3MF {shortened(foreign[0])}, which is not supported"
        raise InputError(str(path), finding, "Export it as a mesh alone")


def _say_what_is_not_read(root: Element, model: _Model, remarks: dict[str, None]) -> None:
    """Note opacities, and colours that slicers paint on triangles in codes of their own."""
    if any(not _PAINTED.isdisjoint(triangle.attrib) for triangle in root.iter("triangle")):
        remarks["colours that a slicer painted on its faces are not read"] = None
    remarks |= dict.fromkeys(alpha_remark(colours[:, 3] for colours in model.colours.values()))


def _model(root: Element) -> _Model:
    items = [item for build in root.iter("build") for item in build.iter("item")]
    printed = [item for item in items if item.get("printable", "1") not in ("0", "false")] or items
    model = _Model(_UNITS_M[root.get("unit", "millimeter")], all_printed=len(printed) == len(items))
    pictures = {element.get("id", ""): element.get("path", "") for element in root.iter("texture2d")}
    for tag, item, key in (("basematerials", "base", "displaycolor"), ("colorgroup", "color", "color")):
        for group in root.iter(tag):
            model.colours[group.get("id", "")] = np.array(
                [_colour(element.get(key, "")) for element in group.iter(item)]
            )
    for group in root.iter("texture2dgroup"):
        pairs = [
            [float(element.attrib["u"]), float(element.attrib["v"])] for element in group.iter("tex2coord")
        ]
        model.pictures[group.get("id", "")] = (pictures[group.attrib["texid"]], np.array(pairs))
    for element in root.iter("object"):
        model.bodies[element.attrib["id"]] = _body(element)
    model.items.extend(_place(item) for item in printed)
    return model


def _body(element: Element) -> _Body:
    of_all, first = element.get("pid", ""), element.get("pindex", "0")
    vertices = [[float(vertex.attrib[axis]) for axis in "xyz"] for vertex in element.iter("vertex")]
    triangles = [triangle.attrib for triangle in element.iter("triangle")]
    faces = [[int(triangle[corner]) for corner in ("v1", "v2", "v3")] for triangle in triangles]
    indices = []
    for triangle in triangles:
        start = triangle.get("p1", first)
        indices.append([int(start), int(triangle.get("p2", start)), int(triangle.get("p3", start))])
    return _Body(
        np.array(vertices).reshape(-1, 3),
        np.array(faces, dtype=np.int64).reshape(-1, 3),
        [triangle.get("pid", of_all) for triangle in triangles],
        np.array(indices, dtype=np.int64).reshape(-1, 3),
        element.get("type", "model") in _SUPPORTS,
        [_place(component) for component in element.iter("component")],
    )


def _place(element: Element) -> tuple[str, str, np.ndarray]:
    """Part of the archive, or nothing for the same, id of an object, and its transform (4, 3)."""
    numbers = np.array(element.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split(), dtype=np.float64)
    return element.get("path", ""), element.attrib["objectid"], numbers.reshape(4, 3)


def _colour(text: str) -> list[float]:
    """RGBA in 0..1 of #RRGGBB or #RRGGBBAA."""
    return [int(text[start : start + 2] or "ff", 16) / 255 for start in (1, 3, 5, 7)]
