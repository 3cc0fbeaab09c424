"""Writes absent pages of objects, and removes other files from their folder."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from objectfolder.atomic import PARTIAL
from objectfolder.errors import ObjectFolderError
from pipeline.dataset.archives import REMEDY
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.records import SAFE_ID
from pipeline.publish.report.measured_objects import MeasuredObject
from pipeline.publish.report.object_page import ObjectPage, page_name, shown_fingerprint
from pipeline.publish.report.object_products import UNEXPECTED

# Pairs that a page shows of each sense, at most: as many as a verification stores.
PAIRS = 4
PLAYER = ".player.js"


def write_pages(
    objects: Sequence[MeasuredObject],
    data: Path,
    failures: Mapping[str, Sequence[FailedObject]],
    folder: Path,
    pairs: int,
    cache: Path,
) -> tuple[frozenset[str], list[FailedObject]]:
    """Write the page, the thumbnail and the player of each object into `folder`; remove all others.

    A page that carries the fingerprint of what it would show is kept as it is.

    Parameters
    ----------
    objects
        By id.
    data
        Folder of the stages' folders.
    failures
        By object.
    pairs
        Held-out queries of each sense on a page, at most.
    cache
        Folder in which the data of players are kept by what their Object Files hold.

    Returns
    -------
    tuple
        Ids of the objects that have a page, and why the others have none.
    """
    paged, damaged = set(), []
    wanted: set[str] = set()
    ids = ["", *(one.object_id for one in objects), ""]
    for place, one in enumerate(objects):
        own, file = (
            tuple(failures.get(one.object_id, ())),
            data / "object_files" / f"{one.stored_name}.safetensors",
        )
        player = f"{one.object_id}{PLAYER}" if file.is_file() and SAFE_ID.fullmatch(one.object_id) else ""
        page = ObjectPage(one, data, ids[place], ids[place + 2], own, player, pairs)
        try:
            wanted |= _write_page(page, folder, file, cache)
            paged.add(one.object_id)
        except (ObjectFolderError, *UNEXPECTED) as error:
            finding, remedy = _unexpected(error)
            finding = f"{one.stored_name}: {finding}"
            damaged.append(FailedObject(one.object_id, "report", finding, remedy))
    if any(name.endswith(PLAYER) for name in wanted):
        from pipeline.publish.viewer.static import write_player_assets

        wanted |= write_player_assets(folder)
    for path in folder.iterdir() if folder.is_dir() else []:
        if path.name not in wanted and path.is_file():
            path.unlink()
    return frozenset(paged), damaged


def _write_page(page: ObjectPage, folder: Path, object_file: Path, cache: Path) -> set[str]:
    """Write the files of a page where they are not there already; return their names."""
    path = folder / page_name(page.subject.object_id)
    files = {path.name, path.with_suffix(".webp").name}
    fingerprint = page.fingerprint()
    shown, has_player = shown_fingerprint(path)
    kept = files | {page.player} if has_player else files
    if shown == fingerprint and all((folder / name).exists() for name in kept):
        return kept
    content = page.read()
    if page.player:
        from pipeline.publish.viewer.static import write_player

        try:
            write_player(object_file, folder, page.subject.object_id, cache)
            files.add(page.player)
        except (ObjectFolderError, *UNEXPECTED) as error:
            page = replace(page, player="")
            content.unreadable = [*content.unreadable, f"player: {_unexpected(error)[0]}"]
    _write(path.with_suffix(".webp"), content.thumbnail)
    _write(path, page.render(content, fingerprint).encode())
    return files


def _unexpected(error: Exception) -> tuple[str, str]:
    """Return finding and remedy."""
    if isinstance(error, ObjectFolderError):
        return error.finding, error.remedy
    return f"not what a report can show ({type(error).__name__}: {error})", REMEDY


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, without waiting for the disk: it can be made again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}{PARTIAL}")
    partial.write_bytes(content)
    partial.replace(path)
