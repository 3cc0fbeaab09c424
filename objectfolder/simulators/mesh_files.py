"""Meshes of an asset as Wavefront OBJ, which every simulator reads."""

from pathlib import Path

import numpy as np
from PIL import Image

from objectfolder.export.gltf import Part
from objectfolder.simulators.asset import Asset
from objectfolder.surface.surface import Surface

SURFACE = "surface.obj"


def visual_name(index: int) -> str:
    """Return the name, without suffix, of the files of a visual part."""
    return f"visual_{index}"


def collision_name(index: int) -> str:
    """Return the name, without suffix, of the file of a convex part."""
    return f"collision_{index:02d}"


def write_meshes(folder: Path, asset: Asset) -> list[str]:
    """Write all meshes and textures of an asset into a folder; return their names."""
    written = [SURFACE]
    _write_faces(folder / SURFACE, asset.surface)
    for index, part in enumerate(asset.visual):
        written += _write_visual(folder, visual_name(index), part)
    for index, hull in enumerate(asset.collision.hulls):
        written.append(f"{collision_name(index)}.obj")
        _write_faces(folder / written[-1], hull)
    return written


def _write_visual(folder: Path, name: str, part: Part) -> list[str]:
    """Write a part with its texture as OBJ, MTL and PNG, equal vertices once."""
    positions, corner = _unique(part.positions.reshape(-1, 3))
    normals, corner_normal = _unique(part.normals.reshape(-1, 3))
    lines = [f"mtllib {name}.mtl", f"o {name}", *(f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions)]
    written = [f"{name}.obj", f"{name}.mtl"]
    material = [f"newmtl {name}", "Ka 0 0 0", "Kd 1 1 1", "Ks 0.04 0.04 0.04", "illum 2"]
    if part.texture_coordinates is not None and part.texture is not None:
        coordinates, corner_texture = _unique(part.texture_coordinates.reshape(-1, 2))
        lines += [f"vt {u:.7g} {v:.7g}" for u, v in coordinates]
        corners = zip(corner + 1, corner_texture + 1, corner_normal + 1, strict=True)
        at_corner = [f"{v}/{t}/{n}" for v, t, n in corners]
        material.append(f"map_Kd {name}.png")
        written.append(f"{name}.png")
        Image.fromarray(np.ascontiguousarray(part.texture[..., :3])).save(folder / written[-1])
    else:
        at_corner = [f"{v}//{n}" for v, n in zip(corner + 1, corner_normal + 1, strict=True)]
    lines += [f"vn {x:.5f} {y:.5f} {z:.5f}" for x, y, z in normals]
    lines += [f"usemtl {name}", "s 1"]
    lines += [f"f {' '.join(at_corner[face : face + 3])}" for face in range(0, len(at_corner), 3)]
    (folder / f"{name}.obj").write_text("\n".join(lines) + "\n", encoding="ascii")
    (folder / f"{name}.mtl").write_text("\n".join(material) + "\n", encoding="ascii")
    return written


def _write_faces(path: Path, surface: Surface) -> None:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in surface.vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in surface.faces + 1]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _unique(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct rows as float32 (n, k), and which of them each row is."""
    distinct, index = np.unique(rows.astype(np.float32), axis=0, return_inverse=True)
    return distinct, index.reshape(-1)
