"""A picture of an object as it was read: all sides to one scale, a section, its walls, its numbers."""

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from objectfolder.atomic import atomic_write
from objectfolder.geometry.mesh import TexturedMesh
from objectfolder.geometry.mesh_product import textured_mesh_of
from objectfolder.geometry.vessels import THIN, TORN
from objectfolder.geometry.wall_measures import FACING_AWAY, WALL_SHARE
from objectfolder.geometry.walls_of_materials import limits_of
from pipeline.intake.add.addition import Checked
from pipeline.intake.add.preview_views import Floats, Tint, draw, side_m, standard_views

PIXELS = 300
"""A side of one view."""
LETTERS = 120
INDENT = 13
"""Letters that labels of lines take."""
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
    from matplotlib.figure import Figure

    views = standard_views(mesh.extents, up_axis)
    side = side_m(mesh, views)
    tint = None if least_wall_m is None else walls_marked(mesh, least_wall_m)
    text = "\n".join(textwrap.fill(line, LETTERS, subsequent_indent=INDENT * " ") for line in lines)
    figure = Figure(figsize=(10, 7 + 0.17 * len(text.splitlines())), dpi=100, layout="constrained")
    for axes, view in zip(figure.subplots(2, 3, sharex=True, sharey=True).flat, views, strict=True):
        axes.imshow(draw(mesh, view, side, PIXELS, tint), extent=2 * (-side / 2, side / 2))
        axes.set_title(view.title, fontsize=10)
    figure.supylabel("metres", fontsize=10)
    figure.supxlabel(text, x=0.01, ha="left", fontsize=9, fontfamily="monospace", parse_math=False)
    data = io.BytesIO()
    figure.savefig(data, format="png")
    with atomic_write(path) as file:
        file.write(data.getvalue())


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


def preview_of(checked: Checked, mesh: Path, path: Path, lines: Sequence[str]) -> None:
    """Write the picture of an object that was read from `mesh`; doubtful walls are marked."""
    marked = any(finding.kind in (THIN, TORN) for finding in checked.findings)
    write_preview(
        path,
        textured_mesh_of(checked.product),
        lines,
        least_wall_m=limits_of(checked.material.name).least_wall_m if marked else None,
        # glTF has y up; scans, z.
        up_axis=1 if mesh.suffix.lower() in (".gltf", ".glb") else 2,
    )
