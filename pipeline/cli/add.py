"""The command `add`: one's own mesh as a row of a table of objects."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.intake.add.addition import Added, Checked

REPOSITORY = Path(__file__).parents[2]
TABLE = "data/my_objects.csv"


def add_commands(commands: Any) -> None:
    """Add the command to a parser's sub-commands."""
    text = "check one's own mesh, copy it with what it refers to, and add it to a table of objects"
    command = commands.add_parser("add", help=text, description=text)
    command.add_argument("mesh", help="OBJ, glTF, GLB, PLY or STL")
    command.add_argument("--material", required=True, help="a row of the materials table")
    command.add_argument("--licence", required=True, help="SPDX identifier, such as CC-BY-4.0 or CC0-1.0")
    command.add_argument("--attribution", help="whom to name (needed but for CC0-1.0 and the like)")
    command.add_argument("--length", type=float, help="longest side in metres (default: as in the file)")
    command.add_argument("--id", help="identifier (default: from the name of the file)")
    command.add_argument("--name", help="name in words (default: from the identifier)")
    command.add_argument("--texture", help="base colour image (default: the mesh's own)")
    command.add_argument("--source", default="", help="where the mesh is from")
    command.add_argument("--wall", type=float, help="least thickness of walls, metres, where too thin")
    command.add_argument("--shell", type=float, help="wall of a container that was scanned solid, metres")
    command.add_argument("--roughness", type=float, help="0..1 (default: the material's)")
    command.add_argument("--metallic", type=float, help="0..1 (default: the material's)")
    command.add_argument("--mass", type=float, help="mass in kilograms where it is known: a check")
    command.add_argument("--table", default=TABLE, help=f"CSV table, made if absent (default {TABLE})")
    command.add_argument("--materials", help="materials table (default: the project's)")
    command.add_argument("--replace", action="store_true", help="replace the object of this id")
    command.add_argument("--preview", metavar="FILE.png", help="the picture (default: beside the object)")
    command.add_argument("--no-preview", action="store_true", help="make no picture")
    command.add_argument("--dry-run", action="store_true", help="check only; write no row and no copy")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Check, copy, add the row, draw; print what was measured and what comes next."""
    from pipeline.intake.add.addition import Wanted, check_object, put_object, up_axis
    from pipeline.intake.add.addition_summary import lines_about

    table = Path(options.table)
    checked = check_object(
        Wanted(
            mesh=Path(options.mesh),
            material=options.material,
            licence=options.licence,
            materials=Path(options.materials or REPOSITORY / "data" / "materials.csv"),
            attribution=options.attribution,
            length_m=options.length,
            object_id=options.id,
            name=options.name,
            texture=Path(options.texture) if options.texture else None,
            source=options.source,
            wall_m=options.wall,
            shell_m=options.shell,
            roughness=options.roughness,
            metallic=options.metallic,
            mass_kg=options.mass,
        )
    )
    lines = lines_about(checked)
    print("\n".join(lines))
    added = None if options.dry_run else put_object(checked, table, replace=options.replace)
    if added is not None:
        count = len(checked.layout.files)
        what = "added to" if added.changed else "is in"
        print(f"{checked.object_id} {what} {table}; {count} file{'s'[: count > 1]} in {added.folder}")
    picture = _picture(options, checked, added)
    if picture is not None:
        _draw(picture, checked, lines, up_axis(Path(options.mesh)))
        print(f"picture      {picture}")
    if added is not None:
        print(f"next         make dataset OBJECTS={table} ONLY={checked.object_id}")


def _picture(options: argparse.Namespace, checked: "Checked", added: "Added | None") -> Path | None:
    if options.no_preview:
        return None
    if options.preview:
        return Path(options.preview)
    if added is None:
        return None
    return added.folder.parent / f"{checked.object_id}.png"


def _draw(path: Path, checked: "Checked", lines: list[str], up_axis: int) -> None:
    from objectfolder.geometry.mesh_product import textured_mesh_of
    from objectfolder.geometry.vessels import THIN, TORN
    from objectfolder.geometry.walls_of_materials import limits_of
    from pipeline.intake.add.preview import write_preview

    marked = any(finding.kind in (THIN, TORN) for finding in checked.findings)
    write_preview(
        path,
        textured_mesh_of(checked.product),
        lines,
        least_wall_m=limits_of(checked.material.name).least_wall_m if marked else None,
        up_axis=up_axis,
    )
