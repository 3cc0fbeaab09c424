"""Pages of objects, written where they are not there already, and nothing beside them left behind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from objectfolder.atomic import PARTIAL
from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.dataset.archives import REMEDY
from pipeline.dataset.records import SAFE_ID
from pipeline.publish.report.archive import Archive
from pipeline.publish.report.costs import Costs
from pipeline.publish.report.object_page import (
    Neighbourhood,
    fingerprint,
    page_name,
    render_object,
    shown_fingerprint,
    stored_name,
)
from pipeline.publish.report.object_records import Failure, Record
from pipeline.publish.report.pictures import thumbnail
from pipeline.publish.report.stored_products import ODD, Shelf

# Pairs that a page shows of each sense, at most: as many as a verification stores.
PAIRS = 4
PLAYER = ".player.js"


@dataclass(frozen=True)
class Pages:
    """What was done.

    Parameters
    ----------
    made, kept
        Ids.
    damaged
        Objects whose page could not be made.
    """

    made: list[str]
    kept: list[str]
    damaged: list[Failure]


def write_pages(
    records: Sequence[Record],
    shelf: Shelf,
    costs: Costs,
    failures: Mapping[str, Sequence[Failure]],
    folder: Path,
    pairs: int = PAIRS,
    cache: Path | None = None,
) -> Pages:
    """Write the page, the thumbnail and the player of each object into `folder`; remove all others.

    A page that carries the fingerprint of what it would show is kept as it is.

    Parameters
    ----------
    pairs
        Held-out queries of each sense on a page, at most.
    cache
        Folder in which the data of players are kept by what their Object Files hold.
    """
    ordered = sorted(records, key=lambda record: record.object_id)
    made, kept, damaged = [], [], []
    wanted: set[str] = set()
    players = _Players(folder, shelf, cache)
    for place, record in enumerate(ordered):
        page = folder / page_name(record.object_id)
        player = players.name(record)
        around = Neighbourhood(
            ordered[place - 1].object_id if place else "",
            ordered[place + 1].object_id if place + 1 < len(ordered) else "",
            tuple(failures.get(record.object_id, ())),
            player,
        )
        files = [page.name, page.with_suffix(".webp").name]
        shown, has_player = shown_fingerprint(page)
        try:
            made_of = fingerprint(record, shelf, costs, around, pairs)
            if shown == made_of and all((folder / name).exists() for name in files + [player] * has_player):
                files += [player] * has_player
                kept.append(record.object_id)
            else:
                problem = players.write(record) if player else ""
                if problem:
                    around = replace(around, player="")
                elif player:
                    files.append(player)
                thumb = _thumbnail(shelf.archive("fidelity", stored_name(record)))
                text = render_object(record, shelf, costs, around, pairs, made_of, problem)
                _write(page.with_suffix(".webp"), thumb)
                _write(page, text.encode())
                made.append(record.object_id)
            wanted.update(files)
        except ObjectFolderError as error:
            finding = f"{record.path.name}: {error.finding}"
            damaged.append(Failure(record.object_id, "report", finding, error.remedy))
        except ODD as error:
            finding = f"{record.path.name}: not what a report can show ({type(error).__name__}: {error})"
            damaged.append(Failure(record.object_id, "report", finding, REMEDY))
    _sweep(folder, wanted | players.write_shared(wanted))
    return Pages(made, kept, damaged)


def _thumbnail(path: Path) -> bytes:
    with Archive(path) as fidelity:
        if "vision_truth" not in fidelity:
            return thumbnail(None)
        try:
            return thumbnail(fidelity.array("vision_truth"))
        except (*ODD, FormatError):  # the page says what is wrong with its views
            return thumbnail(None)


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, without waiting for the disk: it can be made again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}{PARTIAL}")
    partial.write_bytes(content)
    partial.replace(path)


def _sweep(folder: Path, wanted: set[str]) -> None:
    for path in folder.iterdir() if folder.is_dir() else []:
        if path.name not in wanted and path.is_file():
            path.unlink()


class _Players:
    """Interactive players beside the pages, for objects that have an Object File."""

    def __init__(self, folder: Path, shelf: Shelf, cache: Path | None) -> None:
        self.folder = folder
        self.shelf = shelf
        self.cache = cache

    def name(self, record: Record) -> str:
        """Return the name of the script of an object's player, empty where there can be none."""
        path = self.shelf.tensors("object_files", stored_name(record))
        return f"{record.object_id}{PLAYER}" if path.is_file() and SAFE_ID.fullmatch(record.object_id) else ""

    def write(self, record: Record) -> str:
        """Write the script of an object's player; return why that is not possible, empty where it was."""
        from pipeline.publish.viewer.static import write_player

        path = self.shelf.tensors("object_files", stored_name(record))
        try:
            write_player(path, self.folder, record.object_id, self.cache)
        except ObjectFolderError as error:
            return f"player: {error.finding}"
        except ODD as error:
            return f"player: not what it can be made of ({type(error).__name__}: {error})"
        return ""

    def write_shared(self, files: set[str]) -> set[str]:
        """Write what all players share where `files` has any; return its names."""
        if not any(name.endswith(PLAYER) for name in files):
            return set()
        from pipeline.publish.viewer.static import write_player_assets

        write_player_assets(self.folder)
        return {"player.js", "player.css"}
