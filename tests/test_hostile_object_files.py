"""Object Files from elsewhere: streams longer than they should be, and numbers no object has, are refused."""

import itertools
import json
import lzma
import sys
import time
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from objectfolder.audio.audionet import audionet
from objectfolder.errors import FormatError, QueryError
from objectfolder.object_file import ObjectFile
from objectfolder.products.integer_coding import LZMA_FILTERS, pack_integers
from objectfolder.products.tensor_file import TensorFile, read_tensor_file, write_tensor_file
from objectfolder.products.unpacking import unpack_deflate, unpack_lzma
from objectfolder.surface.codec import LARGEST_COUNT, encode_surface
from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.vision.cameras import look_at
from objectfolder.vision.network import holes
from objectfolder.vision.network.face_lattice import FaceLattice, pack_levels
from objectfolder.vision.network.sparse_grid import LARGEST_RESOLUTION, SparseGrid
from objectfolder.vision.network.surface_maps import FINEST_PITCH, MAP_CHANNELS, MAP_WHOLE, lattice_of

MEGABYTE = 1 << 20
ENOUGH = 96 * MEGABYTE  # the window of LZMA's preset alone is 64
BOMB = bytes(256 * MEGABYTE)
BODY = {"filled_mass_kg": 1.0, "mass_kg": 1.0, "centre_of_mass_m": [0.0] * 3}
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
            metadata[key] = json.dumps({**(json.loads(metadata.get(key, "null")) or {}), **values})
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
    [
        ((1 << 40, 12), 0),
        ((8, 1 << 40), 1),
        ((-1, 12), 255),
        ((8, 0), 1),
        ((1 << 62, 1 << 62), 255),
        ((LARGEST_COUNT + 1, 12), 1),
        ((8, LARGEST_COUNT + 1), 1),
    ],
)
def test_a_surface_of_more_than_there_are(counts, planes, changed, lzma_bomb):
    streams = {
        name: stream(bytes([planes]) + lzma_bomb) for name in ("surface.connectivity", "surface.positions")
    }
    refused(changed({"surface.counts": np.array(counts), **streams}, {}), "vertices and")


@pytest.mark.parametrize(
    ("corners", "counts", "match"),
    [
        (np.eye(4, 3), [5], "do not fit together"),
        (np.eye(4, 3), [[4]], "do not fit together"),
        (np.eye(4, 3), [4] * 5000, "do not fit together"),
        (np.full((4, 3), np.nan), [4], "do not fit together"),
        (np.eye(4, 3), [4.0], "do not fit together"),
    ],
    ids=["counts", "nested", "many", "nan", "float"],
)
def test_convex_parts_that_are_none(corners, counts, match, changed):
    tensors = {"collision.corners": corners, "collision.counts": np.array(counts)}
    measures = {"union_iou": 1.0, "outward_m": 0.0, "inward_m": 0.0}
    refused(changed(tensors, {"collision": measures}), match)


def test_a_convex_part_that_is_flat(changed):
    tensors = {"collision.corners": np.eye(4, 3) * [1, 1, 0], "collision.counts": np.array([4])}
    measures = {"union_iou": 1.0, "outward_m": 0.0, "inward_m": 0.0}
    file = ObjectFile.load(changed(tensors, {"collision": measures}))
    with pytest.raises(FormatError, match="encloses nothing"):
        _ = file.collision


@pytest.mark.slow
def test_a_surface_whose_faces_meet_in_a_few_places(changed):
    """Smooth normals look at all pairs of corners in a place: 60,000 faces at seven places were 2.6 TB."""
    faces = 60_000
    places = np.random.default_rng(0).integers(0, 1000, (7, 3))
    vertices = places[np.arange(faces + 2) % 7] * 1e-5
    strip = Surface(vertices, np.arange(faces)[:, None] + np.arange(3))
    refused(changed(encode_surface(strip), {}), "corners of faces in one place")


def test_the_largest_surface_opens_or_is_refused_soon(changed):
    count = LARGEST_COUNT - 2
    # A strip: each face but the first takes the last two vertices and a new one.
    ages = np.zeros((3, count), int)
    ages[0, 1:], ages[1, 1:] = 2, 1
    strip = {
        "surface.counts": np.array([LARGEST_COUNT, count]),
        "surface.connectivity": pack_integers(ages),
        "surface.positions": pack_integers(np.zeros(3 * LARGEST_COUNT, int)),
    }
    path = changed(strip, {})
    begin = time.process_time()
    with pytest.raises(FormatError):
        ObjectFile.load(path)
    assert time.process_time() - begin < 2


def test_numbers_of_too_many_bytes(changed, lzma_bomb):
    refused(changed({"surface.positions": stream(b"\xff" + lzma_bomb)}, {}), "surface: damaged .*more than 8")


def test_detours_that_unpack_to_more(changed, lzma_bomb):
    refused(
        changed({"audio.detours": stream(b"\x01" + lzma_bomb)}, {}), "audio.detours: damaged .*more than the"
    )


def test_a_grid_that_unpacks_to_more(changed, deflate_bomb):
    refused(changed({"vision.grid": stream(deflate_bomb)}, {}), "more than the")


def crowded(file: ObjectFile, names: list[str], pitch: float = FINEST_PITCH) -> tuple[Tensors, Metadata]:
    """Maps with nearly as many places as a lattice may have, each another; every other a hole."""
    triangles = file.frame.to_unit(file.surface.vertices)[file.surface.faces]
    tensors, described = Tensors(), Metadata()
    for name in names:
        while True:
            pitch *= 1.03
            try:
                size = lattice_of(name, triangles, pitch).size
                break
            except FormatError:  # too many places
                continue
        levels = np.zeros((size, MAP_CHANNELS[name]), np.uint8)
        levels[::2] = MAP_WHOLE[name]
        tensors[f"vision.map.{name}"] = pack_levels(levels)
        described[name] = {"pitch": pitch, "values": size}
    return tensors, {"vision": {"maps": described}}


@pytest.mark.slow
def test_maps_of_as_many_places_as_a_lattice_may_have(changed, small_file, monkeypatch):
    """Faces full of holes are cut into no more than `MOST_PIECES`, whole arrays at a time."""
    assert holes.MOST_HOLE_PIECES <= 200_000  # 4 s of a query, and 150 MB
    monkeypatch.setattr(holes, "MOST_HOLE_PIECES", 10_000)
    places, interpolate = [], FaceLattice.interpolate

    def counted(lattice: FaceLattice, values: np.ndarray, face: np.ndarray, at: np.ndarray) -> np.ndarray:
        places.append(len(face))
        assert sum(places) < 3 * 10_000 + 5_000  # corners of pieces, and what is seen
        return interpolate(lattice, values, face, at)

    monkeypatch.setattr(FaceLattice, "interpolate", counted)
    file, names = ObjectFile.load(small_file), ["alpha", "albedo", "normal"]
    camera = file.frame.camera_to_object(look_at(np.array([[0.8, -2.0, 1.2]])))
    light = file.frame.to_object(np.array([0.2, -0.3, 0.9]))

    def ask(path: Path) -> None:
        ObjectFile.load(path).render_passes(camera, ["image", "normal", "albedo"], light, 8)

    ask(changed(*crowded(file, names, 1 / 32)))  # the first query loads kernels
    path, calls = changed(*crowded(file, names)), itertools.count()
    places.clear()
    tracemalloc.start()
    sys.setprofile(lambda *_: next(calls))
    try:
        ask(path)
    finally:
        sys.setprofile(None)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert next(calls) < 100_000  # of functions
    assert peak < 250 * MEGABYTE


def test_maps_of_many_lattices_and_of_long_numbers(changed, small_file):
    file = ObjectFile.load(small_file)
    names = ["alpha", "albedo", "normal", "roughness"]
    tensors, fields = crowded(file, names)
    refused(changed(tensors, fields), "more than 3 pitches")
    size = fields["vision"]["maps"]["alpha"]["values"]
    long = {"vision.map.alpha": pack_integers(np.full(size, 1 << 60))}
    refused(changed(long, {"vision": {"maps": {"alpha": fields["vision"]["maps"]["alpha"]}}}), "a byte")


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
    refused(changed(tensors, {"audio": size}), r"audio\.(control_points|modes): \d+ is no number within 0 to")


def test_fields_that_no_object_has(subtests, changed):
    sensor = Sensor().to_dict()
    for part, fields, match in [
        ("frame", {"scale": 0.0}, "frame.scale: 0.0 is no number"),
        ("frame", {"scale": True}, "frame.scale: True is no number"),
        ("frame", {"centre": [1e3, 0.0, 0.0]}, "frame: it is not that of the surface"),
        ("vision", {"grid_resolution": float("inf")}, "vision.grid_resolution: inf is no number"),
        ("vision", {"radiance_scale": float("nan")}, "vision.radiance_scale: nan is no number"),
        ("audio", {"modes": 1.5}, "audio.modes: 1.5 is no "),
        ("audio", {"kernel": 3}, "audio metadata"),
        ("body", {"filled_mass_kg": [[0.1]]}, r"body.filled_mass_kg: \[\[0.1\]\] is no number"),
        ("body", {**BODY, "inertia_kg_m2": [[1.0]]}, "body.inertia_kg_m2: .* is not of shape"),
        ("material", {"youngs_modulus_pa": "steel"}, "material.youngs_modulus_pa: 'steel' is no number"),
        ("object", {"name": 7}, "object.name: 7 is no text"),
        ("object", {"id": ""}, "object.id: '' is no text"),
        ("fidelity", {"vision": 3}, "fidelity.vision: 3 holds no fields"),
        ("fidelity", {"vision": {}}, "fidelity.vision.psnr_db: None is no number"),
        ("fidelity", {"touch": {"psnr_db": []}}, r"fidelity.touch.psnr_db: \[\] is no number"),
        ("touch", {"sensor": []}, "touch.sensor"),
        ("touch", {"sensor": {**sensor, "gel_width_m": {}}}, "touch.sensor.gel_width_m: {} is no number"),
        ("touch", {"sensor": {**sensor, "near_m": "1"}}, "touch.sensor.near_m: '1' is no number"),
        ("touch", {"sensor": {**sensor, "gel_apex_m": [0.0]}}, "gel_apex_m: .* is not of shape"),
        ("touch", {"sensor": {**sensor, "light_colors": [{}] * 3}}, "touch.sensor.light_colors.0"),
        ("touch", {"sensor": {**sensor, "light_colors": [[0.1] * 3] * 1000}}, "light_colors: 1000 is no"),
        ("touch", {"sensor": {**sensor, "image_height": 5000, "image_width": 5000}}, "100000000 rays"),
    ]:  # fmt: skip
        with subtests.test(part=part, fields=str(fields)[:60]):
            refused(changed({}, {part: fields}), match)


def test_numbers_that_no_network_has(subtests, changed, small_file):
    tensors = read_tensor_file(small_file).tensors
    for name, value in [
        ("vision.direct.0.bias", np.nan),
        ("vision.tables.3", np.inf),
        ("audio.eigenvalues", 1e300),
        ("surface.origin", 1e7),
        ("surface.step", 1e300),
    ]:
        with subtests.test(name=name):
            refused(changed({name: np.full_like(tensors[name], value)}, {}), name.split(".")[0])


def test_gains_that_no_body_has(changed, small_file):
    step = read_tensor_file(small_file).tensors["audio.step"]
    struck = ObjectFile.load(changed({"audio.step": step * 1e9}, {}))
    points, normals = struck.sample_contacts(1, seed=0, reachable=False)
    with pytest.raises(FormatError, match="gains of"):
        struck.strike(points, -normals, 0.01)


def test_a_camera_that_sees_past_the_gel(changed):
    sensor = {**Sensor().to_dict(), "camera_position_m": [-0.03, 0.0, 0.015]}
    pressed = ObjectFile.load(changed({}, {"touch": {"sensor": sensor}}))
    with pytest.raises(QueryError, match="past the gel"):
        pressed.press(pressed.sample_contacts(1, seed=0, reachable=False)[0])


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
            lambda data, size: unpack_lzma(data, LZMA_FILTERS, size),
            lambda data: lzma.compress(data, lzma.FORMAT_RAW, filters=LZMA_FILTERS),
        ),
        (unpack_deflate, lambda data: zlib.compress(data, 9)),
    ],
    ids=["lzma", "deflate"],
)
@pytest.mark.parametrize("size", [0, 1, 1000, MEGABYTE + 1])
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
