"""The rows of a table of objects that fetched objects could become."""

import csv
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path

from objectfolder.catalogue import AS_IN_FILE
from pipeline.intake.sources.fetching import Fetched

COLUMNS = (
    "id", "name", "mesh", "texture", "material", "length_m", "source", "licence", "attribution", "source_id",
)  # fmt: skip


def proposed_rows(objects: Sequence[Fetched], folder: Path) -> str:
    """Return CSV with a header: all that is known of objects, but for their materials.

    Parameters
    ----------
    folder
        Of the table, which paths are relative to.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for fetched in objects:
        source, name = fetched.asked.source, fetched.asked.name
        writer.writerow(
            {
                "id": re.sub(r"[^A-Za-z0-9_.-]", "_", name).lstrip(".")[:100],
                "name": re.sub(r"^\d+(-\w)? ", "", name.replace("_", " ")),
                "mesh": Path(os.path.relpath(fetched.mesh, folder)).as_posix(),
                "texture": Path(os.path.relpath(fetched.texture, folder)).as_posix()
                if fetched.texture
                else "",
                "length_m": AS_IN_FILE,
                "source": source.title,
                "licence": source.licence,
                "attribution": source.attribution,
                "source_id": fetched.asked.id,
            }
        )
    return text.getvalue()
