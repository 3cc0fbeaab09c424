import dataclasses
import sys

import numpy as np
import pytest
from vision_shapes import cube, sphere

from objectfolder.errors import InputError, SimulationError
from objectfolder.geometry.frames import UnitFrame
from objectfolder.vision import cycles_process
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at, project
from objectfolder.vision.compositing import srgb_decode
from objectfolder.vision.cycles_process import render_in_children
from objectfolder.vision.render_request import Scene, Shots, load_request, save_request
from objectfolder.vision.views import simulate_views

LAMBERT = Appearance(roughness=1.0, metallic=0.0, specular=0.0)
SMALL = {
    "resolution": (24, 32),
    "training_views": 3,
    "training_samples": 4,
    "held_out_views": 2,
    "held_out_samples": 16,
}


def scene_of(mesh, appearance=LAMBERT) -> Scene:
    frame = UnitFrame.of_points(mesh.vertices)
    return Scene(
        frame.to_unit(mesh.vertices), mesh.faces, mesh.surface.corner_normals, mesh.texture_coordinates,
        mesh.face_texture, mesh.textures, appearance,
    )  # fmt: skip


def test_a_lambert_sphere_has_the_analytic_radiance():
    mesh = sphere(0.5, (188, 120, 60))
    camera, light = np.array([[0.0, -2.5, 0.0]]), np.array([[0.3, -0.9, 0.5]])
    shots = Shots(look_at(camera), light, np.array([1]), 64, 65, 65, 30.0, light_power_w=12.0)
    image = render_in_children(scene_of(mesh), shots)[0].astype(float)
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


def test_creases_of_a_welded_mesh_cast_no_shadow_on_their_own_faces():
    mesh = dataclasses.replace(cube(), textures=(np.full((1, 1, 4), 188, dtype=np.uint8),))
    camera, light = look_at(np.array([[0.0, -2.5, 0.0]])), np.array([[0.1, -0.95, -0.3]])
    image = render_in_children(scene_of(mesh), Shots(camera, light, np.array([1]), 16, 33, 33, 20.0))[0]
    row, column = np.mgrid[4:29, 4:29]
    step = 2.0 / (16.5 / np.tan(np.radians(10)))
    offset = np.stack(
        [(column - 16) * step - 0.1, np.full(row.shape, 0.45), (16 - row) * step + 0.3], axis=-1
    )
    distance = np.linalg.norm(offset, axis=-1)
    expected = srgb_decode(188 / 255) * 12.0 / (4 * np.pi**2) * 0.45 / distance**3
    np.testing.assert_allclose(image[4:29, 4:29, 1].astype(float), expected, rtol=0.01)


def test_each_face_has_its_texture_and_texture_alpha_is_ignored():
    red, green = np.full((2, 2, 4), [200, 0, 0, 255], np.uint8), np.full((2, 2, 4), [0, 200, 0, 0], np.uint8)
    mesh = cube()
    upper = mesh.surface.face_normals[:, 2] > 0.5
    mesh = dataclasses.replace(mesh, textures=(red, green), face_texture=upper.astype(np.int32))
    cameras = look_at(np.array([[0.0, 0.0, 2.5], [0.0, -2.5, 0.0]]))
    lights = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    images = render_in_children(scene_of(mesh), Shots(cameras, lights, np.zeros(2, int), 4, 9, 9, 30.0))
    assert (images[:, 4, 4, 3] == 1).all()
    assert images[0, 4, 4, 1] > 0.1 > 0.01 > images[0, 4, 4, 0]
    assert images[1, 4, 4, 0] > 0.1 > 0.01 > images[1, 4, 4, 1]


def test_projected_vertices_lie_on_the_rendered_silhouette():
    mesh = cube()
    pose = look_at(np.array([[1.2, -1.9, 1.1]]))
    shots = Shots(pose, np.array([[0.0, 0.0, 1.0]]), np.array([0]), 16, 60, 90, 65.0)
    alpha = render_in_children(scene_of(mesh), shots)[0, ..., 3]
    corners = project(scene_of(mesh).vertices, pose[0], (60, 90), 65.0)
    rows, columns = np.nonzero(alpha > 0)
    np.testing.assert_allclose(
        [columns.min(), columns.max() + 1, rows.min(), rows.max() + 1],
        [corners[:, 0].min(), corners[:, 0].max(), corners[:, 1].min(), corners[:, 1].max()],
        atol=1.01,
    )


def test_views_are_reproducible_whatever_the_threads_and_counts():
    first = simulate_views(cube(), Appearance(), **SMALL, seed=5)
    again = simulate_views(cube(), Appearance(), **{**SMALL, "training_views": 2}, seed=5, threads=2)
    assert "bpy" not in sys.modules
    for name in first.arrays:
        np.testing.assert_array_equal(first[name][[0, 1, 3, 4]], again[name], err_msg=name)
    assert first["rgba"].shape == (5, 24, 32, 4)
    assert first["rgba"].dtype == np.float16
    assert first["held_out"].tolist() == [False] * 3 + [True] * 2
    assert first["samples"].tolist() == [4] * 3 + [16] * 2
    assert 20 < first.attributes["noise_floor_foreground_db"] < first.attributes["noise_floor_db"] < 90
    np.testing.assert_allclose(first.attributes["frame"]["centre"], [0.3, -0.2, 0.1], atol=1e-12)
    assert first.attributes["frame"]["scale"] == pytest.approx(0.1)
    np.testing.assert_allclose(np.linalg.norm(first["camera_to_world"][:, :3, 3], axis=1), 2.5)
    other = simulate_views(cube(), Appearance(), **SMALL, seed=6)
    assert not np.array_equal(first["light_position"], other["light_position"])


def test_bad_parameters_and_appearances_are_named():
    with pytest.raises(InputError, match=r"views\.training_samples"):
        simulate_views(cube(), Appearance(), **{**SMALL, "training_samples": 0})
    with pytest.raises(InputError, match=r"appearance\.roughness"):
        Appearance(roughness=1.5)


def test_a_failed_render_process_says_why(monkeypatch):
    monkeypatch.setattr(cycles_process.sys, "executable", "/bin/false")
    shots = Shots(look_at(np.array([[0, 0, 2.5]])), np.array([[0.0, 0, 1]]), np.array([0]), 1, 8, 8, 40.0)
    with pytest.raises(SimulationError, match="status 1"):
        render_in_children(scene_of(cube()), shots)


def test_a_request_survives_the_way_to_the_child(tmp_path):
    scene = scene_of(cube(), Appearance(0.25, 1.0, 0.0))
    shots = Shots(look_at(np.array([[0, 0, 2.5]])), np.array([[0.0, 0, 1]]), np.array([3]), 7, 8, 9, 40.0)
    save_request(tmp_path / "request.npz", scene, shots)
    found_scene, found_shots = load_request(tmp_path / "request.npz")
    assert found_scene.appearance == scene.appearance
    np.testing.assert_array_equal(found_scene.textures[0], scene.textures[0])
    assert (found_shots.samples, found_shots.height, found_shots.width) == (7, 8, 9)
    np.testing.assert_array_equal(found_shots.camera_to_world, shots.camera_to_world)
