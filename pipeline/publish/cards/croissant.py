"""The data set as Croissant 1.1, JSON-LD for search engines and loaders of data sets.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html. Written without any library; the tests
validate and load it with ``mlcroissant``.
"""

import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from objectfolder.splits import OBJECT_SPLITS
from pipeline.publish.cards.data_set import DataSet, PublishedFile
from pipeline.publish.cards.statements import LIMITS, SUMMARY, citation, description

CONFORMS_TO = "http://mlcommons.org/croissant/1.1"
# As the specification prints it; a loader compares keys with these.
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
TEXT, FLOAT = "sc:Text", "sc:Float"
TEXT_COLUMNS = ("id", "name", "material")
FIGURES, FILES = "per_object.csv", "object-files"


def croissant_text(data_set: DataSet, root: Path, folder: Path) -> str:
    """Return the JSON-LD of a data set at `root` for a file in `folder`: equal data sets give equal bytes."""
    up = Path(os.path.relpath(root, folder)).as_posix()
    return json.dumps(croissant(data_set, up), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def croissant(data_set: DataSet, up: str) -> dict[str, Any]:
    """Return the JSON-LD of a data set.

    Parameters
    ----------
    up
        Path from the folder of the JSON-LD to the root of the data set, as ``..``.
    """
    publication = data_set.publication
    licences = sorted({entry.licence for entry in data_set.objects}, key=lambda licence: licence.label)
    stated = [licence.url or licence.stated for licence in licences if licence.stated]
    optional = {
        "license": stated[0] if len(stated) == 1 else stated,
        "url": publication.url,
        "datePublished": publication.date,
        "creator": [{"@type": "Organization", "name": name} for name in publication.creators],
        "sameAs": f"https://doi.org/{publication.doi}" if publication.doi else "",
        "distribution": _distribution(data_set, up),
        "recordSet": _record_sets(data_set),
    }
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "name": publication.title,
        "description": description(data_set),
        "conformsTo": CONFORMS_TO,
        "version": data_set.version,
        "citeAs": citation(data_set),
        "keywords": ["multisensory objects", "vision", "impact sound", "touch", "simulation", "ObjectFolder"],
        "rai:dataCollection": SUMMARY,
        "rai:dataLimitations": list(LIMITS),
        **{key: value for key, value in optional.items() if value},
    }


def _distribution(data_set: DataSet, up: str) -> list[dict[str, Any]]:
    base = data_set.publication.files_url.rstrip("/") or up
    files = [
        _file_object(
            f"file/{entry.object_id}", entry.file, f"{base}/{entry.file.path}", "application/octet-stream",
            f"Object File of {entry.object_id} (safetensors)",
        )
        for entry in data_set.objects
    ]  # fmt: skip
    if files:
        files.append(
            {
                "@type": "cr:FileSet",
                "@id": FILES,
                "name": FILES,
                "description": "The Object Files, one an object; objectfolder.load opens one.",
                "containedIn": [{"@id": file["@id"]} for file in files],
                "encodingFormat": "application/octet-stream",
                "includes": "*.safetensors",
            }
        )
    if data_set.figures_file:
        about = "Fidelity on held-out queries, bytes and CPU seconds of each object."
        files.append(_file_object(FIGURES, data_set.figures_file, FIGURES, "text/csv", about))
    return files


def _file_object(identifier: str, file: PublishedFile, url: str, media: str, about: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": identifier,
        "name": file.path.rpartition("/")[2],
        "description": about,
        "contentUrl": url,
        "contentSize": f"{file.bytes} B",
        "encodingFormat": media,
        "sha256": file.sha256,
    }


def _record_sets(data_set: DataSet) -> list[dict[str, Any]]:
    if not data_set.objects:
        return []
    sets = [
        _inline(
            "splits",
            "Which objects are for training, validation and testing; see objectfolder.splits.",
            ("name",),
            [{"name": name} for name in OBJECT_SPLITS],
        )
        | {"dataType": "cr:Split", "key": {"@id": "splits/name"}},
        _inline(
            "origins",
            "What each object is and under which terms: empty where its table states nothing.",
            ("id", "name", "material", "split", "source", "licence", "attribution", "object_file"),
            [
                {
                    "id": entry.object_id,
                    "name": entry.name,
                    "material": entry.material,
                    "split": entry.split,
                    "source": entry.source,
                    "licence": entry.licence.stated,
                    "attribution": entry.attribution,
                    "object_file": entry.file.path,
                }
                for entry in data_set.objects
            ],
        )
        | {"key": {"@id": "origins/id"}},
        {
            "@type": "cr:RecordSet",
            "@id": "object_files",
            "name": "object_files",
            "description": "The Object Files as bytes, with their names.",
            "field": [
                _field("object_files", name, TEXT, about, _of_file_set(name))
                for name, about in (("filename", "Id and .safetensors."), ("content", "Bytes of the file."))
            ],
        },
    ]  # fmt: skip
    if data_set.figures_file:
        sets.append(_figures(data_set))
    return sets


def _of_file_set(file_property: str) -> dict[str, Any]:
    return {"fileSet": {"@id": FILES}, "extract": {"fileProperty": file_property}}


def _figures(data_set: DataSet) -> dict[str, Any]:
    """Return the records of per_object.csv: read from it, or inline where a reader would garble its ids."""
    about = "Every number known of an object; a fidelity is null where a sense is silent."
    definitions = data_set.definitions
    # The next mean whole groups of columns, and are told in the card.
    texts = {column: definitions.get(column, column) for column in data_set.columns}
    rows = [entry.figures for entry in data_set.objects if entry.figures]
    if rows and not _survives_pandas(data_set.columns, rows):
        records = [{column: _value(column, row[column]) for column in data_set.columns} for row in rows]
        made = _inline("objects", about, data_set.columns, records)
        for field, column in zip(made["field"], data_set.columns, strict=True):
            field |= {"dataType": TEXT if column in TEXT_COLUMNS else FLOAT, "description": texts[column]}
        return made | {"key": {"@id": "objects/id"}}
    return {
        "@type": "cr:RecordSet",
        "@id": "objects",
        "name": "objects",
        "description": about,
        "key": {"@id": "objects/id"},
        "field": [
            _field(
                "objects",
                column,
                TEXT if column in TEXT_COLUMNS else FLOAT,
                texts[column],
                {"fileObject": {"@id": FIGURES}, "extract": {"column": column}},
            )
            for column in data_set.columns
        ],
    }


def _survives_pandas(columns: Sequence[str], rows: Sequence[Mapping[str, str]]) -> bool:
    """Return whether text stays text: a loader takes ids that are all digits for numbers, and NA for none."""
    import pandas

    written = pandas.DataFrame([[row[column] for column in TEXT_COLUMNS] for row in rows]).to_csv(index=False)
    read = pandas.read_csv(io.StringIO(written))
    wanted = [[row[column] for column in TEXT_COLUMNS] for row in rows]
    return bool(read.to_numpy().tolist() == wanted) and set(TEXT_COLUMNS) <= set(columns)


def _value(column: str, text: str) -> str | float | None:
    if column in TEXT_COLUMNS:
        return text
    return float(text) if text else None


def _inline(
    name: str, about: str, columns: Sequence[str], records: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": about,
        "field": [_field(name, column, TEXT, column) for column in columns],
        "data": [{f"{name}/{column}": record[column] for column in columns} for record in records],
    }


def _field(
    record_set: str, name: str, kind: str, about: str, source: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    field = {
        "@type": "cr:Field",
        "@id": f"{record_set}/{name}",
        "name": name,
        "description": about,
        "dataType": kind,
    }
    return field | ({"source": dict(source)} if source else {})
