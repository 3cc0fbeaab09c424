"""An object as it was read, for people: its numbers in lines, and a picture of all sides and a section."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from objectfolder.making.mesh.body import told_normals
from objectfolder.making.mesh.walls import (
    ANY_MATERIAL,
    FACING_AWAY,
    THIN,
    THIN_SHARE,
    WALL_LIMITS,
    WALL_SHARE,
    millimetres,
)
from objectfolder.products.atomic import atomic_write
from objectfolder.surface.textured_mesh import TexturedMesh, textured_mesh_of
from pipeline.dataset.catalogue import AS_IN_FILE
from pipeline.intake.add.addition import Checked
from pipeline.intake.add.preview_views import Floats, Tint, draw, side_m, standard_views
from pipeline.run.looks import looks_of

PIXELS = 300
"""A side of one view."""
LETTERS = 120
INDENT = 13
"""Letters that labels of lines take."""
RED = np.array([0.9, 0.1, 0.1])


def write_preview(path: Path, mesh: TexturedMesh, lines: Sequence[str], tint: Tint | None = None) -> None:
    """Write a PNG of a cleaned mesh in metres, with lines of text below it; z is up."""
    from matplotlib.figure import Figure

    views = standard_views(mesh.extents)
    side = side_m(mesh, views)
    text = "\n".join(textwrap.fill(line, LETTERS, subsequent_indent=INDENT * " ") for line in lines)
    figure = Figure(figsize=(10, 7 + 0.17 * len(text.splitlines())), dpi=100, layout="constrained")
    for axes, view in zip(figure.subplots(2, 3, sharex=True, sharey=True).flat, views, strict=True):
        axes.imshow(draw(mesh, view, side, PIXELS, tint), extent=2 * (-side / 2, side / 2))
        axes.set_title(view.title, fontsize=10)
    figure.supylabel("metres", fontsize=10)
    figure.supxlabel(text, x=0.01, ha="left", fontsize=9, fontfamily="monospace", parse_math=False)
    with atomic_write(path) as file:
        figure.savefig(file, format="png")


def walls_marked(mesh: TexturedMesh, least_wall_m: float) -> Tint:
    """Colour points red that lie on a wall thinner than `least_wall_m`."""
    surface = mesh.surface
    start = 1e-6 * float(mesh.extents.max())
    widest = WALL_SHARE * float(np.sort(mesh.extents)[1])

    def marked(points: Floats, normals: Floats, colours: Floats) -> Floats:
        hits = surface.ray_hits(points - start * normals, -normals)
        behind = np.einsum("ij,ij->i", normals, surface.face_normals[np.maximum(hits.face, 0)])
        thin = (hits.face >= 0) & (behind < FACING_AWAY) & (hits.distance + start < min(least_wall_m, widest))
        return np.where(thin[:, None], 0.35 * colours + 0.65 * RED, colours)

    return marked


def preview_of(candidate: Checked, path: Path, lines: Sequence[str]) -> None:
    """Write the picture of an object that was read; doubtful walls are marked."""
    mesh, tint = textured_mesh_of(candidate.product), None
    if any(finding.kind == THIN for finding in candidate.findings):
        tint = walls_marked(mesh, WALL_LIMITS.get(candidate.material.name, ANY_MATERIAL).least_wall_m)
    write_preview(path, mesh, lines, tint)


def lines_about(candidate: Checked) -> list[str]:
    """Size, volume, mass, walls, and what is doubtful."""
    attributes, walls = candidate.product.attributes, candidate.walls
    topology, cavities = attributes["topology"], attributes["cleaning"]["cavities"]
    extents = attributes["length"]["extents_m"]
    origin = "as in the file" if candidate.row["length_m"] == AS_IN_FILE else "as stated"
    density = candidate.material.density_kg_m3
    closure = (
        "closed"
        if walls.closed
        else f"{'closed but for cracks' if walls.cracked else 'open'} ({topology['boundary_edges']} boundary "
        "edges): filled as it sounds"
    )
    lines = [
        f"object       {candidate.row['name']} ({candidate.object_id}), {candidate.row['licence']}",
        f"size         {' x '.join(f'{side:.4g}' for side in extents)} m, longest side {origin}",
        f"surface      {len(candidate.product['faces'])} triangles, {closure}, "
        f"pieces {topology['components'] - cavities}, cavities {cavities}, "
        f"normals {told_normals(attributes['normals_of_source'])}",
        f"looks        {looks_of(textured_mesh_of(candidate.product))}",
        f"up           {attributes.get('source_up', 'z')} of the file",
        f"volume       {_number(1e6 * walls.volume_m3)} cm3, {_number(density * walls.volume_m3)} kg of "
        f"{candidate.material.name} ({density:g} kg/m3)",
    ]
    solid = f"2V/A {millimetres(walls.effective_m)}, thickest {millimetres(walls.bulk_m)}"
    wall_words = "none"
    if walls.wall_median_m is not None:
        wall_words = f"{100 * walls.wall_share:.0f} % of the area, median {millimetres(walls.wall_median_m)}"
    if walls.wall_thin_m is not None:
        wall_words += f", {100 * THIN_SHARE:.0f} % of the area below {millimetres(walls.wall_thin_m)}"
    lines.append(f"walls        {wall_words}; {solid}")
    lines += [f"warning      {text}" for text in candidate.warnings]
    lines += [f"walls?       {finding}" for finding in candidate.findings]
    return lines


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}"
