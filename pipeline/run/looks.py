"""What a mesh looks like, in a line: textures, plain colours, maps, and what has no colour."""

import numpy as np

from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.making.mesh.readers.textures import uniform_texture
from objectfolder.surface.textured_mesh import TexturedMesh


def looks_of(mesh: TexturedMesh) -> str:
    """Describe textures with their sizes, plain colours, maps, and the share of the area without colour.

    Examples
    --------
    >>> from pathlib import Path
    >>> from objectfolder.making.mesh.readers.load import load_mesh
    >>> looks_of(load_mesh(Path("bar.obj")))
    '1 plain colour'
    """
    grey = uniform_texture(DEFAULT_COLOUR)
    bare = [bool(np.array_equal(texture, grey)) for texture in mesh.textures]
    sizes = [f"{t.shape[1]} x {t.shape[0]}" for t in mesh.textures if t.shape[:2] != (1, 1)]
    plain = sum(texture.shape[:2] == (1, 1) for texture in mesh.textures) - sum(bare)
    parts = []
    if sizes:
        examples = ", ".join(sizes[:4]) + (", ..." if len(sizes) > 4 else "")
        parts.append(f"{_number(len(sizes), 'texture')} ({examples})")
    if plain:
        parts.append(_number(plain, "plain colour"))
    maps = {"roughness": mesh.roughness_maps, "metallic": mesh.metallic_maps, "normals": mesh.normal_maps}
    kinds = [
        kind for kind, images in maps.items() if any(image.shape[:2] != (1, 1) for image in images.values())
    ]
    if kinds:
        parts.append(f"maps of {', '.join(kinds)}")
    if any(texture[..., 3].min() < 255 for texture in mesh.textures):
        parts.append("partly transparent")
    areas = np.bincount(mesh.face_texture, mesh.surface.face_areas, len(mesh.textures))
    share = float(areas[bare].sum() / max(float(areas.sum()), 1e-300))
    if share:
        parts.append(f"{100 * share:.3g} % of the area has no colour and is grey")
    return ", ".join(parts)


def _number(count: int, name: str) -> str:
    return f"{count} {name}" + ("" if count == 1 else "s")
