"""Descriptions of products, read from a few bytes of a local or a remote file.

A Zarr archive has its attributes in an entry that `objectfolder.products.store.write_product` puts last,
right before the list of entries; the list has a checksum of every chunk. A safetensors file has all of it
in front. Both may come from others: only lengths that fit into the file are believed.
"""

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, BinaryIO

from pydantic_core import from_json

from objectfolder.errors import FormatError
from pipeline.dataset.archives import (
    CENTRAL,
    CENTRAL_MARK,
    END,
    END_MARK,
    GROUP,
    LARGEST_JSON_BYTES,
    LOCAL,
    read_json,
)
from pipeline.dataset.products import TENSORS

REMEDY = "See `objectfolder verify`; fetch it again (`dvc fetch`), or delete it and run `dvc repro`."
TAIL_BYTES = 1 << 16
# An entry of an archive's list: its mark, checksum and sizes, length of its name, first folder and rest. An
# audit of a thousand objects reads ten thousand lists: too many for zipfile.
_ENTRY = re.compile(
    rb"PK\x01\x02.{12}(.{12})(..)\0{4}.{12}([\x20-\x2e0-\x7e]+)([\x20-\x7e]*)(?=PK\x01\x02|\Z)", re.DOTALL
)
_ZIP64 = 0xFFFF, 0xFFFFFFFF


@dataclass(frozen=True)
class Description:
    """Attributes of a product, and checksums of its arrays.

    Parameters
    ----------
    attributes
        As `pipeline.dataset.products.read_description` returns them, provenance and all.
    listing
        The list of entries of an archive; empty where the format keeps no checksums of single arrays.
    """

    attributes: Mapping[str, Any]
    listing: bytes = field(default=b"", repr=False)

    @cached_property
    def provenance(self) -> Mapping[str, Any]:
        """What it was made from."""
        return _mapping(self.attributes.get("provenance"))

    @property
    def fingerprint(self) -> str:
        """The fingerprint it carries; empty where it has none."""
        found = self.attributes.get("fingerprint")
        return found if isinstance(found, str) else ""

    @property
    def chunks(self) -> set[tuple[bytes, bytes, bytes, bytes]]:
        """Checksum (CRC-32) and sizes, length of the name, array, and rest of the name of every entry.

        Raises
        ------
        ValueError
            A damaged list of entries.
        """
        found = _ENTRY.findall(self.listing)
        names = sum(struct.unpack(f"<{len(found)}H", b"".join([entry[1] for entry in found])))
        if CENTRAL.size * len(found) + names != len(self.listing):
            raise ValueError("its list of entries is damaged")
        if names != len(b"".join([entry[2] + entry[3] for entry in found])):
            raise ValueError("its list of entries is damaged: a name is longer or shorter than it says")
        return set(found)


def read(file: BinaryIO, size: int, suffix: str, where: str) -> Description:
    """Read the description of a product; only parts of the file are read.

    Parameters
    ----------
    size
        Length of the file, bytes.
    suffix
        `pipeline.dataset.products.ZARR` or `TENSORS`.
    where
        What to call it in errors.

    Raises
    ------
    FormatError
        Not a product, or a damaged one.
    """
    try:
        found = _of_tensors(file, size) if suffix == TENSORS else _of_archive(file, size)
        if not isinstance(found.attributes, dict):
            raise ValueError("its attributes have no names")
    except (
        zipfile.BadZipFile, struct.error, LookupError, TypeError, ValueError, RuntimeError, EOFError,
    ) as error:  # fmt: skip
        raise FormatError(where, f"not a readable product ({error})", REMEDY) from error
    return found


def _of_archive(file: BinaryIO, size: int) -> Description:
    """Read the end of an archive; one that does not lie there as a product's does is left to zipfile."""
    first = max(0, size - TAIL_BYTES)
    tail = _span(file, first, size)
    if len(tail) < END.size:
        raise ValueError(f"{size} bytes are no archive")
    mark, *disks, _, count, length, start, comment = END.unpack_from(tail, len(tail) - END.size)
    end = size - END.size
    if (mark, *disks, comment) != (END_MARK, 0, 0, 0) or count == _ZIP64[0] or start + length != end:
        return _by_zipfile(file)
    if start < first and length <= LARGEST_JSON_BYTES:
        first, tail = start, _span(file, start, size)
    listing = tail[max(0, start - first) : end - first]
    # The last entry, where the writer puts the attributes.
    last = len(listing) - CENTRAL.size - len(GROUP)
    if start < first or last < 0 or not listing.endswith(GROUP.encode()):
        return _by_zipfile(file)
    mark, _, _, flags, method, _, _, checksum, packed, plain, *lengths = CENTRAL.unpack_from(listing, last)
    begin = lengths[-1] + LOCAL.size + len(GROUP)
    if (mark, flags, method, *lengths[:3]) != (CENTRAL_MARK, 0, zipfile.ZIP_STORED, len(GROUP), 0, 0):
        return _by_zipfile(file)
    if plain > LARGEST_JSON_BYTES or packed != plain or begin + plain != start:
        raise ValueError(f"its attributes of {plain} bytes do not lie where a product has them")
    text = tail[begin - first : start - first] if begin >= first else _span(file, begin, start)
    if zlib.crc32(text) != checksum:
        raise ValueError("its attributes are damaged")
    return Description(from_json(text)["attributes"], listing)


def _by_zipfile(file: BinaryIO) -> Description:
    """Read an archive of more entries than the plain form of the format can name, or of another order."""
    with zipfile.ZipFile(file) as archive:
        attributes = read_json(archive, archive.getinfo(GROUP))["attributes"]
        listing = io.BytesIO()
        for one in archive.infolist():
            name = one.filename.encode()
            numbers = (0, 0, 0, 0, 0, 0, one.CRC, one.file_size & _ZIP64[1], one.file_size & _ZIP64[1])
            listing.write(CENTRAL.pack(CENTRAL_MARK, *numbers, len(name), 0, 0, 0, 0, 0, 0) + name)
    return Description(attributes, listing.getvalue())


def _of_tensors(file: BinaryIO, size: int) -> Description:
    head = _span(file, 0, min(size, TAIL_BYTES))
    length = int.from_bytes(head[:8], "little")
    if size < 8 or length > min(LARGEST_JSON_BYTES, size - 8):
        raise ValueError(f"not a safetensors file, or truncated ({size} bytes)")
    text = head[8 : 8 + length] if 8 + length <= len(head) else _span(file, 8, 8 + length)
    header = from_json(text)
    attributes = header.get("__metadata__", {})
    ends = [entry["data_offsets"][1] for name, entry in header.items() if name != "__metadata__"]
    if max(ends, default=0) != size - 8 - length:
        raise ValueError(f"truncated: {size} bytes where {8 + length + max(ends, default=0)} are described")
    return Description(attributes)


def _span(file: BinaryIO, begin: int, end: int) -> bytes:
    file.seek(begin)
    data = file.read(end - begin)
    if len(data) != end - begin:
        raise EOFError(f"it ends before byte {end}")
    return data


def _mapping(value: Any) -> Mapping[str, Any]:
    """Return a mapping that may be stored as JSON text; empty for anything else."""
    if isinstance(value, str):
        try:
            value = from_json(value)
        except (ValueError, RecursionError):
            return {}
    return value if isinstance(value, dict) else {}
