"""Views as NeRF and COLMAP data: conventions by hand, and readers written from the formats' documents."""

import json
import math
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial.transform import Rotation
from vision_shapes import cube

from objectfolder.errors import FormatError, InputError, MissingPackageError
from objectfolder.export.files import (
    MANIFEST,
    Credit,
    new_folder,
    straight_srgb,
    write_exr,
    write_json,
)
from objectfolder.export.posed_views import PosedViews
from objectfolder.products.store import Array, Product
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import look_at, pixel_rays, project, uniform_on_sphere
from objectfolder.vision.compositing import on_white
from pipeline.publish.export.colmap import quaternion, sparse_model, world_to_camera, write_colmap
from pipeline.publish.export.transforms import write_transforms

HEIGHT, WIDTH, FIELD_OF_VIEW = 60, 44, 39.6
CREDIT = Credit("cube", "A cube", "made by code", "CC-BY-4.0", "the tests")


def straight_colour(face: np.ndarray) -> np.ndarray:
    """A colour for each side of the cube."""
    return 0.1 + 0.07 * (face // 2)[:, None] * [1.0, 0.5, 0.2]


@pytest.fixture(scope="module")
def surface() -> Surface:
    return cube().surface


@pytest.fixture(scope="module")
def views(surface: Surface) -> Product:
    """Eight views, the first from +x, the last three held out; every face has a colour of its own."""
    frame = UnitFrame.of_points(surface.vertices)
    positions = np.concatenate([[[2.5, 0.0, 0.0]], uniform_on_sphere(7, 2.5, np.random.default_rng(3))])
    cameras = look_at(positions)
    rgba = np.zeros((8, HEIGHT * WIDTH, 4), dtype=np.float16)
    offsets = (np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2) + 0.5) / 4
    for index, camera in enumerate(cameras):
        origins, along = pixel_rays(
            camera, np.arange(HEIGHT * WIDTH), offsets, (HEIGHT, WIDTH), FIELD_OF_VIEW
        )
        hits = surface.ray_hits(frame.to_object(origins), along)
        colours = np.concatenate([straight_colour(hits.face), np.ones((len(hits.face), 1))], axis=1)
        colours[hits.face < 0] = 0
        rgba[index] = colours.reshape(-1, len(offsets), 4).mean(axis=1)
    return Product(
        {
            "rgba": Array(rgba.reshape(8, HEIGHT, WIDTH, 4), ("view", "y", "x", "channel"), "1", "colour"),
            "camera_to_world": Array(cameras, ("view", "row", "column"), "1", "poses"),
            "light_position": Array(
                uniform_on_sphere(8, 1.0, np.random.default_rng(4)), ("view", "axis"), "1", "light"
            ),
            "held_out": Array(np.arange(8) >= 5, ("view",), "1", "held out"),
        },
        {"field_of_view_deg": FIELD_OF_VIEW, "light_power_w": 12.0, "frame": frame.to_dict()},
    )


def exported(folder: Path, kind: str, views: Product, frame: str = "unit", **options: object) -> PosedViews:
    posed = PosedViews.of_product(views, frame)
    folder.mkdir(parents=True)
    if kind == "nerf":
        write_transforms(folder, posed, CREDIT, **options)
    else:
        write_colmap(folder, posed, CREDIT, **options)
    return posed


# Independent readers of the COLMAP formats.


def read_text(folder: Path):
    def lines(name: str) -> list[str]:
        return [line for line in (folder / name).read_text().split("\n") if not line.startswith("#")]

    cameras = {int(row.split()[0]): row.split()[1:] for row in lines("cameras.txt") if row}
    images, rows = {}, lines("images.txt")
    for pose, points in zip(rows[0::2], rows[1::2], strict=False):
        identifier, *numbers, camera, name = pose.split()
        cells = np.array(points.split(), dtype=float).reshape(-1, 3)
        images[int(identifier)] = (np.array(numbers, float), int(camera), name, cells)
    points = {}
    for row in filter(None, lines("points3D.txt")):
        cells = row.split()
        track = np.array(cells[8:], dtype=int).reshape(-1, 2)
        points[int(cells[0])] = (np.array(cells[1:4], float), tuple(map(int, cells[4:7])), track)
    return cameras, images, points


def read_binary(folder: Path):
    class Reader:
        def __init__(self, name: str) -> None:
            self.data, self.at = (folder / name).read_bytes(), 0

        def take(self, form: str):
            values = struct.unpack_from("<" + form, self.data, self.at)
            self.at += struct.calcsize("<" + form)
            return values

        def text(self) -> str:
            end = self.data.index(b"\0", self.at)
            value, self.at = self.data[self.at : end].decode(), end + 1
            return value

    file = Reader("cameras.bin")
    cameras = {}
    for _ in range(file.take("Q")[0]):
        identifier, model, width, height = file.take("iiQQ")
        assert model == 1
        cameras[identifier] = ["PINHOLE", str(width), str(height), *map(str, file.take("4d"))]
    assert file.at == len(file.data)
    file = Reader("images.bin")
    images = {}
    for _ in range(file.take("Q")[0]):
        identifier, *pose, camera = file.take("i7di")
        name = file.text()
        count = file.take("Q")[0]
        cells = np.array([file.take("ddq") for _ in range(count)]).reshape(-1, 3)
        images[identifier] = (np.array(pose), camera, name, cells)
    assert file.at == len(file.data)
    file = Reader("points3D.bin")
    points = {}
    for _ in range(file.take("Q")[0]):
        identifier, *values = file.take("Q3d3Bd")
        count = file.take("Q")[0]
        track = np.array([file.take("ii") for _ in range(count)]).reshape(-1, 2)
        points[identifier] = (np.array(values[:3]), tuple(values[3:6]), track)
    assert file.at == len(file.data)
    return cameras, images, points


def project_as_colmap(points: np.ndarray, cameras, image) -> np.ndarray:
    pose, camera, _, _ = image
    fx, fy, cx, cy = map(float, cameras[camera][3:])
    rotation = Rotation.from_quat([*pose[1:4], pose[0]]).as_matrix()
    x, y, z = (points @ rotation.T + pose[4:]).T
    assert (z > 0).all()
    return np.stack([fx * x / z + cx, fy * y / z + cy], axis=1)


def project_as_nerf(points: np.ndarray, content, frame) -> np.ndarray:
    world_to_camera = np.linalg.inv(np.array(frame["transform_matrix"]))
    x, y, z = (points @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]).T
    return np.stack(
        [content["cx"] - content["fl_x"] * x / z, content["cy"] + content["fl_y"] * y / z], axis=1
    )


def test_a_camera_on_x_looking_at_the_origin_by_hand(views, tmp_path):
    exported(tmp_path / "nerf", "nerf", views)
    frame = json.loads((tmp_path / "nerf" / "transforms_train.json").read_text())["frames"][0]
    # Right is +y, up +z, backward +x.
    np.testing.assert_allclose(
        frame["transform_matrix"], [[0, 0, 1, 2.5], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], atol=1e-12
    )
    exported(tmp_path / "colmap", "colmap", views, surface=None)
    # Rows right, down = -z, ahead = -x: a turn by 120 degrees about (1, 1, -1).
    pose = read_text(tmp_path / "colmap" / "sparse_text" / "0")[1][1][0]
    np.testing.assert_allclose(pose, [0.5, 0.5, 0.5, -0.5, 0, 0, 2.5], atol=1e-12)


def test_angle_is_over_the_width_though_the_product_has_it_over_the_longer_side(views, tmp_path):
    exported(tmp_path / "nerf", "nerf", views)
    for name in ("train", "val", "test"):
        content = json.loads((tmp_path / "nerf" / f"transforms_{name}.json").read_text())
        expected = 2 * math.atan(math.tan(math.radians(FIELD_OF_VIEW) / 2) * WIDTH / HEIGHT)
        assert content["camera_angle_x"] == pytest.approx(expected, rel=1e-12)
    content = json.loads((tmp_path / "nerf" / "transforms.json").read_text())
    assert (content["w"], content["h"], content["cx"], content["cy"]) == (
        WIDTH,
        HEIGHT,
        WIDTH / 2,
        HEIGHT / 2,
    )
    # instant-ngp would take these for its own.
    assert not {"scale", "offset", "aabb"} & set(content)


def test_splits_name_every_view_once_and_hold_the_held_out_ones_apart(views, tmp_path):
    exported(tmp_path / "nerf", "nerf", views)
    content = json.loads((tmp_path / "nerf" / "transforms.json").read_text())
    held_out = [frame["file_path"] for frame in content["frames"] if frame["held_out"]]
    assert content["test_filenames"] == held_out
    assert len(held_out) == 3
    assert sorted(content["train_filenames"] + held_out) == sorted(f["file_path"] for f in content["frames"])
    for name, count in (("train", 5), ("test", 3)):
        frames = json.loads((tmp_path / "nerf" / f"transforms_{name}.json").read_text())["frames"]
        assert len(frames) == count
        for frame in frames:
            assert (tmp_path / "nerf" / f"{frame['file_path']}.png").is_file()
    exported(tmp_path / "colmap", "colmap", views, surface=None)
    listed = (tmp_path / "colmap" / "sparse" / "0" / "test.txt").read_text().split()
    assert listed == ["test_0000.png", "test_0001.png", "test_0002.png"]


@pytest.mark.parametrize("frame", ["unit", "object"])
def test_both_formats_put_a_point_on_the_pixel_the_project_does(views, surface, tmp_path, frame):
    posed = exported(tmp_path / "nerf", "nerf", views, frame)
    exported(tmp_path / "colmap", "colmap", views, frame, surface=surface, points=40)
    unit_frame = UnitFrame.from_dict(views.attributes["frame"])
    metric = surface.sample(200, 5).points
    unit = unit_frame.to_unit(metric)
    content = json.loads((tmp_path / "nerf" / "transforms.json").read_text())
    described = content["frame"]
    points = (metric - described["origin_in_metres"]) / described["unit_in_metres"]
    models = [read_text(tmp_path / "colmap" / "sparse_text" / "0")]
    models.append(read_binary(tmp_path / "colmap" / "sparse" / "0"))
    for row in range(len(posed)):
        expected = project(unit, views["camera_to_world"][row], (HEIGHT, WIDTH), FIELD_OF_VIEW)
        nerf = project_as_nerf(points, content, content["frames"][row])
        np.testing.assert_allclose(nerf, expected, atol=1e-6)
        for cameras, images, _ in models:
            assert images[row + 1][2] == f"{posed.names[row]}.png"
            np.testing.assert_allclose(
                project_as_colmap(points, cameras, images[row + 1]), expected, atol=1e-4
            )


def test_text_and_binary_hold_one_model_and_tracks_are_consistent(views, surface, tmp_path):
    exported(tmp_path / "colmap", "colmap", views, surface=surface, points=300)
    text = read_text(tmp_path / "colmap" / "sparse_text" / "0")
    binary = read_binary(tmp_path / "colmap" / "sparse" / "0")
    assert [float(cell) for cell in text[0][1][1:]] == [float(cell) for cell in binary[0][1][1:]]
    assert text[1].keys() == binary[1].keys()
    assert text[2].keys() == binary[2].keys()
    assert len(text[2]) > 250
    for identifier, (pose, camera, name, cells) in text[1].items():
        record = binary[1][identifier]
        np.testing.assert_array_equal(pose, record[0])
        assert (camera, name) == record[1:3]
        np.testing.assert_allclose(cells, record[3], atol=1e-6)
    for identifier, (position, colour, track) in text[2].items():
        np.testing.assert_array_equal(position, binary[2][identifier][0])
        assert colour == binary[2][identifier][1]
        np.testing.assert_array_equal(track, binary[2][identifier][2])
        assert len(track) >= 2
        assert len(set(track[:, 0].tolist())) == len(track)
        for image, index in track:
            x, y, point = text[1][image][3][index]
            assert point == identifier
            at = project_as_colmap(position[None], text[0], text[1][image])[0]
            np.testing.assert_allclose((x, y), at, atol=1e-4)
    mentioned = sum(len(track) for _, _, track in text[2].values())
    assert mentioned == sum(len(cells) for _, _, _, cells in text[1].values())


def test_a_convex_body_is_seen_exactly_where_it_faces_the_camera(views, surface):
    posed = PosedViews.of_product(views)
    model = sparse_model(posed, surface, points=400, seed=2)
    visibility = np.zeros((len(posed), len(model.points)), dtype=bool)
    visibility[model.observed_image, model.observed_point] = True
    metric = posed.unit_frame.to_object(model.points)
    normals = surface.face_normals[surface.closest_points(metric).face]
    for row, pose in enumerate(posed.camera_to_object):
        towards = pose[:3, 3] - model.points
        cosine = np.einsum("ij,ij->i", normals, towards) / np.linalg.norm(towards, axis=1)
        assert not visibility[row, cosine < -1e-6].any()
        at = project(model.points, pose, (HEIGHT, WIDTH), FIELD_OF_VIEW)
        inside = ((at >= 0) & (at < [WIDTH, HEIGHT])).all(axis=1)
        column, line = np.floor(np.where(inside[:, None], at, 0)).astype(int).T
        covered = inside & (views["rgba"][row, line, column, 3] >= 0.5)
        np.testing.assert_array_equal(visibility[row, cosine > 0.02], covered[cosine > 0.02])


def test_points_have_the_mean_colour_of_training_views_alone(views, surface):
    spoilt = views["rgba"].copy()
    spoilt[views["held_out"], ..., :3] = 0.9
    spoilt_views = Product(
        {**views.arrays, "rgba": Array(spoilt, ("view", "y", "x", "channel"), "1", "colour")},
        views.attributes,
    )
    model = sparse_model(PosedViews.of_product(views), surface, points=300, seed=0)
    again = sparse_model(PosedViews.of_product(spoilt_views), surface, points=300, seed=0)
    np.testing.assert_array_equal(model.colours, again.colours)
    face = surface.closest_points(UnitFrame.from_dict(views.attributes["frame"]).to_object(model.points)).face
    expected = straight_srgb(np.concatenate([straight_colour(face), np.ones((len(face), 1))], axis=1))[:, :3]
    # Pixels on edges mix two faces.
    assert np.median(np.abs(model.colours.astype(int) - expected)) == 0
    assert (np.abs(model.colours.astype(int) - expected).max(axis=1) <= 2).mean() > 0.7


def test_without_a_surface_there_are_no_points_and_it_says_so(views, tmp_path):
    exported(tmp_path / "colmap", "colmap", views, surface=None)
    _, images, points = read_binary(tmp_path / "colmap" / "sparse" / "0")
    assert not points
    assert len(images) == 8
    assert all(len(cells) == 0 for _, _, _, cells in images.values())
    assert "not at hand" in json.loads((tmp_path / "colmap" / "views.json").read_text())["points"]


def test_light_obeys_the_inverse_square_law_in_either_frame(views):
    unit, metric = (PosedViews.of_product(views, frame) for frame in ("unit", "object"))
    point = np.array([0.1, 0.2, -0.3])
    in_unit = unit.light_intensity / np.sum((unit.lights - point) ** 2, axis=1)
    in_metres = metric.light_intensity / np.sum(
        (metric.lights - metric.unit_frame.to_object(point)) ** 2, axis=1
    )
    np.testing.assert_allclose(in_metres, in_unit, rtol=1e-12)
    # Radiance of a Lambertian surface in the data set is albedo P cos / (4 pi^2 d^2).
    assert unit.light_intensity / math.pi == pytest.approx(12.0 / (4 * math.pi**2))


def test_png_over_white_is_the_projects_image_on_white(views, tmp_path):
    posed = exported(tmp_path / "nerf", "nerf", views)
    for row in (0, 6):
        split, _, index = posed.names[row].partition("_")
        image = Image.open(tmp_path / "nerf" / split / f"r_{index}.png")
        assert image.mode == "RGBA"
        pixels = np.asarray(image).astype(float)
        blended = pixels[..., :3] * pixels[..., 3:] / 255 + 255 - pixels[..., 3:]
        assert np.abs(blended - on_white(views["rgba"][row])).max() <= 1.5
        assert (np.asarray(image)[views["rgba"][row, ..., 3] == 0] == 0).all()


def test_exr_holds_the_master_bit_for_bit(views, tmp_path):
    script = (
        "import sys, numpy as np; from pathlib import Path\n"
        "from objectfolder.export.files import write_exr\n"
        "import cv2\n"
        "rgba = np.load(sys.argv[1]); write_exr(Path(sys.argv[2]), rgba)\n"
        "read = cv2.imread(sys.argv[2], cv2.IMREAD_UNCHANGED)\n"
        "assert np.array_equal(read[..., [2, 1, 0, 3]].astype(np.float16), rgba)\n"
    )
    np.save(tmp_path / "rgba.npy", views["rgba"][1] * np.float16(3.7))
    # A process of its own: OpenCV asks for its flag once.
    subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "rgba.npy"), str(tmp_path / "image.exr")],
        check=True,
        cwd=Path(__file__).parents[2],
        env={key: value for key, value in os.environ.items() if key != "OPENCV_IO_ENABLE_OPENEXR"},
    )
    header = (tmp_path / "image.exr").read_bytes()[:400]
    assert header[:4] == b"\x76\x2f\x31\x01"
    # A channel's name and its type: 1 is half float.
    assert b"A\0" + struct.pack("<i", 1) in header


def test_exr_that_cannot_be_written_says_what_to_do(views, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingPackageError, match=r"cv2: is not installed\. .*factory\[factory\]"):
        write_exr(tmp_path / "image.exr", views["rgba"][0])


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_quaternions_of_any_turn(values):
    rotation = Rotation.from_quat(values).as_matrix()
    w, x, y, z = quaternion(rotation[None])[0]
    assert w >= 0
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), rotation, atol=1e-9)


def test_camera_centre_is_minus_r_transposed_t():
    poses = look_at(uniform_on_sphere(5, 2.0, np.random.default_rng(0)))
    rotation, translation = world_to_camera(poses)
    np.testing.assert_allclose(-np.einsum("nji,nj->ni", rotation, translation), poses[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)


def test_equal_exports_have_equal_bytes(views, surface, tmp_path):
    for name in ("first", "second"):
        exported(tmp_path / name, "colmap", views, surface=surface, points=50)
    first, second = (
        {path.relative_to(tmp_path / name): path.read_bytes() for path in (tmp_path / name).rglob("*.*")}
        for name in ("first", "second")
    )
    assert first == second


def test_a_folder_is_not_overwritten_unless_asked_and_never_half_written(tmp_path):
    folder = tmp_path / "out"
    with new_folder(folder) as output:
        write_json(output / MANIFEST, {"version": 1})
    with pytest.raises(InputError, match="ask to overwrite it"), new_folder(folder):
        pytest.fail("must not be entered")
    with pytest.raises(ValueError, match="not JSON compliant"), new_folder(folder, overwrite=True) as output:
        write_json(output / MANIFEST, {"version": float("nan")})
    assert json.loads((folder / MANIFEST).read_text()) == {"version": 1}
    with new_folder(folder, overwrite=True) as output:
        write_json(output / MANIFEST, {"version": 3})
    assert json.loads((folder / MANIFEST).read_text()) == {"version": 3}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_of_something_else_is_never_replaced(tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.tex").write_text("years of work")
    with (
        pytest.raises(InputError, match=r"holds files but no export\.json"),
        new_folder(tmp_path / "home", overwrite=True),
    ):
        pytest.fail("must not be entered")
    assert (tmp_path / "home" / "thesis.tex").read_text() == "years of work"


def test_a_product_of_another_kind_is_named_with_what_it_lacks(views):
    foreign = Product({"rgba": views.arrays["rgba"]}, {})
    with pytest.raises(FormatError, match="cup: no product of views: lacks camera_to_world"):
        PosedViews.of_product(foreign, where="cup")


def test_credit_keeps_what_is_known_and_says_what_is_not():
    credit = Credit.of_record("mug", {"name": "Mug", "licence": "CC-BY-4.0", "attribution": "A. Potter"})
    assert "CC-BY-4.0" in credit.to_text()
    assert "A. Potter" in credit.to_text()
    assert credit.source == "not stated"
    assert Credit.of_record("mug", None) == Credit("mug", "mug")
