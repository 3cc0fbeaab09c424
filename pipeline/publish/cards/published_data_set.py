"""Everything cards say of a data set, read from its products, reports, parameters and ``data/card.yaml``."""

import contextlib
import csv
import datetime
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, StringConstraints
from pydantic.dataclasses import dataclass as checked_dataclass

from objectfolder.errors import FormatError, InputError
from objectfolder.products.provenance import canonical_json
from objectfolder.products.splits import object_split
from objectfolder.products.store import read_attributes
from pipeline.dataset.counts import counted
from pipeline.dataset.failures import FailedObject, read_failures
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.partition_folders import data_sets
from pipeline.dataset.records import read_records
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.dataset.validation import read_yaml, validated
from pipeline.dataset.verified import Verified
from pipeline.publish.cards.licences import Licence

PUBLICATION, PARAMETERS = "data/card.yaml", "params.yaml"
PER_OBJECT, METRICS = "per_object.csv", "metrics.json"
Address = Annotated[str, StringConstraints(pattern=r"^https?://\S+$")]
SUMMARY = (
    "Simulated by ObjectFolder Factory from meshes and material constants: views by path tracing (Blender "
    "Cycles), modal sound by finite elements, touches by a simulated tactile sensor. Each Object File was "
    "fitted to the training part and measured against the held-out part."
)
LIMITS = (
    "Everything is simulated; no figure here compares with a measurement of a real object.",
    "Material constants are those of the table of materials, one set an object: isotropic, uniform, linear.",
    "Glass and other clear materials are drawn as glossy opaque bodies, or where the table says so with thin "
    "walls that refract nothing.",
    "A container that was scanned solid rings like a solid unless its wall is stated in the table.",
    "The estimated error of a frequency is that of the elements, not of the mesh they were given.",
    "The gel of the tactile sensor is a model of its shape and lights; unless the parameters say elastic it "
    "does not deform and bears no force.",
    "Masses, sizes and wall thicknesses are those of the mesh at its stated length.",
)


@checked_dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Publication:
    """What no product knows, as the publisher states it in ``data/card.yaml``; empty where it is not stated.

    Parameters
    ----------
    version
        MAJOR.MINOR.PATCH; a digest of the Object Files is appended.
    url
        Page of the data set.
    files_url
        Address that paths such as ``data/object_files/mug.safetensors`` are relative to, if files are served.
    doi
        Without ``https://doi.org/``.
    creators
        Names of people or groups.
    """

    title: str = "ObjectFolder Factory data set"
    description: str = ""
    version: Annotated[str, StringConstraints(pattern=r"^\d+\.\d+\.\d+$")] = "0.1.0"
    date: datetime.date | None = None
    url: Address = ""
    files_url: Address = ""
    doi: str = ""
    creators: tuple[Annotated[str, StringConstraints(min_length=1)], ...] = ()


@dataclass(frozen=True)
class PublishedObject:
    """An object that has an Object File; empty text is what was not stated.

    Parameters
    ----------
    object_file, bytes, sha256
        Path of the file from the root of the data set, with slashes, its size, and 64 hex digits.
    figures
        The object's row of per_object.csv, text by column; empty where the report has none.
    """

    id: str
    name: str
    material: str
    source: str
    licence: Licence
    attribution: str
    object_file: str
    bytes: int
    sha256: str
    figures: Mapping[str, str]

    @property
    def split(self) -> str:
        """Whether it is for training, validation or testing across objects."""
        return object_split(self.id, self.material)


@dataclass(frozen=True)
class DataSet:
    """What cards are made of.

    Parameters
    ----------
    missing
        Listed objects without an Object File, and why, as far as that is known here.
    metrics, definitions
        Content of metrics.json, and what its measures mean by name; empty without a report.
    parameters
        Those of the size that was made, by sense.
    """

    publication: Publication
    objects: tuple[PublishedObject, ...]
    missing: tuple[FailedObject, ...]
    metrics: Mapping[str, Any]
    definitions: Mapping[str, str]
    size: str
    seed: int
    parameters: Mapping[str, Any]

    @property
    def version(self) -> str:
        """The publisher's version, and a digest of ids and Object Files: other files, another version."""
        content = canonical_json([[entry.id, entry.sha256] for entry in self.objects])
        return f"{self.publication.version}+{hashlib.sha256(content.encode()).hexdigest()[:12]}"

    @property
    def unstated(self) -> int:
        """How many objects have no stated licence."""
        return sum(not entry.licence.stated for entry in self.objects)

    @property
    def description(self) -> str:
        """The paragraph that says what is in the data set."""
        parts = [
            self.publication.description,
            f"{counted(len(self.objects), 'object')}, each one file that answers what the object looks, "
            "sounds and feels like, with the fidelity of each file on held-out queries.",
            SUMMARY,
            f"No licence is stated for {counted(self.unstated, 'object')}." if self.unstated else "",
            f"{counted(len(self.missing), 'listed object')} could not be made." if self.missing else "",
        ]
        return " ".join(part for part in parts if part)

    @property
    def citation(self) -> str:
        """How to cite the data set, of what its publisher states."""
        publication = self.publication
        parts = [
            ", ".join(publication.creators),
            f"{publication.title}, version {self.version}",
            str(publication.date or ""),
            f"https://doi.org/{publication.doi}" if publication.doi else publication.url,
        ]
        return ". ".join(part for part in parts if part) + "."

    def sources(self) -> list[list[PublishedObject]]:
        """Return the objects in groups of one source, licence and attribution, the largest group first."""
        groups: dict[tuple[str, str, str], list[PublishedObject]] = {}
        for entry in self.objects:
            groups.setdefault((entry.source, entry.licence.label, entry.attribution), []).append(entry)
        return [groups[key] for key in sorted(groups, key=lambda key: (-len(groups[key]), key))]


def read_data_set(root: Path, folder: Path, states: Verified | None = None) -> DataSet:
    """Read the data set at `root` whose reports lie in `folder`; of a long table, all its partitions.

    Raises
    ------
    InputError
        No records, or a damaged file; in ``data/card.yaml`` an unknown key, or a value of a wrong kind.
    """
    figures = _figures(folder / PER_OBJECT)
    parameters = read_parameters(root / PARAMETERS)
    objects: list[PublishedObject] = []
    missing: list[FailedObject] = []
    definitions: dict[str, str] = {}
    for own in data_sets(root):
        records, own_states = read_records(own), states if states and own == root else Verified(own)
        object_ids = [name for name in sorted(records.rows) if OBJECT_FILES.path(own, name).is_file()]
        failures_by_id = {
            failure.object_id: FailedObject.of("objects", failure) for failure in records.refused
        }
        # The first stage counts.
        failures_by_id |= {failure.object: failure for failure in reversed(read_failures(own))}
        unmade = records.listed.difference(object_ids)
        missing += [failures_by_id.get(name, FailedObject(name, "", "not made", "")) for name in unmade]
        objects += [
            _object(root, OBJECT_FILES.path(own, name), records.rows[name], figures.get(name, {}), own_states)
            for name in object_ids
        ]
        definitions = definitions or _definitions(own, object_ids)
    return DataSet(
        validated(PUBLICATION, Publication, _read(root / PUBLICATION)),
        tuple(sorted(objects, key=lambda entry: entry.id)),
        tuple(sorted(missing, key=lambda failure: failure.object)),
        _read(folder / METRICS),
        definitions,
        parameters.size,
        parameters.seed,
        read_yaml(root / PARAMETERS)["sizes"][parameters.size],
    )


def _object(
    root: Path, path: Path, row: Mapping[str, Any], figures: Mapping[str, str], states: Verified
) -> PublishedObject:
    object_id = path.name.removesuffix(OBJECT_FILES.suffix)
    return PublishedObject(
        object_id,
        _line(row["name"]) or object_id,
        _line(row["material"]["name"]),
        _line(row["source"]),
        Licence.of(str(row["licence"] or "")),
        _line(row["attribution"]),
        path.relative_to(root).as_posix(),
        path.stat().st_size,
        states.source_digest(path),
        figures,
    )


def _line(text: object) -> str:
    """Return one line of text: what others state may have breaks in it."""
    return " ".join(str(text or "").split())


def _figures(path: Path) -> dict[str, dict[str, str]]:
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        try:
            return {row["id"]: row for row in csv.DictReader(file)}
        except KeyError:
            raise InputError(str(path), "it has no column id", "Run the stage `report`.") from None


def _read(path: Path) -> Any:
    return (read_yaml(path) or {}) if path.is_file() else {}


def _definitions(root: Path, object_ids: Sequence[str]) -> dict[str, str]:
    """Return those of the first object that has them: one version of the code measured all."""
    for object_id in object_ids:
        with contextlib.suppress(FileNotFoundError, FormatError):  # the report says which are damaged
            return dict(read_attributes(FIDELITY.path(root, object_id)).get("definitions", {}))
    return {}
