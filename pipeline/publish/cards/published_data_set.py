"""Everything cards say of a data set, read from its products, reports and parameters."""

import csv
import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from objectfolder.errors import FormatError, InputError
from objectfolder.provenance import canonical_json, file_digest
from objectfolder.splits import object_split
from objectfolder.store import read_attributes
from pipeline.dataset.failures import read_failures
from pipeline.dataset.records import read_records
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.publish.cards.licences import Licence
from pipeline.publish.cards.publication import Publication, read_publication

PARAMETERS = Path("params.yaml")
PER_OBJECT = "per_object.csv"
METRICS = "metrics.json"


@dataclass(frozen=True)
class PublishedFile:
    """A file of the data set: path from its root with slashes, size, SHA-256 (64 hex digits)."""

    path: str
    bytes: int
    sha256: str


@dataclass(frozen=True)
class PublishedObject:
    """An object that has an Object File.

    Parameters
    ----------
    figures
        Its row of per_object.csv, text by column; empty where the report has none.
    definitions
        What its fidelity product says of its measures, by name.
    """

    object_id: str
    name: str
    material: str
    source: str
    licence: Licence
    attribution: str
    file: PublishedFile
    figures: Mapping[str, str]
    definitions: Mapping[str, str]

    @property
    def split(self) -> str:
        """Whether it is for training, validation or testing across objects."""
        return object_split(self.object_id, self.material)


@dataclass(frozen=True)
class Missing:
    """A listed object without an Object File, and why, as far as that is known here."""

    object_id: str
    stage: str
    error: str


@dataclass(frozen=True)
class Source:
    """Objects of one origin under one licence with one attribution; empty text is what was not stated."""

    source: str
    licence: Licence
    attribution: str
    object_ids: tuple[str, ...]


@dataclass(frozen=True)
class DataSet:
    """What cards are made of; `parameters` are those of the size that was made."""

    publication: Publication
    objects: tuple[PublishedObject, ...]
    missing: tuple[Missing, ...]
    figures_file: PublishedFile | None
    columns: tuple[str, ...]
    metrics: Mapping[str, Any]
    size: str
    parameters: Mapping[str, Any]
    seed: int

    @property
    def version(self) -> str:
        """The publisher's version, and a digest of ids and Object Files: other files, another version."""
        content = [[entry.object_id, entry.file.sha256] for entry in self.objects]
        return (
            f"{self.publication.version}+{hashlib.sha256(canonical_json(content).encode()).hexdigest()[:12]}"
        )

    @property
    def definitions(self) -> dict[str, str]:
        """What measures mean, by name; the same for all objects that one version of the code measured."""
        return {name: text for entry in self.objects for name, text in entry.definitions.items()}

    def sources(self) -> list[Source]:
        """Return every source once, most objects first; each object is in exactly one."""
        groups: dict[tuple[str, Licence, str], list[str]] = {}
        for entry in self.objects:
            groups.setdefault((entry.source, entry.licence, entry.attribution), []).append(entry.object_id)
        made = [Source(*key, tuple(sorted(ids))) for key, ids in groups.items()]
        return sorted(
            made, key=lambda one: (-len(one.object_ids), one.source, one.licence.label, one.attribution)
        )

    def licences(self) -> list[tuple[Licence, int]]:
        """Return every licence, the absence of one included, with its number of objects, most first."""
        counts = Counter(entry.licence for entry in self.objects)
        return sorted(counts.items(), key=lambda item: (-item[1], item[0].label))


def read_data_set(root: Path, folder: Path) -> DataSet:
    """Read the data set at `root` whose reports lie in `folder`.

    Raises
    ------
    InputError
        No records, or a report or parameter file that is damaged.
    """
    records = read_records(root)
    columns, rows = _figures(folder / PER_OBJECT)
    objects = []
    for object_id in sorted(records.rows):
        path = OBJECT_FILES.path(root, object_id)
        if path.is_file():
            row = records.rows[object_id]
            objects.append(
                PublishedObject(
                    object_id,
                    _line(row["name"]) or object_id,
                    _line(row["material"]["name"]),
                    _line(row["source"]),
                    Licence.of(str(row["licence"] or "")),
                    _line(row["attribution"]),
                    _file(root, path),
                    rows.get(object_id, {}),
                    _definitions(FIDELITY.path(root, object_id)),
                )
            )
    made = {entry.object_id for entry in objects}
    listed = {*records.rows, *(failure.object_id for failure in records.refused)}
    reasons = _reasons(root)
    for failure in records.refused:
        reasons.setdefault(failure.object_id, ("objects", failure.error))
    missing = tuple(
        Missing(object_id, *reasons.get(object_id, ("", "not made"))) for object_id in sorted(listed - made)
    )
    size, parameters, seed = _parameters(root / PARAMETERS)
    report = folder / PER_OBJECT
    return DataSet(
        read_publication(root),
        tuple(objects),
        missing,
        _file(folder, report) if report.is_file() else None,
        columns,
        _metrics(folder / METRICS),
        size,
        parameters,
        seed,
    )


def _line(text: object) -> str:
    """Return one line of text: what others state may have breaks in it."""
    return " ".join(str(text or "").split())


def _file(root: Path, path: Path) -> PublishedFile:
    return PublishedFile(path.relative_to(root).as_posix(), path.stat().st_size, file_digest(path))


def _definitions(path: Path) -> dict[str, str]:
    try:
        said = read_attributes(path).get("definitions")
    except (FileNotFoundError, FormatError):  # the report says which are damaged
        return {}
    return {str(key): _line(text) for key, text in said.items()} if isinstance(said, dict) else {}


def _reasons(root: Path) -> dict[str, tuple[str, str]]:
    """Return the stage in which each object failed, and why."""
    return {failed.object: (failed.stage, _line(failed.error)) for failed in read_failures(root)}


def _figures(path: Path) -> tuple[tuple[str, ...], dict[str, dict[str, str]]]:
    if not path.is_file():
        return (), {}
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        columns = tuple(reader.fieldnames or ())
        if "id" not in columns:
            raise InputError(str(path), "it has no column id", "Run the stage `report`.")
        return columns, {row["id"]: row for row in reader}


def _metrics(path: Path) -> dict[str, Any]:
    try:
        read = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except ValueError as error:
        raise InputError(str(path), f"not JSON ({error})", "Run the stage `report`.") from error
    return read if isinstance(read, dict) else {}


def _parameters(path: Path) -> tuple[str, dict[str, Any], int]:
    try:
        read = yaml.safe_load(path.read_text(encoding="utf-8"))
        size = str(read["size"])
        return size, dict(read["sizes"][size]), int(read["seed"])
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise InputError(str(path), f"cannot be read ({error!r})", "Restore it.") from error
