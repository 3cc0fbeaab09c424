"""Safetensors files: readable by the format's own library, equal bytes, damage refused."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from objectfolder.errors import FormatError
from objectfolder.products.tensor_file import (
    DTYPES,
    TensorFile,
    read_metadata,
    read_tensor_file,
    to_bytes,
    write_tensor_file,
)

arrays = hnp.arrays(
    st.sampled_from(list(DTYPES.values())), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)
)


@given(st.dictionaries(st.text("abc.", min_size=1, max_size=4), arrays, max_size=4))
def test_round_trip_and_the_formats_own_library(tensors):
    from safetensors.numpy import load

    data = to_bytes(TensorFile(tensors, {"name": "mug", "numbers": {"b": 1, "a": 0.5}}))
    theirs = load(data)
    assert set(theirs) == set(tensors)
    for name, array in tensors.items():
        assert theirs[name].dtype == array.dtype
        np.testing.assert_array_equal(theirs[name], array)
    assert data == to_bytes(
        TensorFile(dict(reversed(tensors.items())), {"numbers": {"a": 0.5, "b": 1}, "name": "mug"})
    )


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a.safetensors"
    tensors = {
        "half": np.arange(5, dtype=np.float16),
        "none": np.zeros((0, 3)),
        "byte": np.ones((2, 2), np.uint8),
    }
    write_tensor_file(path, TensorFile(tensors, {"name": "mug", "numbers": [1, 2]}))
    return path


def test_reads_back(file):
    content = read_tensor_file(file)
    np.testing.assert_array_equal(content.tensors["half"], np.arange(5))
    assert content.tensors["none"].shape == (0, 3)
    assert content.metadata["numbers"] == "[1,2]"
    assert read_metadata(file) == content.metadata


def test_any_truncation_is_refused(file):
    whole = file.read_bytes()
    for length in range(len(whole)):
        file.write_bytes(whole[:length])
        with pytest.raises(FormatError, match=r"a\.safetensors"):
            read_tensor_file(file)


def test_any_changed_bit_of_the_arrays_is_noticed(file):
    whole = file.read_bytes()
    start = 8 + int.from_bytes(whole[:8], "little")
    for position in range(start, len(whole)):
        damaged = bytearray(whole)
        damaged[position] ^= 1
        file.write_bytes(damaged)
        with pytest.raises(FormatError, match="digest"):
            read_tensor_file(file)


def test_foreign_files_are_refused_by_name(subtests, file):
    for content in [
        b"",
        b"PK\x03\x04",
        b"\xff" * 64,
        b"\x02" + bytes(7) + b"[]",
        b"\x02" + bytes(7) + b"{}" + b"tail",
    ]:
        with subtests.test(content=content):
            file.write_bytes(content)
            with pytest.raises(FormatError, match=r"a\.safetensors"):
                read_tensor_file(file)


def test_types_the_format_lacks_are_refused():
    with pytest.raises(ValueError, match="complex"):
        to_bytes(TensorFile({"x": np.zeros(2, complex)}))


HUGE = 10**11
SHAPES = [[1] * 70, [10**400], [HUGE], [0] + [1 << 61] * 7, [-1], [-1, -1], [True], [1.0], "1", None]


@pytest.mark.parametrize(
    "described",
    [
        *({"shape": shape} for shape in SHAPES),
        {"dtype": ["F64"]},
        {"data_offsets": [0, HUGE]},
        {"data_offsets": [0, 8, 8]},
    ],
    ids=str,
)
def test_descriptions_that_no_array_has(tmp_path, described):
    size = 0 if described.get("shape") == SHAPES[3] else 8
    array = {"dtype": "F64", "shape": [1], "data_offsets": [0, size]} | described
    path = written(tmp_path / "shape.safetensors", {"a": array}, size)
    with pytest.raises(FormatError, match=r"shape\.safetensors"):
        read_tensor_file(path)


@pytest.mark.parametrize("header", [{"__metadata__": {"a": 1}}, ["x"]], ids=str)
def test_headers_that_are_none(tmp_path, header):
    path = written(tmp_path / "header.safetensors", header, 8)
    with pytest.raises(FormatError, match=r"header\.safetensors"):
        read_tensor_file(path)
    path.write_bytes((1 << 62).to_bytes(8, "little") + path.read_bytes()[8:])
    with pytest.raises(FormatError, match="truncated"):
        read_tensor_file(path)


def written(path, header, size):
    """A file of a header and some zeros."""
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + bytes(size))
    return path
