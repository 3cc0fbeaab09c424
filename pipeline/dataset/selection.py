"""The choice of objects: the table in ``params.yaml``, and which of its objects this checkout makes.

The table is part of the data set. The selection is one person's, so it has a file of its own, which git
ignores. Its folder is always there, for DVC to see when the selection changes.
"""

import os
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.products.atomic import atomic_write, write_whole
from objectfolder.products.regular_file import read_regular
from pipeline.dataset.parameters import PARAMETERS, read_parameters

SELECTION_FOLDER = Path("data/selection")
SELECTION = SELECTION_FOLDER / "only.txt"


def read_selection(root: Path) -> tuple[str, ...]:
    """Return the ids of the objects that this checkout makes; none for all of the table.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    try:
        return tuple(dict.fromkeys(read_regular(root / SELECTION).decode().split()))
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        remedy = "Delete it, and run `objectfolder select --only`."
        raise InputError(str(SELECTION), f"cannot be read ({error})", remedy) from error


def select(root: Path, table: str | None, only: str | None) -> list[str]:
    """Set ``objects.table`` in ``params.yaml``, and the selection; None leaves each as it is.

    With another table, ``objects.meshes`` becomes the folder of its meshes and textures. Comments stay.

    Parameters
    ----------
    root
        Root of the data set.
    table
        CSV file, relative to `root` or absolute. Another table takes all of its objects, unless `only` says
        otherwise.
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
    from ruamel.yaml import YAML  # here: every run reads a selection, and starts sooner without

    path = root / PARAMETERS
    before, ids_before = read_parameters(path).objects, read_selection(root)
    new_table = before.table if table is None else table
    if table is not None and not (root / table).is_file():
        raise InputError(table, "no such table of objects", "Give the path of a CSV file.")
    ids = ids_before if new_table == before.table else ()
    if only is not None:
        ids = tuple(object_id.strip() for object_id in only.split(",") if object_id.strip())
        _check_ids(ids, root / new_table)
    changes = []
    if new_table != before.table:
        changes.append(f"{path.name}: objects.table is now {new_table} (was {before.table})")
    meshes = before.meshes if new_table == before.table else _meshes(root.absolute(), new_table)
    if meshes != before.meshes:
        changes.append(f"{path.name}: objects.meshes is now {meshes} (was {before.meshes})")
    if changes and path.is_symlink():
        raise InputError("--table", f"{root} is a partition", "Choose the table of the checkout above it.")
    if changes:
        yaml = YAML()
        yaml.preserve_quotes, yaml.width = True, 4096
        content = yaml.load(path.read_text(encoding="utf-8"))
        content["objects"]["table"] = new_table
        content["objects"]["meshes"] = meshes
        with atomic_write(path) as file:
            yaml.dump(content, file)
    if ids != ids_before:
        named_before, words = ("all" if not names else ", ".join(names) for names in (ids_before, ids))
        changes.append(f"{SELECTION}: selected are now {words} (were {named_before})")
        _write_selection(root, ids)
    return changes


def _write_selection(root: Path, ids: tuple[str, ...]) -> None:
    if ids:
        (root / SELECTION_FOLDER).mkdir(parents=True, exist_ok=True)
        write_whole(root / SELECTION, "".join(f"{object_id}\n" for object_id in ids))
    else:
        (root / SELECTION).unlink()


def _meshes(root: Path, table: str) -> str:
    """Return the folder that has all meshes and textures of a table.

    It is the table itself where that folder would have products in it, too: DVC cannot watch that.
    """
    from pipeline.dataset.catalogue import read_rows

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


def _check_ids(ids: tuple[str, ...], table: Path) -> None:
    """Refuse ids that a table does not list, before they are written."""
    from pipeline.dataset.catalogue import read_rows

    table_ids = [str(row.get("id") or "").strip() for _, row in read_rows(table)[1]] if ids else []
    unknown = [object_id for object_id in ids if object_id not in table_ids]
    if unknown:
        finding = f"{', '.join(unknown)}: not in {table}"
        raise InputError("--only", finding, f"Known are {', '.join(table_ids)}.")
