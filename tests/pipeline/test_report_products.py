"""What pages read of products, and where on an object they say a touch was made."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fidelity_products import fidelity
from report_data_sets import SENSOR, SIDE_M, cube, touched, write_modes, write_object

from objectfolder.errors import FormatError
from objectfolder.fidelity.images import psnr_db
from objectfolder.store import Array, Product, read_product, write_product
from pipeline.publish.report.archive import Archive, content_digest
from pipeline.publish.report.contacts import contacts, find_touches, gel_corners
from pipeline.publish.report.modal_table import modal_table
from pipeline.publish.report.object_products import ObjectProducts
from pipeline.publish.report.queries import queries
from pipeline.publish.report.surface_picture import (
    PIXELS,
    SHOWING_COSINES,
    Surface,
    picture,
    pictures_showing,
)

# Larger than what is stored in one chunk for all items.
LARGE = 72


@pytest.fixture
def product_file(tmp_path: Path) -> Path:
    generator = np.random.default_rng(3)
    arrays = {
        "items": Array(generator.normal(size=(5, 40, 20)), ("i", "y", "x"), "1", "chunked by item"),
        "whole": Array(generator.integers(0, 9, (7, 3)), ("i", "x"), "1", "one chunk"),
        "zeros": Array(np.zeros((3, 80, 80), np.uint8), ("i", "y", "x"), "1", "no chunk is stored"),
        "none": Array(np.zeros((0, 4)), ("i", "x"), "1", "empty"),
        "flags": Array(np.array([True, False]), ("i",), "1", "flags"),
    }
    path = tmp_path / "x.zarr.zip"
    write_product(path, Product(arrays, {"name": "ä", "part": {"one": 1}}))
    return path


def test_an_archive_reads_what_zarr_reads(product_file: Path) -> None:
    product = read_product(product_file)
    with Archive(product_file) as archive:
        assert archive.attributes() == product.attributes
        for name in product.arrays:
            read = archive.array(name)
            assert read.dtype == product[name].dtype
            assert np.array_equal(read, product[name])
        assert "items" in archive
        assert "item" not in archive
        assert archive.item_sums("zeros") == [None] * 3
        with pytest.raises(FormatError, match="absent"):
            archive.array("absent")


def test_every_flipped_bit_of_what_is_read_is_noticed(product_file: Path, tmp_path: Path) -> None:
    whole = product_file.read_bytes()
    begin = whole.index(b"items/c/2/0/0") + 40
    for place in range(begin, begin + 200, 37):
        flipped = bytearray(whole)
        flipped[place] ^= 4
        (tmp_path / "flipped.zarr.zip").write_bytes(flipped)
        with Archive(tmp_path / "flipped.zarr.zip") as archive, pytest.raises(FormatError, match="Bad CRC"):
            archive.array("items")


def test_what_is_no_archive_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"PK", b"x" * 4000):
        (tmp_path / "x.zarr.zip").write_bytes(content)
        with pytest.raises(FormatError, match="not a readable product"):
            Archive(tmp_path / "x.zarr.zip")


@pytest.mark.parametrize(
    ("array", "shape", "chunks", "finding"),
    [
        ("items", [5, 3_000_000, 400], [1, 3_000_000, 400], "too large"),
        ("zeros", [90, 100_000_000], [1, 100_000_000], "too large"),
        ("zeros", [1_000_001, 1], [1, 1], "lies in 1000001 chunks"),
    ],
)
def test_sizes_that_no_product_has_are_refused_before_anything_is_made(
    product_file: Path, array: str, shape: list[int], chunks: list[int], finding: str
) -> None:
    """Chunks of zeros are not stored, so a few bytes may declare any number of them."""
    with zipfile.ZipFile(product_file) as read:
        contents = {name: read.read(name) for name in read.namelist()}
    said = json.loads(contents[f"{array}/zarr.json"])
    said["shape"], said["chunk_grid"]["configuration"]["chunk_shape"] = shape, chunks
    contents[f"{array}/zarr.json"] = json.dumps(said).encode()
    with zipfile.ZipFile(product_file, "w") as written:
        for name, content in contents.items():
            written.writestr(name, content)
    with Archive(product_file) as archive:
        for read_it in (archive.array, archive.item_sums):
            with pytest.raises(FormatError, match=finding):
                read_it(array)


def test_the_digest_tells_contents_apart_and_equal_ones_not(tmp_path: Path) -> None:
    for name, value in (("a", 1.0), ("b", 1.0), ("c", 2.0)):
        array = Array(np.full((2, 100, 100), value), ("i", "y", "x"), "1", "values")
        write_product(tmp_path / f"{name}.zarr.zip", Product({"values": array}))
    a, b, c = (content_digest(tmp_path / f"{name}.zarr.zip") for name in "abc")
    assert a == b != c


def test_touches_shown_are_found_in_the_truth(tmp_path: Path) -> None:
    product = fidelity("cube", size=LARGE)
    touches, points, _ = touched(product["touch_truth"], before=3)
    write_product(tmp_path / "f.zarr.zip", product)
    write_product(tmp_path / "t.zarr.zip", touches)
    with Archive(tmp_path / "f.zarr.zip") as shown, Archive(tmp_path / "t.zarr.zip") as truth:
        assert find_touches(shown, truth) == [3, 4, 5, 6]
    foreign = Product({**touches.arrays, "rgb": Array(255 - touches["rgb"], ("t", "y", "x", "c"), "1", "")})
    write_product(tmp_path / "t.zarr.zip", foreign)
    with Archive(tmp_path / "f.zarr.zip") as shown, Archive(tmp_path / "t.zarr.zip") as truth:
        assert find_touches(shown, truth) == [None] * 4
    assert len(points) == 7


def test_a_contact_is_marked_where_it_is(tmp_path: Path) -> None:
    """The marked pixel, taken back through the picture's own camera, is the asked point on the surface."""
    product = fidelity("cube", size=LARGE)
    touches, points, normals = touched(product["touch_truth"], before=3)
    write_product(tmp_path / "f.zarr.zip", product)
    write_product(tmp_path / "t.zarr.zip", touches)
    vertices, faces = cube()
    mesh = {
        "vertices": Array(vertices, ("v", "a"), "m", "", chunk_first=False),
        "faces": Array(faces, ("f", "c"), "1", "", chunk_first=False),
    }
    write_product(tmp_path / "o.zarr.zip", Product(mesh))
    with (
        Archive(tmp_path / "f.zarr.zip") as shown,
        Archive(tmp_path / "t.zarr.zip") as truth,
        Archive(tmp_path / "o.zarr.zip") as objects,
    ):
        found = contacts(shown, truth, objects)
    surface = Surface(vertices, faces)
    pictures = pictures_showing(surface, points[3:], normals[3:])
    for index, (contact, drawn) in enumerate(zip(found, pictures, strict=True), start=3):
        assert contact is not None
        assert contact.visible
        millimetres = [value for _, value, unit in contact.labels if unit == "mm"]
        assert millimetres[:3] == pytest.approx(1e3 * points[index])
        # The surface under the marked pixel is the touched face, and lies as deep as the point.
        face = drawn.seen[int(contact.y), int(contact.x)]
        assert surface.face_normals[face] @ normals[index] == pytest.approx(1.0)
        assert drawn.direction @ normals[index] > 0.2
        (_,), (depth,) = drawn.project(points[index][None])
        assert drawn.depth_m[int(contact.y), int(contact.x)] == pytest.approx(depth, rel=0.02)
        # The arrow comes from outside: its begin is nearer to the camera than where it ends.
        (_,), (start,) = drawn.project((points[index] + 0.01 * normals[index])[None])
        assert start < depth
        corners = np.array([[float(part) for part in pair.split(",")] for pair in contact.gel.split()])
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert np.all(low <= [contact.x, contact.y])
        assert np.all(high >= [contact.x, contact.y])


def test_a_camera_projects_as_a_pinhole_does() -> None:
    vertices, faces = cube()
    surface = Surface(vertices, faces)
    drawn = picture(surface, np.array([1.0, 0.0, 0.0]))
    pixels, depths = drawn.project(vertices)
    # From +x: +y is right, +z is up, the near face is larger, and the silhouette is its square.
    centre = PIXELS / 2
    right_up = np.sign(vertices[:, 1:])
    assert np.array_equal(np.sign(pixels - centre), right_up * [1, -1])
    assert np.all(depths[vertices[:, 0] > 0] < depths[vertices[:, 0] < 0])
    near = pixels[vertices[:, 0] > 0]
    rows, columns = np.nonzero(drawn.seen >= 0)
    assert columns.min() == pytest.approx(near[:, 0].min(), abs=1)
    assert columns.max() + 1 == pytest.approx(near[:, 0].max(), abs=1)
    assert rows.min() == pytest.approx(near[:, 1].min(), abs=1)
    middle = drawn.depth_m[PIXELS // 2, PIXELS // 2]
    assert middle == pytest.approx(depths[vertices[:, 0] > 0].mean(), rel=1e-5)


def test_a_hidden_point_is_said_to_be_hidden() -> None:
    vertices, faces = cube()
    surface = Surface(vertices, faces)
    front = picture(surface, np.array([1.0, 0.0, 0.0]))
    assert front.shows(np.array([SIDE_M / 2, 0.01, 0.0]))
    assert not front.shows(np.array([-SIDE_M / 2, 0.01, 0.0]))
    up = np.array([[0.0, 0.0, 1.0]])
    (inside,) = pictures_showing(surface, np.zeros((1, 3)), up)
    assert np.array_equal(inside.direction, up[0])
    assert not inside.shows(np.zeros(3))


def test_points_that_one_side_shows_share_its_picture() -> None:
    vertices, faces = cube()
    half = SIDE_M / 2
    points = np.array([[half, 0.01, 0.0], [half, -0.01, 0.0], [0.0, half, 0.0], [-half, 0.0, 0.0]])
    normals = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    pictures = pictures_showing(Surface(vertices, faces), points, normals)
    assert len({id(drawn) for drawn in pictures}) == 2
    assert pictures[0] is pictures[1]
    least, most = SHOWING_COSINES
    for drawn, point, normal in zip(pictures, points, normals, strict=True):
        assert drawn.shows(point)
        assert least <= drawn.direction @ normal <= most


def test_corners_of_the_gel_lie_in_its_plane() -> None:
    corners = gel_corners(SENSOR)
    assert np.allclose(corners[:, 0], 0.022)
    assert np.allclose(np.ptp(corners, axis=0), [0, 0.02, 0.03])


def test_errors_of_modes_are_those_of_the_file(tmp_path: Path) -> None:
    write_object(tmp_path, "cube")
    with ObjectProducts(tmp_path, "cube") as products:
        attributes = products.attributes("fidelity")
        rows = modal_table(products, attributes)
        truth = attributes["audio"]["modes_table"]
    assert len(rows) == len(truth)
    assert [row.frequency_hz for row in rows] == [mode["frequency_hz"] for mode in truth]
    assert [row.error_cents for row in rows] == pytest.approx([3.0] * len(rows), abs=1e-6)
    assert rows[0].damping_error == pytest.approx(6.0 / truth[0]["damping_per_s"] - 1)
    assert rows[0].solver_error_cents == 1.5
    assert np.isnan(rows[1].solver_error_cents)
    write_modes(tmp_path, "cube", [100.0])
    with ObjectProducts(tmp_path, "cube") as products:
        rows = modal_table(products, products.attributes("fidelity"))
    assert all(np.isnan(row.error_cents) for row in rows), "a file of other modes says nothing of these"


def test_views_shown_carry_the_numbers_of_their_view(tmp_path: Path) -> None:
    """The stored views are the product's own choice by rank, recognised by their score."""
    write_object(tmp_path, "cube")
    path = tmp_path / "fidelity" / "cube.zarr.zip"
    product = read_product(path)
    scores = [psnr_db(*pair) for pair in zip(product["vision_truth"], product["vision_answer"], strict=True)]
    order = np.argsort(scores)
    rows = [
        {"view": 10 + rank, "psnr_db": scores[index], "ssim": 0.9 + rank / 100}
        for rank, index in enumerate(order)
    ]
    arrays = {
        name: Array(array.data[order] if name.startswith("vision") else array.data, array.dims, "1", name)
        for name, array in product.arrays.items()
    }
    vision = {**product.attributes["vision"], "per_view": rows[::-1]}
    write_product(path, Product(arrays, {**product.attributes, "vision": vision}))
    with ObjectProducts(tmp_path, "cube") as products:
        shown = queries(products, products.attributes("fidelity"), 4).views
    facts = [{fact.name: fact.value for fact in view.facts} for view in shown]
    assert [view.place for view in shown] == ["worst", "rank 2 of 4 stored", "rank 3 of 4 stored", "best"]
    assert [fact["full image"] for fact in facts] == pytest.approx(sorted(scores))
    assert [fact["SSIM"] for fact in facts] == pytest.approx([0.9, 0.91, 0.92, 0.93])
