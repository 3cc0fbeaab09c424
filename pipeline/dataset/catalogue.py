"""The list of objects: a CSV table, read strictly, its faults named by row and field."""

import csv
import difflib
import math
import re
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import is_file
from objectfolder.making.mesh.up_axis import check_up_axis
from objectfolder.surface.textured_mesh import check_stated_length
from objectfolder.vision.appearance import OPAQUE, check_glass

AS_IN_FILE = "as in file"
"""Value of `length_m` for a mesh whose own unit is the metre."""

SENSES = ("vision", "audio", "touch")

REQUIRED_COLUMNS = ("id", "material")
COLUMNS = (
    "id", "name", "mesh", "texture", "material", "length_m", "source", "licence", "attribution", "roughness",
    "metallic", "glass", "wall_m", "shell_m", "mass_kg", "source_id",
)  # fmt: skip

# Windows opens a device for these names, whatever extension follows, and drops a dot at the end.
_SAFE_ID = re.compile(
    r"(?!(con|prn|aux|nul|com[1-9]|lpt[1-9])(\.|$))[a-z0-9_]([a-z0-9_.-]{0,98}[a-z0-9_-])?",
    re.ASCII | re.IGNORECASE,
)


@dataclass(frozen=True)
class ObjectRecord:
    """One row of the table.

    Parameters
    ----------
    id
        Names the object's files; see `check_id`.
    mesh, texture
        Files that exist; a texture of None follows the mesh.
    material
        A material of the material table.
    length_m
        Longest side in metres; None as in the file.
    roughness, metallic
        Appearance in 0..1 in place of the material's; None leaves the material's.
    glass
        ``"thin"`` where light passes its walls, as through a slab each; else ``"opaque"``.
    wall_m
        Least thickness of the walls for its sound, metres, where the scan made them too thin.
    shell_m
        Thickness in metres of the wall, for its sound, of a closed container that the scan has as solid. Not
        together with `wall_m`.
    up
        Axis of the mesh that is up, x, y or z; None takes y for glTF, z for all others.
    mass_kg
        As measured, where it is known. It is that of simulators' assets; sound keeps the material's density.
    senses
        Those of `SENSES` that it gets; sound alone can be left out.
    source_id
        What `objectfolder fetch` knows the object by, as ``ycb:025_mug``; empty for one's own.
    """

    id: str
    name: str
    mesh: Path
    texture: Path | None
    material: str
    length_m: float | None
    source: str
    licence: str
    attribution: str
    roughness: float | None = None
    metallic: float | None = None
    glass: str = OPAQUE
    wall_m: float | None = None
    shell_m: float | None = None
    mass_kg: float | None = None
    source_id: str = ""
    senses: tuple[str, ...] = SENSES
    up: str | None = None


@dataclass(frozen=True)
class Catalogue:
    """Objects that can be made, and for each of the others why it cannot."""

    records: tuple[ObjectRecord, ...]
    errors: dict[str, InputError]


def read_catalogue(path: Path, materials: Iterable[str]) -> Catalogue:
    """Read the table of objects.

    Columns `id` and `material` are required. `mesh` and `texture` are relative to the table's folder; without
    a `mesh` column the mesh of each object is ``<id>/model.obj`` beside the table and `texture` is relative
    to ``<id>``. Columns that are not known are passed over.

    Parameters
    ----------
    materials
        Names an object's `material` may have.

    Returns
    -------
    Catalogue
        Rows in order; a row with a fault of its own is in `errors` under its id, so that the others go on.
        Rows that share an id are all at fault.

    Raises
    ------
    InputError
        The table is missing or is no CSV, or lacks a column.
    """
    path = Path(path)
    known_materials = tuple(materials)
    columns, rows = read_rows(path)
    faulty = _faulty_ids(path, rows)
    records: list[ObjectRecord] = []
    errors: dict[str, InputError] = {}
    for line, row in rows:
        try:
            if line in faulty:
                raise faulty[line]
            records.append(_record(path, columns, line, row, known_materials))
        except InputError as problem:
            errors[row["id"] or f"line {line}"] = problem
    return Catalogue(tuple(records), errors)


def read_rows(path: Path) -> tuple[list[str], list[tuple[int, dict[str, str]]]]:
    """Read a table of objects as text, unknown columns too.

    Returns
    -------
    columns
        Their names.
    rows
        Each with its line in the file; cells stripped, empty lines left out.

    Raises
    ------
    InputError
        The table is missing or is no CSV, or lacks a column.
    """
    if not path.is_file():
        raise InputError(str(path), "the table of objects does not exist", "Correct the path")
    rows: list[tuple[int, dict[str, str]]] = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            columns = [name.strip() for name in next(reader, [])]
            _check_columns(path, columns)
            for cells in reader:
                if not any(cell.strip() for cell in cells):
                    continue
                if len(cells) > len(columns):
                    raise InputError(
                        f"{path} line {reader.line_num}",
                        f"has {len(cells)} cells for {len(columns)} columns",
                        "Put cells that contain commas in double quotes",
                    )
                row_cells = [cell.strip() for cell in cells] + [""] * (len(columns) - len(cells))
                rows.append((reader.line_num, dict(zip(columns, row_cells, strict=True))))
    except (csv.Error, UnicodeDecodeError) as problem:
        raise InputError(
            str(path), f"is not a CSV table in UTF-8 ({problem})", "Export it again"
        ) from problem
    if not rows:
        raise InputError(str(path), "lists no objects", "Add a row for each object")
    return columns, rows


def _check_columns(path: Path, columns: list[str]) -> None:
    doubles = {name for name in columns if name in COLUMNS and columns.count(name) > 1}
    if doubles:
        raise InputError(str(path), f"repeats the column {', '.join(sorted(doubles))}", "Keep one of them")
    for name in COLUMNS:
        near = difflib.get_close_matches(
            name, [column for column in columns if column not in COLUMNS], 1, 0.85
        )
        if name not in columns and (near or name in REQUIRED_COLUMNS):
            remedy = f"Rename {near[0]!r} to {name!r}" if near else f"Add a column {name!r}"
            for separator, marks in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
                if len(columns) == 1 and separator in columns[0]:
                    remedy = f"Its columns are separated by {marks}: separate them by commas"
            raise InputError(str(path), f"has no column {name!r}", remedy)


def _faulty_ids(path: Path, rows: list[tuple[int, dict[str, str]]]) -> dict[int, InputError]:
    """Return, by line, why the id of a row names no file or no one object."""
    lines: dict[str, list[int]] = {}
    for line, row in rows:
        # File systems that ignore case would let one object overwrite the other.
        lines.setdefault(row["id"].casefold(), []).append(line)
    errors: dict[int, InputError] = {}
    for line, row in rows:
        object_id = row["id"]
        repeats = [str(number) for number in lines[object_id.casefold()] if number != line]
        where = f"{path} line {line}, field id"
        try:
            check_id(object_id, where)
        except InputError as problem:
            errors[line] = problem
        else:
            if repeats:
                errors[line] = InputError(
                    where,
                    f"{object_id!r} is also used in line {', '.join(repeats)} (case does not count)",
                    "Give each object its own id",
                )
    return errors


def check_id(object_id: str, where: str) -> None:
    """Raise `InputError` for an id that cannot name a file on every system, or that looks like an option."""
    if not _SAFE_ID.fullmatch(object_id):
        raise InputError(
            where,
            f"{object_id!r} cannot be a file name",
            "Use at most 100 letters, digits, '_', '-' and '.', not '-' or '.' first, no '.' last, and no "
            "name of a Windows device (CON, NUL, COM1)",
        )


def _record(
    path: Path, columns: list[str], line: int, row: dict[str, str], materials: tuple[str, ...]
) -> ObjectRecord:
    object_id = row["id"]
    where = f"{object_id} ({path} line {line})"
    folder = path.parent if "mesh" in columns else path.parent / object_id
    mesh_name = row["mesh"] if "mesh" in columns else "model.obj"
    if not mesh_name:
        raise InputError(f"{where}, field mesh", "is empty", "Name the mesh file")
    wall_m = _positive(row.get("wall_m", ""), f"{where}, field wall_m", "metres")
    shell_m = _positive(row.get("shell_m", ""), f"{where}, field shell_m", "metres")
    if wall_m is not None and shell_m is not None:
        raise InputError(
            f"{where}, field shell_m",
            "is stated together with wall_m",
            "State wall_m for an open vessel with thin walls, shell_m for one that is scanned solid",
        )
    texture_name, source_id = row.get("texture", ""), row.get("source_id", "")
    record = ObjectRecord(
        id=object_id,
        name=row.get("name") or object_id,
        mesh=folder / mesh_name,
        texture=folder / texture_name if texture_name else None,
        material=_material(row["material"], materials, where),
        length_m=_length(row.get("length_m", ""), where),
        source=row.get("source", ""),
        licence=row.get("licence", ""),
        attribution=row.get("attribution", ""),
        roughness=_fraction(row.get("roughness", ""), f"{where}, field roughness"),
        metallic=_fraction(row.get("metallic", ""), f"{where}, field metallic"),
        glass=_glass(row.get("glass", ""), f"{where}, field glass"),
        wall_m=wall_m,
        shell_m=shell_m,
        mass_kg=_positive(row.get("mass_kg", ""), f"{where}, field mass_kg", "kilograms"),
        source_id=source_id,
        up=_up(row.get("up", ""), f"{where}, field up"),
        senses=_senses(row.get("senses", ""), f"{where}, field senses"),
    )
    # Last: a row that only waits for its files has no other fault.
    _check_exists(record.mesh, f"{where}, field mesh", source_id)
    if record.texture is not None:
        _check_exists(record.texture, f"{where}, field texture", source_id)
    return record


def _check_exists(path: Path, where: str, source_id: str) -> None:
    if not is_file(path):
        remedy = (
            f"objectfolder fetch {shlex.quote(source_id)}"
            if source_id
            else "Correct the path or add the file"
        )
        raise InputError(where, f"the file {path} does not exist", remedy)


def _material(name: str, materials: tuple[str, ...], where: str) -> str:
    if name in materials:
        return name
    near = difflib.get_close_matches(name.lower(), materials, n=1)
    hint = f"Did you mean {near[0]!r}? " if near else ""
    raise InputError(
        f"{where}, field material",
        f"the material {name!r} is not known",
        f"{hint}Use one of {', '.join(materials)}, or add a row to the table of materials",
    )


def number_in(text: str) -> float:
    """Return a number as CSV files have it; NaN for any other text, as ``1_0``, which `float` would take."""
    try:
        return float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan


def _length(text: str, where: str) -> float | None:
    if text.lower() in ("", AS_IN_FILE):
        return None
    length = number_in(text)
    if math.isnan(length):
        raise InputError(
            f"{where}, field length_m", f"{text!r} is not a number", f"Give metres, or {AS_IN_FILE!r}"
        )
    check_stated_length(length, where)
    return length


def _fraction(text: str, where: str) -> float | None:
    if not text:
        return None
    value = number_in(text)
    if not 0 <= value <= 1:
        raise InputError(where, f"{text!r} is not a number in 0..1", "Correct it, or leave it empty")
    return value


def _glass(text: str, where: str) -> str:
    glass = text.lower() or OPAQUE
    check_glass(glass, where)
    return glass


def _up(text: str, where: str) -> str | None:
    check_up_axis(text.lower() or None, where)
    return text.lower() or None


def _senses(text: str, where: str) -> tuple[str, ...]:
    senses = text.lower().split() or list(SENSES)
    if not {"vision", "touch"} <= set(senses) <= set(SENSES):
        remedy = f"Give {' '.join(SENSES)!r}, 'vision touch' to leave sound out, or nothing for all"
        raise InputError(where, f"{text!r} is not vision, touch and perhaps audio", remedy)
    return tuple(sense for sense in SENSES if sense in senses)


def _positive(text: str, where: str, unit: str) -> float | None:
    if not text:
        return None
    value = number_in(text)
    if not (math.isfinite(value) and value > 0):
        raise InputError(where, f"{text!r} is not a positive number", f"Give {unit}, or leave it empty")
    return value
