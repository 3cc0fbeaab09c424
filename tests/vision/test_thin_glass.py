"""Thin glass: a slab by its closed form, as the Object File draws it, and as Cycles does."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_normal_maps import stored
from vision_shapes import cube, sphere

from objectfolder import load
from objectfolder.errors import FormatError, InputError
from objectfolder.fidelity.sight import foreground_alpha, held_out_truth
from objectfolder.making.views.views import simulate_views
from objectfolder.making.visionnet import map_sampling
from objectfolder.making.visionnet.fitting import fit_visionnet
from objectfolder.making.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import Product
from objectfolder.products.tensor_file import TensorFile, write_tensor_file
from objectfolder.surface.codec import encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at
from objectfolder.vision.compiled.bounding_volumes import BoundingVolumes
from objectfolder.vision.compositing import srgb_encode
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.thin_glass import slab
from objectfolder.vision.visionnet.visionnet import VisionNet
from pipeline.publish.queries.description import info_lines
from tests.small_file import bar_mesh

THIN = Appearance(0.3, 0.0, glass="thin")
UPRIGHT = ((1.5 - 1) / (1.5 + 1)) ** 2
CAMERA = look_at(np.array([[0.0, -2.5, 0.0]]))
WHITE = (255, 255, 255)


@pytest.fixture(autouse=True)
def _coarse_albedo(monkeypatch: pytest.MonkeyPatch) -> None:
    """Colours here are even: fine lattices would show the same, and take most of the time to pack."""
    monkeypatch.setattr(map_sampling, "ALBEDO_PITCHES", (1 / 64,))
    monkeypatch.setattr(map_sampling, "FINE_PITCHES", ())


def hollow(mesh: TexturedMesh, thickness: float) -> TexturedMesh:
    """A closed mesh with a cavity of its own shape about its middle."""
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    inner = middle + (1 - thickness) * (mesh.vertices - middle)
    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, inner]),
        faces=np.concatenate([mesh.faces, len(mesh.vertices) + mesh.faces[:, ::-1]]),
        texture_coordinates=np.concatenate([mesh.texture_coordinates, mesh.texture_coordinates[:, ::-1]]),
        face_texture=np.concatenate([mesh.face_texture, mesh.face_texture]),
    )


def net_of(mesh: TexturedMesh, appearance: Appearance = THIN) -> VisionNet:
    frame = UnitFrame.of_points(mesh.vertices)
    maps = sample_maps(mesh, frame, appearance, "known")
    return VisionNet(
        mesh.surface, frame, None, {}, radiance_scale=12 / (4 * np.pi**2), camera_radius=2.5,
        maps=maps, appearance=appearance,
    )  # fmt: skip


@given(st.floats(-1, 1), st.floats(0, 1), st.floats(1.01, 2.5))
def test_what_a_wall_neither_reflects_nor_lets_through_it_absorbs(cosine, colour, index):
    reflectance, transmittance = slab(np.array([cosine]), np.array([[colour, 1.0, 0.0]]), index)
    absorbed = 1 - reflectance - transmittance
    assert (absorbed >= -1e-12).all()
    np.testing.assert_allclose(absorbed[0, 1], 0, atol=1e-12)
    np.testing.assert_allclose(transmittance[0, 2], 0, atol=1e-12)


def test_upright_light_meets_the_closed_form():
    colours = np.array([[1.0, 0.5, 0.0]])
    reflectance, transmittance = slab(np.ones(1), colours, 1.5)
    lost = 1 - (UPRIGHT * colours) ** 2
    np.testing.assert_allclose(transmittance, (1 - UPRIGHT) ** 2 * colours / lost)
    np.testing.assert_allclose(reflectance[0, 0], 2 * UPRIGHT / (1 + UPRIGHT))
    np.testing.assert_allclose(reflectance[0, 2], UPRIGHT)


def test_rays_meet_the_front_faces_of_nested_shells_once_each_in_order():
    mesh = hollow(cube(1.0), 0.2)
    volumes = BoundingVolumes.of_triangles(mesh.vertices[mesh.faces])
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    # Along the diagonals of its sides, where two faces meet.
    origins = middle + np.array([[0.0, -3.0, 0.0], [0.1, -3.0, 0.1], [0.0, -3.0, 0.0]])
    directions, reach = np.tile([0.0, 1.0, 0.0], (3, 1)), np.array([np.inf, np.inf, 2.8])
    ray, face, barycentric = volumes.front_faces(origins, directions, reach, 8)
    np.testing.assert_array_equal(ray, [0, 0, 1, 1, 2])
    met = np.einsum("ij,ijk->ik", barycentric, mesh.vertices[mesh.faces[face]]) - middle
    np.testing.assert_allclose(met[:, 1], [-0.5, 0.4, -0.5, 0.4, -0.5], atol=1e-12)
    assert volumes.front_faces(origins, directions, reach, 1)[0].tolist() == [0, 1, 2]


@pytest.mark.parametrize(("walls", "mesh"), [(1, cube(1.0)), (2, hollow(cube(1.0), 0.2))])
def test_alpha_is_what_the_walls_of_a_box_keep(walls, mesh):
    clear = replace(mesh, textures=(np.full((1, 1, 4), 255, np.uint8),))
    image = net_of(clear).render(CAMERA, np.array([0.0, 1.0, 0.5]), 33, 39.6)[0]
    reflectance = 2 * UPRIGHT / (1 + UPRIGHT)
    assert image[16, 16, 3] == pytest.approx(1 - (1 - reflectance) ** walls, abs=1e-4)
    assert image[0, 0, 3] == 0


def test_an_even_environment_shows_by_what_is_reflected_alone():
    around = Environment.of(np.ones((8, 16, 3)))
    image = net_of(sphere(0.5, WHITE, 4)).render(CAMERA, around, 33, 39.6)[0]
    # One wall, convex: what it does not let through it reflects, of radiance 1 all round.
    inside = image[12:21, 12:21]
    assert inside[..., 0].mean() == pytest.approx(inside[..., 3].mean(), rel=0.01)
    np.testing.assert_allclose(inside[..., 0], inside[..., 3], rtol=0.08)


def test_an_answer_is_the_same_in_part_and_along_a_ray():
    net, light = net_of(hollow(sphere(0.5, WHITE, 2), 0.1)), np.array([0.6, -0.7, 0.5])
    image = net.render(CAMERA, light, 24, 39.6)
    part = net.render(CAMERA, light, 24, 39.6, crop=(5, 6, 9, 8))
    np.testing.assert_array_equal(part[0], image[0, 5:14, 6:14])
    along = net.radiance(CAMERA[:, :3, 3], -CAMERA[:, :3, 2], light)
    reflectance = 2 * UPRIGHT / (1 + UPRIGHT)
    assert along[0, 3] == pytest.approx(1 - (1 - reflectance) ** 2, abs=1e-3)


@pytest.mark.slow
def test_a_glass_shell_is_as_cycles_draws_it():
    mesh = hollow(sphere(0.5, (200, 255, 220), 3), 0.1)
    counts = {"training_views": 1, "training_samples": 1, "held_out_views": 2, "held_out_samples": 32}
    views = simulate_views(mesh, THIN, resolution=32, **counts, seed=4, passes=False)
    assert "slab" in views.attributes["transmission"]
    held_out = views["held_out"]
    truth = views["rgba"][held_out].astype(np.float64)
    answer = net_of(mesh).render(
        views["camera_to_world"][held_out], views["light_position"][held_out], 32, 39.6
    )
    within = held_out_truth(views)[1]
    assert foreground_alpha(views) < 0.05
    assert within.sum() > 500
    # At the rim alpha rises steeply within a pixel, and paths are few.
    assert np.sqrt(np.mean((answer[within][:, 3] - truth[within][:, 3]) ** 2)) < 0.015
    apart = srgb_encode(answer[..., :3]) - srgb_encode(truth[..., :3])
    assert -10 * np.log10((apart[within] ** 2).mean()) > 38
    assert truth[..., :3].max() > 0.05


def test_thin_glass_is_refused_where_it_cannot_be():
    open_mesh = cube()
    open_mesh = replace(
        open_mesh,
        faces=open_mesh.faces[1:],
        texture_coordinates=open_mesh.texture_coordinates[1:],
        face_texture=open_mesh.face_texture[1:],
    )
    counts = {"training_views": 1, "training_samples": 1, "held_out_views": 0, "held_out_samples": 1}
    with pytest.raises(InputError, match="the surface is open"):
        simulate_views(open_mesh, THIN, resolution=8, **counts)
    with pytest.raises(InputError, match=r"'milky' is not known\. Use one of opaque, thin"):
        Appearance(glass="milky")
    with pytest.raises(InputError, match="thin, of a metal"):
        Appearance(metallic=1.0, glass="thin")
    views = Product({}, {"appearance": THIN.to_dict(), "light_power_w": 12.0, "camera_radius": 2.5})
    mesh, frame, _ = stored(cube())
    with pytest.raises(InputError, match="cannot be learned"):
        fit_visionnet(mesh.surface, frame, views, material="learned")


def test_a_file_of_thin_glass_has_a_version_of_its_own(small_file: Path, tmp_path: Path):
    bar = load(small_file)
    maps = sample_maps(stored_mesh(bar_mesh(), bar.surface), bar.frame, THIN, "known")
    counts = {"radiance_scale": 0.3, "camera_radius": 2.5, "maps": maps, "appearance": THIN}
    net = VisionNet(bar.surface, bar.frame, None, {}, **counts)
    sensor, parts = bar.touch.net, encode_surface(bar.surface)
    file = ObjectFile.of_encoders(parts, bar.frame, net, bar.modes, sensor, bar.description)
    file.save(tmp_path / "bar.safetensors")
    again = load(tmp_path / "bar.safetensors")
    assert again.content().metadata["format_version"] == "5"
    assert (again.vision.glass, bar.vision.glass) == ("thin", "opaque")
    assert "sight        computed as thin glass" in info_lines(again, tmp_path / "bar.safetensors")
    content = again.content()
    description = json.loads(content.metadata["vision"])
    description["appearance"]["glass"] = "milky"
    wrong = TensorFile(content.tensors, {**content.metadata, "vision": json.dumps(description)})
    write_tensor_file(tmp_path / "wrong.safetensors", wrong)
    with pytest.raises(FormatError):
        load(tmp_path / "wrong.safetensors")
