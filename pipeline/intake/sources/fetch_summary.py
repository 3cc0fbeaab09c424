"""A summary of fetched objects, and the rows of a table of objects that they could become."""

import csv
import io
import os
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from pipeline.dataset.catalogue import AS_IN_FILE
from pipeline.intake.sources.fetching import Fetched


def lines_of(outcomes: Fetched) -> str:
    """Return what an object is, and where its files are."""
    source = outcomes.source_object.source
    size = f"{len(outcomes.form.files)} files, {outcomes.bytes / 1e6:.2f} MB"
    new = f", hashes recorded: {outcomes.recorded}" if outcomes.recorded else ""
    return (
        f"{outcomes.source_object.id}  {outcomes.outcome}, {size}{new}\n"
        f"  mesh     {outcomes.mesh}\n"
        f"  texture  {outcomes.texture or 'named by the mesh'}\n"
        f"  licence  {source.licence}; {source.attribution}"
    )


def summary(outcomes: Sequence[Fetched], table: Path, rows: Collection[Mapping[str, str]], count: int) -> str:
    """Return rows to add to the table for new objects and, of several objects, how many there are."""
    in_table = {row.get("source_id") for row in rows}
    new = [entry for entry in outcomes if entry.source_object.id not in in_table]
    lines = []
    if new:
        lines += [f"\nRows for {table}, each to be given its material:"]
        lines += [proposed_rows(new, table.parent).rstrip("\n")]
    if count > 1:
        lines += [
            f"{len(outcomes)} of {count} are there, {sum(entry.bytes for entry in outcomes) / 1e6:.1f} MB"
        ]
    return "\n".join(lines)


def proposed_rows(objects: Sequence[Fetched], folder: Path) -> str:
    """Return CSV with a header: all that is known of objects but their materials; paths are from `folder`."""
    rows = []
    for outcomes in objects:
        source, name = outcomes.source_object.source, outcomes.source_object.name
        mesh, texture = (
            Path(os.path.relpath(path, folder)).as_posix() if path else ""
            for path in (outcomes.mesh, outcomes.texture)
        )
        rows.append(
            {
                "id": re.sub(r"[^A-Za-z0-9_.-]", "_", name).lstrip(".")[:100],
                "name": re.sub(r"^\d+(-\w)? ", "", name.replace("_", " ")),
                "mesh": mesh,
                "texture": texture,
                "material": "",
                "length_m": AS_IN_FILE,
                "source": source.title,
                "licence": source.licence,
                "attribution": source.attribution,
                "source_id": outcomes.source_object.id,
            }
        )
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
