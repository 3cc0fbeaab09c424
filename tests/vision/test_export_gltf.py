"""Textured glTF: written here, read back by trimesh, compared with the colours it was baked from."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from vision_shapes import cube, sphere

from objectfolder.errors import InputError
from objectfolder.export.files import Credit
from objectfolder.export.gltf import Part, write_glb
from objectfolder.export.textured_surface import bake, pack, write_mesh, write_surface
from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.making.visionnet.reflectance import Reflectance, angle_inputs
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at, pixel_rays
from objectfolder.vision.compositing import srgb_decode, srgb_encode
from objectfolder.vision.network.incidence import Incidence
from objectfolder.vision.network.network_layout import SURROUNDINGS, weight_shapes
from objectfolder.vision.network.sparse_grid import SparseGrid
from objectfolder.vision.visionnet.visionnet import VisionNet
from pipeline.publish.export.base_colour import nearest_texture_colour, network_colour, texture_colour

CREDIT = Credit("ball", "A ball", "made by code", "CC-BY-4.0", "the tests")
MATT = Appearance(roughness=0.7, metallic=0.0)


@pytest.fixture(scope="module")
def ball() -> Surface:
    return sphere(0.05, (200, 100, 50), 3).surface


def waves(points: np.ndarray) -> np.ndarray:
    """A smooth opaque colour of space, sRGB-encoded."""
    colour = 0.5 + 0.4 * np.sin(points * [60.0, 40.0, 80.0] + [0.0, 1.0, 2.0])
    return np.concatenate([colour, np.ones((len(points), 1))], axis=1)


def bilinear(image: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    """Look up (n, c) values of an image that repeats at (n, 2) u, v, v up: one texel at a time."""
    height, width = image.shape[:2]
    result = np.zeros((len(coordinates), image.shape[2]))
    for row, (u, v) in enumerate(coordinates):
        x, y = u * width - 0.5, (1 - v) * height - 0.5
        left, top = int(np.floor(x)), int(np.floor(y))
        for i, share_x in ((left, 1 - (x - left)), (left + 1, x - left)):
            for j, share_y in ((top, 1 - (y - top)), (top + 1, y - top)):
                result[row] += share_x * share_y * image[j % height, i % width]
    return result


def reloaded(path: Path) -> tuple[trimesh.Trimesh, np.ndarray]:
    """Return the one mesh of a GLB, and the matrix of its node, as trimesh reads them."""
    scene = trimesh.load(path, process=False)
    transform, name = scene.graph[scene.graph.nodes_geometry[0]]
    return scene.geometry[name], transform


def shown(mesh: trimesh.Trimesh, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Return the colours 0..255 that a viewer without light shows."""
    coordinates = np.einsum("ij,ijk->ik", barycentric, mesh.visual.uv[mesh.faces[face]])
    return bilinear(np.asarray(mesh.visual.material.baseColorTexture.convert("RGB")), coordinates)


def json_of(path: Path) -> dict:
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    body, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    assert 28 + size + body == len(data)
    content = json.loads(data[20 : 20 + size])
    assert content["buffers"] == [{"byteLength": body}]
    for view in content["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= body
    return content


def test_reloaded_glb_shows_the_baked_colours_at_random_points(ball, tmp_path):
    report = write_surface(
        tmp_path / "ball.glb", ball, lambda face, at: waves(ball.points_at(face, at)), MATT, CREDIT,
        colour="waves", side=512,
    )  # fmt: skip
    mesh, _ = reloaded(tmp_path / "ball.glb")
    samples = ball.sample(2000, 1)
    np.testing.assert_allclose(mesh.vertices.reshape(-1, 3, 3), ball.vertices[ball.faces], atol=1e-8)
    error = np.abs(shown(mesh, samples.face, samples.barycentric) - 255 * waves(samples.points)[:, :3])
    assert error.mean() < 1.0
    assert error.max() < 6.0
    assert report["bytes"] == (tmp_path / "ball.glb").stat().st_size
    assert report["texel_pitch_m"] < 0.001


def test_an_unlit_render_of_the_reloaded_glb_equals_one_of_the_surface(ball, tmp_path):
    write_surface(
        tmp_path / "ball.glb", ball, lambda face, at: waves(ball.points_at(face, at)), MATT, CREDIT,
        colour="waves", side=512,
    )  # fmt: skip
    mesh, node = reloaded(tmp_path / "ball.glb")
    upright = Surface(mesh.vertices @ node[:3, :3].T + node[:3, 3], mesh.faces)
    # The same camera about the object frame's z axis and about glTF's y axis.
    pose = look_at(np.array([[0.2, 0.1, 0.1]]))[0]
    origins, along = pixel_rays(pose, np.arange(48 * 48), np.array([[0.5, 0.5]]), 48, 39.6)
    first = ball.ray_hits(origins, along)
    turned = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    second = upright.ray_hits(origins @ turned.T, along @ turned.T)
    both = (first.face >= 0) & (second.face >= 0)
    assert both.sum() > 500
    assert (first.face >= 0).sum() - both.sum() < 5
    expected = 255 * waves(ball.points_at(first.face[both], first.barycentric[both]))[:, :3]
    colours = shown(mesh, second.face[both], second.barycentric[both])
    assert np.abs(colours - expected).mean() < 2.0


def test_up_is_y_and_lengths_are_metres(tmp_path):
    mesh = cube(0.1)
    write_mesh(tmp_path / "cube.glb", mesh, MATT, CREDIT)
    scene = trimesh.load(tmp_path / "cube.glb")
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    # x stays, z becomes y, y becomes -z.
    np.testing.assert_allclose(
        scene.bounds, [[low[0], low[2], -high[1]], [high[0], high[2], -low[1]]], atol=1e-7
    )


@given(st.integers(0, 10_000), st.integers(1, 60), st.sampled_from([64, 200, 256]))
def test_blocks_of_an_atlas_are_apart_and_hold_every_texel_that_is_read(seed, count, side):
    random = np.random.default_rng(seed)
    triangles = random.normal(size=(count, 1, 3)) + random.normal(size=(count, 3, 3)) * random.lognormal(
        -3, 1.5, size=(count, 1, 1)
    )
    atlas = pack(triangles, side)
    owner = np.full((side, side), -1)
    for face in range(count):
        block = owner[
            atlas.row[face] : atlas.row[face] + atlas.rows[face] + 1,
            atlas.column[face] : atlas.column[face] + atlas.columns[face] + 1,
        ]
        assert block.shape == (atlas.rows[face] + 1, atlas.columns[face] + 1)
        assert (block == -1).all()
        block[:] = face
    row, column, face, barycentric = atlas.texels()
    np.testing.assert_array_equal(owner[row, column], face)
    np.testing.assert_allclose(barycentric.sum(axis=1), 1.0)
    baked = np.zeros((side, side), dtype=bool)
    baked[row, column] = True
    at = random.dirichlet([0.5, 0.5, 0.5], size=count * 20)
    of = np.repeat(np.arange(count), 20)
    u, v = np.einsum("ij,ijk->ik", at, atlas.texture_coordinates()[of]).T
    x, y = u * side - 0.5, (1 - v) * side - 0.5
    for i in (np.floor(x + 1e-9).astype(int), np.ceil(x - 1e-9).astype(int)):
        for j in (np.floor(y + 1e-9).astype(int), np.ceil(y - 1e-9).astype(int)):
            assert baked[j, i].all()
            np.testing.assert_array_equal(owner[j, i], of)


def test_colour_does_not_bleed_between_triangles(tmp_path):
    mesh = cube()
    palette = np.random.default_rng(0).random((len(mesh.faces), 3))
    surface = mesh.surface

    def own(face: np.ndarray, _: np.ndarray) -> np.ndarray:
        return np.concatenate([palette[face], np.ones((len(face), 1))], axis=1)

    write_surface(tmp_path / "cube.glb", surface, own, MATT, CREDIT, colour="palette", side=64)
    loaded, _ = reloaded(tmp_path / "cube.glb")
    face = np.repeat(np.arange(len(mesh.faces)), 30)
    corners = np.random.default_rng(1).dirichlet([0.2, 0.2, 0.2], size=len(face))
    assert np.abs(shown(loaded, face, corners) - 255 * palette[face]).max() < 0.51


def test_a_texture_too_small_for_the_triangles_is_refused(ball):
    with pytest.raises(InputError, match=r"16 texels do not hold 1280 triangles\. Ask for a larger"):
        pack(ball.vertices[ball.faces], 16)


def test_triangles_without_area_have_a_place(tmp_path):
    surface = Surface(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]]), np.array([[0, 1, 2], [0, 1, 3]])
    )
    atlas = pack(surface.vertices[surface.faces], 32)
    image, _ = bake(atlas, lambda face, at: np.ones((len(face), 4)))
    assert image.max() == 255
    write_surface(
        tmp_path / "flat.glb", surface, lambda face, at: np.ones((len(face), 4)), MATT, CREDIT, colour="white"
    )
    assert len(reloaded(tmp_path / "flat.glb")[0].vertices) == 6


def test_vertex_colours_are_linear_and_need_no_texture(ball, tmp_path):
    write_surface(
        tmp_path / "ball.glb", ball, lambda face, at: waves(ball.points_at(face, at)), MATT, CREDIT,
        colour="waves", vertex_colours=True,
    )  # fmt: skip
    content = json_of(tmp_path / "ball.glb")
    assert "images" not in content
    accessor = content["accessors"][content["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    view = content["bufferViews"][accessor["bufferView"]]
    data = (tmp_path / "ball.glb").read_bytes()
    start = 28 + struct.unpack_from("<I", data, 12)[0] + view["byteOffset"]
    stored = np.frombuffer(data, "<f4", accessor["count"] * 4, start).reshape(-1, 4)
    corners = ball.vertices[ball.faces].reshape(-1, 3)
    np.testing.assert_allclose(stored[:, :3], srgb_decode(waves(corners)[:, :3]), atol=1e-6)


def test_the_source_mesh_keeps_its_textures_and_coordinates(tmp_path):
    mesh = cube()
    second = np.array([[[10, 20, 30, 255], [40, 50, 60, 255]]], dtype=np.uint8)
    mesh = TexturedMesh(
        mesh.vertices, mesh.faces, mesh.texture_coordinates * 2 - 0.5, (mesh.textures[0], second),
        (np.arange(12) >= 6).astype(np.int32),
    )  # fmt: skip
    write_mesh(tmp_path / "cube.glb", mesh, Appearance(0.25, 1.0), CREDIT)
    scene = trimesh.load(tmp_path / "cube.glb", process=False)
    parts = list(scene.geometry.values())
    assert [len(part.faces) for part in parts] == [6, 6]
    for part, texture, own in zip(parts, mesh.textures, (slice(0, 6), slice(6, 12)), strict=True):
        np.testing.assert_array_equal(part.visual.material.baseColorTexture.convert("RGBA"), texture)
        np.testing.assert_allclose(part.visual.uv.reshape(-1, 3, 2), mesh.texture_coordinates[own], atol=1e-6)
        assert part.visual.material.roughnessFactor == 0.25
        assert part.visual.material.metallicFactor == 1.0
        assert part.visual.material.doubleSided
    samples = mesh.surface.sample(200, 0)
    texture = texture_colour(mesh, samples.face, samples.barycentric)
    for index in range(2):
        own = mesh.face_texture[samples.face] == index
        at = np.einsum("ij,ijk->ik", samples.barycentric[own], mesh.texture_coordinates[samples.face[own]])
        np.testing.assert_allclose(255 * texture[own], bilinear(mesh.textures[index], at), atol=1e-3)


def test_the_file_is_well_formed_and_credits_its_source(tmp_path):
    write_mesh(tmp_path / "cube.glb", cube(), Appearance(0.5, 0.0, specular=0.25), CREDIT)
    content = json_of(tmp_path / "cube.glb")
    assert content["asset"]["copyright"] == "the tests; CC-BY-4.0"
    assert content["asset"]["extras"]["object"]["source"] == "made by code"
    assert content["extensionsUsed"] == ["KHR_materials_specular"]
    specular = content["materials"][0]["extensions"]["KHR_materials_specular"]
    assert specular == {"specularFactor": 0.5}
    positions = content["accessors"][0]
    np.testing.assert_allclose(
        [positions["min"], positions["max"]],
        [cube().vertices.min(axis=0), cube().vertices.max(axis=0)],
        atol=1e-7,
    )


def test_holes_of_a_texture_are_cut_or_blended(tmp_path):
    positions = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=float)
    texture = np.zeros((2, 2, 4), dtype=np.uint8)
    texture[0] = 255
    for cutoff, mode in ((None, "BLEND"), (0.3, "MASK")):
        part = Part(
            positions, np.tile([0.0, 0, 1], (1, 3, 1)), positions[..., :2], texture, alpha_cutoff=cutoff
        )
        write_glb(tmp_path / "hole.glb", [part], MATT, CREDIT, mipmaps=True)
        material = json_of(tmp_path / "hole.glb")["materials"][0]
        assert material["alphaMode"] == mode
        assert material.get("alphaCutoff") == cutoff
        image = reloaded(tmp_path / "hole.glb")[0].visual.material.baseColorTexture
        np.testing.assert_array_equal(np.asarray(image), texture)


def test_maps_of_roughness_and_metal_take_the_place_of_the_factors(tmp_path):
    mesh = cube()
    roughness = np.array([[10, 200], [90, 140]], dtype=np.uint8)
    mesh = TexturedMesh(
        mesh.vertices, mesh.faces, mesh.texture_coordinates, mesh.textures, mesh.face_texture,
        roughness_maps={0: roughness},
    )  # fmt: skip
    write_mesh(tmp_path / "cube.glb", mesh, Appearance(0.9, 1.0), CREDIT)
    material = reloaded(tmp_path / "cube.glb")[0].visual.material
    assert (material.roughnessFactor, material.metallicFactor) == (1.0, 1.0)
    image = np.asarray(material.metallicRoughnessTexture)
    np.testing.assert_array_equal(image[..., 1], roughness)
    assert (image[..., 2] == 255).all()


def test_a_map_of_normals_goes_along_and_is_read_back(tmp_path):
    mesh = cube()
    normals = np.array([[[173, 188, 230], [128, 128, 255]]], dtype=np.uint8)
    mesh = TexturedMesh(
        mesh.vertices, mesh.faces, mesh.texture_coordinates, mesh.textures, mesh.face_texture,
        normal_maps={0: normals},
    )  # fmt: skip
    write_mesh(tmp_path / "cube.glb", mesh, MATT, CREDIT)
    np.testing.assert_array_equal(load_mesh(tmp_path / "cube.glb").normal_maps[0], normals)


def test_the_atlas_has_no_mip_maps_and_equal_exports_equal_bytes(ball, tmp_path):
    for name in ("first", "second"):
        write_surface(
            tmp_path / name, ball, lambda face, at: waves(ball.points_at(face, at)), MATT, CREDIT,
            colour="waves", side=128,
        )  # fmt: skip
    assert (tmp_path / "first").read_bytes() == (tmp_path / "second").read_bytes()
    # 9729 is LINEAR: without a mip map.
    assert json_of(tmp_path / "first")["samplers"][0]["minFilter"] == 9729


def constant_network(surface: Surface, albedo: float, lobe: float, log_alpha: float) -> VisionNet:
    """A VisionNet that reflects `albedo` plus `lobe` times its highlight, and has bright bounced light."""
    frame = UnitFrame.of_points(surface.vertices)
    grid = SparseGrid.of_points(frame.to_unit(surface.vertices[surface.faces].mean(axis=1)), 16)
    weights = {name: np.zeros(shape, dtype=np.float32) for name, shape in weight_shapes(grid.sizes).items()}
    weights["log_alpha"] = np.array(log_alpha, dtype=np.float32)
    weights["albedo.bias"] += np.float32(np.log(albedo / (1 - albedo)))
    weights["direct.4.bias"][3:] = np.log(np.expm1(lobe)) if lobe else -40.0
    weights["bounced.4.bias"] += 1.0
    return VisionNet(surface, frame, grid, weights, radiance_scale=0.3, camera_radius=2.5)


def weights_of(network: VisionNet) -> tuple[tuple[int, ...], dict[str, torch.Tensor]]:
    """Grid sizes and weights of a VisionNet by the names its network has for them."""
    tensors = {name.removeprefix("vision."): value for name, value in network.tensors().items()}
    grid = SparseGrid.from_bytes(tensors.pop("grid"), 16)
    return grid.sizes, {name: torch.from_numpy(np.asarray(value)) for name, value in tensors.items()}


def test_colour_of_a_lambertian_network_is_its_albedo(ball):
    network = constant_network(ball, 0.35, 0.0, -1.0)
    frame, samples = UnitFrame.of_points(ball.vertices), ball.sample(50, 0)
    metal = network_colour(network, ball, frame, samples.face, samples.barycentric, metallic=1.0)
    np.testing.assert_allclose(metal[:, :3], srgb_encode(np.array(0.35)), atol=2e-4)
    coated = network_colour(network, ball, frame, samples.face, samples.barycentric, metallic=0.0)
    np.testing.assert_allclose(coated[:, :3], srgb_encode(np.array((0.35 - 0.04) / 0.96)), atol=2e-4)
    assert (metal[:, 3] == 1).all()


@pytest.mark.parametrize("alpha", [0.1, 0.25, 0.6])
def test_colour_of_a_highlight_is_its_integral(ball, alpha):
    network = constant_network(ball, 0.2, 0.7, np.log(alpha))
    reflectance = Reflectance(weights_of(network)[0])
    reflectance.load_state_dict(weights_of(network)[1])
    # A camera on the normal and 4000 lights from there to the horizon: the rule of the mean in the angle.
    angle = (np.arange(4000) + 0.5) / 4000 * np.pi / 2
    normal = np.tile([0.0, 0.0, 1.0], (4000, 1))
    to_light = np.stack([np.sin(angle), np.zeros(4000), np.cos(angle)], axis=1)
    points = Incidence(normal * 0.5, normal, normal, to_light, np.ones(4000), np.ones(4000))
    inputs = (torch.from_numpy(angle_inputs(points)), torch.zeros(4000, SURROUNDINGS))
    nowhere = [(np.zeros((4000, 8), dtype=np.int32), np.zeros((4000, 8), dtype=np.float32))] * 4
    with torch.inference_mode():
        lit, dark = (reflectance(nowhere, *inputs, torch.full((4000,), level)) for level in (1.0, 0.0))
    weights = 2 * np.sin(angle) * np.cos(angle) * np.pi / 2 / 4000
    expected = weights @ (lit - dark).numpy().astype(np.float64)
    assert expected.min() > 0.21
    frame, samples = UnitFrame.of_points(ball.vertices), ball.sample(20, 0)
    colour = network_colour(network, ball, frame, samples.face, samples.barycentric, metallic=1.0)[:, :3]
    np.testing.assert_allclose(srgb_decode(colour), np.tile(expected, (20, 1)), rtol=0.02)


def test_nearest_texture_is_that_of_the_near_layer_of_a_thin_wall():
    plate = cube(0.1)
    vertices = plate.vertices.copy()
    middle = vertices[:, 2].mean()
    # 0.08 mm: rays along the normals, 0.1 mm long, reach both layers.
    vertices[:, 2] = middle + (vertices[:, 2] - middle) * 8e-4
    mesh = TexturedMesh(vertices, plate.faces, plate.texture_coordinates, plate.textures, plate.face_texture)
    samples = mesh.surface.sample(300, 0)
    normals = mesh.surface.face_normals[samples.face]
    exact = texture_colour(mesh, samples.face, samples.barycentric)
    off = samples.points + normals * np.random.default_rng(0).uniform(-3e-5, 3e-5, (300, 1))
    colours = nearest_texture_colour(mesh, off, normals)
    assert np.abs(colours - exact).max(axis=1).mean() < 0.01
    far = samples.points + 0.01 * normals
    nearest = mesh.surface.closest_points(far)
    expected = texture_colour(mesh, nearest.face, nearest.barycentric)
    np.testing.assert_array_equal(nearest_texture_colour(mesh, far, normals), expected)
