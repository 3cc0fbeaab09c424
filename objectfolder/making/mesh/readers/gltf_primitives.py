"""The numbers of a primitive of a glTF file: its attributes and the vertices of its corners."""

from typing import Any

import numpy as np

from objectfolder.extras import needs_extra
from objectfolder.making.mesh.readers.gltf_file import DRACO, Gltf, Json, extensions, whole

_BRIGHTEST = 2.0
"""Colours of vertices above it are not in 0..1."""
_OPAQUE = 0.99

MOST_VALUES = 2**23
"""Of an accessor without bytes of its own, whose length nothing else bounds."""

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Primitive:
    """The attributes and corners of a primitive.

    Parameters
    ----------
    file
        The file it is in.
    primitive
        Its JSON.

    Raises
    ------
    ValueError
        What the file says of it does not fit its bytes.
    """

    def __init__(self, file: Gltf, primitive: Json) -> None:
        self._file = file
        self._accessors: Json = dict(primitive["attributes"])
        self._indices = primitive.get("indices")
        self._compressed: dict[str, np.ndarray] = {}
        self._faces: np.ndarray | None = None
        compression = extensions(primitive).get(DRACO)
        if compression is not None:
            self._decompress(compression)

    def __contains__(self, name: str) -> bool:
        return name in self._accessors

    def stored(self, name: str) -> np.ndarray:
        """Return an attribute (n, width) in the type it is stored in."""
        if name in self._compressed:
            return self._compressed[name]
        return _stored(self._file, self._file.entry("accessors", self._accessors[name]))

    def values(self, name: str) -> np.ndarray:
        """Return an attribute (n, width) as float64, normalised where the file says so."""
        accessor = self._file.entry("accessors", self._accessors[name])
        attribute = self.stored(name)
        if accessor.get("normalized", False) and attribute.dtype.kind in "iu":
            return np.maximum(attribute / np.iinfo(attribute.dtype).max, -1.0)
        return attribute.astype(np.float64)

    def colours(self, name: str) -> np.ndarray:
        """Return an attribute of colours (n, 3) in 0..1, scene-linear.

        Whole numbers are fractions of their type's range, as glTF has them, also where the file does not say
        so. Floats above 1 are in 0..255, and a remark says so.
        """
        stored = self.stored(name)
        opaque = np.iinfo(stored.dtype).max if stored.dtype.kind == "u" else 1.0
        if stored.shape[1] == 4 and (stored[:, 3] < _OPAQUE * opaque).any():
            self._file.remark(f"the alpha of {name} is not used")
        colours = stored[:, :3].astype(np.float64) / opaque
        most = float(np.nanmax(colours, initial=0.0))
        if most <= _BRIGHTEST:
            return colours
        self._file.remark(f"{name} goes up to {most:g}: its colours are taken to be in 0..255")
        return colours / 255

    def corners(self, count: int) -> np.ndarray:
        """Return the vertex of each corner (n,) in order; of `count` vertices."""
        if self._faces is not None:
            indices = self._faces.reshape(-1)
        elif self._indices is None:
            indices = np.arange(count)
        else:
            accessor = self._file.entry("accessors", self._indices)
            indices = _stored(self._file, accessor)
            if indices.shape[1] != 1 or indices.dtype.kind != "u":
                raise ValueError("indices that are no whole numbers")
            indices = indices.reshape(-1)
        if len(indices) and int(indices.max()) >= count:
            raise ValueError(f"a face names vertex {int(indices.max())} of {count}")
        return indices.astype(np.int64)

    def _decompress(self, compression: Json) -> None:
        with needs_extra("factory"):
            import DracoPy
        try:
            decoded = DracoPy.decode(bytes(self._file.view(compression["bufferView"])))
        except Exception as problem:  # the decoder may raise anything
            raise ValueError(f"its Draco data cannot be decoded: {problem}") from problem
        by_number = {entry["unique_id"]: entry["data"] for entry in decoded.attributes}
        for name, number in compression["attributes"].items():
            values = np.asarray(by_number[number])
            values = values.reshape(len(values), -1)
            accessor = self._file.entry("accessors", self._accessors[name])
            if values.shape != (whole(accessor["count"]), _WIDTHS[accessor["type"]]):
                raise ValueError(f"its Draco data do not hold what it says of {name}")
            self._compressed[name] = values
        faces = np.asarray(getattr(decoded, "faces", np.zeros(0)))
        if faces.size == 0 or faces.min() < 0:
            raise ValueError("its Draco data hold no faces")
        self._faces = faces


def _stored(file: Gltf, accessor: Json) -> np.ndarray:
    kind, width, count = (
        np.dtype(_TYPES[accessor["componentType"]]),
        _WIDTHS[accessor["type"]],
        accessor["count"],
    )
    count = whole(count)
    if "bufferView" in accessor:
        view = file.entry("bufferViews", accessor["bufferView"])
        stride = whole(view.get("byteStride", kind.itemsize * width))
        data = file.view(accessor["bufferView"])
        values = _strided(data, whole(accessor.get("byteOffset", 0)), kind, count, width, stride)
    elif "sparse" in accessor:
        if count * width > MOST_VALUES:
            raise ValueError(f"an accessor of {count} values without bytes")
        values = np.zeros((count, width), kind)
    else:
        raise ValueError("an accessor without bytes")
    if "sparse" in accessor:
        _overwrite(file, values, accessor["sparse"])
    return values


def _strided(
    data: memoryview, start: int, kind: np.dtype[Any], count: int, width: int, stride: int
) -> np.ndarray:
    """Copy of (count, width) values whose rows are `stride` bytes apart."""
    row = kind.itemsize * width
    if stride < row or (count and start + (count - 1) * stride + row > len(data)):
        raise ValueError(f"an accessor of {count} values ends behind its bytes")
    if not count:
        return np.zeros((0, width), kind)
    return np.ndarray((count, width), kind, data, start, (stride, kind.itemsize)).copy()


def _overwrite(file: Gltf, values: np.ndarray, sparse: Json) -> None:
    count = whole(sparse["count"])
    places, replaced = sparse["indices"], sparse["values"]
    kind = np.dtype(_TYPES[places["componentType"]])
    rows = _strided(
        file.view(places["bufferView"]), whole(places.get("byteOffset", 0)), kind, count, 1, kind.itemsize
    )[:, 0]
    width = values.shape[1]
    new = _strided(
        file.view(replaced["bufferView"]), whole(replaced.get("byteOffset", 0)), values.dtype, count, width,
        width * values.dtype.itemsize,
    )  # fmt: skip
    if kind.kind != "u" or (count and int(rows.max()) >= len(values)):
        raise ValueError("a sparse accessor names a value that is not there")
    values[rows] = new
