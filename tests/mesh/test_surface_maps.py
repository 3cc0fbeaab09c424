"""Transparency, roughness and metallic as sources give them, and as nothing else does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_meshes import checker, png, write_gltf, write_textured_cube

from objectfolder.errors import InputError
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.mesh.readers.load import load_mesh, source_files
from objectfolder.making.mesh.readers.textures import opaque, scaled_map, with_alpha
from objectfolder.products.store import read_product, write_product
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.surface.textured_mesh import mesh_arrays, textured_mesh_of

ALPHA = np.tile(np.array([0, 64, 128, 255] * 2, dtype=np.uint8), (8, 1))
SHEER = np.dstack([checker(), ALPHA])
# Roughness in green, metallic in blue.
LAYERS = np.dstack([np.full((4, 4), 99), 20 * np.arange(16).reshape(4, 4) // 2, np.full((4, 4), 200)])
LAYERS = LAYERS.astype(np.uint8)


def obj_with(folder, *lines: str, texture=None):
    path = write_textured_cube(folder, texture=texture)
    library = folder / "model.mtl"
    library.write_text(library.read_text() + "\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("lines", [[], ["d 1.0"], ["Tr 1.0", "illum 4", "Ns 250", "map_Ns texture.png"]])
def test_alpha_of_a_scans_texture_alone_means_nothing(tmp_path, lines):
    mesh = load_mesh(obj_with(tmp_path, *lines, texture=SHEER))
    assert (mesh.textures[0][..., 3] == 255).all()
    assert (mesh.alpha_cutoffs, mesh.roughness_maps, mesh.metallic_maps) == ({}, {}, {})
    assert not any(name.startswith(("alpha", "rough", "metal")) for name in mesh_arrays(mesh))


def test_map_d_gives_alpha_by_its_alpha_channel_or_as_grey(tmp_path):
    own = load_mesh(obj_with(tmp_path / "own", "map_d texture.png", texture=SHEER))
    np.testing.assert_array_equal(own.textures[0], SHEER)
    path = obj_with(tmp_path / "grey", "d 0.5", "map_d holes.png")
    (tmp_path / "grey" / "holes.png").write_bytes(png(ALPHA))
    grey = load_mesh(path).textures[0]
    np.testing.assert_array_equal(grey[..., :3], checker())
    np.testing.assert_array_equal(grey[..., 3], scaled_map(ALPHA, 0.5))


def test_d_below_one_is_coverage_and_d_of_zero_is_refused(tmp_path):
    half = load_mesh(obj_with(tmp_path / "half", "d -halo 0.5")).textures[0]
    assert (half[..., 3] == 128).all()
    with pytest.raises(InputError, match=r"model\.mtl line 4.*wholly transparent"):
        load_mesh(obj_with(tmp_path / "none", "d 0"))


def test_pr_and_pm_and_their_maps(tmp_path):
    path = obj_with(tmp_path, "Pr 0.25", "map_Pr -imfchan g layers.png", "Pm 1")
    (tmp_path / "layers.png").write_bytes(png(LAYERS))
    mesh = load_mesh(path)
    np.testing.assert_array_equal(mesh.roughness_maps[0], LAYERS[..., 1])
    np.testing.assert_array_equal(mesh.metallic_maps[0], [[255]])
    (tmp_path / "layers.png").unlink()
    with pytest.raises(InputError, match=r"layers\.png"):
        load_mesh(path)
    assert len(load_mesh(path, with_textures=False).faces) == 12


@pytest.mark.parametrize("line", ["Pr rough", "Pm -0.1", "d 7"])
def test_values_that_are_no_fractions_are_refused(tmp_path, line):
    with pytest.raises(InputError, match=r"model\.mtl line 4.*is no number in 0\.\.1"):
        load_mesh(obj_with(tmp_path, line))


@pytest.mark.parametrize(
    ("outer", "alpha", "cutoffs"),
    [
        pytest.param({}, 255, {}, id="no mode"),
        pytest.param({"alphaMode": "OPAQUE"}, 255, {}, id="opaque"),
        pytest.param({"alphaMode": "BLEND"}, ALPHA, {}, id="blend"),
        pytest.param({"alphaMode": "MASK"}, ALPHA, {0: 0.5}, id="mask"),
        pytest.param({"alphaMode": "MASK", "alphaCutoff": 0.1}, ALPHA, {0: 0.1}, id="mask with cutoff"),
        pytest.param({"alphaMode": "MASK", "alphaCutoff": 0.0}, 255, {}, id="mask that cuts nothing"),
    ],
)
def test_gltf_alpha_is_what_the_alpha_mode_says(tmp_path, outer, alpha, cutoffs):
    path = write_gltf(tmp_path / "model.gltf", outer=outer)
    (tmp_path / "texture.png").write_bytes(png(SHEER))
    mesh = load_mesh(path)
    np.testing.assert_array_equal(mesh.textures[0][..., :3], checker())
    np.testing.assert_array_equal(mesh.textures[0][..., 3], np.broadcast_to(alpha, (8, 8)))
    assert mesh.alpha_cutoffs == cutoffs


def test_gltf_roughness_is_green_metallic_is_blue_and_factors_multiply(tmp_path):
    material = {"metallicRoughnessTexture": {"index": 1}, "roughnessFactor": 0.5}
    path = write_gltf(tmp_path / "model.gltf", material=material, images={"layers.png": LAYERS})
    mesh = load_mesh(path)
    np.testing.assert_array_equal(mesh.roughness_maps[0], np.rint(LAYERS[..., 1] * 0.5).astype(np.uint8))
    np.testing.assert_array_equal(mesh.metallic_maps[0], LAYERS[..., 2])
    (tmp_path / "layers.png").unlink()
    with pytest.raises(InputError, match=r"metallicRoughnessTexture 'layers\.png'.* is missing"):
        load_mesh(path)


def test_gltf_factors_count_where_written_and_defaults_are_the_materials(tmp_path):
    mesh = load_mesh(write_gltf(tmp_path / "a.gltf", material={"roughnessFactor": 0.2}))
    np.testing.assert_array_equal(mesh.roughness_maps[0], [[51]])
    assert mesh.metallic_maps == {}
    silent = load_mesh(write_gltf(tmp_path / "b.gltf"))
    assert (silent.roughness_maps, silent.metallic_maps) == ({}, {})


NORMALS = np.zeros((4, 4, 3), dtype=np.uint8) + np.array([[[173, 188, 230]]], dtype=np.uint8)
HEIGHTS = np.dstack([20 * np.arange(12, dtype=np.uint8).reshape(3, 4)] * 3)


def test_gltf_normals_are_scaled_as_its_scale_asks(tmp_path):
    outer = {"normalTexture": {"index": 1}}
    path = write_gltf(tmp_path / "model.gltf", outer=outer, images={"bumps.png": NORMALS})
    np.testing.assert_array_equal(load_mesh(path).normal_maps[0], NORMALS)
    outer["normalTexture"]["scale"] = 0.5
    scaled = load_mesh(write_gltf(tmp_path / "model.gltf", outer=outer, images={"bumps.png": NORMALS}))
    x, y, z = NORMALS[0, 0] / 127.5 - 1
    expected = np.array([x / 2, y / 2, z]) / np.sqrt((x * x + y * y) / 4 + z * z)
    np.testing.assert_allclose(scaled.normal_maps[0][0, 0] / 127.5 - 1, expected, atol=0.005)
    outer["normalTexture"]["scale"] = 0
    flat = load_mesh(write_gltf(tmp_path / "model.gltf", outer=outer, images={"bumps.png": NORMALS}))
    assert flat.normal_maps == {}
    (tmp_path / "bumps.png").unlink()
    with pytest.raises(InputError, match=r"normalTexture 'bumps\.png'.* is missing"):
        load_mesh(path)


def test_gltf_normals_on_other_coordinates_are_refused(tmp_path):
    outer = {"normalTexture": {"index": 1, "texCoord": 1}}
    path = write_gltf(tmp_path / "model.gltf", outer=outer, images={"bumps.png": NORMALS})
    with pytest.raises(InputError, match=r"normalTexture .* lies otherwise than baseColorTexture"):
        load_mesh(path)


@pytest.mark.parametrize(
    "line", ["norm bumps.png", "map_Kn bumps.png", "bump bumps.png", "map_Bump bumps.png"]
)
def test_normals_of_a_material_library(tmp_path, line):
    path = obj_with(tmp_path, line)
    (tmp_path / "bumps.png").write_bytes(png(NORMALS))
    np.testing.assert_array_equal(load_mesh(path).normal_maps[0], NORMALS)


def test_heights_are_left_aside_and_need_not_be_there(tmp_path):
    path = obj_with(tmp_path, "map_Bump -bm 0.3 bumps.png")
    assert load_mesh(path).normal_maps == {}
    (tmp_path / "bumps.png").write_bytes(png(HEIGHTS))
    assert load_mesh(path).normal_maps == {}
    (tmp_path / "bumps.png").write_bytes(png(NORMALS))
    scaled = load_mesh(path).normal_maps[0][0, 0] / 127.5 - 1
    x, _, z = NORMALS[0, 0] / 127.5 - 1
    np.testing.assert_allclose(scaled[0] / scaled[2], 0.3 * x / z, atol=0.01)
    with pytest.raises(InputError, match=r"bumps\.png"):
        load_mesh(obj_with(tmp_path / "missing", "norm bumps.png"))


def test_normals_survive_the_product_and_change_its_digest(tmp_path):
    path = write_gltf(
        tmp_path / "model.gltf", outer={"normalTexture": {"index": 1}}, images={"bumps.png": NORMALS}
    )  # fmt: skip
    product = ingest_object(path, object_id="leaf")
    write_product(tmp_path / "leaf.zarr.zip", product)
    product_mesh = textured_mesh_of(read_product(tmp_path / "leaf.zarr.zip"))
    np.testing.assert_array_equal(product_mesh.normal_maps[0], NORMALS)
    (tmp_path / "bumps.png").write_bytes(png(NORMALS[..., [1, 0, 2]]))
    variant = ingest_object(path, object_id="leaf")
    assert variant.attributes["digests"]["texture"] != product.attributes["digests"]["texture"]


def test_gltf_texture_on_a_second_set_of_coordinates_is_refused(tmp_path):
    material = {"baseColorTexture": {"index": 0, "texCoord": 1}}
    with pytest.raises(InputError, match="second set of texture coordinates"):
        load_mesh(write_gltf(tmp_path / "model.gltf", material=material))


def test_a_named_texture_replaces_maps_and_is_opaque(tmp_path):
    path = obj_with(tmp_path, "d 0.5", "Pr 0.1", "Pm 1")
    (tmp_path / "other.png").write_bytes(png(SHEER[::-1]))
    mesh = load_mesh(path, tmp_path / "other.png")
    np.testing.assert_array_equal(mesh.textures[0], opaque(SHEER[::-1]))
    assert (mesh.alpha_cutoffs, mesh.roughness_maps, mesh.metallic_maps) == ({}, {}, {})
    assert source_files(path, tmp_path / "other.png") == (path, tmp_path / "other.png")


def test_equal_colours_with_other_maps_stay_apart(tmp_path):
    path = obj_with(tmp_path, "Pr 0.1", "newmtl other", "map_Kd texture.png", "Pr 0.9")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:-6], "usemtl other", *lines[-6:]]) + "\n")
    mesh = load_mesh(path)
    assert len(mesh.textures) == 2
    assert {index: int(image[0, 0]) for index, image in mesh.roughness_maps.items()} == {0: 26, 1: 230}
    assert np.bincount(mesh.face_texture).tolist() == [6, 6]
    library = path.with_name("model.mtl")
    library.write_text(library.read_text().replace("Pr 0.9", "Pr 0.1"))
    assert len(load_mesh(path).textures) == 1


def test_maps_survive_the_product_and_change_its_digest(tmp_path):
    path = write_gltf(
        tmp_path / "model.gltf", material={"metallicRoughnessTexture": {"index": 1}},
        outer={"alphaMode": "MASK", "alphaCutoff": 0.3}, images={"layers.png": LAYERS},
    )  # fmt: skip
    (tmp_path / "texture.png").write_bytes(png(SHEER))
    product = ingest_object(path, object_id="leaf")
    write_product(tmp_path / "leaf.zarr.zip", product)
    mesh, product_mesh = load_mesh(path), textured_mesh_of(read_product(tmp_path / "leaf.zarr.zip"))
    assert product_mesh.alpha_cutoffs == {0: 0.3}
    np.testing.assert_array_equal(product_mesh.textures[0], mesh.textures[0])
    np.testing.assert_array_equal(product_mesh.roughness_maps[0], LAYERS[..., 1])
    np.testing.assert_array_equal(product_mesh.metallic_maps[0], LAYERS[..., 2])
    (tmp_path / "layers.png").write_bytes(png(LAYERS[::-1]))
    variant = ingest_object(path, object_id="leaf")
    assert variant.attributes["digests"]["texture"] != product.attributes["digests"]["texture"]
    assert variant.attributes["digests"]["geometry"] == product.attributes["digests"]["geometry"]


def test_alpha_of_another_size_keeps_its_values():
    texture, alpha = np.zeros((4, 2, 4), dtype=np.uint8), np.array([[10, 20], [30, 40]], dtype=np.uint8)
    rgba = with_alpha(texture, alpha)
    assert rgba.shape == (4, 2, 4)
    np.testing.assert_array_equal(rgba[..., 3], alpha.repeat(2, axis=0))
    np.testing.assert_array_equal(with_alpha(texture[:1, :1], alpha)[..., 3], alpha)


@given(
    u=st.floats(-5, 5), v=st.floats(-5, 5), repeats=st.tuples(st.integers(-9, 9), st.integers(-9, 9)),
    size=st.tuples(st.integers(1, 5), st.integers(1, 5)), seed=st.integers(0, 99),
)  # fmt: skip
def test_bilinear_lookup_repeats_and_stays_within_the_texels(u, v, repeats, size, seed):
    image = np.random.default_rng(seed).integers(0, 256, (*size, 4), dtype=np.uint8)
    colour = bilinear(image, np.array([[u, v]]))
    again = bilinear(image, np.array([[u, v]]) + repeats)
    np.testing.assert_allclose(colour, again, atol=1e-5)
    assert (colour >= image.min(axis=(0, 1)) / 255 - 1e-6).all()
    assert (colour <= image.max(axis=(0, 1)) / 255 + 1e-6).all()


def test_bilinear_lookup_is_exact_at_texel_centres_and_half_way_between():
    image = checker(8)
    row, column = np.mgrid[:8, :8]
    centres = np.stack([(column + 0.5) / 8, 1 - (row + 0.5) / 8], axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(bilinear(image, centres), image.reshape(-1, 3) / 255, atol=1e-6)
    between = bilinear(image, np.array([[2 / 8, 1 - 2.5 / 8]]))
    np.testing.assert_allclose(between[0], image[2, 1:3].mean(axis=0) / 255, atol=1e-6)
