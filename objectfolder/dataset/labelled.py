"""Products as `xarray.Dataset`: named dimensions, units, coordinates; read when it is looked at."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.extras import needs_extra
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    import xarray

COORDINATE_NAMES = {
    3: {"channel": list("rgb"), "axis": list("xyz"), "xyz": list("xyz")},
    4: {"channel": list("rgba")},
}


def open_xarray(product: Path | str, *, chunks: Any = None) -> "xarray.Dataset":
    """Open a product of a data set.

    Every variable has `units` and `long_name`. Coordinates: ``held_out`` and other labels along the first
    dimension; ``frequency_hz`` along ``mode``; ``time_s`` along ``sample``; names of axes and channels. Where
    arrays of one product have the same dimension with several sizes (three and four channels), all but the
    smallest carry their size in the name: ``channel_4``.

    Parameters
    ----------
    product
        A ``.zarr.zip``, as ``data/views/mug.zarr.zip``.
    chunks
        None reads an array's part when its values are asked for; ``{}`` gives a dask array of a chunk an
        image (dask is needed), or anything else that `xarray.open_zarr` takes.

    Raises
    ------
    FormatError
        Not a readable product.
    MissingPackageError
        xarray or Zarr is not installed.

    Examples
    --------
    >>> views = open_xarray("views.zarr.zip")
    >>> views.rgba.dims, views.rgba.shape
    (('view', 'y', 'x', 'channel_4'), (8, 24, 24, 4))
    """
    with needs_extra("xarray"):
        import xarray
        import zarr
    path = Path(product)
    try:
        store = zarr.storage.ZipStore(path, mode="r")
        group = zarr.open_group(store, mode="r", zarr_format=3)
        shapes = {name: tuple(array.shape) for name, array in group.arrays()}
        metadata: dict[str, Any] = {name: array.metadata for name, array in group.arrays()}
        names = {name: tuple(entry.dimension_names) for name, entry in metadata.items()}
        renamed = _renamed(names, shapes)
        parts = []
        for new in sorted({tuple(sorted(rename.items())) for rename in renamed.values()}):
            rest = [name for name, rename in renamed.items() if tuple(sorted(rename.items())) != new]
            part = xarray.open_zarr(
                store, consolidated=False, zarr_format=3, drop_variables=rest, chunks=chunks
            )
            parts.append(part.rename(dict(new)))
        data = xarray.merge(parts, combine_attrs="override", join="exact", compat="no_conflicts")
    except FileNotFoundError:
        raise
    except Exception as error:  # of zarr, zipfile and JSON
        raise FormatError(
            str(path), f"not a readable product ({error})", "Fetch or make it again."
        ) from error
    return _with_coordinates(data)


def _renamed(
    names: dict[str, tuple[str, ...]], shapes: dict[str, tuple[int, ...]]
) -> dict[str, dict[str, str]]:
    """Return new names of each array's dimensions, where one name has several sizes."""
    sizes: dict[str, set[int]] = {}
    for name, dims in names.items():
        for dim, size in zip(dims, shapes[name], strict=True):
            sizes.setdefault(dim, set()).add(size)
    return {
        name: {
            dim: f"{dim}_{size}"
            for dim, size in zip(dims, shapes[name], strict=True)
            if size != min(sizes[dim])
        }
        for name, dims in names.items()
    }


def _with_coordinates(data: "xarray.Dataset") -> "xarray.Dataset":
    labels = [
        name for name in ("held_out", "reachable", "samples", "seed") if name in data and data[name].ndim == 1
    ]
    data = data.set_coords(labels)
    if "frequencies_hz" in data:
        attributes = {"units": "Hz", "long_name": "damped eigenfrequency"}
        data = data.assign_coords(frequency_hz=("mode", data["frequencies_hz"].values, attributes))
    if "sample" in data.sizes:
        time = np.arange(data.sizes["sample"]) / SAMPLE_RATE_HZ
        data = data.assign_coords(time_s=("sample", time, {"units": "s", "long_name": "time"}))
    for dim, size in data.sizes.items():
        letters = COORDINATE_NAMES.get(size, {}).get(str(dim).removesuffix(f"_{size}"))
        if letters:
            data = data.assign_coords({dim: letters})
    return data
