"""How many errors of the published annotation `objectfolder check` finds, and how many right rows it doubts.

    python -m bench.factory.annotation [SCANS]

The rows of ``data/objects.csv`` get the published list's materials and lengths and lose what is ours (notes,
shells, looks), and are checked on the meshes that are there: those fetched, or ``SCANS/ID/model.obj``. Wrong
is a material that our table does not keep or for which it says there is no class, and a length that is off
the mesh's longest side by more than 3 %. Then faults are put into our own rows, one at a time, and those
found are counted.
"""

import csv
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from bench.factory.annotation_faults import injected, scaled
from bench.record import REPOSITORY, arguments, conclude
from objectfolder.audio.materials import read_materials
from pipeline.intake.check.entry import NOTE, Entry
from pipeline.intake.check.mesh_rules import LENGTH, MASS, SAME, WALLS, is_close
from pipeline.intake.check.row_rules import MATERIAL
from pipeline.intake.check.table_check import Check, check_entries, measured, read_entries

TABLE = REPOSITORY / "data" / "objects.csv"
MATERIALS = REPOSITORY / "data" / "materials.csv"
NO_CLASS = "the table of materials has no"
OURS = ("notes", "accepted", "roughness", "metallic", "wall_m", "shell_m")


def main() -> None:
    parser = arguments("errors of the published annotation that a check finds")
    parser.add_argument("scans", type=Path, nargs="?", help="folder of meshes by id (default: those fetched)")
    scans = parser.parse_args().scans
    with TABLE.open(newline="", encoding="utf-8") as file:
        ours = {row["id"]: row for row in csv.DictReader(file)}
    rows = [published(row, scans) for row in ours.values() if mesh_of(row, scans).is_file()]
    if not rows:
        parser.error("no mesh is there: fetch some, or name a folder of them")
    known = read_materials(MATERIALS)
    with tempfile.TemporaryDirectory(prefix="annotation-") as folder:
        table = Path(folder) / "published.csv"
        with table.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        entries = [measured(entry) for entry in read_entries(table, known)]
        ours_of = {
            entry.object_id: entry for entry in read_entries(ours_table(rows, ours, Path(folder)), known)
        }
    # A stated length scales a mesh, and ours is as in the file.
    right = [as_in_file(entry, ours_of[entry.object_id]) for entry in entries]
    check = check_entries(entries)
    wrong_material = {
        one.object_id
        for one in entries
        if ours[one.object_id]["material"] != one.cell("material") or NO_CLASS in ours[one.object_id]["notes"]
    }
    wrong_length = {one.object_id for one in entries if length_is_off(one)}
    figures = {
        "rows": len(entries),
        "length": score(entries, wrong_length, doubted(check, (LENGTH,))),
        "material_by_name": score(entries, wrong_material, doubted(check, (MATERIAL,))),
        "material_by_name_or_mass": score(entries, wrong_material, doubted(check, (MATERIAL, MASS))),
        "rows_with_a_doubt_about_walls": sorted(doubted(check, (WALLS,))),
        "faults_put_into_our_rows": injected(right),
        "findings": [
            {"object": one.object_id, "rule": one.rule, "severity": one.severity, "found": one.found}
            for one in check.findings
            if one.severity != NOTE
        ],
    }
    settings = {"objects": [one.object_id for one in entries], "same_length_within": SAME}
    compared = (
        "Errors and warnings of objectfolder check on the published list against our table's judgement."
    )
    conclude("annotation", figures, settings, compared)


def mesh_of(row: Mapping[str, str], scans: Path | None) -> Path:
    """Return where the mesh of a row is, or would be."""
    return TABLE.parent / row["mesh"] if scans is None else scans / row["id"] / "model.obj"


def published(row: Mapping[str, str], scans: Path | None) -> dict[str, str]:
    """Return a row as published: its materials and lengths, and nothing of ours."""
    texture = str(TABLE.parent / row["texture"]) if scans is None and row["texture"] else ""
    theirs = {"material": row["paper_material"], "length_m": row["paper_length_m"]}
    return {
        **row,
        **dict.fromkeys(OURS, ""),
        **theirs,
        "mesh": str(mesh_of(row, scans).resolve()),
        "texture": texture,
    }


def ours_table(
    rows: Sequence[Mapping[str, str]], ours: Mapping[str, Mapping[str, str]], folder: Path
) -> Path:
    """Write our own rows of the same meshes, without notes: a check is to find faults, not to be told."""
    table = folder / "ours.csv"
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            files = {"mesh": row["mesh"], "texture": row["texture"], "paper_length_m": ""}
            writer.writerow({**ours[row["id"]], "notes": "", "accepted": "", "metallic": "", **files})
    return table


def as_in_file(published: Entry, ours: Entry) -> Entry:
    """Return our row with what was measured of the same mesh under the published length."""
    if published.shape is None:
        return ours
    factor = published.shape.file_length / published.shape.length_m
    return replace(ours, shape=scaled(published.shape, factor))


def length_is_off(entry: Entry) -> bool:
    """Whether the published length is not the longest side of the mesh, which is in metres."""
    stated = entry.number("length_m")
    return (
        entry.shape is not None and stated is not None and not is_close(stated / entry.shape.file_length, 1)
    )


def doubted(check: Check, rules: Sequence[str]) -> set[str]:
    """Ids with an error or a warning by one of the rules."""
    return {one.object_id for one in check.findings if one.rule in rules and one.severity != NOTE}


def score(entries: Sequence[Entry], wrong: set[str], doubts: set[str]) -> dict[str, Any]:
    """Return what was found of what is wrong, and what was doubted though it is right."""
    return {
        "wrong": len(wrong),
        "right": len(entries) - len(wrong),
        "wrong_found": len(wrong & doubts),
        "right_doubted": len(doubts - wrong),
        "missed": sorted(wrong - doubts),
        "doubted_though_right": sorted(doubts - wrong),
    }


if __name__ == "__main__":
    main()
