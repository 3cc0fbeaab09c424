"""Small meshes for tests, made by code."""

import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import TexturedMesh

CUBE_VERTICES = np.array(
    [[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)], dtype=np.float64
)
CUBE_FACES = np.array(
    [
        [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
    ]
)  # fmt: skip


def bare_mesh(vertices: np.ndarray, faces: np.ndarray) -> TexturedMesh:
    """A mesh of one grey texel."""
    faces = np.asarray(faces, dtype=np.int64)
    return TexturedMesh(
        np.asarray(vertices, dtype=np.float64),
        faces,
        np.zeros((len(faces), 3, 2)),
        (np.full((1, 1, 4), 128, dtype=np.uint8),),
        np.zeros(len(faces), dtype=np.int32),
    )


def cube(side_m: float = 1.0) -> TexturedMesh:
    """A closed cube of 12 outward triangles about the origin."""
    return bare_mesh(side_m * CUBE_VERTICES, CUBE_FACES)


def box(low: Sequence[float], high: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and the 12 outward triangles of a box between two corners."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return np.array(low) + corners * np.subtract(high, low), quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def joined(*parts: tuple[np.ndarray, np.ndarray]) -> Surface:
    """One surface of several pieces."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    return Surface(
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=True)]),
    )


def sphere(radius_m: float = 1.0, subdivisions: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward faces of a subdivided octahedron projected to the sphere."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    for _ in range(subdivisions):
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (len(vertices) + inverse.reshape(3, -1)).reshape(3, -1)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c = faces.T
        faces = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return radius_m * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def checker(size: int = 8) -> np.ndarray:
    """(size, size, 3) uint8 of distinct colours."""
    row, column = np.mgrid[:size, :size]
    step = 255 // (size - 1)
    return np.stack([row * step, column * step, np.full_like(row, 40)], axis=-1).astype(np.uint8)


def write_textured_cube(folder: Path, *, texture: np.ndarray | None = None, side_m: float = 0.1) -> Path:
    """model.obj, model.mtl and texture.png of a cube whose faces all show the whole texture."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["mtllib model.mtl", "usemtl skin"]
    lines += [f"v {x} {y} {z}" for x, y, z in side_m * CUBE_VERTICES]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1"]
    lines += [
        "f " + " ".join(f"{vertex + 1}/{corner + 1}" for corner, vertex in enumerate(face))
        for face in CUBE_FACES
    ]
    (folder / "model.obj").write_text("\n".join(lines) + "\n")
    (folder / "model.mtl").write_text("newmtl skin\nKd 1 1 1\nmap_Kd texture.png\n")
    Image.fromarray(checker() if texture is None else texture).save(folder / "texture.png")
    return folder / "model.obj"


def png(image: np.ndarray) -> bytes:
    data = io.BytesIO()
    Image.fromarray(image).save(data, "PNG")
    return data.getvalue()


def write_gltf(
    path: Path,
    *,
    node: dict | None = None,
    material: dict | None = None,
    outer: dict | None = None,
    images: dict[str, np.ndarray] | None = None,
    with_file: bool = True,
) -> Path:
    """A triangle with texture coordinates, in a node with a transform, textured by texture.png.

    `material` goes into pbrMetallicRoughness, `outer` beside it; `images` are further files by name, whose
    textures have the indices 1, 2, ...
    """
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], dtype="<f4")
    coordinates = np.array([[0, 1], [1, 1], [1, 0]], dtype="<f4")  # v down
    indices = np.array([0, 1, 2], dtype="<u4")
    blob = positions.tobytes() + coordinates.tobytes() + indices.tobytes()
    (path.parent / "model.bin").write_bytes(blob)
    if with_file:
        (path.parent / "texture.png").write_bytes(png(checker()))
    for name, image in (images or {}).items():
        (path.parent / name).write_bytes(png(image))
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **(node or {})}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}
        ],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, **(material or {})}, **(outer or {})}
        ],
        "textures": [{"source": index} for index in range(1 + len(images or {}))],
        "images": [{"uri": "texture.png"}, *({"uri": name} for name in images or {})],
        "buffers": [{"uri": "model.bin", "byteLength": len(blob)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 24},
            {"buffer": 0, "byteOffset": 60, "byteLength": 12},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [0, 0, 0],
                "max": [1, 1, 0],
            },
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
    }
    path.write_text(json.dumps(header))
    return path


def sorted_triangles(mesh: TexturedMesh) -> np.ndarray:
    """(F, 9) positions of the corners in a form that does not depend on vertex or face order."""
    corners = mesh.vertices[mesh.faces]
    rotations = np.stack([np.roll(corners, -shift, axis=1).reshape(-1, 9) for shift in range(3)], axis=1)
    smallest = np.array([min(map(tuple, triple)) for triple in rotations])
    return smallest[np.lexsort(smallest.T[::-1])]
