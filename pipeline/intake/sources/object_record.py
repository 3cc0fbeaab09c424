"""`source.json` of a fetched object's folder: which file is what, where from, and what its content was."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from objectfolder.products.atomic import atomic_write
from objectfolder.products.provenance import file_digest
from pipeline.intake.sources.recorded_hashes import Content
from pipeline.intake.sources.source import SourceObject

RECORD = "source.json"


@dataclass(frozen=True)
class Form:
    """An object as it was fetched at one resolution.

    Parameters
    ----------
    mesh, texture
        Paths in the object's folder; a texture of None is named by the mesh.
    addresses
        Of all that was fetched for it.
    files
        Paths in the object's folder.
    """

    mesh: str
    texture: str | None
    addresses: tuple[str, ...]
    files: tuple[str, ...]


@dataclass(frozen=True)
class Record:
    """What `source.json` says.

    Parameters
    ----------
    resolution
        That was fetched last; its form is what `mesh` and `texture` of the file name.
    resolutions
        Forms by resolution.
    files
        What each file's content was when it was fetched.
    """

    resolution: str
    resolutions: Mapping[str, Form]
    files: Mapping[str, Content]

    def files_of(self, resolution: str) -> dict[str, Content]:
        """Return the contents of one form's files."""
        return {name: self.files[name] for name in self.resolutions[resolution].files}


def write_record(folder: Path, asked: SourceObject, record: Record) -> None:
    """Write `source.json` of an object's folder."""
    source, form = asked.source, record.resolutions[record.resolution]
    said = {
        "source_id": asked.id,
        "source": source.title,
        "address": source.object_page(asked.name),
        "licence": source.licence,
        "attribution": source.attribution,
        "mesh": form.mesh,
        "texture": form.texture,
        "resolution": record.resolution,
        "resolutions": {key: asdict(value) for key, value in sorted(record.resolutions.items())},
        "files": {key: asdict(value) for key, value in sorted(record.files.items())},
    }
    with atomic_write(folder / RECORD) as file:
        file.write((json.dumps(said, indent=1, ensure_ascii=False) + "\n").encode())


def read_record(folder: Path) -> Record | None:
    """Read `source.json` of an object's folder; None where it is absent or no such record."""
    path = folder / RECORD
    try:
        record = TypeAdapter(Record).validate_json(path.read_bytes())
        for resolution in {record.resolution, *record.resolutions}:
            record.files_of(resolution)
    except (OSError, ValueError, KeyError):
        return None
    return record


def content_of(path: Path) -> Content:
    """Read a file for its size and hash."""
    return Content(path.stat().st_size, file_digest(path))


def is_whole(folder: Path, record: Record, resolution: str) -> bool:
    """Whether all files of a form are there as they were fetched."""
    if resolution not in record.resolutions:
        return False
    return all(
        (folder / name).is_file() and content_of(folder / name) == content
        for name, content in record.files_of(resolution).items()
    )
