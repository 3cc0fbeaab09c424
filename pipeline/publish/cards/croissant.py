"""The data set as Croissant 1.1, JSON-LD for search engines and loaders of data sets.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html; the tests read it by ``mlcroissant``.
"""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from objectfolder.products.provenance import json_lines
from pipeline.publish.cards.published_data_set import LIMITS, SUMMARY, DataSet, PublishedObject

CONTEXT = Path(__file__).parent / "template" / "croissant_context.json"  # the specification's
KEYWORDS = ("multisensory objects", "vision", "impact sound", "touch", "simulation", "ObjectFolder")
TEXTS = ("id", "name", "material", "split", "source", "licence", "attribution", "object_file")
FILES, BINARY = "object-files", "application/octet-stream"
TEXT, NUMBER = "sc:Text", "sc:Float"
Node = dict[str, Any]


def croissant_text(data_set: DataSet, root: Path, folder: Path) -> str:
    """Return the JSON-LD of a data set at `root` for a file in `folder`: equal data sets give equal bytes."""
    publication, objects = data_set.publication, data_set.objects
    base = publication.files_url.rstrip("/") or Path(os.path.relpath(root, folder)).as_posix()
    stated_licences = {entry.licence for entry in objects if entry.licence.stated}
    licences = sorted(stated_licences, key=lambda licence: licence.label)
    metadata = {
        "@context": json.loads(CONTEXT.read_text()),
        "@type": "sc:Dataset",
        "name": publication.title,
        "description": data_set.description,
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "citeAs": data_set.citation,
        "creator": _some([{"@type": "sc:Organization", "name": name} for name in publication.creators]),
        "datePublished": str(publication.date or ""),
        "keywords": list(KEYWORDS),
        "license": _some([licence.url or licence.stated for licence in licences]),
        "rai:dataCollection": SUMMARY,
        "rai:dataLimitations": list(LIMITS),
        "sameAs": f"https://doi.org/{publication.doi}" if publication.doi else "",
        "url": publication.url,
        "version": data_set.version,
        "distribution": _distribution(objects, base) if objects else [],
        "recordSet": [_objects(data_set), _object_files()] if objects else [],
    }
    entries = {key: value for key, value in metadata.items() if value}
    return json_lines(entries, 4) + "\n"


def _some(values: Sequence[Any]) -> Any:
    """Return one value as itself, several as a list."""
    return values[0] if len(values) == 1 else list(values)


def _node(kind: str, identity: str, name: str, description: str, **more: Any) -> Node:
    return {"@type": f"cr:{kind}", "@id": identity, "name": name, "description": description, **more}


def _distribution(objects: Sequence[PublishedObject], base: str) -> list[Node]:
    files = [
        _node(
            "FileObject",
            f"file/{entry.id}",
            Path(entry.object_file).name,
            f"Object File of {entry.id} (safetensors)",
            contentSize=f"{entry.bytes} B",
            contentUrl=f"{base}/{entry.object_file}",
            encodingFormat=BINARY,
            sha256=entry.sha256,
        )
        for entry in objects
    ]
    together = _node(
        "FileSet",
        FILES,
        FILES,
        "The Object Files, one an object; objectfolder.load opens one.",
        containedIn=_some([{"@id": file["@id"]} for file in files]),
        encodingFormat=BINARY,
        includes="*.safetensors",
    )
    return [*files, together]


def _objects(data_set: DataSet) -> Node:
    """Return every number known of each object, inline: in a table, 007 is a number and NA is none."""
    rows = [_row(entry) for entry in data_set.objects]
    columns = dict.fromkeys(column for row in rows for column in row)
    return _node(
        "RecordSet",
        "objects",
        "objects",
        "What each object is, under which terms, and every number known of it. A text is empty where the "
        "table of objects states nothing; a fidelity is null where a sense is silent.",
        key={"@id": "objects/id"},
        field=[
            _node(
                "Field",
                f"objects/{column}",
                column,
                data_set.definitions.get(column, column),
                dataType=TEXT if column in TEXTS else NUMBER,
            )
            for column in columns
        ],
        data=[{f"objects/{column}": row.get(column) for column in columns} for row in rows],
    )


def _object_files() -> Node:
    fields = [
        _node(
            "Field",
            f"object_files/{name}",
            name,
            about,
            dataType=TEXT,
            source={"fileSet": {"@id": FILES}, "extract": {"fileProperty": name}},
        )
        for name, about in (("filename", "Id and .safetensors."), ("content", "Bytes of the file."))
    ]
    description = "The Object Files as bytes, with their names."
    return _node("RecordSet", "object_files", "object_files", description, field=fields)


def _row(entry: PublishedObject) -> dict[str, str | float | None]:
    texts = {name: getattr(entry, name) for name in TEXTS} | {"licence": entry.licence.stated}
    figures = {column: text for column, text in entry.figures.items() if column not in texts}
    return texts | {column: float(text) if text else None for column, text in figures.items()}
