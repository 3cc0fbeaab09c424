"""Archives of strangers read member by member: zip, tar, and tar in gzip.

Sizes that an archive declares allocate nothing; what is neither plain file nor folder is refused.
"""

import contextlib
import gzip
import io
import stat
import struct
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar

from pipeline.dataset.archives import END, END_MARK
from pipeline.intake.sources.cached_file import writing

BLOCK = 1 << 20
LARGEST_READ = 4 << 20  # of a zip's directory, or of a tar's long name, which are read at once
# What a damaged archive makes the readers of the standard library raise.
DAMAGE = (
    zipfile.BadZipFile, tarfile.TarError, zlib.error, gzip.BadGzipFile, struct.error, EOFError, LookupError,
    TypeError, ValueError, AttributeError, RuntimeError, OverflowError,
)  # fmt: skip
_UNICODE_PATH = 0x7075  # extra field of Info-ZIP
_LONGEST_END = (1 << 16) + 200  # bytes of a zip's last records and comment
_END_64_MARK = b"PK\6\6"
_T = TypeVar("_T")


class Unreadable(Exception):
    """An archive that is damaged, or has what none from a source should have; the text says what."""


@dataclass(frozen=True)
class Member:
    """A file or folder in an archive.

    Parameters
    ----------
    name
        As the archive has it.
    is_folder
        Whether it is one.
    blocks
        The content, not yet read. Its end is reached only where its checksum holds.
    """

    name: str
    is_folder: bool
    blocks: Iterator[bytes]


@contextlib.contextmanager
def opened(path: Path, count: Callable[[int], None]) -> Iterator[Iterator[Member]]:
    """Yield an archive's members in their order, each to be read before the next.

    The members, and their contents, raise `Unreadable` as well.

    Parameters
    ----------
    count
        Called with the number of bytes that were unpacked on the way and are no member's content.

    Raises
    ------
    Unreadable
        No archive of these kinds, or a damaged one.
    OSError
        Its disk fails.
    """
    with _Bounded(io.FileIO(path)) as file:
        start = file.read(512)
        file.seek(0)
        if start.startswith((b"PK\3\4", b"PK\5\6")):
            yield _told(_zip_members(file))
        elif start.startswith(b"\x1f\x8b"):
            # Before any of it is looked at: the checksum stands at the end.
            with _gunzipped(file, path.parent, count) as unpacked:
                yield _told(_tar_members(unpacked))
        elif start[257:262] == b"ustar":
            yield _told(_tar_members(file))
        elif start.lstrip()[:1] == b"<":
            raise Unreadable("a page of the web, and no archive")
        else:
            raise Unreadable("no archive: neither zip, tar nor tar.gz")


def _told(parts: Iterator[_T]) -> Iterator[_T]:
    """Yield the same, with every kind of damage as `Unreadable`."""
    while True:
        try:
            part = next(parts)
        except StopIteration:
            return
        except RecursionError as error:
            raise Unreadable("its headers follow one another without end") from error
        except DAMAGE as error:
            raise Unreadable(str(error) or type(error).__name__) from error
        yield part


class _Bounded(io.BufferedReader):
    """A file of which nothing large is read at once, whatever sizes its headers declare."""

    def read(self, size: int | None = -1) -> bytes:
        if size is None or size == -1:
            size = LARGEST_READ + 1
        if size < 0:
            raise ValueError("a header declares a negative size")
        content = super().read(min(size, LARGEST_READ + 1))
        if len(content) > LARGEST_READ:
            raise ValueError(f"a header of more than {LARGEST_READ} bytes")
        return content

    def seek(self, target: int, whence: int = io.SEEK_SET) -> int:
        if whence == io.SEEK_SET and target < 0:  # and not the OSError of a disk that fails
            raise ValueError("a header points before the beginning")
        return super().seek(target, whence)


def _zip_members(file: IO[bytes]) -> Iterator[Member]:
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        # The reader goes by the directory's size alone, and one damaged there may seem to have fewer.
        if len(entries) != _told_count(file):
            raise Unreadable(f"its directory has {len(entries)} entries and tells of others")
        for entry in entries:
            name = _zip_name(entry)
            kind = stat.S_IFMT(entry.external_attr >> 16)
            if entry.flag_bits & 0x2041:
                raise Unreadable(f"{name!r} is encrypted")
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise Unreadable(f"{name!r} is a link or device")
            # Others, such as LZMA, may ask for gigabytes of memory to be unpacked.
            if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise Unreadable(f"{name!r} is compressed by method {entry.compress_type}, not 0 or 8")
            is_folder = name.endswith("/")
            if (is_folder and entry.file_size) or (kind == stat.S_IFDIR and not is_folder):
                raise Unreadable(f"{name!r} is a folder and a file")
            yield Member(name, is_folder, _told(_zip_blocks(archive, entry)))


def _told_count(file: IO[bytes]) -> int:
    """Return the number of entries by a zip's last record."""
    size = file.seek(0, io.SEEK_END)
    file.seek(max(0, size - _LONGEST_END))
    tail = file.read(_LONGEST_END)
    place = tail.rindex(END_MARK)
    count = END.unpack_from(tail, place)[4]
    if count == 0xFFFF and (larger := tail.rfind(_END_64_MARK, 0, place)) >= 0:
        (count,) = struct.unpack_from("<Q", tail, larger + 32)
    return int(count)


def _zip_name(entry: zipfile.ZipInfo) -> str:
    """Return a member's name: UTF-8 where it is said, or where it can be, and else the old code page."""
    name = entry.orig_filename
    if entry.flag_bits & 0x800 or name.isascii():
        return name
    raw = name.encode("cp437")
    extra = entry.extra
    while len(extra) >= 4:
        field, length = struct.unpack_from("<HH", extra)
        content, extra = extra[4 : 4 + length], extra[4 + length :]
        if field == _UNICODE_PATH and len(content) > 5 and content[1:5] == struct.pack("<L", zlib.crc32(raw)):
            return content[5:].decode()
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return name


def _zip_blocks(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Iterator[bytes]:
    with archive.open(entry) as content:
        while block := content.read(BLOCK):
            yield block


@contextlib.contextmanager
def _gunzipped(file: IO[bytes], folder: Path, count: Callable[[int], None]) -> Iterator[IO[bytes]]:
    """Unpack all of a file to one without a name in `folder`."""
    with contextlib.ExitStack() as stack:
        with writing(folder):
            unpacked = stack.enter_context(tempfile.TemporaryFile(dir=folder))
        content = stack.enter_context(gzip.GzipFile(fileobj=file))
        for block in _told(iter(lambda: content.read(BLOCK), b"")):
            count(len(block))
            with writing(folder):
                unpacked.write(block)
        with writing(folder):
            unpacked.flush()
        unpacked.seek(0)
        yield stack.enter_context(_Bounded(io.FileIO(unpacked.fileno(), closefd=False)))


def _tar_members(file: IO[bytes]) -> Iterator[Member]:
    with tarfile.open(fileobj=file, mode="r:") as archive:
        while (entry := archive.next()) is not None:
            if entry.size < 0:  # the reader would go back and round
                raise Unreadable(f"{entry.name!r} declares a negative size")
            if not (entry.isreg() or entry.isdir()) or entry.issparse():
                raise Unreadable(f"{entry.name!r} is a link, device or file with holes")
            yield Member(entry.name, entry.isdir(), _told(_tar_blocks(archive, entry)))
        # The reader takes anything that it does not understand for the end.
        file.seek(archive.offset)
        if file.read(tarfile.BLOCKSIZE) != bytes(tarfile.BLOCKSIZE):
            raise Unreadable(f"it is cut or damaged after {archive.offset} bytes")


def _tar_blocks(archive: tarfile.TarFile, entry: tarfile.TarInfo) -> Iterator[bytes]:
    content = archive.extractfile(entry)
    if content is None:
        raise Unreadable(f"{entry.name!r} has no content")
    with content:
        left = entry.size
        while left:
            block = content.read(min(BLOCK, left))
            if not block:
                raise Unreadable(f"{entry.name!r} is cut")
            left -= len(block)
            yield block
