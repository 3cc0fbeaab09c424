"""The data set as Croissant 1.1, JSON-LD for search engines and loaders of data sets.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html, written and checked by ``mlcroissant``.
"""

import datetime
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from objectfolder.splits import OBJECT_SPLITS
from pipeline.publish.cards.published_data_set import DataSet, PublishedFile
from pipeline.publish.cards.statements import LIMITS, SUMMARY, citation, description

# What the library's context of 1.0 lacks of the specification's of 1.1; loaders compare the keys.
CONTEXT = {
    "arrayShape": "cr:arrayShape",
    "containedIn": "cr:containedIn",
    "description": {"@container": "@language"},
    "isArray": "cr:isArray",
    "name": {"@container": "@language"},
}
TEXT_COLUMNS = ("id", "name", "material")
FIGURES, FILES = "per_object.csv", "object-files"
BINARY = "application/octet-stream"
ORIGINS = ("id", "name", "material", "split", "source", "licence", "attribution", "object_file")


def croissant_text(data_set: DataSet, root: Path, folder: Path) -> str:
    """Return the JSON-LD of a data set at `root` for a file in `folder`: equal data sets give equal bytes."""
    up = Path(os.path.relpath(root, folder)).as_posix()
    return (
        json.dumps(_Croissant(data_set, up).to_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    )


class _Croissant:
    """The parts of the JSON-LD.

    Parameters
    ----------
    data_set
        What they are of.
    up
        Path from the folder of the JSON-LD to the root of the data set, as ``..``.
    """

    def __init__(self, data_set: DataSet, up: str) -> None:
        import mlcroissant  # takes a second

        self._data_set = data_set
        self._base = data_set.publication.files_url.rstrip("/") or up
        self._library = mlcroissant
        self._context = mlcroissant.Context(conforms_to="http://mlcommons.org/croissant/1.1")
        self._context.rdf.context.update(CONTEXT)

    def to_json(self) -> dict[str, Any]:
        """Return the whole.

        Raises
        ------
        ValidationError
            The library finds it wrong.
        """
        data_set, publication = self._data_set, self._data_set.publication
        licences = sorted({entry.licence for entry in data_set.objects}, key=lambda licence: licence.label)
        organization = self._library.Organization
        metadata = self._library.Metadata(
            ctx=self._context,
            name=publication.title,
            description=description(data_set),
            version=data_set.version,
            cite_as=citation(data_set),
            keywords=[
                "multisensory objects",
                "vision",
                "impact sound",
                "touch",
                "simulation",
                "ObjectFolder",
            ],
            data_collection=SUMMARY,
            data_limitations=list(LIMITS),
            license=[licence.url or licence.stated for licence in licences if licence.stated],
            url=publication.url or None,
            date_published=datetime.datetime.fromisoformat(publication.date) if publication.date else None,
            creators=[organization(ctx=self._context, name=name) for name in publication.creators],
            same_as=[f"https://doi.org/{publication.doi}"] if publication.doi else None,
            distribution=self._distribution(),
            record_sets=self._record_sets(),
        )
        return dict(metadata.to_json())

    def _distribution(self) -> list[Any]:
        data_set = self._data_set
        files = [
            self._file(
                f"file/{entry.object_id}", entry.file, f"{self._base}/{entry.file.path}", BINARY,
                f"Object File of {entry.object_id} (safetensors)",
            )
            for entry in data_set.objects
        ]  # fmt: skip
        if files:
            together = self._library.FileSet(
                ctx=self._context, id=FILES, name=FILES,
                description="The Object Files, one an object; objectfolder.load opens one.",
                contained_in=[file.id for file in files], encoding_formats=[BINARY],
                includes=["*.safetensors"],
            )  # fmt: skip
            files.append(together)
        if data_set.figures_file:
            about = "Fidelity on held-out queries, bytes and CPU seconds of each object."
            files.append(self._file(FIGURES, data_set.figures_file, FIGURES, "text/csv", about))
        return files

    def _file(self, identifier: str, file: PublishedFile, url: str, media: str, about: str) -> Any:
        return self._library.FileObject(
            ctx=self._context, id=identifier, name=file.path.rpartition("/")[2], description=about,
            content_url=url, content_size=f"{file.bytes} B", encoding_formats=[media], sha256=file.sha256,
        )  # fmt: skip

    def _record_sets(self) -> list[Any]:
        data_set = self._data_set
        if not data_set.objects:
            return []
        splits = "Which objects are for training, validation and testing; see objectfolder.splits."
        origins = "What each object is and under which terms: empty where its table states nothing."
        about = "The Object Files as bytes, with their names."
        files = {"filename": "Id and .safetensors.", "content": "Bytes of the file."}
        rows = [
            (
                entry.object_id, entry.name, entry.material, entry.split, entry.source, entry.licence.stated,
                entry.attribution, entry.file.path,
            )
            for entry in data_set.objects
        ]  # fmt: skip
        sets = [
            self._records("splits", splits, {"name": "name"}, [[name] for name in OBJECT_SPLITS]),
            self._records("origins", origins, {name: name for name in ORIGINS}, rows),
            self._records("object_files", about, files, source=self._of_files),
        ]
        return [*sets, self._figures()] if data_set.figures_file else sets

    def _figures(self) -> Any:
        """Return the records of per_object.csv: read from it, or inline where a reader garbles its ids."""
        about = "Every number known of an object; a fidelity is null where a sense is silent."
        columns, definitions = self._data_set.columns, self._data_set.definitions
        # The next mean whole groups of columns, and are told in the card.
        texts = {column: definitions.get(column, column) for column in columns}
        rows = [entry.figures for entry in self._data_set.objects if entry.figures]
        if rows and not _survives_pandas(columns, rows):
            values = [[_value(column, row[column]) for column in columns] for row in rows]
            return self._records("objects", about, texts, values)
        return self._records("objects", about, texts, source=self._of_figures)

    def _records(
        self,
        name: str,
        about: str,
        fields: Mapping[str, str],
        rows: Sequence[Sequence[Any]] = (),
        source: Any = None,
    ) -> Any:
        """Return a record set whose fields are described; its rows are inline, or come from a source."""
        types = self._library.DataType
        made = [
            self._library.Field(
                ctx=self._context, id=f"{name}/{field}", name=field, description=text,
                data_types=[types.FLOAT if name == "objects" and field not in TEXT_COLUMNS else types.TEXT],
                **({"source": source(field)} if source else {}),
            )
            for field, text in fields.items()
        ]  # fmt: skip
        identifiers = [field.id for field in made]
        return self._library.RecordSet(
            ctx=self._context, id=name, name=name, description=about, fields=made,
            data=[dict(zip(identifiers, row, strict=True)) for row in rows] or None,
            key=None if name == "object_files" else identifiers[:1],
            data_types=[types.SPLIT] if name == "splits" else [],
        )  # fmt: skip

    def _of_files(self, field: str) -> Any:
        extract = self._library.Extract(ctx=self._context, file_property=field)
        return self._library.Source(ctx=self._context, file_set=FILES, extract=extract)

    def _of_figures(self, field: str) -> Any:
        extract = self._library.Extract(ctx=self._context, column=field)
        return self._library.Source(ctx=self._context, file_object=FIGURES, extract=extract)


def _survives_pandas(columns: Sequence[str], rows: Sequence[Mapping[str, str]]) -> bool:
    """Return whether text stays text: a loader takes ids that are all digits for numbers, and NA for none."""
    import pandas

    wanted = [[row[column] for column in TEXT_COLUMNS] for row in rows]
    written = pandas.DataFrame(wanted).to_csv(index=False)
    read = pandas.read_csv(io.StringIO(written))
    return bool(read.to_numpy().tolist() == wanted) and set(TEXT_COLUMNS) <= set(columns)


def _value(column: str, text: str) -> str | float | None:
    if column in TEXT_COLUMNS:
        return text
    return float(text) if text else None
