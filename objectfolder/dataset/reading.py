"""Rows of products read one at a time: a chunk from the archive, never the whole of an array of images."""

import os
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from objectfolder.errors import FormatError

REMEDY = "Fetch it again, or make it again."
Value = TypeVar("Value")


class ProductReader:
    """A product that stays open; what is stored in one chunk is read once and kept.

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
        import zarr

        self.path = path
        self._whole: dict[str, np.ndarray] = {}
        try:
            store = zarr.storage.ZipStore(path, mode="r")
            self._group: Any = zarr.open_group(store, mode="r", zarr_format=3)
        except FileNotFoundError:
            raise
        except Exception as error:  # of zarr, zipfile and JSON
            raise FormatError(str(path), f"not a readable product ({error})", REMEDY) from error
        self.attributes: dict[str, Any] = dict(self._group.attrs)
        self._arrays: dict[str, Any] = {}

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            try:
                self._arrays[name] = self._group[name]
            except Exception as error:  # KeyError where there is none, and what zarr makes of damage
                raise FormatError(str(self.path), f"no readable array {name} ({error})", REMEDY) from error
        return self._arrays[name]

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array."""
        return tuple(self._array(name).shape)

    def whole(self, name: str) -> np.ndarray:
        """Return an array, read once."""
        if name not in self._whole:
            self._whole[name] = self._read(name, ...)
        return self._whole[name]

    def row(self, name: str, index: int) -> np.ndarray:
        """Return one item of an array's first axis, reading its chunk alone where it has one."""
        if name not in self._whole and self._array(name).chunks[0] == 1:
            return self._read(name, index)
        return np.asarray(self.whole(name)[index])

    def _read(self, name: str, selection: Any) -> np.ndarray:
        try:
            return np.asarray(self._array(name)[selection])
        except FormatError:
            raise
        except Exception as error:  # of zarr, its codecs and zipfile
            raise FormatError(str(self.path), f"damaged array {name} ({error})", REMEDY) from error


class Kept(Generic[Value]):
    """The values used last, made where they are missing; a process forked from another starts with none.

    An archive open in two processes would be read at one place of both.

    Parameters
    ----------
    make
        From a key.
    most
        How many are kept.
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
