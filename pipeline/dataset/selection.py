"""Choosing objects in ``params.yaml``, with its comments kept."""

import os
from pathlib import Path

from ruamel.yaml import YAML

from objectfolder.catalogue import read_rows
from objectfolder.errors import InputError
from objectfolder.products.atomic import atomic_write
from pipeline.dataset.parameters import read_parameters


def select(path: Path, table: str | None, only: str | None) -> list[str]:
    """Set ``objects.table`` and ``objects.only``; None leaves a value as it is.

    With another table, ``objects.meshes`` becomes the folder of its meshes and textures.

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
        A table that does not exist, or an id that it does not list.
    """
    before = read_parameters(path).objects
    wanted_table = before.table if table is None else table
    if table is not None and not (path.parent / table).is_file():
        raise InputError(table, "no such table of objects", "Give the path of a CSV file.")
    wanted_only = list(before.only) if wanted_table == before.table else []
    if only is not None:
        wanted_only = [object_id.strip() for object_id in only.split(",") if object_id.strip()]
        _check_ids(wanted_only, path.parent / wanted_table)
    changes = []
    if wanted_table != before.table:
        changes.append(f"{path.name}: objects.table is now {wanted_table} (was {before.table})")
    if tuple(wanted_only) != before.only:
        ids_before, ids_after = ("all" if not ids else ", ".join(ids) for ids in (before.only, wanted_only))
        changes.append(f"{path.name}: objects.only is now {ids_after} (was {ids_before})")
    meshes = before.meshes if wanted_table == before.table else _meshes(path.parent.absolute(), wanted_table)
    if meshes != before.meshes:
        changes.append(f"{path.name}: objects.meshes is now {meshes} (was {before.meshes})")
    if changes:
        yaml = YAML()
        yaml.preserve_quotes, yaml.width = True, 4096
        content = yaml.load(path.read_text(encoding="utf-8"))
        content["objects"]["table"] = wanted_table
        content["objects"]["meshes"] = meshes
        content["objects"]["only"][:] = wanted_only  # in place: the list keeps its style and comments
        with atomic_write(path) as file:
            yaml.dump(content, file)
    return changes


def _meshes(root: Path, table: str) -> str:
    """Return the folder that has all meshes and textures of a table.

    It is the table itself where that folder would have products in it, too: DVC cannot watch that.
    """
    folder = (root / table).parent
    try:
        rows = [row for _, row in read_rows(root / table)[1]]
    except InputError:  # a run says what is wrong with it
        return table
    names = [row.get(column) for row in rows for column in ("mesh", "texture")]
    parents = {os.path.dirname(os.path.abspath(folder / name)) for name in names if name}
    common = Path(os.path.commonpath(parents)) if parents else root
    if (root / "data").is_relative_to(common):
        return table
    return str(common.relative_to(root) if common.is_relative_to(root) else common)


def _check_ids(ids: list[str], table: Path) -> None:
    """Refuse ids that a table does not list, before they are written."""
    table_ids = [str(row.get("id") or "").strip() for _, row in read_rows(table)[1]] if ids else []
    unknown = [object_id for object_id in ids if object_id not in table_ids]
    if unknown:
        finding = f"{', '.join(unknown)}: not in {table}"
        raise InputError("--only", finding, f"Known are {', '.join(table_ids)}.")
