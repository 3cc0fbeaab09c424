"""A picture of an object as it was understood: all sides to one scale, a section, its walls, its numbers."""

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from objectfolder.atomic import atomic_write
from objectfolder.geometry.mesh import TexturedMesh
from objectfolder.geometry.wall_measures import FACING_AWAY, WALL_SHARE
from pipeline.intake.add.preview_views import Floats, Tint, draw, side_m, standard_views

PIXELS = 300
MARGIN = 10
LINE = 17
COLUMNS = 3
LETTERS = 116
INDENT = 90
"""Pixels that labels of lines take: words before the first two blanks."""
RED, PURPLE = np.array([0.9, 0.1, 0.1]), np.array([0.6, 0.1, 0.8])


def write_preview(
    path: Path,
    mesh: TexturedMesh,
    lines: Sequence[str],
    *,
    least_wall_m: float | None = None,
    up_axis: int = 2,
) -> None:
    """Write a PNG of a cleaned mesh in metres.

    Parameters
    ----------
    lines
        Text below the picture.
    least_wall_m
        Colour walls thinner than this red, and surface behind which there is no inside purple; None colours
        nothing.
    up_axis
        Which axis is up in the picture.
    """
    from PIL import Image, ImageDraw, ImageFont

    views = standard_views(mesh.extents, up_axis)
    side = side_m(mesh, views)
    tint = None if least_wall_m is None else walls_marked(mesh, least_wall_m)
    rows = -(-len(views) // COLUMNS)
    text = [part for line in lines for part in _wrapped(line)]
    width = COLUMNS * PIXELS + 2 * MARGIN
    height = rows * (PIXELS + LINE) + (len(text) + 2) * LINE + 3 * MARGIN
    sheet = Image.new("RGB", (width, height), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=13)
    for index, view in enumerate(views):
        left = MARGIN + index % COLUMNS * PIXELS
        top = MARGIN + index // COLUMNS * (PIXELS + LINE)
        sheet.paste(Image.fromarray(draw(mesh, view, side, PIXELS, tint)), (left, top))
        pen.text((left + 4, top + PIXELS), view.title, "dimgray", font)
    bar = scale_bar_m(side)
    below = MARGIN + rows * (PIXELS + LINE) + LINE // 2
    end = MARGIN + round(bar / side * PIXELS)
    pen.line([(MARGIN, below), (end, below)], "black", 2)
    for x in (MARGIN, end):
        pen.line([(x, below - 4), (x, below + 4)], "black", 2)
    pen.text((end + 8, below - 8), f"{bar:g} m, all views alike", "black", font)
    for index, (label, part) in enumerate(text):
        pen.text((MARGIN, below + LINE + index * LINE), label, "dimgray", font)
        pen.text((MARGIN + INDENT, below + LINE + index * LINE), part, "black", font)
    data = io.BytesIO()
    sheet.save(data, "PNG")
    with atomic_write(path) as file:
        file.write(data.getvalue())


def _wrapped(line: str) -> list[tuple[str, str]]:
    """Labels and texts of the lines that one is broken into."""
    label, blanks, rest = line.partition("  ")
    if not blanks:
        label, rest = "", line
    return [
        (label if not index else "", part) for index, part in enumerate(textwrap.wrap(rest.strip(), LETTERS))
    ]


def scale_bar_m(side_m: float) -> float:
    """The longest of 1, 2, 5, 10, ... (in any decade) metres that a third of the picture holds."""
    wanted = side_m / 3
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * decade for step in (1, 2, 5) if step * decade <= wanted * (1 + 1e-9)))


def walls_marked(mesh: TexturedMesh, least_wall_m: float) -> Tint:
    """Colour by what lies behind each point: red a wall thinner than `least_wall_m`, purple no inside."""
    surface = mesh.surface
    start = 1e-6 * float(mesh.extents.max())
    widest = WALL_SHARE * float(np.sort(mesh.extents)[1])

    def marked(points: Floats, normals: Floats, colours: Floats) -> Floats:
        hits = surface.ray_hits(points - start * normals, -normals)
        behind = np.einsum("ij,ij->i", normals, surface.face_normals[np.maximum(hits.face, 0)])
        met = hits.face >= 0
        thin = met & (behind < FACING_AWAY) & (hits.distance + start < min(least_wall_m, widest))
        torn = met & (behind > 0)
        return _blended(_blended(colours, thin, RED), torn, PURPLE)

    return marked


def _blended(colours: Floats, chosen: NDArray[np.bool_], colour: Floats) -> Floats:
    return np.where(chosen[:, None], 0.35 * colours + 0.65 * colour, colours)
