"""The measurements of an object, in lines for people."""

import numpy as np

from objectfolder.catalogue import AS_IN_FILE
from objectfolder.geometry.mass_evidence import millimetres
from objectfolder.geometry.wall_measures import LEVELS
from pipeline.intake.add.addition import Checked


def lines_about(checked: Checked) -> list[str]:
    """Size, volume, mass, walls, and what is doubtful."""
    attributes, walls = checked.product.attributes, checked.walls
    extents = attributes["length"]["extents_m"]
    origin = "as in the file" if checked.row["length_m"] == AS_IN_FILE else "as stated"
    density = checked.material.density_kg_m3
    closed = (
        "closed" if walls.closed else f"open ({walls.boundary_edges} boundary edges): filled as it sounds"
    )
    lines = [
        f"object       {checked.row['name']} ({checked.object_id}), {checked.row['licence']}",
        f"size         {' x '.join(f'{side:.4g}' for side in extents)} m, longest side {origin}",
        f"surface      {len(checked.product['faces'])} triangles, {closed}, "
        f"pieces {walls.pieces}, cavities {walls.cavities}",
        f"volume       {_number(1e6 * walls.volume_m3)} cm3, {_number(density * walls.volume_m3)} kg of "
        f"{checked.material.name} ({density:g} kg/m3)",
        _walls(checked),
    ]
    lines += [f"warning      {text}" for text in checked.warnings]
    lines += [f"walls?       {finding}" for finding in checked.findings]
    return lines


def _walls(checked: Checked) -> str:
    walls = checked.walls
    solid = f"2V/A {millimetres(walls.effective_m)}, thickest {millimetres(walls.bulk_m)}"
    median = walls.usual_wall_m()
    if median is None:
        return f"walls        none; {solid}"
    thin = float(np.interp(0.05, LEVELS, walls.wall_m))
    return (
        f"walls        {100 * walls.wall_share:.0f} % of the area, median {millimetres(median)}, "
        f"a twentieth of them below {millimetres(thin)}; {solid}"
    )


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}"
