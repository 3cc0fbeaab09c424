"""Records of fetched files: a table of hashes under version control, and `source.json` of each object.

Archives are not in it, for mirrors and sources pack the same files again: what is in them is.
"""

import csv
import io
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from objectfolder.errors import InputError
from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import file_digest
from objectfolder.products.regular_file import read_regular
from pipeline.intake.disk import locked, writing
from pipeline.intake.sources.source import SourceObject

COLUMNS = ("source_id", "file", "bytes", "sha256")
_SHA256 = re.compile(r"[0-9a-f]{64}")


class ChangedError(InputError):
    """Content of a file that differs from its recorded hash."""


@dataclass(frozen=True)
class Content:
    """What a file's content is."""

    bytes: int
    sha256: str


Hashes = dict[tuple[str, str], Content]


def read_hashes(path: Path) -> Hashes:
    """Read the table; an absent one is empty.

    Returns
    -------
    dict
        By source id (``ycb:025_mug``) and file (its path in the object's folder).

    Raises
    ------
    InputError
        It is no such table, with its line.
    """
    if not path.is_file():
        return {}
    hashes: Hashes = {}
    where = str(path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.reader(file, strict=True)
            if tuple(next(reader, ())) != COLUMNS:
                raise ValueError(f"its columns are not {', '.join(COLUMNS)}")
            for cells in reader:
                where = f"{path} line {reader.line_num}"
                source_id, name, size, sha256 = cells
                if not size.isdecimal() or not _SHA256.fullmatch(sha256):
                    raise ValueError(f"{size!r} and {sha256!r} are not a size and a SHA-256 hash")
                content = Content(int(size), sha256)
                if hashes.setdefault((source_id, name), content) != content:
                    raise ValueError(f"contradicts a line above about {name}")
    except (csv.Error, ValueError) as problem:
        raise InputError(where, f"not a CSV table of hashes in UTF-8 ({problem})", "Restore it.") from problem
    return hashes


def content_of(path: Path) -> Content:
    """Read a file for its size and hash."""
    return Content(path.stat().st_size, file_digest(path))


def record_hashes(
    path: Path, source_id: str, files: Mapping[str, Content], *, accept_changed: bool = False
) -> int:
    """Add hashes of new files, by their paths in an object's folder, to the table; return how many are new.

    `accept_changed` replaces what is known of other content instead of refusing it.

    Raises
    ------
    ChangedError
        A file is another than is known of it; both hashes are named.
    InputError
        The table is damaged or cannot be written.
    """
    with locked(path.with_name(f".{path.name}.lock")), writing(path):
        hashes = read_hashes(path)
        new = {
            key: content for name, content in files.items() if hashes.get(key := (source_id, name)) != content
        }
        for key, content in sorted(new.items()):
            if key in hashes and not accept_changed:
                before = hashes[key]
                raise ChangedError(
                    " ".join(key),
                    f"has changed: sha256 {content.sha256} ({content.bytes} bytes), "
                    f"recorded is {before.sha256} ({before.bytes} bytes)",
                    "Nothing of it is used. Compare with a mirror (--mirror); if the new content is right, "
                    f"`objectfolder fetch {source_id} --accept-changed` records it.",
                )
        if new:
            text = io.StringIO()
            writer = csv.writer(text, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows(
                (*key, content.bytes, content.sha256) for key, content in sorted((hashes | new).items())
            )
            write_whole(path, text.getvalue())
    return len(new)


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
        Paths in the object's folder; `recorded_hashes` has their contents.
    """

    mesh: str
    texture: str | None
    addresses: tuple[str, ...]
    files: tuple[str, ...]


def write_forms(folder: Path, source_object: SourceObject, forms: Mapping[str, Form]) -> None:
    """Write `source.json` of an object's folder; its mesh and texture are those that were asked for."""
    source, form = source_object.source, forms[source_object.resolution]
    record = {
        "source_id": source_object.id,
        "source": source.title,
        "address": source.object_page(source_object.name),
        "licence": source.licence,
        "attribution": source.attribution,
        "mesh": form.mesh,
        "texture": form.texture,
        "resolution": source_object.resolution,
        "resolutions": {key: asdict(value) for key, value in sorted(forms.items())},
    }
    write_whole(folder / RECORD, json.dumps(record, indent=1, ensure_ascii=False) + "\n")


def read_forms(folder: Path) -> dict[str, Form]:
    """Return the forms by resolution of `source.json`; none where it is absent or no such record."""
    try:
        record = json.loads(read_regular(folder / RECORD))
        return TypeAdapter(dict[str, Form]).validate_python(record["resolutions"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}
