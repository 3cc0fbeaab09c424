"""A fetched object's folder: its files as the source has them, and `source.json`, which says what is what."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from objectfolder.atomic import atomic_write
from pipeline.intake.sources.cached_file import Digests
from pipeline.intake.sources.recorded_hashes import Content
from pipeline.intake.sources.source import SourceObject

RECORD = "source.json"
LARGEST_RECORD_BYTES = 16 << 20


@dataclass(frozen=True)
class Form:
    """An object as it was fetched at one resolution.

    Parameters
    ----------
    mesh, texture
        Paths in the object's folder; a texture of None is the mesh's own affair.
    addresses
        Of all that was brought for it.
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
    forms
        By resolution.
    files
        What each file's content was when it came.
    """

    resolution: str
    forms: Mapping[str, Form]
    files: Mapping[str, Content]

    def files_of(self, resolution: str) -> dict[str, Content]:
        """Return what the files of one form were."""
        return {name: self.files[name] for name in self.forms[resolution].files}


def write_record(folder: Path, asked: SourceObject, record: Record) -> None:
    """Write `source.json` of an object's folder."""
    source, form = asked.source, record.forms[record.resolution]
    said = {
        "source_id": asked.id,
        "source": source.title,
        "address": source.object_page(asked.name),
        "licence": source.licence,
        "attribution": source.attribution,
        "mesh": form.mesh,
        "texture": form.texture,
        "resolution": record.resolution,
        "resolutions": {key: asdict(value) for key, value in sorted(record.forms.items())},
        "files": {key: asdict(value) for key, value in sorted(record.files.items())},
    }
    with atomic_write(folder / RECORD) as file:
        file.write((json.dumps(said, indent=1, ensure_ascii=False) + "\n").encode())


def read_record(folder: Path) -> Record | None:
    """Read `source.json` of an object's folder; None where it is absent or no such record."""
    path = folder / RECORD
    try:
        if path.stat().st_size > LARGEST_RECORD_BYTES:
            return None
        said = json.loads(path.read_bytes())
        forms = {
            str(key): Form(
                _inside(form["mesh"]),
                None if form["texture"] is None else _inside(form["texture"]),
                tuple(map(str, form["addresses"])),
                tuple(map(_inside, form["files"])),
            )
            for key, form in said["resolutions"].items()
        }
        files = {_inside(key): _content(value) for key, value in said["files"].items()}
        if said["resolution"] not in forms or any(set(form.files) - set(files) for form in forms.values()):
            return None
        return Record(said["resolution"], forms, files)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None


def content_of(path: Path) -> Content:
    """Read a file for what it is."""
    found = Digests.of(path)
    return Content(found.size, found.sha256)


def is_whole(folder: Path, record: Record, resolution: str) -> bool:
    """Whether all files of a form are there as they came."""
    form = record.forms.get(resolution)
    return form is not None and all(_as_it_came(folder, record, name) for name in form.files)


def _as_it_came(folder: Path, record: Record, name: str) -> bool:
    path = folder / name
    return path.is_file() and not path.is_symlink() and content_of(path) == record.files[name]


def _inside(text: Any) -> str:
    """Return a path that stays in its folder; ValueError for another."""
    parts = PurePosixPath(text).parts
    if not parts or text != "/".join(parts) or ".." in parts:
        raise ValueError(text)
    return str(text)


def _content(said: Mapping[str, Any]) -> Content:
    return Content(int(said["bytes"]), str(said["sha256"]))
