"""The nodes of a glTF file: which meshes its scene shows, and where."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.mesh.readers.files import shortened
from objectfolder.mesh.readers.gltf_file import Gltf, Json, extensions, number, numbers, whole

_INSTANCES = "EXT_mesh_gpu_instancing"


def placed_meshes(file: Gltf) -> Iterator[tuple[np.ndarray, Json]]:
    """Give each mesh of the scene with its transform (4, 4) to the scene's frame, in the order of the file.

    The scene is the file's default, else its first; a file without scenes shows all its nodes, and one
    without nodes all its meshes.

    Raises
    ------
    InputError
        A node that bones pose or that a shape key changes, or one of many instances.
    ValueError, KeyError, TypeError
        Nodes that do not form trees, or a transform that is none.
    """
    nodes = file.header.get("nodes", [])
    if not nodes:
        for index in range(len(file.header.get("meshes", []))):
            yield np.eye(4), file.entry("meshes", index)
        return
    seen: set[int] = set()
    pending = [(index, np.eye(4)) for index in reversed(_roots(file))]
    while pending:
        index, around = pending.pop()
        if index in seen:
            raise ValueError(f"node {index} is reached twice, and nodes form a tree")
        seen.add(index)
        node = file.entry("nodes", index)
        transform = around @ _local_transform(node)
        if "mesh" in node:
            mesh = file.entry("meshes", node["mesh"])
            _refuse_pose(file, node, mesh)
            yield transform, mesh
        pending += [(whole(child), transform) for child in reversed(node.get("children", []))]


def _roots(file: Gltf) -> list[int]:
    if file.header.get("scenes"):
        return [whole(index) for index in file.entry("scenes", file.header.get("scene", 0)).get("nodes", [])]
    nodes = file.header["nodes"]
    children = {whole(child) for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _local_transform(node: Json) -> np.ndarray:
    if "matrix" in node:
        matrix = np.array(numbers(node["matrix"], 16)).reshape(4, 4).T
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise ValueError("the matrix of a node is no affine transform")
        return matrix
    transform = np.eye(4)
    transform[:3, :3] = _rotation(node.get("rotation", [0, 0, 0, 1])) * numbers(
        node.get("scale", [1, 1, 1]), 3
    )
    transform[:3, 3] = numbers(node.get("translation", [0, 0, 0]), 3)
    return transform


def _rotation(quaternion: Any) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion x, y, z, w."""
    parts = np.array(numbers(quaternion, 4, -1e6, 1e6))
    length = float(np.linalg.norm(parts))
    if length < 1e-6:
        raise ValueError("the rotation of a node is zero")
    x, y, z, w = parts / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _refuse_pose(file: Gltf, node: Json, mesh: Json) -> None:
    changed = None
    if "skin" in node:
        changed = ("is posed by a skeleton", "Apply the armature before it is exported")
    elif any(number(weight) for weight in node.get("weights") or mesh.get("weights") or []):
        changed = ("is changed by shape keys", "Apply them before it is exported")
    elif _INSTANCES in extensions(node):
        changed = (f"is repeated by {_INSTANCES}", "Export its instances as nodes of their own")
    if changed is not None:
        raise InputError(
            str(file.path),
            f"mesh {shortened(str(mesh.get('name', node['mesh'])))} {changed[0]}, which is not supported",
            changed[1],
        )
