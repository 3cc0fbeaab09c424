"""`objectfolder export` as a user types it, on a data set laid out as the stages leave it."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from vision_shapes import cube

import objectfolder
from objectfolder.making.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.products.store import Array, Product, write_product
from objectfolder.surface.codec import encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import mesh_arrays
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at, uniform_on_sphere
from objectfolder.vision.visionnet.visionnet import VisionNet
from pipeline.cli import main
from tests.small_file import bar_mesh

RECORD = {
    "name": "A cube",
    "material": {},
    "material_citation": "",
    "roughness_um": None,
    "appearance": {"roughness": 0.25, "metallic": 1.0},
    "walls": {},
    "senses": ["vision", "audio", "touch"],
    "source": "made by code",
    "licence": "CC-BY-4.0",
    "attribution": "the tests",
}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A data set of one cube with four views, one held out; the views are plain white discs."""
    mesh = cube()
    cameras = look_at(uniform_on_sphere(4, 2.5, np.random.default_rng(0)))
    y, x = np.mgrid[:16, :16] - 7.5
    rgba = np.where((np.hypot(x, y) < 7)[None, ..., None], 1.0, 0.0) * np.ones((4, 1, 1, 4))
    views = Product(
        {
            "rgba": Array(rgba.astype(np.float16), ("view", "y", "x", "channel"), "1", "colour"),
            "camera_to_world": Array(cameras, ("view", "row", "column"), "1", "poses"),
            "light_position": Array(cameras[:, :3, 3] / 2.5, ("view", "axis"), "1", "light"),
            "held_out": Array(np.arange(4) >= 3, ("view",), "1", "held out"),
        },
        {
            "field_of_view_deg": 39.6,
            "camera_radius": 2.5,
            "light_power_w": 12.0,
            "frame": UnitFrame.of_points(mesh.vertices).to_dict(),
            "appearance": {"roughness": 0.25, "metallic": 1.0, "specular": 0.5},
        },
    )
    write_product(tmp_path / "set" / "data" / "views" / "cube.zarr.zip", views)
    write_product(
        tmp_path / "set" / "data" / "objects" / "cube.zarr.zip", Product(mesh_arrays(mesh), {"digests": {}})
    )
    records = {"objects": {"cube": RECORD}, "refused": []}
    (tmp_path / "set" / "data" / "records.json").write_text(json.dumps(records))
    return tmp_path / "set"


def error_of(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(arguments) == 1
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    return error


def test_an_id_exports_to_every_format_with_licence_and_units(root, tmp_path, capsys):
    for kind in ("nerf", "colmap", "gltf"):
        folder = tmp_path / kind
        assert main(["export", "cube", "--root", str(root), "--format", kind, "-o", str(folder)]) == 0
        assert "CC-BY-4.0" in capsys.readouterr().out
        manifest = json.loads((folder / "export.json").read_text())
        assert manifest["object"]["attribution"] == "the tests"
        assert "CC-BY-4.0" in (folder / "ATTRIBUTION.txt").read_text()
        if kind != "gltf":
            assert manifest["held_out"] == 1
            assert manifest["frame"]["box_longest_side_m"] == pytest.approx(0.1)
    assert json.loads((tmp_path / "colmap" / "export.json").read_text())["points"] > 0
    loaded = trimesh.load(tmp_path / "gltf" / "cube.glb", process=False)
    material = next(iter(loaded.geometry.values())).visual.material
    assert (material.roughnessFactor, material.metallicFactor) == (0.25, 1.0)


def test_a_product_by_its_path_finds_what_lies_beside_it(root, tmp_path, capsys):
    by_id, by_path = tmp_path / "by_id", tmp_path / "by_path"
    views = str(root / "data" / "views" / "cube.zarr.zip")
    assert main(["export", "cube", "--root", str(root), "--format", "colmap", "-o", str(by_id)]) == 0
    assert main(["export", views, "--format", "colmap", "-o", str(by_path)]) == 0
    assert (by_path / "sparse" / "0" / "points3D.bin").read_bytes() == (
        by_id / "sparse" / "0" / "points3D.bin"
    ).read_bytes()


def test_a_product_elsewhere_is_enough_for_cameras(root, tmp_path, capsys):
    alone = tmp_path / "alone.zarr.zip"
    alone.write_bytes((root / "data" / "views" / "cube.zarr.zip").read_bytes())
    assert main(["export", str(alone), "--format", "colmap", "-o", str(tmp_path / "out")]) == 0
    assert "0 points" in capsys.readouterr().out
    assert "not stated" in (tmp_path / "out" / "ATTRIBUTION.txt").read_text()


def test_a_mesh_file_becomes_gltf_when_told_how_it_reflects(tmp_path, capsys):
    mesh = tmp_path / "box.ply"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(mesh)
    export = ["export", str(mesh), "--format", "gltf", "-o", str(tmp_path / "out")]
    assert "its roughness is not known. Give --roughness." in error_of(export, capsys)
    assert main([*export, "--roughness", "0.5", "--metallic", "0"]) == 0
    np.testing.assert_allclose(trimesh.load(tmp_path / "out" / "box.glb").extents, [0.1, 0.3, 0.2], atol=1e-7)


def test_errors_name_the_thing_and_the_remedy(root, tmp_path, capsys):
    where = ["--root", str(root), "-o", str(tmp_path / "out")]
    assert "Use one of cube." in error_of(["export", "cup", "--format", "nerf", *where], capsys)
    assert "no such file" in error_of(["export", "far/cup.zarr.zip", "--format", "nerf", *where], capsys)
    stored = ["export", "cube", "--format", "gltf", "--surface", "stored", *where]
    assert "has no Object File" in error_of(stored, capsys)
    objects = tmp_path / "cube.zarr.zip"
    objects.write_bytes((root / "data" / "objects" / "cube.zarr.zip").read_bytes())
    assert "has no views" in error_of(["export", str(objects), "--format", "nerf", *where], capsys)
    assert "is negative" in error_of(
        ["export", "cube", "--format", "colmap", "--points", "-1", *where], capsys
    )
    assert not (tmp_path / "out").exists()
    assert main(["export", "cube", "--format", "nerf", *where]) == 0
    assert "ask to overwrite" in error_of(["export", "cube", "--format", "nerf", *where], capsys)
    assert main(["export", "cube", "--format", "colmap", "--overwrite", *where]) == 0
    assert not (tmp_path / "out" / "transforms.json").exists()


@pytest.mark.slow
def test_an_object_file_becomes_gltf_with_the_colours_it_learned(small_file, tmp_path, capsys):
    command = ["export", str(small_file), "--format", "gltf", "--texture-side", "128"]
    assert main([*command, "-o", str(tmp_path / "out")]) == 0
    assert "CC0-1.0" in capsys.readouterr().out
    loaded = trimesh.load(tmp_path / "out" / "bar.glb", process=False)
    part = next(iter(loaded.geometry.values()))
    file = objectfolder.load(small_file)
    np.testing.assert_allclose(
        part.vertices.reshape(-1, 3, 3), file.surface.vertices[file.surface.faces], atol=1e-7
    )
    # Roughness and metallic of glass, from the materials table.
    assert part.visual.material.roughnessFactor == pytest.approx(0.2)
    # Green is 140 all over the bar; the fit is a very short one.
    image = np.asarray(part.visual.material.baseColorTexture.convert("RGB"))
    texels = np.floor(part.visual.uv * [image.shape[1], -image.shape[0]] + [0, image.shape[0]]).astype(int)
    assert 60 < np.median(image[texels[:, 1], texels[:, 0], 1]) < 220


@pytest.mark.slow
def test_an_object_file_of_known_material_becomes_gltf_with_its_albedo(small_file, tmp_path, capsys):
    file = objectfolder.load(small_file)
    matt = Appearance(0.2, 0.0)
    maps = sample_maps(stored_mesh(bar_mesh(), file.surface), file.frame, matt, "known")
    net = VisionNet(
        file.surface, file.frame, None, {}, radiance_scale=0.3, camera_radius=2.5, maps=maps, appearance=matt
    )
    encoded = encode_surface(file.surface)
    object_file = file.of_encoders(encoded, file.frame, net, file.modes, file.touch.net, file.description)
    object_file.save(tmp_path / "known.safetensors")
    command = ["export", str(tmp_path / "known.safetensors"), "--format", "gltf", "--texture-side", "64"]
    assert main([*command, "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "known.glb").exists()
