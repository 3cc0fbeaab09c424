"""The listed objects as the stages see them, read from the table once and stored in one file.

``data/records.json`` holds what is known of each object but its shape and texture, so that stages after
the first depend on neither the table's place nor columns that mean nothing to them.
"""

import difflib
import json
import re
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from objectfolder.errors import InputError
from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import json_lines
from objectfolder.products.regular_file import read_regular
from pipeline.dataset.task import Failure, failure_of

# Stages after the first need neither tables nor meshes, and start sooner without.
if TYPE_CHECKING:
    from objectfolder.making.materials import Material
    from pipeline.dataset.catalogue import ObjectRecord
    from pipeline.dataset.parameters import ObjectsParameters

MATERIALS = Path("data/materials.csv")
RECORDS = Path("data/records.json")
STATED = ("source", "licence", "attribution", "mass_kg")
# As the table's own check: an id names files, and must not lead out of their folder.
SAFE_ID = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,99}")


@dataclass(frozen=True)
class Records:
    """Rows of the listed objects by id, and why other listed objects were refused."""

    rows: Mapping[str, Mapping[str, Any]]
    refused: tuple[Failure, ...] = ()

    @property
    def listed(self) -> frozenset[str]:
        """Ids of all objects that the table lists."""
        return frozenset(self.rows) | {failure.object_id for failure in self.refused}

    def selected(self, only: Collection[str]) -> "Records":
        """Return the objects of a selection; all of them where it is empty.

        Raises
        ------
        InputError
            An id that the table does not list; the nearest one is named.
        """
        if not only:
            return self
        for object_id in only:
            if object_id not in self.listed:
                near = difflib.get_close_matches(object_id, self.listed, n=1)
                remedy = f"Did you mean {near[0]!r}?" if near else "Use an id of the table."
                raise InputError("the selection (ONLY=)", f"there is no object {object_id!r}", remedy)
        rows = {object_id: row for object_id, row in self.rows.items() if object_id in only}
        return Records(rows, tuple(failure for failure in self.refused if failure.object_id in only))


def read_table(root: Path, objects: "ObjectsParameters") -> Records:
    """Read the table of objects and the materials; rows have source files besides their records.

    All objects of the table are returned, those that are not selected included.

    Raises
    ------
    InputError
        A table that cannot be used.
    """
    from objectfolder.making.materials import read_materials
    from pipeline.dataset.catalogue import read_catalogue

    materials = read_materials(root / MATERIALS)
    catalogue = read_catalogue(root / objects.table, materials)
    rows = {record.id: row_of(record, materials[record.material]) for record in catalogue.records}
    refused = tuple(failure_of(object_id, error) for object_id, error in catalogue.errors.items())
    return Records(rows, refused)


def sources(row: Mapping[str, Any]) -> dict[str, Path]:
    """Return the files an object is read from, by role."""
    from objectfolder.making.mesh.readers.load import source_files

    files = {"mesh": row["mesh"]}
    if row["texture"] is not None:
        files["texture"] = row["texture"]
    more = [path for path in source_files(row["mesh"], row["texture"]) if path not in files.values()]
    return {**files, **{f"referred_{index}": path for index, path in enumerate(more)}}


def write_records(root: Path, records: Records) -> None:
    """Write what later stages read of the objects, atomically."""
    handed_on = (
        "name",
        "material",
        "material_citation",
        "loss_citation",
        "roughness_um",
        "appearance",
        "walls",
        "senses",
        *STATED,
    )
    content = {
        "objects": {
            object_id: {field: row[field] for field in handed_on} for object_id, row in records.rows.items()
        },
        "refused": [asdict(failure) for failure in records.refused],
    }
    write_whole(root / RECORDS, json_lines(content, 2) + "\n")


def read_records(root: Path) -> Records:
    """Read ``data/records.json``.

    Raises
    ------
    InputError
        A missing or damaged file.
    """
    try:
        text = read_regular(root / RECORDS)
    except OSError as error:
        raise _unreadable(error) from error
    return parse_records(text)


def parse_records(text: bytes) -> Records:
    """Return what a ``data/records.json`` holds.

    Raises
    ------
    InputError
        A damaged one.
    """
    try:
        content = json.loads(text)
        rows = content["objects"]
        for object_id, row in rows.items():
            if not SAFE_ID.fullmatch(object_id) or not isinstance(row, dict):
                raise ValueError(f"{object_id!r} is no id, or has no record")
            row.setdefault("loss_citation", "")  # records of earlier versions have none
        return Records(rows, tuple(Failure(**entry) for entry in content["refused"]))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise _unreadable(error) from error


def _unreadable(error: Exception) -> InputError:
    return InputError(str(RECORDS), f"cannot be read ({error})", "Run the stage `objects`.")


def row_of(record: "ObjectRecord", material: "Material") -> dict[str, Any]:
    """Return what the stages read of an object: its record, and its material as sound and sight take it."""
    from objectfolder.making.materials import CONTACT_RANGES
    from objectfolder.vision.appearance import OPAQUE

    appearance: dict[str, float | str] = {
        "roughness": material.roughness if record.roughness is None else record.roughness,
        "metallic": material.metallic if record.metallic is None else record.metallic,
    }
    if record.glass != OPAQUE:  # opaque things have the records that they had before glass was told
        appearance["glass"] = record.glass
    elsewhere = (*appearance, *CONTACT_RANGES, "citation", "contact_citation", "loss_citation")
    physical = {key: value for key, value in vars(material).items() if key not in elsewhere}
    return {
        **{name: getattr(record, name) for name in ("name", "mesh", "texture", "length_m", "up", *STATED)},
        "file_names": [record.mesh.name, record.texture.name if record.texture else None],
        "material": physical,
        "material_citation": material.citation,
        "loss_citation": material.loss_citation,
        "roughness_um": material.roughness_um,
        "appearance": appearance,
        "walls": {"wall_m": record.wall_m, "shell_m": record.shell_m},
        "senses": list(record.senses),
    }
