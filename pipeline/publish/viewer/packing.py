"""Arrays as one compressed run of bytes that a browser reads without a library."""

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

NAMES = {"int8": "Int8Array", "uint8": "Uint8Array", "int16": "Int16Array", "int32": "Int32Array"}


def packed(arrays: Mapping[str, np.ndarray]) -> tuple[dict[str, Any], bytes]:
    """Return where each array lies, and all of them, deflated.

    The bytes of an array are stored in planes, all lowest bytes first: the upper ones are nearly
    constant and compress to little.

    Returns
    -------
    tuple
        For each name ``type`` (a JavaScript typed array), ``shape`` and ``offset`` in bytes; a zlib stream.
    """
    described: dict[str, Any] = {}
    parts: list[bytes] = []
    offset = 0
    for name, array in arrays.items():
        values = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"))
        described[name] = {"type": NAMES[array.dtype.name], "shape": list(array.shape), "offset": offset}
        planes = values.reshape(-1).view(np.uint8).reshape(-1, array.dtype.itemsize).T
        parts.append(planes.tobytes())
        offset += values.nbytes
    return described, zlib.compress(b"".join(parts), 6)
