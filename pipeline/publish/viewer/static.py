"""Players for pages without a server: a script of data for each object, and one of code for all.

A page has ``<div class="player" data-object="ID" data-script="ID.player.js"></div>`` for an object,
and once ``<script src="player.js" defer></script>`` and ``<link rel="stylesheet" href="player.css">``.
Nothing is fetched: everything works in a page opened from disk.
"""

import base64
import json
from collections.abc import Sequence
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.products.atomic import atomic_write
from objectfolder.products.provenance import file_digest
from pipeline.publish.viewer import FORMAT
from pipeline.publish.viewer.joined_scripts import joined_script

FILES_OF = "*.safetensors"  # a folder
PAGE = Path(__file__).parent / "page"


def object_files_of(paths: Sequence[Path]) -> list[Path]:
    """Return Object Files, and those in folders.

    Raises
    ------
    InputError
        There is none.
    """
    files = [file for path in paths for file in (sorted(path.glob(FILES_OF)) if path.is_dir() else [path])]
    if not files:
        raise InputError(" ".join(map(str, paths)) or "FILE", f"no Object File ({FILES_OF})", "Name one.")
    return files


def write_player(object_file: Path, folder: Path, object_id: str, cache: Path | None = None) -> Path:
    """Write ``<folder>/<object_id>.player.js``, and return its path; for the rest see `player_script`."""
    target = folder / f"{object_id}.player.js"
    _write(target, player_script(object_file, object_id, cache))
    return target


def player_script(object_file: Path, object_id: str, cache: Path | None = None) -> bytes:
    """Return the script of a player's data.

    Parameters
    ----------
    object_file
        The Object File.
    object_id
        What the page calls the object; a plain file name.
    cache
        Folder in which what was made of Object Files is kept, under hashes of the whole files.

    Raises
    ------
    InputError
        An id that is no file name.
    FormatError
        A file that is no Object File, or a damaged one.
    FileNotFoundError
        No such file.
    """
    if object_id in ("", ".", "..") or "/" in object_id or "\\" in object_id or "\0" in object_id:
        raise InputError(repr(object_id), "no file name", "Give an id without separators.")
    copy = cache / f"{file_digest(object_file)}.{FORMAT}" if cache else None
    if copy and copy.is_file():
        data = copy.read_bytes()
    else:
        from objectfolder.object_file import ObjectFile  # with `bake`, most of what a report would import
        from pipeline.publish.viewer.bake import bake

        header, arrays = bake(ObjectFile.load(object_file))
        data = f'{{"header": {_quoted(header)}, "data": "{base64.b64encode(arrays).decode()}"}}'.encode()
        if copy:
            _write(copy, data)
    # An object without a prototype: any id is a plain key of it.
    own = f"(window.objectfolderPlayers ??= Object.create(null))[{_quoted(object_id)}] = "
    return own.encode() + data + b";\n"


def write_player_assets(folder: Path) -> set[str]:
    """Write ``player.js`` and ``player.css``, once for all objects of a page; return their names."""
    code = joined_script("player.js", lambda name: (PAGE / name).read_text(encoding="utf-8"))
    _write(folder / "player.js", code.encode())
    _write(folder / "player.css", (PAGE / "player.css").read_bytes())
    return {"player.js", "player.css"}


def _write(path: Path, content: bytes) -> None:
    with atomic_write(path) as file:
        file.write(content)


def _quoted(value: object) -> str:
    """Return JSON that is safe within a script, wherever it is put."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
