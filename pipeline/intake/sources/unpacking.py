"""Archives of strangers unpacked: into one folder, all of it or nothing."""

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from objectfolder.atomic import PARTIAL
from objectfolder.errors import FormatError, InputError
from pipeline.intake.sources.archive_names import Names, plain_name
from pipeline.intake.sources.cached_file import writing
from pipeline.intake.sources.source_archives import Member, Unreadable, opened

LIMIT_BYTES = 4 << 30
LIMIT_FILES = 10_000
# Texts of meshes shrink to a fifth and pictures not at all; a bomb, to a thousandth.
MOST_RATIO = 100
LEAST_SUSPECT_BYTES = 64 << 20  # below it, any ratio will do
HEADERS_BYTES = 4096  # of a member of a tar, and what it is filled up with
REMEDY = "Nothing of it was unpacked. Fetch it again; if it stays so, tell its source."


def unpack(
    archive: Path,
    folder: Path,
    *,
    wanted: Callable[[str], bool] | None = None,
    limit_bytes: int = LIMIT_BYTES,
    limit_files: int = LIMIT_FILES,
) -> list[Path]:
    """Unpack a zip, tar or tar.gz to a folder that takes its name when all is there.

    Parameters
    ----------
    archive
        What it is, its content decides and not its name.
    folder
        Where to; it may not be there yet, or must be empty.
    wanted
        Which members to unpack, by their paths below `folder`; all by default. Those left out must be
        harmless all the same.
    limit_bytes, limit_files
        The most that it may unpack to, counted as it is unpacked, and the most members.

    Returns
    -------
    list
        The files unpacked, in the archive's order.

    Raises
    ------
    FormatError
        A damaged or empty archive, or one with a member that is no plain file or folder, lies outside the
        folder, is encrypted or strangely compressed, is there twice, or differs from another by case alone;
        or one that unpacks to too much.
    InputError
        The archive cannot be read, or the folder not written, or it is in use.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(str(folder), "there is something in it already", "Remove it or name another folder.")
    with writing(folder.parent):
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=PARTIAL, dir=folder.parent))
    try:
        names = _fill(archive, temporary, wanted or (lambda name: True), limit_bytes, limit_files)
        with writing(folder):
            temporary.chmod(0o755)
            temporary.replace(folder)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    return [folder / name for name in names]


class _Budget:
    """What may yet be unpacked."""

    def __init__(self, limit_bytes: int, packed_bytes: int) -> None:
        self._most = min(limit_bytes, max(LEAST_SUSPECT_BYTES, MOST_RATIO * packed_bytes))
        self._total = 0

    def spend(self, count: int) -> None:
        self._total += count
        if self._total > self._most:
            raise Unreadable(f"it unpacks to more than {self._most} bytes")


def _fill(
    archive: Path, folder: Path, wanted: Callable[[str], bool], limit_bytes: int, limit_files: int
) -> list[str]:
    """Unpack into a folder of one's own; return the files."""
    files: list[str] = []
    names = Names()
    empty = True
    try:
        packed_bytes = archive.stat().st_size
        budget = _Budget(limit_bytes, packed_bytes)
        # A tar.gz is unpacked whole on the way, with what is not wanted, and with its headers.
        on_the_way = _Budget(limit_bytes + limit_files * HEADERS_BYTES, packed_bytes)
        with opened(archive, on_the_way.spend) as members:
            for number, member in enumerate(members):
                if number >= limit_files:
                    raise Unreadable(f"it has more than {limit_files} members")
                name = _checked_name(member, names)
                empty = empty and member.is_folder
                if not member.is_folder and wanted(name):
                    _write(member, folder / name, budget)
                    files.append(name)
            if empty:
                raise Unreadable("it holds no file")
    except Unreadable as error:
        raise FormatError(str(archive), f"not to be unpacked: {error}", REMEDY) from error
    except OSError as error:
        raise InputError(
            str(archive),
            f"cannot be read ({error.strerror or error})",
            "Check that it is there, and the disk.",
        ) from error
    return files


def _checked_name(member: Member, names: Names) -> str:
    """Return a member's path below the folder; empty for the folder itself."""
    try:
        name = plain_name(member.name)
        if name:
            names.add(name, is_folder=member.is_folder)
        elif not member.is_folder:
            raise ValueError(f"{member.name!r} is no name of a file")
    except ValueError as error:
        raise Unreadable(str(error)) from error
    return name


def _write(member: Member, path: Path, budget: _Budget) -> None:
    """Write a member's content, with the permissions of any new file, whatever the archive has."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("xb")
    with file:
        for block in member.blocks:
            budget.spend(len(block))
            with writing(path):
                file.write(block)
        with writing(path):
            file.flush()
            os.fsync(file.fileno())
