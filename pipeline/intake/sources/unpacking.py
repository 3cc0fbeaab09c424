"""Archives unpacked into a folder: checked whole before anything is written, extracted by the library."""

import gzip
import io
import re
import stat
import struct
import tarfile
import unicodedata
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from objectfolder.errors import FormatError
from pipeline.intake.disk import writing

LIMIT_BYTES = 4 << 30
LIMIT_FILES = 10_000
# Texts of meshes shrink to a fifth and pictures not at all; a bomb, to a thousandth.
MOST_RATIO = 100
LEAST_SUSPECT_BYTES = 64 << 20  # below it, any ratio will do
BUFFER = 1 << 20
LARGEST_READ = 4 << 20  # of a zip's directory, or of a tar's long name, which are read at once
REMEDY = "Nothing of it is used. Fetch it again; if it stays so, tell its source."
# What a damaged archive makes the readers of the standard library raise.
DAMAGE = (
    zipfile.BadZipFile, tarfile.TarError, zlib.error, gzip.BadGzipFile, struct.error, EOFError, LookupError,
    TypeError, ValueError, AttributeError, RuntimeError, OverflowError,
)  # fmt: skip
# Python before 3.11.4 has no filters. What is extracted is a plain file or folder whose name was checked.
TAR_FILTER: dict[str, Any] = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
_DRIVE = re.compile(r"[A-Za-z]:")
# Devices of Windows, and what git obeys.
_RESERVED = re.compile(r"(con|prn|aux|nul|com[1-9]|lpt[1-9])(\..*)?|\.git.*|git~\d+", re.IGNORECASE)


class _Member(NamedTuple):
    """A file or folder in an archive; `extract` writes it under another name in a folder."""

    name: str
    size: int
    is_folder: bool
    extract: Callable[[str, Path], object]


def unpack(
    archive: Path, folder: Path, *, top: str = "", selects: Callable[[str], bool] = lambda path: True
) -> list[str]:
    """Unpack a zip or tar.gz into an empty folder; where it is refused, the caller removes the folder.

    Parameters
    ----------
    archive
        What it is, its content decides and not its name.
    top
        Folder in the archive whose members are unpacked, without it; all for an empty one.
    selects
        Which members to unpack, by their paths below `top`. Those left out must be harmless all the same.

    Returns
    -------
    list
        Paths of the files in `folder`, in the archive's order.

    Raises
    ------
    FormatError
        A damaged or empty archive; one with a member that is no plain file or folder, leads out of the
        folder, is encrypted, is there twice or differs from another only by case; one of more than
        `LIMIT_FILES` members; or one that unpacks to more than `LIMIT_BYTES` or `MOST_RATIO` times its size.
    InputError
        The archive cannot be read, or the folder not written.
    """
    start = f"{top}/" if top else ""
    files: list[str] = []
    with writing(archive):
        limit_bytes = min(LIMIT_BYTES, max(LEAST_SUSPECT_BYTES, MOST_RATIO * archive.stat().st_size))
        try:
            for path, member in _checked(_members(archive), limit_bytes):
                inner = path.removeprefix(start)
                if path.startswith(start) and selects(inner):
                    member.extract(inner, folder)
                    files.append(inner)
        except RecursionError as error:
            finding = "cannot be unpacked: its headers follow one another without end"
            raise FormatError(str(archive), finding, REMEDY) from error
        except DAMAGE as error:
            reason = str(error) or type(error).__name__
            raise FormatError(str(archive), f"cannot be unpacked: {reason}", REMEDY) from error
    return files


def _checked(members: Iterable[_Member], limit_bytes: int) -> Iterator[tuple[str, _Member]]:
    """Yield files and their plain paths; ValueError for a member that is refused, or for no file."""
    # By names as a file system sees them that tells neither case nor composed letters apart; a file's
    # number differs from that of any other member, and all folders have 0.
    places: dict[str, tuple[PurePosixPath, int]] = {}
    total, files = 0, 0
    for count, member in enumerate(members, start=1):
        total += member.size
        if count > LIMIT_FILES:
            raise ValueError(f"it has more than {LIMIT_FILES} members")
        if member.size < 0 or total > limit_bytes:
            raise ValueError(f"it unpacks to more than {limit_bytes} bytes")
        path = _plain_path(member.name)
        if not path.parts and not member.is_folder:
            raise ValueError(f"{member.name!r} is no name of a file")
        number = 0 if member.is_folder else count
        for place in ((path, number), *((parent, 0) for parent in path.parents)):
            key = unicodedata.normalize("NFC", unicodedata.normalize("NFC", str(place[0])).casefold())
            if places.setdefault(key, place) != place:
                raise ValueError(f"{str(path)!r} occurs twice where case is ignored")
        if not member.is_folder:
            files += 1
            yield str(path), member
    if not files:
        raise ValueError("it holds no file")


def _plain_path(name: str) -> PurePosixPath:
    """Return a member's path below its archive's folder; ValueError for one that leads elsewhere."""
    path = PurePosixPath(name)
    if path.is_absolute():
        raise ValueError(f"{name!r} is an absolute path")
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in name):
        raise ValueError(f"{name!r} has control characters, or is not UTF-8")
    if "\\" in name or any(part == ".." or _DRIVE.match(part) for part in path.parts):
        raise ValueError(f"{name!r} leads out of its folder, on this machine or on others")
    if any(_RESERVED.fullmatch(part) for part in path.parts):
        raise ValueError(f"{name!r} is reserved for a device or for git")
    return path


class _Bounded(io.BufferedReader):
    """A file of which nothing large is read at once, whatever sizes its headers declare."""

    def read(self, size: int | None = -1) -> bytes:
        if size is not None and size < -1:
            raise ValueError("a header declares a negative size")
        content = super().read(LARGEST_READ + 1 if size in (None, -1) else min(size, LARGEST_READ + 1))
        if len(content) > LARGEST_READ:
            raise ValueError(f"a header of more than {LARGEST_READ} bytes")
        return content

    def seek(self, target: int, whence: int = io.SEEK_SET) -> int:
        if whence == io.SEEK_SET and target < 0:  # and not the OSError of a disk that fails
            raise ValueError("a header points before the beginning")
        return super().seek(target, whence)


def _members(archive: Path) -> Iterator[_Member]:
    """Yield the members in their order, each to be extracted before the next."""
    with archive.open("rb") as file:
        start = file.read(512).lstrip()
    if start.startswith((b"PK\3\4", b"PK\5\6")):
        with _Bounded(io.FileIO(archive)) as content, zipfile.ZipFile(content) as archive_file:
            yield from _zip_members(content, archive_file)
    elif start.startswith(b"\x1f\x8b"):
        with _Bounded(gzip.GzipFile(archive), BUFFER) as content:
            yield from _tar_members(content)
    elif start.startswith(b"<"):
        raise ValueError("a web page, not an archive")
    else:
        raise ValueError("no archive: neither zip nor tar.gz")


def _zip_members(file: _Bounded, archive: zipfile.ZipFile) -> Iterator[_Member]:
    def extract(entry: zipfile.ZipInfo, path: str, folder: Path) -> None:
        entry.filename = path
        archive.extract(entry, folder)

    entries = archive.infolist()
    if len(entries) > LIMIT_FILES:
        raise ValueError(f"it has more than {LIMIT_FILES} members")
    # The reader uses only the directory's size; with a damaged one an archive seems to have fewer members.
    file.seek(-12 - len(archive.comment), io.SEEK_END)
    (count,) = struct.unpack("<H", file.read(2))
    if len(entries) != count and count != 0xFFFF:
        raise ValueError(f"its directory has {len(entries)} entries but declares {count}")
    for entry in entries:
        name = entry.orig_filename  # `filename` ends at a zero byte
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise ValueError(f"{name!r} is a link or device")
        if entry.flag_bits & 0x1:
            raise ValueError(f"{name!r} is encrypted")
        # Others, such as LZMA, may ask for gigabytes of memory to be unpacked.
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{name!r} is compressed by method {entry.compress_type}, not 0 or 8")
        yield _Member(name, entry.file_size, name.endswith("/"), partial(extract, entry))


def _tar_members(file: _Bounded) -> Iterator[_Member]:
    def extract(entry: tarfile.TarInfo, path: str, folder: Path) -> None:
        entry.name = path
        archive.extract(entry, folder, set_attrs=False, **TAR_FILTER)

    with tarfile.open(fileobj=file, mode="r:") as archive:
        while (entry := archive.next()) is not None:
            if not (entry.isreg() or entry.isdir()) or entry.issparse():
                raise ValueError(f"{entry.name!r} is a link, device or file with holes")
            yield _Member(entry.name, entry.size, entry.isdir(), partial(extract, entry))
        # The reader takes anything that it does not understand for the end.
        file.seek(archive.offset)
        if file.read(tarfile.BLOCKSIZE) != bytes(tarfile.BLOCKSIZE):
            raise ValueError(f"it is cut or damaged after {archive.offset} bytes")
        # The checksum of gzip stands after what fills up the tar's last record.
        if len(file.read(LARGEST_READ)) == LARGEST_READ:
            raise ValueError("something follows its end")
