"""STL, binary or as text.

Read here and not with trimesh, which passes over the rest of a text in silence where it is cut or damaged,
and refuses binary files with bytes behind the last triangle.
"""

import codecs
import re
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.mesh.readers.files import (
    brief,
    read_bytes,
    refuse_coarse,
    refuse_unusable,
    single_precision_step,
)
from objectfolder.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.mesh.readers.textures import uniform_texture

_HEADER_BYTES = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NAME = re.compile(rb"(?:end)?solid\b[^\n]*", re.IGNORECASE)
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_END_OF_FACET = re.compile(rb"\bendfacet\b", re.IGNORECASE)


def read_stl(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read an STL file as it is: three vertices a triangle, the default colour, no texture coordinates.

    Solids are joined; normals and attributes (colours of some programs) are left out.

    Parameters
    ----------
    with_textures
        Makes no difference: an STL file has none.

    Raises
    ------
    InputError
        Neither kind of STL, cut short, no triangles, or positions that show no shape.
    """
    data = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    count = int.from_bytes(data[80:84], "little") if len(data) >= _HEADER_BYTES else -1
    end = _HEADER_BYTES + count * _TRIANGLE.itemsize
    is_text = data[:512].lstrip()[:5].lower() == b"solid" and b"\0" not in data
    if is_text and end != len(data):
        corners, step = _text_corners(path, data), 0.0
    elif count >= 0 and end <= len(data):
        corners = np.frombuffer(data, _TRIANGLE, count, _HEADER_BYTES)["corners"].astype(np.float64)
        step = single_precision_step(corners)
    else:
        said = f"says {count} triangles, more than it holds" if count >= 0 else f"has {len(data)} bytes only"
        raise InputError(str(path), f"cannot be read as STL ({said})", "Use the complete file")
    if not len(corners):
        raise InputError(str(path), "holds no faces", "Use an STL file with triangles")
    vertices = corners.reshape(-1, 3)
    refuse_unusable(path, vertices)
    refuse_coarse(path, vertices, step)
    faces = np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
    return TexturedMesh(
        vertices,
        faces,
        np.full((len(faces), 3, 2), np.nan),
        (uniform_texture(DEFAULT_COLOUR),),
        np.zeros(len(faces), dtype=np.int32),
    )


def _text_corners(path: Path, data: bytes) -> np.ndarray:
    """Corners (F, 3, 3) of the triangles of a text."""
    text = _NAME.sub(b"", data.replace(b"\r", b"\n"))
    found = _VERTEX.findall(text)
    triangles = len(_END_OF_FACET.findall(text))
    if len(found) != 3 * triangles:
        raise InputError(
            str(path),
            f"cannot be read as STL ({len(found)} vertices for {triangles} facets)",
            "Use the complete file, with triangles only",
        )
    try:
        return np.array(found).astype(np.float64).reshape(-1, 3, 3)
    except ValueError as problem:
        raise InputError(
            str(path), f"cannot be read as STL ({brief(problem)})", "Export the mesh again"
        ) from problem
