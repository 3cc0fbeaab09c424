"""Products: equal data, equal bytes; whole or not there."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.errors import FormatError
from objectfolder.products.store import Array, Product, read_attributes, read_product, write_product
from pipeline.dataset import archives


def _product() -> Product:
    random = np.random.default_rng(0)
    return Product(
        {
            "rgba": Array(
                random.random((3, 32, 32, 4)).astype(np.float16),
                ("view", "y", "x", "channel"),
                "1",
                "radiance",
            ),
            "frequencies_hz": Array(np.zeros(0), ("mode",), "Hz", "frequencies of no mode"),
            "held_out": Array(np.array([True, False, True]), ("view",), "1", "held out"),
        },
        {"name": "mug", "size": {"metres": 0.1}},
    )


def test_what_is_written_is_read(tmp_path: Path) -> None:
    write_product(tmp_path / "mug.zarr.zip", _product())
    read = read_product(tmp_path / "mug.zarr.zip")
    for name, array in _product().arrays.items():
        np.testing.assert_array_equal(read[name], array.data)
        assert read.arrays[name].dims == array.dims
        assert read.arrays[name].units == array.units
    assert read.attributes == _product().attributes == read_attributes(tmp_path / "mug.zarr.zip")
    assert set(read_product(tmp_path / "mug.zarr.zip", ("held_out",)).arrays) == {"held_out"}


def test_equal_products_have_equal_bytes(tmp_path: Path) -> None:
    write_product(tmp_path / "a.zarr.zip", _product())
    write_product(tmp_path / "b.zarr.zip", read_product(tmp_path / "a.zarr.zip"))
    assert (tmp_path / "a.zarr.zip").read_bytes() == (tmp_path / "b.zarr.zip").read_bytes()


def test_a_failed_write_leaves_the_old_product_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "mug.zarr.zip"
    write_product(path, _product())
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        write_product(path, _product().with_attributes(noise_floor_db=float("nan")))
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["mug.zarr.zip"]


@given(st.floats(0.0, 0.999))
def test_a_truncated_product_is_refused_by_name(
    tmp_path_factory: pytest.TempPathFactory, share: float
) -> None:
    path = tmp_path_factory.mktemp("store") / "mug.zarr.zip"
    write_product(path, _product())
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    for read in (read_product, read_attributes):
        with pytest.raises(FormatError, match=r"mug\.zarr\.zip"):
            read(path)


def test_an_archive_without_a_group_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "mug.zarr.zip"
    write_product(path, _product())
    path.write_bytes(path.read_bytes() + b"PK\5\6" + bytes(18))  # the end of an empty archive
    for read in (read_product, read_attributes):
        with pytest.raises(FormatError, match=r"mug\.zarr\.zip"):
            read(path)
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "other.zarr.zip")


@pytest.mark.parametrize(
    ("shape", "chunks", "fill"),
    [([10**15, 4], [3, 4], 0.0), ([3.0, 4], [3, 4], 0.0), ([3, 4], [0, 0], 0.0), ([3, 4], [3, 4], "none")],
    ids=["petabytes", "fraction", "empty chunks", "filled with text"],
)
def test_a_description_that_promises_what_cannot_be_is_refused(tmp_path, shape, chunks, fill):
    path, damaged_path = tmp_path / "mug.zarr.zip", tmp_path / "other.zarr.zip"
    write_product(path, Product({"values": Array(np.ones((3, 4)), ("row", "column"), "1", "values")}, {}))
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(damaged_path, "w") as changed:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "values/zarr.json":
                described = json.loads(content) | {"shape": shape, "fill_value": fill}
                described["chunk_grid"]["configuration"]["chunk_shape"] = chunks
                content = json.dumps(described).encode()
            changed.writestr(name, content)
    for read in (read_product, archives.check):
        with pytest.raises(FormatError, match=r"other\.zarr\.zip"):
            read(damaged_path)


def test_an_array_that_is_not_there_is_named(tmp_path: Path) -> None:
    write_product(tmp_path / "mug.zarr.zip", _product())
    with pytest.raises(FormatError, match="depth"):
        read_product(tmp_path / "mug.zarr.zip", ("depth",))


def test_dims_must_fit_the_array() -> None:
    with pytest.raises(ValueError, match="axes"):
        Array(np.zeros((2, 2)), ("x",), "1", "a square")
