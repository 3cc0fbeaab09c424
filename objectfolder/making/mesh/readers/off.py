"""OFF as text: polygons, and colours of vertices or faces."""

import re
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import read_text, refuse_unusable, unreadable, without_comment
from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR
from objectfolder.making.mesh.readers.polygons import triangulated
from objectfolder.making.mesh.readers.textures import corner_colour_atlas, opaque, uniform_texture
from objectfolder.making.mesh.readers.vertex_colours import alpha_remark, colour_fractions
from objectfolder.surface.textured_mesh import TexturedMesh

_KEYWORD = re.compile(r"\s*(ST)?C?(N)?OFF(?!\s*BINARY)")
"""Data sets in use write the counts right behind it, without a space."""


def read_off(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read an OFF file as it is; colours of vertices go before colours of faces, as fractions or in 0..255.

    Parameters
    ----------
    with_textures
        False leaves colours out.

    Raises
    ------
    InputError
        Not OFF as text, cut short, no faces, an index out of range.
    """
    lines = (line for line in map(without_comment, read_text(path).split("\n")) if line)
    text = "\n".join(lines)
    head = _KEYWORD.match(text)
    try:
        if head is None:
            raise ValueError("it does not begin with OFF, or is binary")
        counts, *rows = [line.split() for line in text[head.end() :].strip().split("\n")]
        vertex_count, face_count = int(counts[0]), int(counts[1])
        if min(vertex_count, face_count) < 0 or len(rows) < vertex_count + face_count:
            raise ValueError(f"{len(rows)} lines for {vertex_count} vertices and {face_count} faces")
        of_faces = rows[vertex_count : vertex_count + face_count]
        vertices = np.array([row[:3] for row in rows[:vertex_count]], dtype=np.float64).reshape(-1, 3)
        ends = [1 + int(row[0]) for row in of_faces]
        loops = [[int(word) for word in row[1:end]] for row, end in zip(of_faces, ends, strict=True)]
        for loop, end in zip(loops, ends, strict=True):
            if not 3 <= len(loop) == end - 1 or not 0 <= min(loop) <= max(loop) < vertex_count:
                raise ValueError("a face has fewer than three corners, or names a vertex that is not there")
    except (ValueError, IndexError, OverflowError) as problem:
        raise unreadable(path, "OFF", problem) from problem
    if not loops:
        raise InputError(str(path), "holds no faces", "Use an OFF file with polygons")
    refuse_unusable(path, vertices)
    try:
        places, polygon = triangulated(vertices, loops)
    except ValueError as problem:
        raise InputError(str(path), f"holds {problem}", "Triangulate the mesh first") from problem
    faces = np.concatenate(loops).astype(np.int64)[places]
    texture, coordinates = uniform_texture(DEFAULT_COLOUR), np.full((len(faces), 3, 2), np.nan)
    remarks: list[str] = []
    if with_textures and head is not None:
        colours_from, colours_to = (6 if head[2] else 3), (-2 if head[1] else None)
        by_vertex = [row[colours_from:colours_to] for row in rows[:vertex_count]]
        colours = _colours(path, by_vertex, faces)
        if colours is None:
            by_face = [row[end:] for row, end in zip(of_faces, ends, strict=True)]
            colours = _colours(path, by_face, np.repeat(polygon[:, None], 3, axis=1))
            if colours is None and any(len(row) == 1 for row in by_face):
                remarks.append("the colours of its faces are numbers of a table that it lacks: drawn grey")
            by_vertex += by_face
        alphas = np.array([row[3] for row in by_vertex if len(row) == 4], dtype=np.float64)
        remarks += alpha_remark([alphas / 255 if alphas.max(initial=0) > 1 else alphas])
        if colours is not None:
            texture, coordinates = corner_colour_atlas(colours)
            texture = opaque(texture)
    of_face = np.zeros(len(faces), dtype=np.int32)
    return TexturedMesh(vertices, faces, coordinates, (texture,), of_face, remarks=tuple(remarks))


def _colours(path: Path, words: list[list[str]], rows: np.ndarray) -> np.ndarray | None:
    """RGBA (F, 3, 4) in 0..1 of corners by their rows (F, 3); None where no row has colours."""
    present = np.array([len(row) in (3, 4) for row in words])
    if not present.any():
        return None
    listed = [row[:3] for row, has_colour in zip(words, present, strict=True) if has_colour]
    whole = not any("." in word for row in listed for word in row)
    try:
        values = np.array(listed, dtype=np.float64).astype(np.int32 if whole else np.float64)
    except ValueError as problem:
        raise unreadable(path, "OFF", problem) from problem
    colours = np.tile(np.append(DEFAULT_COLOUR, 1.0), (len(words), 1))
    colours[present, :3] = colour_fractions(path, values)
    return np.asarray(colours[rows])
