"""Streams unpacked to the size that they should have, however much a file packs into them."""

import lzma
import zlib
from collections.abc import Mapping, Sequence
from typing import Any


def unpack_lzma(data: bytes, filters: Sequence[Mapping[str, Any]], size: int) -> bytes:
    """Unpack a raw LZMA stream of `size` bytes; no more than one byte beyond is ever unpacked.

    Raises
    ------
    ValueError
        It is damaged, holds more or less, or something follows it.
    """
    unpacker = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=filters)
    try:
        content = unpacker.decompress(data, max_length=size + 1)
    except lzma.LZMAError as error:
        raise ValueError(str(error)) from error
    return _checked(content, size, unpacker.eof and not unpacker.unused_data)


def unpack_deflate(data: bytes, size: int) -> bytes:
    """Unpack a zlib stream of `size` bytes; no more than one byte beyond is ever unpacked.

    Raises
    ------
    ValueError
        It is damaged, holds more or less, or something follows it.
    """
    unpacker = zlib.decompressobj()
    try:
        content = unpacker.decompress(data, size + 1)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    return _checked(content, size, unpacker.eof and not unpacker.unused_data)


def _checked(content: bytes, size: int, ended: bool) -> bytes:
    if len(content) > size:
        raise ValueError(f"a stream of more than the {size} bytes expected")
    if len(content) < size or not ended:
        raise ValueError(f"a stream of {len(content)} bytes, or cut short, where {size} were expected")
    return content
