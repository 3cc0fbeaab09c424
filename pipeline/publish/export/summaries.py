"""What an export wrote, in figures; ``str`` words it in a line."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.dataset.counts import counted


@dataclass(frozen=True, kw_only=True)
class ExportSummary:
    """An object that was exported.

    Parameters
    ----------
    folder
        Where it is.
    licence
        Of the object.
    figures
        As they stand in the manifest of the export.
    words
        What was written, for people.
    """

    folder: str
    licence: str
    figures: Mapping[str, Any]
    words: str

    def as_json(self) -> dict[str, Any]:
        """Return the figures of a manifest with the folder and the licence, for JSON."""
        return {"folder": self.folder, "licence": self.licence, **self.figures}

    def __str__(self) -> str:
        return f"{self.folder}: {self.words}; {self.licence}"


@dataclass(frozen=True, kw_only=True)
class SceneSummary:
    """A scene that was composed: its file, its objects in order, and the side of the table in metres."""

    file: str
    objects: tuple[str, ...]
    table_m: float

    def __str__(self) -> str:
        things = counted(len(self.objects), "object")
        return f"{self.file}: {things} at rest on a table of {self.table_m:g} m"
