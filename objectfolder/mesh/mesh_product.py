"""A textured mesh in a product, apart from the cleaning that made it: its readers need no more."""

import numpy as np

from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.products.store import Array, Product


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
