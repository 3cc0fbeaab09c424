"""Products in xarray: named, with units, and read only where they are looked at."""

import numpy as np
import pytest

from objectfolder.dataset import open_xarray
from objectfolder.errors import FormatError
from objectfolder.products.store import Array, Product, read_product, write_product


@pytest.mark.parametrize("kind", ["views", "modes", "touches"])
def test_every_array_is_there_with_units(small_set, kind):
    path = small_set / f"data/{kind}/bar.zarr.zip"
    stored, opened = read_product(path), open_xarray(path)
    for name, array in stored.arrays.items():
        assert np.array_equal(opened[name].values, array.data, equal_nan=array.data.dtype.kind == "f"), name
        assert opened[name].attrs["units"] == array.units
        assert opened[name].attrs["long_name"] == array.long_name
        assert [str(dim).partition("_")[0] for dim in opened[name].dims] == list(array.dims)
    assert stored.attributes
    assert opened.attrs == stored.attributes


def test_coordinates_select_what_is_meant(small_set):
    views = open_xarray(small_set / "data/views/bar.zarr.zip")
    held_out = views.isel(view=views.held_out.values)
    assert held_out.sizes["view"] == 2
    assert views.rgba.sel(channel_4="a").dims == ("view", "y", "x")
    assert views.albedo.sel(channel="r").shape == views.mask.shape
    modes = open_xarray(small_set / "data/modes/bar.zarr.zip")
    assert modes.frequency_hz.attrs["units"] == "Hz"
    low = modes.mode_shapes.where(modes.frequency_hz < 5000, drop=True)
    assert low.sizes["mode"] == int((modes.frequencies_hz < 5000).sum())
    assert modes.mode_shapes.sel(axis="z").dims == ("point", "mode")


def test_an_array_is_read_when_it_is_looked_at(small_set, monkeypatch):
    import zarr

    read = []
    original = zarr.storage.ZipStore.get

    async def noted(self, key, *rest, **more):
        read.append(key)
        return await original(self, key, *rest, **more)

    monkeypatch.setattr(zarr.storage.ZipStore, "get", noted)
    views = open_xarray(small_set / "data/views/bar.zarr.zip")
    assert not [key for key in read if key.startswith("rgba/c/")]
    views.rgba[2].load()
    assert {key for key in read if key.startswith("rgba/c/")} == {"rgba/c/2/0/0/0"}


def test_dask_arrays_have_a_chunk_an_image(small_set):
    views = open_xarray(small_set / "data/views/bar.zarr.zip", chunks={})
    assert views.rgba.data.chunksize == (1, 24, 24, 4)
    assert float(views.mask.mean()) > 0


def test_an_object_without_modes_opens(tmp_path):
    none = Array(np.zeros(0), ("mode",), "Hz", "damped eigenfrequency")
    shapes = Array(np.zeros((5, 3, 0), np.float32), ("point", "axis", "mode"), "kg-1/2", "mode shape")
    path = tmp_path / "die.zarr.zip"
    write_product(path, Product({"frequencies_hz": none, "mode_shapes": shapes}))
    assert open_xarray(path).sizes["mode"] == 0


def test_a_damaged_product_is_said(tmp_path):
    (tmp_path / "x.zarr.zip").write_bytes(b"PK nothing")
    with pytest.raises(FormatError, match="not a readable product"):
        open_xarray(tmp_path / "x.zarr.zip")
    with pytest.raises(FileNotFoundError):
        open_xarray(tmp_path / "y.zarr.zip")
