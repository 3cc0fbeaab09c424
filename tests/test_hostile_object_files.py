"""Object Files of strangers: streams longer than they should be, and numbers no object has, are refused."""

import json
import lzma
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from objectfolder.audio import audionet
from objectfolder.errors import FormatError
from objectfolder.geometry import surface_codec
from objectfolder.object_file import ObjectFile
from objectfolder.tensor_file import TensorFile, read_tensor_file, write_tensor_file
from objectfolder.unpacking import unpack_deflate, unpack_lzma
from objectfolder.vision.sparse_grid import LARGEST_RESOLUTION, SparseGrid

MEGABYTE = 1 << 20
ENOUGH = 96 * MEGABYTE  # the window of LZMA's preset alone is 64
BOMB = bytes(256 * MEGABYTE)
QUICK = [{"id": lzma.FILTER_LZMA2, "preset": 0}]

Tensors = dict[str, np.ndarray]
Metadata = dict[str, Any]


def stream(data: bytes) -> np.ndarray:
    return np.frombuffer(data, dtype=np.uint8)


@pytest.fixture(scope="module")
def lzma_bomb() -> bytes:
    return lzma.compress(BOMB, lzma.FORMAT_RAW, filters=QUICK)


@pytest.fixture(scope="module")
def deflate_bomb() -> bytes:
    return zlib.compress(BOMB, 1)


@pytest.fixture
def changed(small_file: Path, tmp_path: Path) -> Callable[[Tensors, Metadata], Path]:
    """Write the small Object File with tensors and fields of its metadata replaced, its digest right."""
    content = read_tensor_file(small_file)

    def write(tensors: Tensors, fields: Metadata) -> Path:
        metadata = dict(content.metadata)
        for key, values in fields.items():
            metadata[key] = {**json.loads(metadata[key]), **values}
        path = tmp_path / "hostile.safetensors"
        write_tensor_file(path, TensorFile({**content.tensors, **tensors}, metadata))
        return path

    return write


def refused(path: Path, match: str) -> None:
    """It is refused by name, in little memory."""
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match=rf"hostile\.safetensors.*{match}"):
            ObjectFile.load(path)
        assert tracemalloc.get_traced_memory()[1] < ENOUGH
    finally:
        tracemalloc.stop()


def test_the_file_itself_opens_within_what_is_allowed(changed):
    tracemalloc.start()
    try:
        ObjectFile.load(changed({}, {}))
        assert tracemalloc.get_traced_memory()[1] < ENOUGH
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["surface.connectivity", "surface.positions"])
def test_a_surface_that_unpacks_to_more(name, changed, lzma_bomb):
    refused(changed({name: stream(b"\x01" + lzma_bomb)}, {}), "more than the")


@pytest.mark.parametrize(
    ("counts", "planes"),
    [((1 << 40, 12), 0), ((8, 1 << 40), 1), ((-1, 12), 255), ((8, 0), 1), ((1 << 62, 1 << 62), 255)],
)
def test_a_surface_of_more_than_there_are(counts, planes, changed, lzma_bomb):
    streams = {
        name: stream(bytes([planes]) + lzma_bomb) for name in ("surface.connectivity", "surface.positions")
    }
    refused(changed({"surface.counts": np.array(counts), **streams}, {}), "vertices and")


def test_numbers_of_too_many_bytes(changed, lzma_bomb):
    refused(changed({"surface.positions": stream(b"\xff" + lzma_bomb)}, {}), "255 bytes")


def test_detours_that_unpack_to_more(changed, lzma_bomb):
    refused(changed({"audio.detours": stream(lzma_bomb)}, {}), "audio.detours: damaged .*more than the")


def test_a_grid_that_unpacks_to_more(changed, deflate_bomb):
    refused(changed({"vision.grid": stream(deflate_bomb)}, {}), "more than the")


def test_numbers_that_nobody_stores(subtests, changed, deflate_bomb):
    for part, field, value in [
        ("vision", "grid_resolution", 100_000),
        ("vision", "grid_resolution", -8),
        ("vision", "grid_resolution", 0),
        ("vision", "sub_rays", 10**9),
        ("vision", "sub_rays", 0),
        ("audio", "detour_dimensions", 10**9),
        ("audio", "detour_dimensions", -1),
        ("touch", "samples", 10**9),
        ("touch", "samples", 0),
    ]:
        with subtests.test(part=part):
            grid = {"vision.grid": stream(deflate_bomb)} if field == "grid_resolution" else {}
            refused(changed(grid, {part: {field: value}}), str(value))


@pytest.mark.parametrize(
    "size", [{"modes": 20_000, "control_points": 10_000}, {"modes": 1, "control_points": 100_000}]
)
def test_coefficients_of_more_modes_and_points_than_any_object_has(size, changed):
    modes, points = size["modes"], size["control_points"]
    tensors = {
        "audio.control_faces": np.zeros(points, np.int32),
        "audio.control_barycentric": np.zeros((points, 2), np.uint8),
        "audio.coefficients": np.zeros(12 * modes, np.uint8),
        **{f"audio.{name}": np.zeros(modes) for name in audionet.MODE_TENSORS},
    }
    refused(changed(tensors, {"audio": size}), f"{modes} modes, {points} control points")


def test_nesting_in_the_header_and_in_the_metadata(changed, small_file):
    path = changed({}, {})
    deep = b"[" * 200_000
    path.write_bytes(len(deep).to_bytes(8, "little") + deep)
    refused(path, "not JSON")
    content = read_tensor_file(small_file)
    write_tensor_file(path, TensorFile(content.tensors, {**content.metadata, "frame": deep.decode()}))
    refused(path, "incomplete")


@pytest.mark.parametrize(
    ("unpack", "pack"),
    [
        (
            lambda data, size: unpack_lzma(data, surface_codec.LZMA_FILTERS, size),
            lambda data: lzma.compress(data, lzma.FORMAT_RAW, filters=surface_codec.LZMA_FILTERS),
        ),
        (unpack_deflate, lambda data: zlib.compress(data, 9)),
    ],
    ids=["lzma", "deflate"],
)
@pytest.mark.parametrize("size", [0, 1, 1000, 3 * MEGABYTE])
def test_what_was_packed_is_unpacked_whole_and_nothing_else(unpack, pack, size):
    data = np.random.default_rng(0).integers(0, 4, size, dtype=np.uint8).tobytes()
    packed = pack(data)
    assert unpack(packed, size) == data
    for wrong in (size + 1, size - 1):
        if wrong >= 0:
            with pytest.raises(ValueError, match="stream of"):
                unpack(packed, wrong)
    with pytest.raises(ValueError, match="cut short"):
        unpack(packed[:-1], size)
    with pytest.raises(ValueError, match="stream of"):
        unpack(packed + packed, size)
    with pytest.raises(ValueError, match=r"\w"):
        unpack(b"\xff" + packed, size)


def test_a_grid_that_could_not_be_read_again_is_not_made():
    with pytest.raises(ValueError, match=f"{LARGEST_RESOLUTION} at most"):
        SparseGrid.within_budget(np.zeros((1, 3)), 1000, LARGEST_RESOLUTION + 8)
