"""Rows of products: their chunks from the archive, never the whole of an array of images."""

import json
import os
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.extras import needs_extra
from objectfolder.products.regular_file import require_regular

PRODUCT_REMEDY = "Fetch it again, or make it again."
Value = TypeVar("Value")


@dataclass(frozen=True)
class Layout:
    """How an array lies in the archive of a product; `by_item`: an item of the first axis a chunk."""

    shape: tuple[int, ...]
    dtype: np.dtype
    by_item: bool
    fill: Any

    @classmethod
    def of_json(cls, text: bytes) -> "Layout":
        """Read the metadata of a Zarr 3 array; raises anything for what `write_product` does not write."""
        header = json.loads(text)
        shape, chunks = tuple(header["shape"]), tuple(header["chunk_grid"]["configuration"]["chunk_shape"])
        whole = tuple(max(1, size) for size in shape)
        as_bytes, compressed = header["codecs"]
        endian = as_bytes.get("configuration", {}).get("endian", "little")
        if (as_bytes["name"], endian, compressed["name"]) != ("bytes", "little", "blosc"):
            raise ValueError(f"stored by {header['codecs']}")
        if chunks not in (whole, (1, *whole[1:])):
            raise ValueError(f"shape {shape} in chunks of {chunks}")
        dtype = np.dtype(header["data_type"]).newbyteorder("<")
        return cls(shape, dtype, chunks != whole, header["fill_value"])


class ProductReader:
    """A product that stays open; an image is read alone, other arrays once and kept.

    Chunks are decoded without Zarr, which takes six times as long for a chunk of an image.

    Parameters
    ----------
    path
        A ``.zarr.zip`` of the data set.

    Raises
    ------
    FormatError
        Not a readable product.
    FileNotFoundError
        No such file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._whole: dict[str, np.ndarray] = {}
        self._layouts: dict[str, Layout] = {}
        try:
            require_regular(path)
            self._archive = zipfile.ZipFile(path)
            self.attributes: dict[str, Any] = dict(json.loads(self._archive.read("zarr.json"))["attributes"])
        except FileNotFoundError:
            raise
        except Exception as error:  # of zipfile and JSON
            raise FormatError(str(path), f"not a readable product ({error})", PRODUCT_REMEDY) from error

    def _layout(self, name: str) -> Layout:
        if name not in self._layouts:
            try:
                self._layouts[name] = Layout.of_json(self._archive.read(f"{name}/zarr.json"))
            except Exception as error:  # KeyError where there is none, and what damage makes
                raise FormatError(
                    str(self.path), f"no readable array {name} ({error})", PRODUCT_REMEDY
                ) from error
        return self._layouts[name]

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array."""
        return self._layout(name).shape

    def whole(self, name: str) -> np.ndarray:
        """Return an array, read once."""
        if name not in self._whole:
            layout = self._layout(name)
            everything = np.arange(layout.shape[0]) if layout.by_item else None
            self._whole[name] = self._read(name, everything)
        return self._whole[name]

    def rows(self, name: str, indices: np.ndarray) -> np.ndarray:
        """Return items (n, ...) of an array's first axis, reading their chunks alone where they have one."""
        if name not in self._whole and self._layout(name).by_item:
            return self._read(name, indices)
        return np.asarray(self.whole(name)[indices])

    def _read(self, name: str, indices: np.ndarray | None) -> np.ndarray:
        """Return the items of chunks, or the array that is one chunk."""
        with needs_extra("dataset"):
            import numcodecs  # noqa: F401  (Object Files alone are sampled without it)
        layout = self._layout(name)
        tail = "/0" * (len(layout.shape) - 1)
        try:
            if indices is None:
                return self._chunk(f"{name}/c/0{tail}" if layout.shape else f"{name}/c", layout, layout.shape)
            items = [self._chunk(f"{name}/c/{index}{tail}", layout, layout.shape[1:]) for index in indices]
            return np.stack(items) if items else np.empty((0, *layout.shape[1:]), layout.dtype)
        except Exception as error:  # of zipfile, Blosc and numpy
            raise FormatError(str(self.path), f"damaged array {name} ({error})", PRODUCT_REMEDY) from error

    def _chunk(self, key: str, layout: Layout, shape: tuple[int, ...]) -> np.ndarray:
        if key not in self._archive.NameToInfo:  # where all are the fill value, there is no chunk
            return np.full(shape, layout.fill, layout.dtype)
        from numcodecs import Blosc

        decoded = Blosc().decode(self._archive.read(key))
        return np.frombuffer(decoded, layout.dtype).reshape(shape)


class RecentValues(Generic[Value]):
    """The values used last, made where they are missing; a process forked from another starts with none.

    An archive open in two processes would be read at one place of both.

    Parameters
    ----------
    make
        From a key.
    most
        How many it holds.
    """

    def __init__(self, make: Callable[[Any], Value], most: int) -> None:
        self._make = make
        self._most = most
        self._values: OrderedDict[Hashable, Value] = OrderedDict()
        self._process = os.getpid()

    def __getitem__(self, key: Hashable) -> Value:
        if self._process != os.getpid():
            self._values = OrderedDict()
            self._process = os.getpid()
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key]
        self._values[key] = value = self._make(key)
        while len(self._values) > self._most:
            self._values.popitem(last=False)
        return value
