"""The objects a report is about, read from their fidelity products."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError
from objectfolder.store import read_attributes
from pipeline.dataset.measures import smallest_margin_db

PRODUCT_SUFFIX = ".zarr.zip"


@dataclass(frozen=True)
class Failure:
    """Why an object has no, or an older, product of a stage."""

    object_id: str
    stage: str
    error: str
    remedy: str = ""


@dataclass(frozen=True)
class Record:
    """One object: its fidelity product and the attributes of it."""

    path: Path
    attributes: Mapping[str, Any]

    @property
    def object_id(self) -> str:
        """Name of the object in every table."""
        return str(self.description.get("id") or self.path.name.removesuffix(PRODUCT_SUFFIX))

    @property
    def name(self) -> str:
        """Name for people."""
        return str(self.description.get("name") or self.object_id)

    @property
    def description(self) -> Mapping[str, Any]:
        """Id, name, material, licence, attribution, source and length."""
        return self.sense("object")

    @property
    def fingerprints(self) -> dict[str, str]:
        """Stage to fingerprint of the products that were measured, as far as the provenance names them."""
        named = self.sense("provenance").get("fingerprints")
        return (
            {str(stage): str(value) for stage, value in named.items()} if isinstance(named, Mapping) else {}
        )

    @property
    def margin_db(self) -> float | None:
        """Smallest margin to a target, dB."""
        return smallest_margin_db(self.attributes)

    @property
    def silent(self) -> bool:
        """Whether the solver found no audible mode."""
        return self.sense("audio").get("audible") is False

    @property
    def speed_error(self) -> list[Mapping[str, Any]]:
        """Error and bytes at several settings of each sense."""
        entries = self.attributes.get("speed_error")
        return [e for e in entries if isinstance(e, Mapping)] if isinstance(entries, list) else []

    def sense(self, name: str) -> Mapping[str, Any]:
        """Return a part of the attributes, empty where the product has none."""
        part = self.attributes.get(name)
        return part if isinstance(part, Mapping) else {}


def read_records(folder: Path) -> tuple[list[Record], list[Failure]]:
    """Read the attributes of every fidelity product of `folder`, by object id.

    Returns
    -------
    tuple
        The records, and a failure for each product that cannot be read.
    """
    records, failures = [], []
    for path in sorted(folder.glob(f"*{PRODUCT_SUFFIX}")) if folder.is_dir() else []:
        try:
            records.append(Record(path, read_attributes(path)))
        except FormatError as error:
            object_id = path.name.removesuffix(PRODUCT_SUFFIX)
            failures.append(Failure(object_id, "report", f"{path.name}: {error.finding}", error.remedy))
    return sorted(records, key=lambda record: record.object_id), failures


def read_failures(rows: Sequence[Mapping[str, Any]]) -> list[Failure]:
    """Return failures from mappings with object, stage, error and remedy, sorted."""
    failures = [
        Failure(
            str(row.get("object") or ""),
            str(row.get("stage") or ""),
            str(row.get("error") or ""),
            str(row.get("remedy") or ""),
        )
        for row in rows
    ]
    return sorted(failures, key=lambda failure: (failure.object_id, failure.stage, failure.error))


def worst_first(records: Sequence[Record]) -> list[Record]:
    """Order by the smallest margin to a target, worst first; objects without a measure come last."""

    def position(record: Record) -> tuple[bool, float, str]:
        margin = record.margin_db
        return margin is None, 0.0 if margin is None else margin, record.object_id

    return sorted(records, key=position)
