"""A textured mesh in a product, apart from the cleaning that made it: its readers need no more."""

from objectfolder.geometry.mesh import TexturedMesh
from objectfolder.store import Array, Product


def textured_mesh_of(product: Product) -> TexturedMesh:
    """Return the mesh in a product of `ingest.ingest_object`."""
    count = sum(name.startswith("texture_") and name[8:].isdigit() for name in product.arrays)
    return TexturedMesh(
        product["vertices"],
        product["faces"],
        product["texture_coordinates"],
        tuple(product[f"texture_{index}"] for index in range(count)),
        product["face_texture"],
    )


def mesh_arrays(mesh: TexturedMesh) -> dict[str, Array]:
    """Return the arrays of a product that hold a mesh whole."""
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
    return arrays
