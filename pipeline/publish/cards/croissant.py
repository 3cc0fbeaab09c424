"""The data set as Croissant 1.1, JSON-LD for search engines and loaders of data sets.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html, written and checked by ``mlcroissant``.
"""

import datetime
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mlcroissant

from pipeline.publish.cards.published_data_set import LIMITS, SUMMARY, DataSet, PublishedObject

# What the library's context of 1.0 lacks of the specification's of 1.1; loaders compare the keys.
CONTEXT = {
    "arrayShape": "cr:arrayShape",
    "containedIn": "cr:containedIn",
    "description": {"@container": "@language"},
    "isArray": "cr:isArray",
    "name": {"@container": "@language"},
}
KEYWORDS = ("multisensory objects", "vision", "impact sound", "touch", "simulation", "ObjectFolder")
TEXTS = ("id", "name", "material", "split", "source", "licence", "attribution", "object_file")
FILES, BINARY = "object-files", "application/octet-stream"


def croissant_text(data_set: DataSet, root: Path, folder: Path) -> str:
    """Return the JSON-LD of a data set at `root` for a file in `folder`: equal data sets give equal bytes.

    Raises
    ------
    mlcroissant.ValidationError
        The library finds it wrong.
    """
    publication, objects = data_set.publication, data_set.objects
    context = mlcroissant.Context(conforms_to="http://mlcommons.org/croissant/1.1")
    context.rdf.context.update(CONTEXT)
    base = publication.files_url.rstrip("/") or Path(os.path.relpath(root, folder)).as_posix()
    licences = sorted(
        {one.licence for one in objects if one.licence.stated}, key=lambda licence: licence.label
    )
    date = publication.date
    metadata = mlcroissant.Metadata(
        ctx=context,
        name=publication.title,
        description=data_set.description,
        version=data_set.version,
        cite_as=data_set.citation,
        keywords=list(KEYWORDS),
        data_collection=SUMMARY,
        data_limitations=list(LIMITS),
        license=[licence.url or licence.stated for licence in licences],
        url=publication.url or None,
        date_published=datetime.datetime.combine(date, datetime.time()) if date else None,
        creators=[mlcroissant.Organization(ctx=context, name=name) for name in publication.creators],
        same_as=[f"https://doi.org/{publication.doi}"] if publication.doi else None,
        distribution=_distribution(context, objects, base),
        record_sets=_record_sets(context, data_set) if objects else [],
    )
    return json.dumps(metadata.to_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _distribution(context: mlcroissant.Context, objects: Sequence[PublishedObject], base: str) -> list[Any]:
    files: list[Any] = [
        mlcroissant.FileObject(
            ctx=context,
            id=f"file/{one.id}",
            name=Path(one.object_file).name,
            description=f"Object File of {one.id} (safetensors)",
            content_url=f"{base}/{one.object_file}",
            content_size=f"{one.bytes} B",
            encoding_formats=[BINARY],
            sha256=one.sha256,
        )
        for one in objects
    ]
    together = mlcroissant.FileSet(
        ctx=context,
        id=FILES,
        name=FILES,
        description="The Object Files, one an object; objectfolder.load opens one.",
        contained_in=[file.id for file in files],
        encoding_formats=[BINARY],
        includes=["*.safetensors"],
    )
    return [*files, together] if files else []


def _record_sets(context: mlcroissant.Context, data_set: DataSet) -> list[Any]:
    rows = [_row(one) for one in data_set.objects]
    columns = dict.fromkeys(column for row in rows for column in row)
    types = mlcroissant.DataType
    fields = [
        mlcroissant.Field(
            ctx=context,
            id=f"objects/{column}",
            name=column,
            description=data_set.definitions.get(column, column),
            data_types=[types.TEXT if column in TEXTS else types.FLOAT],
        )
        for column in columns
    ]
    # Inline: a loader that reads them from a table takes an id 007 for a number, and NA for none.
    objects = mlcroissant.RecordSet(
        ctx=context,
        id="objects",
        name="objects",
        description="What each object is, under which terms, and every number known of it. A text is empty "
        "where the table of objects states nothing; a fidelity is null where a sense is silent.",
        key=["objects/id"],
        fields=fields,
        data=[{f"objects/{column}": row.get(column) for column in columns} for row in rows],
    )
    files = mlcroissant.RecordSet(
        ctx=context,
        id="object_files",
        name="object_files",
        description="The Object Files as bytes, with their names.",
        fields=[
            mlcroissant.Field(
                ctx=context,
                id=f"object_files/{name}",
                name=name,
                description=about,
                data_types=[types.TEXT],
                source=mlcroissant.Source(
                    ctx=context, file_set=FILES, extract=mlcroissant.Extract(ctx=context, file_property=name)
                ),
            )
            for name, about in (("filename", "Id and .safetensors."), ("content", "Bytes of the file."))
        ],
    )
    return [objects, files]


def _row(one: PublishedObject) -> dict[str, str | float | None]:
    texts = {name: getattr(one, name) for name in TEXTS} | {"licence": one.licence.stated}
    figures = {column: text for column, text in one.figures.items() if column not in texts}
    return texts | {column: float(text) if text else None for column, text in figures.items()}
