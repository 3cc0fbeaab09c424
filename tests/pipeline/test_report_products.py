"""What pages read of products, and where on an object they say a touch was made."""

import io
import json
import math
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from report_data_sets import SENSOR, SIDE_M, cube, touched, write_modes, write_object

from objectfolder.errors import FormatError
from objectfolder.fidelity.contacts import PIXELS, SIDES, Side, gel_corners, in_sight, sides_showing
from objectfolder.fidelity.images import psnr_db
from objectfolder.products.store import Array, Product, write_product
from objectfolder.surface.surface import Surface
from pipeline.dataset.verified import Verified
from pipeline.publish.report.object_products import ObjectProducts
from pipeline.publish.report.queries import modal_table, queries


@pytest.fixture
def product_file(tmp_path: Path) -> Path:
    generator = np.random.default_rng(3)
    arrays = {
        "items": Array(generator.normal(size=(5, 40, 20)), ("i", "y", "x"), "1", "chunked by item"),
        "zeros": Array(np.zeros((3, 80, 80), np.uint8), ("i", "y", "x"), "1", "no chunk is stored"),
    }
    path = tmp_path / "fidelity" / "x.zarr.zip"
    write_product(path, Product(arrays, {"name": "ä", "part": {"one": 1}}))
    return path


def test_every_flipped_bit_of_a_product_is_noticed(product_file: Path, tmp_path: Path) -> None:
    whole = product_file.read_bytes()
    begin = whole.index(b"items/c/2/0/0") + 40
    for place in range(begin, begin + 200, 37):
        flipped = bytearray(whole)
        flipped[place] ^= 4
        product_file.write_bytes(flipped)
        with pytest.raises(FormatError, match="items/c/2/0/0"):
            ObjectProducts(tmp_path, "x").arrays("fidelity", "items")


def test_what_is_no_archive_is_refused(product_file: Path, tmp_path: Path) -> None:
    for content in (b"", b"PK", b"x" * 4000):
        product_file.write_bytes(content)
        with pytest.raises(FormatError, match="unreadable"):
            ObjectProducts(tmp_path, "x").arrays("fidelity")
        assert ObjectProducts(tmp_path, "x").digests(Verified(tmp_path))["fidelity"]


@pytest.mark.parametrize(
    ("array", "shape", "chunks", "finding"),
    [
        ("items", [5, 3_000_000, 400], [1, 3_000_000, 400], "would take 48000"),
        ("zeros", [90, 100_000_000], [1, 100_000_000], "would take 9000"),
        ("zeros", [1_000_001, 1], [1, 1], "lies in 1000001 chunks"),
    ],
)
def test_sizes_that_no_product_has_are_refused_before_anything_is_made(
    product_file: Path, tmp_path: Path, array: str, shape: list[int], chunks: list[int], finding: str
) -> None:
    """Chunks of zeros are not stored, so a few bytes may declare any number of them."""
    with zipfile.ZipFile(product_file) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    said = json.loads(contents[f"{array}/zarr.json"])
    said["shape"], said["chunk_grid"]["configuration"]["chunk_shape"] = shape, chunks
    contents[f"{array}/zarr.json"] = json.dumps(said).encode()
    with zipfile.ZipFile(product_file, "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    with pytest.raises(FormatError, match=finding):
        ObjectProducts(tmp_path, "x").arrays("fidelity", array)


def test_the_digest_tells_contents_apart_and_equal_ones_not(tmp_path: Path) -> None:
    for name, value in (("a", 1.0), ("b", 1.0), ("c", 2.0)):
        array = Array(np.full((2, 100, 100), value), ("i", "y", "x"), "1", "values")
        write_product(tmp_path / "views" / f"{name}.zarr.zip", Product({"values": array}))
    a, b, c = (ObjectProducts(tmp_path, name).digests(Verified(tmp_path))["views"] for name in "abc")
    assert a == b != c


def test_a_contact_is_marked_where_it_is(tmp_path: Path) -> None:
    """The surface under the marked pixel is the touched face, seen from outside."""
    write_object(tmp_path, "cube")
    touches = touched()
    points, normals = (touches[name][touches["held_out"]] for name in ("points", "normals"))
    surface = Surface(*cube())
    chosen, _ = sides_showing(surface, points, normals)
    products = ObjectProducts(tmp_path, "cube")
    shown = queries(products.arrays("fidelity"), products, 4)["touches"].items
    assert sorted(item.row for item in shown) == list(range(len(points)))
    assert len({item.contact.side for item in shown}) < len(shown), "a picture may show several"
    for item in shown:
        contact, normal = item.contact, normals[item.row]
        assert contact.visible
        millimetres = [fact.value for fact in item.facts if fact.unit == "mm"]
        assert millimetres[:3] == pytest.approx(1e3 * points[item.row])
        side = Side(surface, SIDES[np.unique(chosen)[contact.side]])
        x, y = contact.spot
        face = side.faces()[int(y), int(x)]
        assert surface.face_normals[face] @ normal == pytest.approx(1.0)
        assert 0.2 < side.direction @ normal < 0.9, "obliquely"
        corners = np.array([[float(part) for part in pair.split(",")] for pair in contact.gel.split()])
        assert np.all(corners.min(axis=0) <= [x, y])
        assert np.all(corners.max(axis=0) >= [x, y])


def test_a_side_is_drawn_to_scale() -> None:
    vertices, faces = cube()
    side = Side(Surface(vertices, faces), np.array([1.0, 0.0, 0.0]))
    pixels = side.project(vertices)
    # From +x: +y is right, +z is up, and the near face hides the far one.
    assert np.array_equal(np.sign(pixels - PIXELS / 2), np.sign(vertices[:, 1:]) * [1, -1])
    near, far = pixels[vertices[:, 0] > 0], pixels[vertices[:, 0] < 0]
    assert sorted(map(tuple, near.round(6))) == sorted(map(tuple, far.round(6)))
    rows, columns = np.nonzero(side.faces() >= 0)
    assert columns.min() == pytest.approx(near[:, 0].min(), abs=1)
    assert columns.max() + 1 == pytest.approx(near[:, 0].max(), abs=1)
    assert rows.min() == pytest.approx(near[:, 1].min(), abs=1)


def test_a_hidden_point_is_said_to_be_hidden() -> None:
    surface = Surface(*cube())
    points = np.array([[SIDE_M / 2, 0.01, 0.0], [-SIDE_M / 2, 0.01, 0.0]])
    assert in_sight(surface, points, np.array([[1.0, 0.0, 0.0]])).tolist() == [[True, False]]
    _, inside = sides_showing(surface, np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    assert inside.tolist() == [False]


def test_corners_of_the_gel_lie_in_its_plane() -> None:
    corners = gel_corners(SENSOR)
    assert np.allclose(corners[:, 0], 0.022)
    assert np.allclose(np.ptp(corners, axis=0), [0, 0.02, 0.03])


def test_errors_of_modes_are_those_of_the_file(tmp_path: Path) -> None:
    write_object(tmp_path, "cube")
    products = ObjectProducts(tmp_path, "cube")
    attributes = products.attributes("fidelity")
    rows = modal_table(products, attributes)
    truth = attributes["audio"]["modes_table"]
    assert len(rows) == len(truth)
    assert [row.frequency_hz for row in rows] == [mode["frequency_hz"] for mode in truth]
    assert [row.error_cents for row in rows] == pytest.approx([3.0] * len(rows), abs=1e-6)
    assert rows[0].damping_error == pytest.approx(6.0 / truth[0]["damping_per_s"] - 1)
    assert rows[0].solver_error_cents == 1.5
    undamped = math.hypot(2 * math.pi * truth[0]["frequency_hz"], truth[0]["damping_per_s"])
    assert rows[0].loss_factor == pytest.approx(2 * truth[0]["damping_per_s"] / undamped)
    assert np.isnan(rows[1].solver_error_cents)
    write_modes(tmp_path, "cube", [100.0])
    rows = modal_table(ObjectProducts(tmp_path, "cube"), attributes)
    assert all(np.isnan(row.error_cents) for row in rows), "a file of other modes says nothing of these"


def test_every_held_out_view_has_its_rank_its_numbers_and_its_row_of_the_sheet(tmp_path: Path) -> None:
    write_object(tmp_path, "cube")
    products = ObjectProducts(tmp_path, "cube")
    product = products.arrays("fidelity")
    gallery = queries(product, products, 4)["views"]
    scores = [row["psnr_db"] for row in product.attributes["vision"]["per_view"]]
    assert [item.rank for item in gallery.items] == list(range(8))
    assert [item.row for item in gallery.items] == np.argsort(scores).tolist()
    facts = [{fact.name: fact.value for fact in item.facts} for item in gallery.items]
    assert [fact["full image"] for fact in facts] == sorted(scores)
    assert [item.rank for item in gallery.stored] == [0, 2, 5, 7]
    assert [item.place for item in gallery.items] == ["worst", *[""] * 6, "best"]
    pairs = zip(product["vision_truth"], product["vision_answer"], strict=True)
    assert [psnr_db(*pair) for pair in pairs] == [sorted(scores)[rank] for rank in (0, 2, 5, 7)]
    sheet = np.asarray(Image.open(io.BytesIO(product["vision_sheet"].tobytes())).convert("RGB"))
    for item, truth in zip(gallery.stored, product["vision_truth"], strict=True):
        rows = slice(item.row * gallery.height, (item.row + 1) * gallery.height)
        assert psnr_db(truth, sheet[rows, : gallery.width]) > 30, "with loss"


def test_touches_without_a_contact_come_last(tmp_path: Path) -> None:
    write_object(tmp_path, "cube")
    products = ObjectProducts(tmp_path, "cube")
    product = products.arrays("fidelity")
    rows = product.attributes["touch"]["per_touch"]
    rows[3]["psnr_contact_db"] = None
    shown = queries(product, products, 4)["touches"].items
    assert (shown[-1].row, shown[-1].place) == (3, "no contact")
    assert shown[-2].place == "best"
    assert [item.rank for item in shown if item.truth] == [0, 1, 3, 4]
