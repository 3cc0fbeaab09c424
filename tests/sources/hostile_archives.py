"""Archives as anybody might make them: any names, kinds, flags and sizes, whole or damaged."""

import gzip
import io
import struct
import tarfile
import warnings
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

KINDS = ("zip", "tgz")


def zipped(members: Iterable[tuple[str, bytes]], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Names as they are given, ``/`` at the end for a folder."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, content in members:
            entry = zipfile.ZipInfo("x", (2020, 1, 1, 0, 0, 0))
            entry.filename = entry.orig_filename = name  # which the constructor would mend
            entry.compress_type = compression
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of names that are there already
                archive.writestr(entry, content)
    return stream.getvalue()


def tarred(members: Iterable[tuple[str, bytes]], kind: bytes = tarfile.REGTYPE, **more: object) -> bytes:
    """Names as they are given; all members of one kind, but those with ``/`` at the end are folders."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, content in members:
            entry = tarfile.TarInfo(name)
            entry.type = tarfile.DIRTYPE if name.endswith("/") else kind
            entry.size = len(content) if entry.isreg() else 0
            for attribute, value in more.items():
                setattr(entry, attribute, value)
            archive.addfile(entry, io.BytesIO(content))
    return stream.getvalue()


def tgz(members: Iterable[tuple[str, bytes]]) -> bytes:
    return gzip.compress(tarred(members), mtime=0)


MAKERS: dict[str, Callable[[Iterable[tuple[str, bytes]]], bytes]] = {"zip": zipped, "tgz": tgz}


def patched_zip(content: bytes, field: int, value: int, width: str = "<H") -> bytes:
    """A zip of one member with a field of its directory's entry, by its offset there, set to a value."""
    place = content.rindex(b"PK\1\2") + field
    return content[:place] + struct.pack(width, value) + content[place + struct.calcsize(width) :]


def patched_tar(content: bytes, size_field: bytes) -> bytes:
    """A tar whose first header declares another size, its checksum right."""
    header = bytearray(content[:512])
    header[124:136] = size_field
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\0 " % sum(header)
    return bytes(header) + content[512:]


def long_names(count: int) -> bytes:
    """A tar of headers that each announce the name of the next."""
    entry = tarfile.TarInfo("././@LongLink")
    entry.type, entry.size = tarfile.GNUTYPE_LONGNAME, 1
    header = entry.tobuf(tarfile.GNU_FORMAT) + b"x".ljust(512, b"\0")
    return header * count + bytes(1024)


def tree(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }
