"""Products: named arrays with dimensions and units, one Zarr 3 archive an object and task.

Equal products have equal bytes: entries are packed stored, in sorted order and with a fixed date
(Zarr's own ``ZipStore`` stamps the time of writing). A product appears under its name only when it
is whole.
"""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.extras import needs_extra
from objectfolder.products.atomic import atomic_write
from objectfolder.products.regular_file import open_regular, require_regular

ZIP_DATE = (1980, 1, 1, 0, 0, 0)
REMAKE = "Delete it; a run makes it again."


@dataclass(frozen=True)
class Array:
    """An array with what a reader needs to use it.

    Parameters
    ----------
    data
        The values.
    dims
        A name for each axis of `data`.
    units
        Unit of the values; ``"1"`` for a pure number.
    long_name
        What the values are, in words.
    chunk_first
        Store one item of the first axis a chunk (an image, a contact), else all in one.
    """

    data: np.ndarray
    dims: tuple[str, ...]
    units: str
    long_name: str
    chunk_first: bool = True

    def __post_init__(self) -> None:
        if len(self.dims) != self.data.ndim:
            raise ValueError(f"{self.long_name}: {self.data.ndim} axes but dims {self.dims}")


@dataclass(frozen=True)
class Product:
    """What a task yields: arrays by name, and JSON attributes."""

    arrays: Mapping[str, Array]
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name].data

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def with_attributes(self, **more: Any) -> "Product":
        """Return the same arrays with attributes added or replaced."""
        return Product(self.arrays, {**self.attributes, **more})


def write_product(path: Path | str, product: Product) -> None:
    """Write `product` as a Zarr 3 group in one stored zip archive, atomically and reproducibly.

    Raises
    ------
    ValueError
        An attribute that JSON cannot hold (NaN included).
    """
    with needs_extra("factory"):
        import zarr
    path = Path(path)
    json.dumps(product.attributes, allow_nan=False)
    store: dict[str, Any] = {}
    group = zarr.open_group(zarr.storage.MemoryStore(store), mode="w", zarr_format=3)
    group.attrs.update(dict(product.attributes))
    for name in sorted(product.arrays):
        _write_array(group, name, product.arrays[name])
    with atomic_write(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for key in sorted(store):
            entry = zipfile.ZipInfo(key, ZIP_DATE)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, store[key].to_bytes())


def _write_array(group: Any, name: str, array: Array) -> None:
    from zarr.codecs import BloscCodec, BloscShuffle

    data = np.ascontiguousarray(array.data)
    chunks = tuple(max(1, size) for size in data.shape)
    if array.chunk_first and data.ndim > 1 and data[:1].nbytes > 4096:
        chunks = (1, *chunks[1:])
    stored = group.create_array(
        name,
        shape=data.shape,
        dtype=data.dtype,
        chunks=chunks,
        dimension_names=array.dims,
        compressors=BloscCodec(cname="zstd", clevel=5, shuffle=BloscShuffle.shuffle),
        attributes={"units": array.units, "long_name": array.long_name, "chunk_first": array.chunk_first},
    )
    if data.size:
        stored[...] = data


def _open(path: Path) -> Any:
    with needs_extra("factory"):
        import zarr
    try:
        require_regular(path)
        return zarr.open_group(zarr.storage.ZipStore(path, mode="r"), mode="r", zarr_format=3)
    except Exception as error:  # an archive without a group is a FileNotFoundError of Zarr's, too
        if not path.exists():
            raise
        raise FormatError(
            str(path),
            f"not a readable product ({type(error).__name__}: {error})",
            REMAKE,
        ) from error


def read_product(path: Path | str, names: tuple[str, ...] | None = None) -> Product:
    """Read a product, or only the arrays `names` of it.

    Raises
    ------
    FormatError
        A truncated or foreign file, or an array that is not there.

    Examples
    --------
    >>> views = read_product("views.zarr.zip", ("held_out",))
    >>> int(views["held_out"].sum())  # of eight views
    2
    """
    path = Path(path)
    group = _open(path)
    try:
        available = tuple(group.array_keys())
        missing = set(names or ()) - set(available)
        if missing:
            raise FormatError(str(path), f"no array {sorted(missing)}, only {sorted(available)}")
        arrays = {}
        for name in sorted(names if names is not None else available):
            stored = group[name]
            arrays[name] = Array(
                np.asarray(stored[...]),
                tuple(stored.metadata.dimension_names),
                stored.attrs["units"],
                stored.attrs["long_name"],
                stored.attrs["chunk_first"],
            )
        return Product(arrays, dict(group.attrs))
    except FormatError:
        raise
    except Exception as error:  # of Zarr and its codecs, and memory that a description promises to fill
        raise FormatError(str(path), f"damaged product ({error})", REMAKE) from error
    finally:
        group.store.close()


def read_attributes(path: Path | str) -> dict[str, Any]:
    """Read only the attributes of a product."""
    path = Path(path)
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            attributes = json.loads(archive.read("zarr.json"))["attributes"]
    except FileNotFoundError:
        raise
    except Exception as error:  # of zipfile and JSON
        raise FormatError(str(path), f"not a readable product ({error})", REMAKE) from error
    assert isinstance(attributes, dict)
    return attributes
