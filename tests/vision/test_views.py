import dataclasses
import struct
import sys

import numpy as np
import pytest
from kept_renderers import render_in_kept
from vision_shapes import cube, sphere

from objectfolder import child_process
from objectfolder.errors import InputError, SimulationError
from objectfolder.making.device import DEVICE
from objectfolder.making.views import cycles_process
from objectfolder.making.views.cycles import read_exr
from objectfolder.making.views.cycles_process import render_in_children, render_series
from objectfolder.making.views.passes import cast_passes
from objectfolder.making.views.render_request import Scene, Shots, load_request, save_request, unit_scene
from objectfolder.making.views.views import exposure, noise_floor, simulate_views
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at, project
from objectfolder.vision.compositing import composite_on_white, srgb_decode
from objectfolder.vision.conditions import CONDITIONS

LAMBERT = Appearance(roughness=1.0, metallic=0.0, specular=0.0)
SMALL = {
    "resolution": (24, 32),
    "training_views": 3,
    "training_samples": 4,
    "held_out_views": 2,
    "held_out_samples": 16,
}


def scene_of(mesh, appearance=LAMBERT) -> Scene:
    return unit_scene(mesh, appearance, UnitFrame.of_points(mesh.vertices))


@pytest.mark.slow
def test_a_lambert_sphere_has_the_analytic_radiance():
    mesh = sphere(0.5, (188, 120, 60))
    camera, light = np.array([[0.0, -2.5, 0.0]]), np.array([[0.3, -0.9, 0.5]])
    shots = Shots(look_at(camera), light, np.array([1]), 16, 65, 65, 30.0, light_power_w=12.0)
    image = render_in_kept(scene_of(mesh), shots)[0].astype(float)
    row, column = np.mgrid[:65, :65]
    focal = 32.5 / np.tan(np.radians(15))
    directions = np.stack([(column - 32) / focal, np.ones((65, 65)), (32 - row) / focal], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    along = directions[..., 1] * 2.5
    root = along**2 - (2.5**2 - 0.25)
    inside = root > 0.02  # away from the silhouette, where a pixel is not its centre
    point = camera[0] + (along - np.sqrt(np.maximum(root, 0)))[..., None] * directions
    to_light = light[0] - point
    distance = np.linalg.norm(to_light, axis=-1)
    cosine = np.maximum((point / 0.5 * to_light).sum(axis=-1) / distance, 0)
    albedo = srgb_decode(np.array([188, 120, 60]) / 255)
    expected = albedo * (12.0 / (4 * np.pi**2) * cosine / distance**2)[..., None]
    np.testing.assert_array_equal(image[inside][:, 3], 1.0)
    np.testing.assert_allclose(image[inside][:, :3], expected[inside], atol=0.01)


@pytest.mark.slow
def test_creases_of_a_welded_mesh_cast_no_shadow_on_their_own_faces():
    mesh = dataclasses.replace(cube(), textures=(np.array([[[188, 188, 188, 255]]], np.uint8),))
    camera, light = look_at(np.array([[0.0, -2.5, 0.0]])), np.array([[0.1, -0.95, -0.3]])
    image = render_in_kept(scene_of(mesh), Shots(camera, light, np.array([1]), 16, 33, 33, 20.0))[0]
    row, column = np.mgrid[4:29, 4:29]
    step = 2.0 / (16.5 / np.tan(np.radians(10)))
    offset = np.stack(
        [(column - 16) * step - 0.1, np.full(row.shape, 0.45), (16 - row) * step + 0.3], axis=-1
    )
    distance = np.linalg.norm(offset, axis=-1)
    expected = srgb_decode(188 / 255) * 12.0 / (4 * np.pi**2) * 0.45 / distance**3
    np.testing.assert_allclose(image[4:29, 4:29, 1].astype(float), expected, rtol=0.01)


@pytest.mark.slow
def test_each_face_has_its_texture():
    red, green = (np.full((2, 2, 4), [*c, 255], np.uint8) for c in ([200, 0, 0], [0, 200, 0]))
    mesh = cube()
    upper = mesh.surface.face_normals[:, 2] > 0.5
    mesh = dataclasses.replace(mesh, textures=(red, green), face_texture=upper.astype(np.int32))
    cameras = look_at(np.array([[0.0, 0.0, 2.5], [0.0, -2.5, 0.0]]))
    lights = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    images = render_in_kept(scene_of(mesh), Shots(cameras, lights, np.zeros(2, int), 16, 9, 9, 30.0))
    assert (images[:, 4, 4, 3] == 1).all()
    assert images[0, 4, 4, 1] > 0.1 > 0.01 > images[0, 4, 4, 0]
    assert images[1, 4, 4, 0] > 0.1 > 0.01 > images[1, 4, 4, 1]


@pytest.mark.slow
def test_projected_vertices_lie_on_the_rendered_silhouette():
    mesh = cube()
    pose = look_at(np.array([[1.2, -1.9, 1.1]]))
    shots = Shots(pose, np.array([[0.0, 0.0, 1.0]]), np.array([0]), 16, 60, 90, 65.0)
    alpha = render_in_kept(scene_of(mesh), shots)[0, ..., 3]
    corners = project(scene_of(mesh).vertices, pose[0], (60, 90), 65.0)
    rows, columns = np.nonzero(alpha > 0)
    np.testing.assert_allclose(
        [columns.min(), columns.max() + 1, rows.min(), rows.max() + 1],
        [corners[:, 0].min(), corners[:, 0].max(), corners[:, 1].min(), corners[:, 1].max()],
        atol=1.01,
    )


@pytest.fixture(scope="module")
def in_conditions():
    """Fewer views of the cube, and one in each condition, by two threads."""
    fewer = {**SMALL, "training_views": 2, "condition_views": 1}
    return simulate_views(cube(), Appearance(), **fewer, seed=5, threads=2)


@pytest.mark.slow
def test_views_are_reproducible_whatever_the_threads_and_counts(in_conditions, monkeypatch):
    first, again = simulate_views(cube(), Appearance(), **SMALL, seed=5), in_conditions
    assert "bpy" not in sys.modules
    for name in first.arrays:
        np.testing.assert_array_equal(first[name][[0, 1, 3, 4]], again[name], err_msg=name)
    shapes = {"rgba": (4,), "depth": (), "normal": (3,), "albedo": (3,), "roughness": (), "metallic": (),
              "mask": ()}  # fmt: skip
    kinds = dict.fromkeys(shapes, "f2") | {"depth": "f4", "mask": "?"}
    for name, channels in shapes.items():
        assert (first[name].shape, first[name].dtype) == ((5, 24, 32, *channels), np.dtype(kinds[name]))
    assert first["held_out"].tolist() == [False] * 3 + [True] * 2
    assert first["samples"].tolist() == [4] * 3 + [16] * 2
    assert 20 < first.attributes["noise_floor_foreground_db"] < first.attributes["noise_floor_db"] < 90
    np.testing.assert_allclose(first.attributes["frame"]["centre"], [0.3, -0.2, 0.1], atol=1e-12)
    assert first.attributes["frame"]["scale"] == pytest.approx(0.1)
    np.testing.assert_allclose(np.linalg.norm(first["camera_to_world"][:, :3, 3], axis=1), 2.5)
    images = np.random.default_rng(0).random((5, 24, 32, 4)).astype(np.float16)
    monkeypatch.setattr(
        "objectfolder.making.views.views.render_series",
        lambda scene, series: [images[: len(shots.camera_to_world)] for shots in series],
    )
    next_views = simulate_views(cube(), Appearance(), **SMALL, seed=6, passes=False)
    assert first.arrays.keys() - next_views.arrays.keys() == set(shapes) - {"rgba"}
    assert not np.array_equal(first["light_position"], next_views["light_position"])


@pytest.mark.slow
def test_parts_of_images_are_rendered_alone_and_several_requests_in_one_process():
    camera, light = look_at(np.array([[1.2, -1.9, 1.1]])), np.array([[0.0, -1.0, 1.0]])
    whole = Shots(camera, light, np.array([3]), 4, 32, 32, 40.0)
    part = dataclasses.replace(whole, parts=np.array([[8, 12, 10, 6]]))
    finer = dataclasses.replace(whole, samples=16, most_samples=64)
    alone = [render_in_children(scene_of(cube()), shots)[0] for shots in (whole, part, finer)]
    assert not np.array_equal(alone[2], alone[0])
    # Half beside the image, and wholly.
    shifts = np.array([[0.0, 0.0, 0.9], [0.0, 0.0, 3.0]])
    aside = dataclasses.replace(
        finer, camera_to_world=look_at(np.tile([[0.0, -2.5, 0.0]], (2, 1)), shifts),
        light_position=np.tile(light, (2, 1)), seeds=np.arange(2), width=51,
    )  # fmt: skip
    everywhere = [
        dataclasses.replace(shots, parts=np.tile([[0, 0, 32, shots.width]], (len(shots.seeds), 1)))
        for shots in (finer, aside)
    ]
    series = render_series(scene_of(cube()), [whole, part, finer, aside, *everywhere])
    for image, again in zip(alone, series[:3], strict=True):
        np.testing.assert_array_equal(again[0], image)
    np.testing.assert_array_equal(series[2], series[4])
    np.testing.assert_array_equal(series[3], series[5])
    assert [(image[..., 3] > 0).any() for image in series[3]] == [True, False]
    expected = np.zeros_like(alone[0])
    expected[8:18, 12:18] = alone[0][8:18, 12:18]
    assert (expected[..., 3] > 0).any()
    np.testing.assert_array_equal(alone[1], expected)


def test_series_are_shared_among_processes_of_few_views(monkeypatch):
    """Each view comes back in its place, whatever process rendered it."""
    processes = []

    def paint(*paths):
        processes.append(sum(len(load_request(path)[1].seeds) for path in paths[::2]))
        for request, result in zip(paths[::2], paths[1::2], strict=True):
            shots = load_request(request)[1]
            tall = np.ones((len(shots.seeds), shots.height, shots.width, 4))
            np.save(result, tall * shots.seeds[:, None, None, None] + shots.parts[:, 0, None, None, None])

    monkeypatch.setattr(cycles_process, "VIEWS_PER_PROCESS", 4)
    monkeypatch.setattr(cycles_process, "_run", paint)
    series = [
        Shots(look_at(np.ones((count, 3))), np.ones((count, 3)), np.arange(count), 1, size, size, 40.0,
              parts=np.full((count, 4), 100 * size))
        for count, size in ((3, 2), (0, 2), (6, 3))
    ]  # fmt: skip
    for shots, images in zip(series, render_series(scene_of(cube()), series), strict=True):
        expected = np.arange(len(shots.seeds)) + 100 * shots.height
        np.testing.assert_array_equal(images[:, 0, 0, 0], expected)
    assert processes == [4, 4, 1]


@pytest.mark.slow
def test_views_in_other_conditions_show_the_object(in_conditions):
    views = in_conditions
    assert list(views.attributes["conditions"]) == list(CONDITIONS)
    rgba = views["condition_rgba"]
    assert rgba.shape == (len(CONDITIONS), 64, 64, 4)
    assert (rgba[..., 3] >= 0.5).mean(axis=(1, 2)).min() > 0.1
    lamps = np.linalg.norm(views["condition_light_position"], axis=1)
    np.testing.assert_allclose(lamps[:5], [1, 1, 1, 0.6, 3])
    # One direction of light, which weakens with the square of the lamp's distance.
    assert rgba[0, ..., :3].max() > 4 * rgba[4, ..., :3].max() > 0
    for condition in views.attributes["conditions"].values():
        assert 20 < condition["noise_floor_db"] <= 120
    assert len(views["rgba"]) == 4


def test_the_noise_floor_is_the_error_of_the_mean_of_two_renders():
    random = np.random.default_rng(0)
    truth = np.ones((3, 24, 24, 4))
    truth[..., :3] = random.uniform(0.2, 0.8, (3, 1, 1, 3))
    truth[:, :12] = 0
    first, second = (truth * (1 + 0.003 * random.normal(size=truth.shape)) for _ in range(2))
    first[..., 3] = second[..., 3] = truth[..., 3]
    error = (composite_on_white((first + second) / 2) - composite_on_white(truth)) ** 2
    floors = noise_floor(first, second)
    assert floors["noise_floor_db"] == pytest.approx(-10 * np.log10(error.mean()), abs=0.2)
    assert floors["noise_floor_foreground_db"] == pytest.approx(floors["noise_floor_db"] - 3.01, abs=0.01)
    assert noise_floor(first[:0], second[:0])["noise_floor_db"] is None


def test_bad_parameters_and_appearances_are_named():
    with pytest.raises(InputError, match=r"views\.training_samples"):
        simulate_views(cube(), Appearance(), **{**SMALL, "training_samples": 0})
    with pytest.raises(InputError, match=r"appearance\.roughness"):
        Appearance(roughness=1.5)


def test_a_failed_render_process_says_why(monkeypatch):
    monkeypatch.setattr(child_process.sys, "executable", "/bin/false")
    shots = Shots(look_at(np.array([[0, 0, 2.5]])), np.array([[0.0, 0, 1]]), np.array([0]), 1, 8, 8, 40.0)
    with pytest.raises(SimulationError, match="status 1"):
        render_in_children(scene_of(cube()), shots)


@pytest.mark.slow
def test_a_device_that_blender_does_not_have_is_named(monkeypatch):
    monkeypatch.setenv(DEVICE, "ABACUS")
    shots = Shots(look_at(np.array([[0, 0, 2.5]])), np.array([[0.0, 0, 1]]), np.array([0]), 1, 8, 8, 40.0)
    with pytest.raises(SimulationError, match="finds no ABACUS device here"):
        render_in_children(scene_of(cube()), shots)


def test_a_request_survives_the_way_to_the_child(tmp_path):
    scene = scene_of(cube(), Appearance(0.25, 1.0, 0.0))
    shots = Shots(look_at(np.array([[0, 0, 2.5]])), np.array([[0.0, 0, 1]]), np.array([3]), 7, 8, 9, 40.0)
    maps = {
        "alpha_cutoffs": {0: 0.25}, "roughness_maps": {}, "metallic_maps": {0: np.eye(3, dtype=np.uint8)},
    }  # fmt: skip
    scene = dataclasses.replace(scene, **maps)
    save_request(tmp_path / "request.npz", scene, shots)
    found_scene, found_shots = load_request(tmp_path / "request.npz")
    assert found_scene.appearance == scene.appearance
    assert (found_scene.alpha_cutoffs, found_scene.roughness_maps) == ({0: 0.25}, {})
    np.testing.assert_array_equal(found_scene.metallic_maps[0], np.eye(3))
    np.testing.assert_array_equal(found_scene.textures[0], scene.textures[0])
    assert (found_shots.samples, found_shots.height, found_shots.width) == (7, 8, 9)
    np.testing.assert_array_equal(found_shots.camera_to_world, shots.camera_to_world)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("resolution", "field_of_view", "radius"),
    [
        ((36, 16), 80.0, 1.2),
        pytest.param((20, 44), 25.0, 3.0, marks=pytest.mark.release("objectfolder.making.views")),
    ],
)
def test_any_resolution_field_of_view_and_radius(resolution, field_of_view, radius):
    """The truth's silhouette and passes agree with the projection of the cube's corners."""
    views = simulate_views(
        cube(), Appearance(), **{**SMALL, "resolution": resolution}, field_of_view_deg=field_of_view,
        camera_radius=radius,
    )  # fmt: skip
    corners = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    for view, pose in enumerate(views["camera_to_world"]):
        alpha, mask = views["rgba"][view, ..., 3], views["mask"][view]
        assert alpha.shape == resolution
        # A convex outline passes few pixels whose centre and area disagree.
        assert np.mean((alpha >= 0.5) != mask) < 0.03
        places = project(corners, pose, resolution, field_of_view)
        rows, columns = np.nonzero(mask)
        ends = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        limits = np.clip(
            [*places.min(axis=0), *places.max(axis=0)], 0, [*resolution[::-1], *resolution[::-1]]
        )
        np.testing.assert_allclose(ends, limits, atol=1.5)


def test_passes_of_a_cube_are_analytic():
    mesh = cube()
    pose = look_at(np.array([[0.0, -2.5, 0.0]]))
    passes = cast_passes(scene_of(mesh), pose, (40, 60), 40.0)
    row, column = np.mgrid[:40, :60]
    focal = 30 / np.tan(np.radians(20))
    inside = (np.abs((column + 0.5 - 30) / focal * 2.0) < 0.5) & (
        np.abs((row + 0.5 - 20) / focal * 2.0) < 0.5
    )
    np.testing.assert_array_equal(passes.mask[0], inside)
    np.testing.assert_allclose(passes.depth[0][inside], 2.0, atol=1e-5)
    assert np.isinf(passes.depth[0][~inside]).all()
    assert (passes.normal[0][~inside] == 0).all()
    np.testing.assert_allclose(passes.normal[0][inside], np.tile([0, -1, 0], (inside.sum(), 1)), atol=1e-3)
    colours = np.unique(passes.albedo[0][inside].round(2), axis=0)
    expected = srgb_decode(np.array([[40, 60, 200], [40 // 3, 60 // 3, 200 // 3]]) / 255)
    for colour in expected:
        assert np.abs(colours - colour).max(axis=1).min() < 0.01


def test_passes_see_the_inner_side_of_a_shell_and_nothing_behind_the_camera():
    shell = sphere(0.5, (128, 128, 128), 3)
    centre = np.eye(4)[None]
    passes = cast_passes(scene_of(shell), centre, (9, 9), 90.0)
    assert passes.mask.all()
    np.testing.assert_allclose(passes.depth[0, 4, 4], 0.5, atol=0.01)
    np.testing.assert_allclose(passes.normal[0, 4, 4].astype(float), [0, 0, 1], atol=0.02)
    away = look_at(np.array([[0.0, -2.5, 0.0]]), np.array([0.0, -5.0, 0.0]))
    assert not cast_passes(scene_of(shell), away, (9, 9), 90.0).mask.any()


def test_clipping_is_counted_over_covered_pixels_and_warned_of():
    rgba = np.zeros((1, 10, 20, 4), dtype=np.float16)
    rgba[0, :5, :, :] = [0.2, 0.4, 0.5, 1.0]
    rgba[0, 0, :2] = [0.1, 1.1, 0.2, 1.0]
    rgba[0, 1, 0] = [0.1, 0.3, 0.3, 0.25]  # a covered quarter whose straight colour is 1.2
    report = exposure(rgba)
    assert report["clipped_share"] == pytest.approx(0.03)
    assert report["warnings"] == ["3.0 % of the covered pixels clip: lower the power of the light"]
    rgba[0, 0, :2] = rgba[0, 2, 0]
    assert exposure(rgba)["warnings"] == []
    assert exposure(np.zeros_like(rgba))["clipped_share"] == 0.0


def test_the_reader_of_renders_takes_only_what_cycles_was_asked_for(tmp_path):
    image = np.random.default_rng(0).random((3, 5, 4)).astype(np.float32)
    lines = [struct.pack("<ii", row, 80) + image[row, :, ::-1].T.astype("<f4").tobytes() for row in range(3)]
    (tmp_path / "whole.exr").write_bytes(b"header" + b"".join(lines))
    np.testing.assert_array_equal(read_exr(str(tmp_path / "whole.exr"), 3, 5), image)
    for name, data in {"order": b"header" + b"".join(lines[::-1]), "short": b"".join(lines[1:])}.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(SimulationError, match="not the uncompressed image"):
            read_exr(str(tmp_path / name), 3, 5)
