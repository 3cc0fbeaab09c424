"""glTF and GLB: all nodes of a scene as one textured mesh, and which meshes they show, and where."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import (
    refuse_coarse,
    refuse_unusable,
    shortened,
    single_precision_step,
    unreadable,
)
from objectfolder.making.mesh.readers.gltf_file import (
    KINDS,
    VISIBILITY,
    Gltf,
    Json,
    extensions,
    number,
    numbers,
    read_gltf_file,
    whole,
)
from objectfolder.making.mesh.readers.gltf_materials import PLAIN, Material, read_material
from objectfolder.making.mesh.readers.gltf_primitives import Primitive
from objectfolder.making.mesh.readers.parts import joined_meshes
from objectfolder.making.mesh.readers.textures import TextureReader, corner_colour_atlas, opaque, srgb_encode
from objectfolder.surface.textured_mesh import TexturedMesh

MOST_TRIANGLES = 10_000_000
"""Of all nodes together: few bytes may ask for very many by naming one mesh often."""

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MOST_OUTSIDE = 0.01
"""How far outside 0..1 coordinates of a texture that does not repeat may lie, by rounding and by padding."""
_INSTANCES = "EXT_mesh_gpu_instancing"


def read_gltf(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read a glTF or GLB file as it is, uncleaned; corners without texture coordinates get NaN.

    All nodes of the scene are joined with their transforms applied (a mirrored node keeps its outside), in
    the order of the file; y is up. Colours of vertices are multiplied by the base colour factor
    and become a texture where there is no other; their alpha is ignored. See `gltf_materials.read_material`.

    Parameters
    ----------
    with_textures
        False leaves materials and textures out (they may then be missing).

    Raises
    ------
    InputError
        Not a file of its kind, no faces, a missing or broken texture, something that would change shape or
        colours and is not supported: an extension, a pose, a shape key, textures that do not repeat.
    """
    file = read_gltf_file(path)
    _say_what_is_left_out(file)
    try:
        parts, step = _parts(file, with_textures)
    except (
        ValueError,
        KeyError,
        IndexError,
        TypeError,
        AttributeError,
        OverflowError,
        MemoryError,
    ) as problem:
        raise unreadable(path, KINDS[path.suffix.lower()], problem) from problem
    if not parts:
        raise InputError(str(path), "holds no faces", "Use a glTF file with triangles in its scene")
    joined = joined_meshes(parts)
    refuse_unusable(path, joined.vertices)
    refuse_coarse(path, joined.vertices, step)
    return replace(joined, remarks=tuple(file.remarks))


def _say_what_is_left_out(file: Gltf) -> None:
    scenes = file.header.get("scenes")
    if isinstance(scenes, list) and len(scenes) > 1:
        which = "its default" if "scene" in file.header else "the first"
        file.remark(f"it has {len(scenes)} scenes, of which {which} is read")
    if file.header.get("animations"):
        file.remark("its animations are left out: it is read as it rests")


def _parts(file: Gltf, with_textures: bool) -> tuple[list[TexturedMesh], float]:
    """Each primitive with faces as a mesh, in the scene's frame, and the largest step of their positions."""
    reader = TextureReader(str(file.path))
    parts: list[TexturedMesh] = []
    materials: dict[int, Material] = {}
    step, triangles = 0.0, 0
    for transform, mesh in placed_meshes(file):
        for entry in mesh["primitives"]:
            primitive = Primitive(file, entry)
            vertices = _positions(primitive)
            faces = _faces(primitive, entry, len(vertices))
            if not len(faces):
                continue
            triangles += len(faces)
            if triangles > MOST_TRIANGLES:
                raise InputError(
                    str(file.path), f"has more than {MOST_TRIANGLES} triangles in all", "Reduce their number"
                )
            material = PLAIN
            if with_textures and "material" in entry:
                index = whole(entry["material"])
                if index not in materials:
                    materials[index] = read_material(file, index, reader)
                material = materials[index]
            parts.append(_part(file.path, primitive, vertices, faces, material, with_textures, transform))
            if primitive.stored("POSITION").dtype == np.float32:
                stretch = float(np.linalg.norm(transform[:3, :3], axis=0).max())
                step = max(step, stretch * single_precision_step(vertices))
    return parts, step


def _positions(primitive: Primitive) -> np.ndarray:
    vertices = primitive.values("POSITION")
    if vertices.shape[1] != 3:
        raise ValueError("positions of other than three coordinates")
    return vertices


def _faces(primitive: Primitive, entry: Json, count: int) -> np.ndarray:
    """Triangles (F, 3) of a primitive; none for points and lines."""
    mode = whole(entry.get("mode", _TRIANGLES))
    if mode < _TRIANGLES:
        return np.zeros((0, 3), dtype=np.int64)
    corners = primitive.corners(count)
    if mode == _TRIANGLES or "KHR_draco_mesh_compression" in extensions(entry):
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode not in (_STRIP, _FAN):
        raise ValueError(f"primitives of mode {mode}")
    first, last = corners[:-2], corners[2:]
    if mode == _FAN:
        return np.stack([np.broadcast_to(corners[:1], first.shape), corners[1:-1], last], axis=1)
    faces = np.stack([first, corners[1:-1], last], axis=1)
    faces[1::2] = faces[1::2, [1, 0, 2]]
    return faces


def _part(
    path: Path,
    primitive: Primitive,
    local: np.ndarray,
    faces: np.ndarray,
    material: Material,
    with_textures: bool,
    transform: np.ndarray,
) -> TexturedMesh:
    # Written out so that equal positions stay bitwise equal, which a BLAS product does not promise.
    columns = [local[:, [axis]] * transform[:3, axis] for axis in range(3)]
    vertices = columns[0] + columns[1] + columns[2] + transform[:3, 3]
    coordinates = np.full((len(faces), 3, 2), np.nan)
    name = f"TEXCOORD_{material.placement.coordinate_set}"
    if name in primitive:
        stored = primitive.values(name)
        if stored.shape != (len(local), 2):
            raise ValueError(f"{name} does not fit the positions")
        placed = material.placement.applied(stored)
        coordinates = np.stack([placed[:, 0], 1 - placed[:, 1]], axis=1)[faces]
        if not material.placement.repeats:
            _refuse_outside(path, coordinates)
    elif material.placement.coordinate_set:
        raise InputError(
            str(path),
            f"a texture lies on a second set of texture coordinates ({name}), which is not there",
            "Export the mesh with all its sets, or bake the texture to the first",
        )
    if with_textures and "COLOR_0" in primitive:
        colours = primitive.colours("COLOR_0")
        if len(colours) != len(local) or colours.shape[1] != 3:
            raise ValueError("COLOR_0 does not fit the positions")
        if len(material.texture) == material.texture.shape[1] == 1:
            linear = np.ones((len(colours), 4))
            linear[:, :3] = srgb_encode(np.nan_to_num(colours) * material.factor[:3])
            atlas, coordinates = corner_colour_atlas(linear[faces])
            material = Material(opaque(atlas), material.factor)
        elif colours.min() < 254 / 255:
            raise InputError(
                str(path),
                "multiplies a texture by colours of vertices, which is not supported",
                "Bake the colours into the texture, or export the mesh without them",
            )
    if np.linalg.det(transform[:3, :3]) < 0:
        faces, coordinates = faces[:, ::-1], coordinates[:, ::-1]
    return TexturedMesh(
        vertices,
        faces,
        coordinates,
        (material.texture,),
        np.zeros(len(faces), dtype=np.int32),
        _normals(primitive, len(local), faces, transform[:3, :3]),
        alpha_cutoffs={} if material.alpha_cutoff is None else {0: material.alpha_cutoff},
        roughness_maps={} if material.roughness is None else {0: material.roughness},
        metallic_maps={} if material.metallic is None else {0: material.metallic},
        normal_maps={} if material.normals is None else {0: material.normals},
    )


def _normals(primitive: Primitive, count: int, faces: np.ndarray, linear: np.ndarray) -> np.ndarray:
    """Normals (F, 3, 3) at corners, turned as planes are: by cofactors; zero where there are none."""
    if "NORMAL" not in primitive:
        return np.zeros((len(faces), 3, 3))
    normals = primitive.values("NORMAL")
    if normals.shape != (count, 3):
        raise ValueError("NORMAL does not fit the positions")
    cofactors = np.cross(np.roll(linear, -1, axis=1), np.roll(linear, -2, axis=1), axis=0)
    mirrored = -1 if np.linalg.det(linear) < 0 else 1
    return np.asarray((mirrored * normals @ cofactors.T)[faces])


def _refuse_outside(path: Path, coordinates: np.ndarray) -> None:
    outside = (coordinates < -_MOST_OUTSIDE) | (coordinates > 1 + _MOST_OUTSIDE)
    if outside.any():
        raise InputError(
            str(path),
            f"{np.count_nonzero(outside.any(axis=(1, 2)))} faces show a texture outside of 0..1 where its "
            "sampler clamps or mirrors, which is not supported",
            "Set the sampler to repeat, or unwrap within 0..1",
        )


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
    visited: set[int] = set()
    pending = [(index, np.eye(4)) for index in reversed(_roots(file))]
    while pending:
        index, around = pending.pop()
        if index in visited:
            raise ValueError(f"node {index} is reached twice, and nodes form a tree")
        visited.add(index)
        node = file.entry("nodes", index)
        if extensions(node).get(VISIBILITY, {}).get("visible") is False:
            file.remark("it has hidden nodes, which are left out with what is below them")
            continue
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
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    # Quarter turns, by which most exporters change axes, move no coordinate by rounding.
    return np.where(np.abs(matrix - np.rint(matrix)) < 1e-15, np.rint(matrix), matrix)


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
