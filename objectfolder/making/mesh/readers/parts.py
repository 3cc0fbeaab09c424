"""Parts of a mesh file, of one texture each, as one mesh."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from objectfolder.surface.textured_mesh import TexturedMesh

Value = TypeVar("Value")


def joined_meshes(meshes: Sequence[TexturedMesh]) -> TexturedMesh:
    """Join meshes of one texture and of normals each, zero where there are none, without their remarks."""
    vertex_offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return TexturedMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, vertex_offsets, strict=False)]),
        np.concatenate([mesh.texture_coordinates for mesh in meshes]),
        tuple(mesh.textures[0] for mesh in meshes),
        np.concatenate(
            [np.full(len(mesh.faces), index, dtype=np.int32) for index, mesh in enumerate(meshes)]
        ),
        np.concatenate([mesh.normals for mesh in meshes if mesh.normals is not None]),
        alpha_cutoffs=_of_each([mesh.alpha_cutoffs for mesh in meshes]),
        roughness_maps=_of_each([mesh.roughness_maps for mesh in meshes]),
        metallic_maps=_of_each([mesh.metallic_maps for mesh in meshes]),
        normal_maps=_of_each([mesh.normal_maps for mesh in meshes]),
    )


def _of_each(parts: list[Mapping[int, Value]]) -> dict[int, Value]:
    """What the only textures of meshes have, by the number of the mesh."""
    return {index: part[0] for index, part in enumerate(parts) if 0 in part}
