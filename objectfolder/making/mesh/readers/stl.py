"""STL, binary or as text.

Read here and not with trimesh, which passes over the rest of a text in silence where it is cut or damaged,
and refuses binary files with bytes behind the last triangle.
"""

import codecs
import re
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import (
    LARGEST_FILE_NUMBER,
    brief,
    read_bytes,
    refuse_coarse,
    refuse_unusable,
    single_precision_step,
)
from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.making.mesh.readers.textures import corner_colour_atlas, opaque, uniform_texture
from objectfolder.surface.textured_mesh import TexturedMesh

_HEADER_BYTES = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NAME = re.compile(rb"(?:end)?solid\b[^\n]*", re.IGNORECASE)
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_END_OF_FACET = re.compile(rb"\bendfacet\b", re.IGNORECASE)


def read_stl(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read an STL file as it is: three vertices a triangle, in colours of triangles where it has some.

    Solids are joined; normals are left out. A binary file whose count is too small is read to its end.
    Attributes are colours where their highest bit says so, as VisCAM and SolidView write them, or in a file
    whose header has ``COLOR=``, as Materialise Magics does.

    Parameters
    ----------
    with_textures
        False leaves colours out.

    Raises
    ------
    InputError
        Neither kind of STL, cut short, no triangles, or positions that show no shape.
    """
    data = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    count = int.from_bytes(data[80:84], "little") if len(data) >= _HEADER_BYTES else -1
    end = _HEADER_BYTES + count * _TRIANGLE.itemsize
    remarks: tuple[str, ...] = ()
    is_text = data[:512].lstrip()[:5].lower() == b"solid" and b"\0" not in data
    if is_text and end != len(data):
        corners, step = _text_corners(path, data), 0.0
        colours = None
    elif count >= 0 and end <= len(data):
        whole = (len(data) - _HEADER_BYTES) // _TRIANGLE.itemsize
        triangles = np.frombuffer(data, _TRIANGLE, whole, _HEADER_BYTES)
        if _go_on(data[end:], triangles[count:]):
            remarks = (f"it says {count} triangles and holds {len(triangles)}, which are read",)
        else:
            triangles = triangles[:count]
        corners = triangles["corners"].astype(np.float64)
        colours = _colours(data[:80], triangles["attribute"])
        step = single_precision_step(corners)
    else:
        fault = f"says {count} triangles, more than it holds" if count >= 0 else f"has {len(data)} bytes only"
        raise InputError(str(path), f"cannot be read as STL ({fault})", "Use the complete file")
    if not len(corners):
        raise InputError(str(path), "holds no faces", "Use an STL file with triangles")
    vertices = corners.reshape(-1, 3)
    refuse_unusable(path, vertices)
    refuse_coarse(path, vertices, step)
    faces = np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
    texture, coordinates = uniform_texture(DEFAULT_COLOUR), np.full((len(faces), 3, 2), np.nan)
    if with_textures and colours is not None:
        texture, coordinates = corner_colour_atlas(np.repeat(colours[:, None], 3, axis=1))
        texture = opaque(texture)
    return TexturedMesh(
        vertices,
        faces,
        coordinates,
        (texture,),
        np.zeros(len(faces), dtype=np.int32),
        remarks=remarks,
    )


def _go_on(rest: bytes, triangles: np.ndarray) -> bool:
    """Whether what is behind the last triangle that is counted are triangles too, to the end of the file."""
    corners = triangles["corners"].astype(np.float64)
    if not len(corners) or len(rest) % _TRIANGLE.itemsize or not np.isfinite(corners).all():
        return False
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return bool((np.abs(corners) < LARGEST_FILE_NUMBER).all() and sides.any(axis=1).mean() > 0.5)


def _colours(header: bytes, attributes: np.ndarray) -> np.ndarray | None:
    """RGBA (F, 4) in 0..1 by the attributes (F,) of triangles; None where these are no colours."""
    place = header.find(b"COLOR=")
    # Magics counts from red up and sets the bit where the object's colour holds, others from blue up.
    own = (attributes >> 15 == 0) & attributes.any() if place >= 0 else (attributes >> 15 == 1)
    if not own.any() and place < 0:
        return None
    whole = np.append(DEFAULT_COLOUR, 1.0)
    if place >= 0 and len(header) >= place + 10:
        whole = np.frombuffer(header, np.uint8, 4, place + 6) / 255
    shifts = (0, 5, 10) if place >= 0 else (10, 5, 0)
    colours = np.ones((len(attributes), 4))
    colours[:, :3] = np.stack([(attributes >> shift & 31) / 31 for shift in shifts], axis=1)
    return np.where(own[:, None], colours, whole)


def _text_corners(path: Path, data: bytes) -> np.ndarray:
    """Corners (F, 3, 3) of the triangles of a text."""
    text = _NAME.sub(b"", data.replace(b"\r", b"\n"))
    corners = _VERTEX.findall(text)
    triangles = len(_END_OF_FACET.findall(text))
    if len(corners) != 3 * triangles:
        raise InputError(
            str(path),
            f"cannot be read as STL ({len(corners)} vertices for {triangles} facets)",
            "Use the complete file, with triangles only",
        )
    try:
        return np.array(corners).astype(np.float64).reshape(-1, 3, 3)
    except ValueError as problem:
        raise InputError(
            str(path), f"cannot be read as STL ({brief(problem)})", "Export the mesh again"
        ) from problem
