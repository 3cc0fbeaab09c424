"""The row of a table of objects that a fetched object could become."""

import csv
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path

from objectfolder.catalogue import AS_IN_FILE
from pipeline.intake.sources.fetching import Fetched

COLUMNS = (
    "id",
    "name",
    "mesh",
    "texture",
    "material",
    "length_m",
    "source",
    "licence",
    "attribution",
    "source_id",
)


def proposed_rows(objects: Sequence[Fetched], folder: Path, columns: Sequence[str] = COLUMNS) -> str:
    """Return CSV with a header: all that is known of objects; their materials nobody knows.

    Parameters
    ----------
    folder
        Of the table, which paths are relative to.
    columns
        Of the table.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for fetched in objects:
        source, name = fetched.asked.source, fetched.asked.name
        writer.writerow(
            {
                "id": re.sub(r"[^A-Za-z0-9_.-]", "_", name).lstrip(".")[:100],
                "name": re.sub(r"^\d+(-\w)? ", "", name.replace("_", " ")),
                "mesh": _relative(fetched.mesh, folder),
                "texture": "" if fetched.texture is None else _relative(fetched.texture, folder),
                "length_m": AS_IN_FILE,
                "source": source.title,
                "licence": source.licence,
                "attribution": source.attribution,
                "source_id": fetched.asked.id,
                "source_url": source.object_page(name),
            }
        )
    return text.getvalue()


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()
