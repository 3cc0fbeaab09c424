"""The textured triangle mesh every loader returns and every sense reads, and its length in metres.

A length is stated or as in the file, and checked for slips of unit.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from objectfolder.errors import InputError
from objectfolder.products.store import Array, Product
from objectfolder.surface.surface import Surface

SHORTEST_M = 0.003
"""A touch sensor's gel is 16 mm wide and a scan's noise 0.3 mm: nothing below this can be simulated."""

LONGEST_M = 30.0
"""Longest side that may be stated; a ship of 24 m is accepted."""

LONGEST_AS_IN_FILE_M = 5.0
"""Longest side that a file's own units may give; furniture is below 3 m, and larger is mostly millimetres."""

UNUSUAL_M = 3.0
"""Objects above this are accepted with a warning."""


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """Triangles with a base colour texture each, and maps of reflectance where the source has them.

    Texture coordinates belong to face corners, not to vertices, so that vertices can be welded into a closed
    solid for sound and touch while texture seams stay as they are for sight.

    Parameters
    ----------
    vertices
        (V, 3) float64, metres in the object frame.
    faces
        (F, 3) int64 vertex indices, counter-clockwise seen from outside.
    texture_coordinates
        (F, 3, 2) float64 of each corner, v up (OpenGL). Outside 0..1 the texture repeats.
    textures
        At least one (h, w, 4) uint8 RGBA image: sRGB-encoded, straight alpha, row 0 on top. An untextured
        material is one texel of its base colour. Alpha is coverage: 255 wherever the source does not ask
        for transparency.
    face_texture
        (F,) int32 index into `textures`.
    normals
        (F, 3, 3) of each corner, custom and split ones included, zero or not finite where the source has
        none; None for none at all.
    alpha_cutoffs
        By index of a texture: the alpha in 0..1 from which the surface is there, below which it is not.
        Alpha of textures without a cutoff blends.
    roughness_maps, metallic_maps
        By index of a texture: (h, w) uint8 image on the same coordinates, linear, 0..255 for 0..1, row 0 on
        top; any size, one texel for a constant. Textures without one have the material's value.
    normal_maps
        By index of a texture: (h, w, 3) uint8 image on the same coordinates, row 0 on top, of normals in the
        tangent space of MikkTSpace, -1..1 as 0..255, green along v up (OpenGL).
    remarks
        What a reader took otherwise than the file says it, or left out, and it shows: sentences.
    """

    vertices: np.ndarray
    faces: np.ndarray
    texture_coordinates: np.ndarray
    textures: tuple[np.ndarray, ...]
    face_texture: np.ndarray
    normals: np.ndarray | None = None
    alpha_cutoffs: Mapping[int, float] = field(default_factory=dict)
    roughness_maps: Mapping[int, np.ndarray] = field(default_factory=dict)
    metallic_maps: Mapping[int, np.ndarray] = field(default_factory=dict)
    normal_maps: Mapping[int, np.ndarray] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.faces)
        shapes = {
            "vertices": (self.vertices.shape, (len(self.vertices), 3)),
            "faces": (self.faces.shape, (count, 3)),
            "texture_coordinates": (self.texture_coordinates.shape, (count, 3, 2)),
            "face_texture": (self.face_texture.shape, (count,)),
            "normals": ((count, 3, 3) if self.normals is None else self.normals.shape, (count, 3, 3)),
        }
        for name, (shape, expected) in shapes.items():
            if shape != expected:
                raise ValueError(f"{name} has shape {shape}, expected {expected}")
        if count and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            raise ValueError(f"faces index outside the {len(self.vertices)} vertices")
        if count and not 0 <= self.face_texture.min() <= self.face_texture.max() < len(self.textures):
            raise ValueError(f"face_texture indexes outside the {len(self.textures)} textures")
        for name in ("alpha_cutoffs", "roughness_maps", "metallic_maps", "normal_maps"):
            if not set(getattr(self, name)) <= set(range(len(self.textures))):
                raise ValueError(f"{name} names a texture outside the {len(self.textures)} textures")

    @cached_property
    def surface(self) -> Surface:
        """The triangles alone, ready for ray, closest-point and sampling queries."""
        return Surface(self.vertices, self.faces, normals=self.normals)

    @property
    def extents(self) -> np.ndarray:
        """(3,) sides of the axis-aligned bounding box of the faces, metres."""
        corners = self.vertices[np.unique(self.faces)] if len(self.faces) else self.vertices
        return np.asarray(np.ptp(corners, axis=0))


def textured_mesh_of(product: Product) -> TexturedMesh:
    """Return the mesh in a product of `ingest.ingest_object`."""
    textures = _numbered(product, "texture_")
    cutoffs = _numbered(product, "alpha_cutoff_")
    return TexturedMesh(
        product["vertices"],
        product["faces"],
        product["texture_coordinates"],
        tuple(textures[index] for index in range(len(textures))),
        product["face_texture"],
        product["normals"] if "normals" in product.arrays else None,
        alpha_cutoffs={index: float(cutoff[0]) for index, cutoff in cutoffs.items()},
        roughness_maps=_numbered(product, "roughness_"),
        metallic_maps=_numbered(product, "metallic_"),
        normal_maps=_numbered(product, "normal_map_"),
    )


def _numbered(product: Product, prefix: str) -> dict[int, np.ndarray]:
    """Arrays named by a prefix and a number, by that number."""
    numbers = sorted(
        int(name.removeprefix(prefix))
        for name in product.arrays
        if name.startswith(prefix) and name.removeprefix(prefix).isdigit()
    )
    return {number: product[f"{prefix}{number}"] for number in numbers}


def mesh_arrays(mesh: TexturedMesh) -> dict[str, Array]:
    """Return the arrays of a product that hold a mesh whole.

    Cutoffs and maps have arrays only where the mesh has them, named after their texture.
    """
    arrays = {
        "vertices": Array(mesh.vertices, ("vertex", "axis"), "m", "Vertex positions, object frame", False),
        "faces": Array(
            mesh.faces, ("face", "corner"), "1", "Vertex indices, counter-clockwise outside", False
        ),
        "texture_coordinates": Array(
            mesh.texture_coordinates, ("face", "corner", "uv"), "1", "Texture coordinates, v up", False
        ),
        "face_texture": Array(mesh.face_texture, ("face",), "1", "Texture index of each face", False),
    }
    if mesh.normals is not None:
        arrays["normals"] = Array(
            mesh.normals,
            ("face", "corner", "axis"),
            "1",
            "The source's normals, zero where it has none",
            False,
        )
    for index, texture in enumerate(mesh.textures):
        arrays[f"texture_{index}"] = Array(
            texture, ("y", "x", "channel"), "1", "Base colour RGBA, sRGB-encoded, row 0 on top", False
        )
    for index, cutoff in mesh.alpha_cutoffs.items():
        arrays[f"alpha_cutoff_{index}"] = Array(
            np.array([cutoff]), ("value",), "1", "Alpha from which the surface is there", False
        )
    for name, maps in (("roughness", mesh.roughness_maps), ("metallic", mesh.metallic_maps)):
        for index, image in maps.items():
            arrays[f"{name}_{index}"] = Array(
                image, ("y", "x"), "1", f"{name.capitalize()} of the texture, 255 for 1, row 0 on top", False
            )
    for index, image in mesh.normal_maps.items():
        arrays[f"normal_map_{index}"] = Array(
            image, ("y", "x", "axis"), "1", "Normals of the texture, tangent space, -1..1 as 0..255", False
        )
    return arrays


def with_length(mesh: TexturedMesh, length_m: float | None, where: str) -> tuple[TexturedMesh, list[str]]:
    """Scale a mesh so that the longest side of its bounding box is `length_m`; None keeps the file's metres.

    Returns
    -------
    mesh
        Scaled about the origin of the object frame.
    warnings
        One sentence for an unusual size.

    Raises
    ------
    InputError
        A length that is no positive number, a box without extent, or a size that a wrong unit would explain.
    """
    extent = float(mesh.extents.max())
    if not extent > 0:
        raise InputError(where, "all vertices are at one point", "Repair the mesh")
    if length_m is None:
        _refuse_absurd(extent, LONGEST_AS_IN_FILE_M, f"{where}, field length_m", "as in the file")
        return mesh, _warnings(extent)
    check_stated_length(length_m, where)
    if length_m > UNUSUAL_M and math.isclose(length_m, 1000 * extent, rel_tol=0.02):
        raise InputError(
            f"{where}, field length_m",
            f"the stated length {length_m:g} m is 1000 times the {extent:g} m of the mesh",
            f"It is in metres: for {length_m:g} mm write {length_m / 1000:g}, or 'as in file'",
        )
    return replace(mesh, vertices=mesh.vertices * (length_m / extent)), _warnings(length_m)


def check_stated_length(length_m: float, where: str) -> None:
    """Raise `InputError` for a stated length that no object of this kind can have."""
    if not math.isfinite(length_m) or length_m <= 0:
        raise InputError(
            f"{where}, field length_m",
            f"{length_m:g} is not a length",
            "Give the longest side in metres, above 0, or 'as in file'",
        )
    _refuse_absurd(length_m, LONGEST_M, f"{where}, field length_m", "as stated")


def _refuse_absurd(length_m: float, longest_m: float, where: str, origin: str) -> None:
    if length_m > longest_m:
        large = f"; if it really is {length_m:g} m long, state that" if length_m <= LONGEST_M else ""
        raise InputError(
            where,
            f"the longest side, {origin}, is {length_m:g} m, more than {longest_m:g} m",
            f"Were millimetres taken for metres? Then write {length_m / 1000:g}{large}",
        )
    if length_m < SHORTEST_M:
        raise InputError(
            where,
            f"the longest side, {origin}, is {length_m:g} m, less than {1000 * SHORTEST_M:g} mm",
            "Is it in another unit? State the longest side in metres",
        )


def _warnings(length_m: float) -> list[str]:
    if length_m <= UNUSUAL_M:
        return []
    return [f"the longest side is {length_m:g} m, unusual for an object to be held"]
