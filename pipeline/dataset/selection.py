"""Choosing objects in ``params.yaml``, with its comments kept."""

from pathlib import Path
from typing import Any

from objectfolder.atomic import atomic_write
from objectfolder.errors import InputError
from pipeline.dataset.parameters import read_parameters


def select(path: Path, table: str | None, only: str | None) -> list[str]:
    """Set ``objects.table`` and ``objects.only``; None leaves a value as it is.

    Parameters
    ----------
    path
        ``params.yaml``.
    table
        CSV file, relative to the folder of `path` or absolute. Another table takes all of its objects,
        unless `only` says otherwise.
    only
        Ids with commas between them; empty for all.

    Returns
    -------
    list of str
        What was changed, a line each.

    Raises
    ------
    InputError
        A table that does not exist.
    """
    before = read_parameters(path).objects
    wanted_table = before.table if table is None else table
    if table is not None and not (path.parent / table).is_file():
        raise InputError(table, "no such table of objects", "Give the path of a CSV file.")
    wanted_only = list(before.only) if wanted_table == before.table else []
    if only is not None:
        wanted_only = [object_id.strip() for object_id in only.split(",") if object_id.strip()]
    changes = []
    if wanted_table != before.table:
        changes.append(f"{path.name}: objects.table is now {wanted_table} (was {before.table})")
    if tuple(wanted_only) != before.only:
        was, now = ("all" if not ids else ", ".join(ids) for ids in (before.only, wanted_only))
        changes.append(f"{path.name}: objects.only is now {now} (was {was})")
    if changes:
        _edit(path, wanted_table, wanted_only)
    return changes


def _edit(path: Path, table: str, only: list[str]) -> None:
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 4096
    content = yaml.load(path.read_text(encoding="utf-8"))
    content["objects"]["table"] = table
    # In place, so that the list keeps its style and comments.
    ids: Any = content["objects"]["only"]
    ids[:] = only
    with atomic_write(path) as file:
        yaml.dump(content, file)
