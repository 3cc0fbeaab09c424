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
from objectfolder.products.tensor_file import metadata_of
from pipeline.dataset.archives import END, GROUP, UNREADABLE, attributes_of, describe
from pipeline.dataset.products import TENSORS

REMEDY = "See `objectfolder verify`; fetch it again (`dvc fetch`), or delete it and run `dvc repro`."
TAIL_BYTES = 1 << 16
# An entry of an archive's list: its mark, checksum and sizes, length of its name, first folder and rest. An
# audit of a thousand objects reads ten thousand lists: too many for zipfile.
_ENTRY = re.compile(
    rb"PK\x01\x02.{12}(.{12})(..)\0{4}.{12}([\x20-\x2e0-\x7e]+)([\x20-\x7e]*)(?=PK\x01\x02|\Z)", re.DOTALL
)
ENTRY_BYTES = 46  # of it, up to the name


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
        return mapping(self.attributes.get("provenance"))

    @property
    def fingerprint(self) -> str:
        """The fingerprint it carries; empty where it has none."""
        value = self.attributes.get("fingerprint")
        return value if isinstance(value, str) else ""

    @property
    def chunks(self) -> set[tuple[bytes, bytes, bytes, bytes]]:
        """Checksum (CRC-32) and sizes, length of the name, array, and rest of the name of every entry.

        Raises
        ------
        ValueError
            A damaged list of entries.
        """
        entries = _ENTRY.findall(self.listing)
        names = sum(struct.unpack(f"<{len(entries)}H", b"".join([entry[1] for entry in entries])))
        if ENTRY_BYTES * len(entries) + names != len(self.listing):
            raise ValueError("its list of entries is damaged")
        if names != len(b"".join([entry[2] + entry[3] for entry in entries])):
            raise ValueError("its list of entries is damaged: a name is longer or shorter than it says")
        return set(entries)


def read(file: BinaryIO, suffix: str, where: str) -> Description:
    """Read the description of a product; only parts of the file are read.

    Parameters
    ----------
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
        return Description(metadata_of(where, file)) if suffix == TENSORS else _of_archive(file)
    except UNREADABLE as error:
        raise FormatError(where, f"not a readable product ({error})", REMEDY) from error


def _of_archive(file: BinaryIO) -> Description:
    """Read the end of an archive: the attributes, the list of entries, and the offset of that list."""
    tail_start = max(0, file.seek(0, io.SEEK_END) - TAIL_BYTES)
    file.seek(tail_start)
    tail = file.read(TAIL_BYTES)
    *_, length, start, _ = END.unpack(tail[-END.size :])
    file.seek(start)
    listing = tail[start - tail_start : -END.size] if start >= tail_start else file.read(length)
    if listing.endswith(GROUP.encode()):
        checksum, _, count = struct.unpack_from("<3L", listing, len(listing) - len(GROUP) - ENTRY_BYTES + 16)
        text = tail[start - tail_start - count : start - tail_start]
        if zlib.crc32(text) == checksum:
            return Description(attributes_of(text), listing)
    with zipfile.ZipFile(file) as archive:  # long attributes, or in another place; or a damaged archive
        return Description(describe(archive, ())[0], listing)


def mapping(value: Any) -> Mapping[str, Any]:
    """Return a mapping that may be stored as JSON text; empty for anything else."""
    if isinstance(value, str):
        try:
            value = from_json(value)
        except (ValueError, RecursionError):
            return {}
    return value if isinstance(value, dict) else {}
