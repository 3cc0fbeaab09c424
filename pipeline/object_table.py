"""The table of objects: a row that cannot be used is refused by name, and the others go on."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from objectfolder.audio.materials import Material
from objectfolder.errors import InputError
from pipeline.task import Failure, failure_of

REQUIRED_COLUMNS = ("id", "material")
AS_IN_FILE = "as in file"
ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
SMALLEST_M, LARGEST_M = 1e-3, 20.0  # outside lies a wrong unit rather than an object


@dataclass(frozen=True)
class ObjectRow:
    """A listed object.

    Parameters
    ----------
    object_id
        Names its files.
    name
        For people.
    mesh
        Mesh file.
    texture
        Texture that replaces the mesh's own; None to use those.
    material
        Name in the table of materials.
    length_m
        Longest side in metres; None as in the file.
    source, licence, attribution
        Where it comes from and on what terms.
    roughness, metallic
        Of its appearance; None for the material's.
    """

    object_id: str
    name: str
    mesh: Path
    texture: Path | None
    material: str
    length_m: float | None
    source: str
    licence: str
    attribution: str
    roughness: float | None
    metallic: float | None


@dataclass(frozen=True)
class ObjectTable:
    """The usable rows by id, and why the others were refused."""

    rows: Mapping[str, ObjectRow]
    refused: tuple[Failure, ...]


def read_object_table(path: Path, only: Sequence[str], materials: Mapping[str, Material]) -> ObjectTable:
    """Read a table with the columns id, name, mesh, texture, material, length_m, source, licence, attribution.

    Paths are relative to the table's folder. Without a mesh column, the mesh of an object is
    ``<id>/model.obj`` beside the table. Further columns are ignored, but roughness and metallic.

    Parameters
    ----------
    path
        A CSV file.
    only
        Ids to take; none for all.
    materials
        Known materials by name.

    Raises
    ------
    InputError
        A missing file or column, or an id in `only` that is not listed.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            columns = reader.fieldnames or []
            missing = [column for column in REQUIRED_COLUMNS if column not in columns]
            if missing:
                raise InputError(str(path), f"no column {missing[0]!r}", f"Columns are {', '.join(columns)}.")
            lines = [
                {key: (value or "").strip() for key, value in line.items() if isinstance(key, str)}
                for line in reader
            ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f"cannot be read ({error})", "Give a CSV file in UTF-8.") from error
    listed = [line["id"] for line in lines]
    for object_id in only:
        if object_id not in listed:
            raise InputError(str(path), f"lists no object {object_id!r}", "Correct `objects.only` (ONLY=).")
    rows: dict[str, ObjectRow] = {}
    refused: dict[str, Failure] = {}
    for line in lines:
        object_id = line["id"]
        if only and object_id not in only:
            continue
        try:
            if listed.count(object_id) > 1:
                finding = f"{path.name} lists the id {listed.count(object_id)} times"
                raise InputError(object_id, finding, "Give every object its own id.")
            rows[object_id] = _row(path, line, materials)
        except InputError as error:
            refused[object_id] = failure_of(object_id, error)
    return ObjectTable(rows, tuple(refused.values()))


def _row(path: Path, line: Mapping[str, str], materials: Mapping[str, Material]) -> ObjectRow:
    object_id = line["id"]
    if not ID.fullmatch(object_id):
        remedy = "Ids name files: use up to 100 letters, digits, '.', '_' and '-', a letter or digit first."
        raise InputError(object_id, f"{path.name}, column id: {object_id!r} cannot name a file", remedy)
    if line["material"] not in materials:
        finding = f"{path.name}, column material: unknown material {line['material']!r}"
        raise InputError(object_id, finding, f"Known are {', '.join(materials)}; add a row for another.")
    folder = path.parent
    texture: str | None = line.get("texture", "")
    if "mesh" in line:
        if not line["mesh"]:
            raise InputError(object_id, f"{path.name}, column mesh: empty", "Name the mesh file.")
        mesh = folder / line["mesh"]
        texture_path = folder / texture if texture else None
    else:
        mesh = folder / object_id / "model.obj"
        texture_path = folder / object_id / texture if texture else None
    return ObjectRow(
        object_id,
        line.get("name") or object_id,
        mesh,
        texture_path,
        line["material"],
        _length(path, object_id, line.get("length_m", "")),
        line.get("source", ""),
        line.get("licence", ""),
        line.get("attribution", ""),
        _fraction(path, object_id, "roughness", line.get("roughness", "")),
        _fraction(path, object_id, "metallic", line.get("metallic", "")),
    )


def _length(path: Path, object_id: str, text: str) -> float | None:
    if text.lower() in ("", AS_IN_FILE):
        return None
    value = _number(path, object_id, "length_m", text)
    if not SMALLEST_M <= value <= LARGEST_M:
        finding = f"{path.name}, column length_m: {text} m"
        remedy = f"Give the longest side in metres, {SMALLEST_M:g} to {LARGEST_M:g}, or '{AS_IN_FILE}'."
        raise InputError(object_id, finding, remedy)
    return value


def _fraction(path: Path, object_id: str, column: str, text: str) -> float | None:
    if not text:
        return None
    value = _number(path, object_id, column, text)
    if not 0 <= value <= 1:
        finding = f"{path.name}, column {column}: {text}"
        raise InputError(object_id, finding, "Give a number from 0 to 1, or nothing for the material's.")
    return value


def _number(path: Path, object_id: str, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(object_id, f"{path.name}, column {column}: {text!r} is no number", "Give a number.")
    return value
