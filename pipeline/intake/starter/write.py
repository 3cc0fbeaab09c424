"""The starter set on disk: one folder an object with model.obj, model.mtl and texture.png."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from objectfolder.surface.textured_mesh import TexturedMesh
from pipeline.intake.starter.bell import bell
from pipeline.intake.starter.die import die
from pipeline.intake.starter.tableware import bowl, mug, plate
from pipeline.intake.starter.utensils import fork, spatula

STARTER_OBJECTS: dict[str, Callable[[], TexturedMesh]] = {
    "bell": bell,
    "bowl": bowl,
    "die": die,
    "fork": fork,
    "mug": mug,
    "plate": plate,
    "spatula": spatula,
}

_MATERIAL = "newmtl surface\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd texture.png\n"


def write_starter_set(folder: Path) -> list[Path]:
    """Write every starter object below `folder`, the same bytes each time; return the mesh files."""
    meshes = []
    for name, make in STARTER_OBJECTS.items():
        path = Path(folder) / name / "model.obj"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_obj(path, make())
        meshes.append(path)
    return meshes


def write_obj(path: Path, mesh: TexturedMesh) -> None:
    """Write a mesh of one texture as OBJ, with ``model.mtl`` and ``texture.png`` beside it.

    Positions have 10 nm steps, texture coordinates 1e-6.
    """
    coordinates, index = np.unique(
        mesh.texture_coordinates.reshape(-1, 2).round(6), axis=0, return_inverse=True
    )
    corners = np.stack([mesh.faces + 1, index.reshape(-1, 3) + 1], axis=-1)
    lines = [
        "mtllib model.mtl",
        *(f"v {x:.8f} {y:.8f} {z:.8f}" for x, y, z in mesh.vertices + 0.0),
        *(f"vt {u:.6f} {v:.6f}" for u, v in coordinates),
        "usemtl surface",
        *("f " + " ".join(f"{vertex}/{texture}" for vertex, texture in face) for face in corners),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")
    (path.parent / "model.mtl").write_text(_MATERIAL, encoding="ascii", newline="\n")
    Image.fromarray(mesh.textures[0][..., :3]).save(path.parent / "texture.png", optimize=False)
