"""A folder that appears under its name only when all its files are written."""

import contextlib
import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from objectfolder.products.atomic import PARTIAL

MANIFEST = "export.json"


@contextlib.contextmanager
def new_folder(path: Path | str, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield an empty folder to fill; it takes the name `path` when the block ends without an error.

    An error inside leaves what was at `path` before, and nothing else.

    Parameters
    ----------
    path
        The folder to make. An empty folder there is replaced.
    overwrite
        Replace an earlier export, too.

    Raises
    ------
    InputError
        A file, an earlier export that may not be overwritten, or a folder that is not an export.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise InputError(str(path), "is a file", "Name a folder that does not exist yet.")
    if path.is_dir() and any(path.iterdir()):
        if not (path / MANIFEST).is_file():
            raise InputError(
                str(path), f"holds files but no {MANIFEST}, so it is no export", "Name another folder."
            )
        if not overwrite:
            raise InputError(str(path), "holds an export", "Name another folder, or ask to overwrite it.")
    path.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=PARTIAL, dir=path.parent))
    try:
        made = work / "new"
        made.mkdir()
        yield made
        if path.exists():
            path.rename(work / "old")
        made.rename(path)
    finally:
        if (work / "old").exists() and not path.exists():
            (work / "old").rename(path)
        shutil.rmtree(work)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with a line end; equal contents give equal bytes.

    Raises
    ------
    ValueError
        A number that JSON cannot hold.
    """
    path.write_text(
        json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )
