"""The textured triangle mesh every loader returns and every sense reads."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from objectfolder.products.store import Array, Product
from objectfolder.surface.surface import Surface


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
    alpha_cutoffs
        By index of a texture: the alpha in 0..1 from which the surface is there, below which it is not.
        Alpha of textures without a cutoff blends.
    roughness_maps, metallic_maps
        By index of a texture: (h, w) uint8 image on the same coordinates, linear, 0..255 for 0..1, row 0 on
        top; any size, one texel for a constant. Textures without one have the material's value.
    """

    vertices: np.ndarray
    faces: np.ndarray
    texture_coordinates: np.ndarray
    textures: tuple[np.ndarray, ...]
    face_texture: np.ndarray
    alpha_cutoffs: Mapping[int, float] = field(default_factory=dict)
    roughness_maps: Mapping[int, np.ndarray] = field(default_factory=dict)
    metallic_maps: Mapping[int, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.faces)
        shapes = {
            "vertices": (self.vertices.shape, (len(self.vertices), 3)),
            "faces": (self.faces.shape, (count, 3)),
            "texture_coordinates": (self.texture_coordinates.shape, (count, 3, 2)),
            "face_texture": (self.face_texture.shape, (count,)),
        }
        for name, (found, expected) in shapes.items():
            if found != expected:
                raise ValueError(f"{name} has shape {found}, expected {expected}")
        if count and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            raise ValueError(f"faces index outside the {len(self.vertices)} vertices")
        if count and not 0 <= self.face_texture.min() <= self.face_texture.max() < len(self.textures):
            raise ValueError(f"face_texture indexes outside the {len(self.textures)} textures")
        for name in ("alpha_cutoffs", "roughness_maps", "metallic_maps"):
            if not set(getattr(self, name)) <= set(range(len(self.textures))):
                raise ValueError(f"{name} names a texture outside the {len(self.textures)} textures")

    @cached_property
    def surface(self) -> Surface:
        """The triangles alone, ready for ray, closest-point and sampling queries."""
        return Surface(self.vertices, self.faces)

    @property
    def extents(self) -> np.ndarray:
        """(3,) sides of the axis-aligned bounding box, metres."""
        return self.vertices.max(axis=0) - self.vertices.min(axis=0)


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
        alpha_cutoffs={index: float(cutoff[0]) for index, cutoff in cutoffs.items()},
        roughness_maps=_numbered(product, "roughness_"),
        metallic_maps=_numbered(product, "metallic_"),
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
    return arrays
