"""One object from file to product: what is in it, and that it says the same each time."""

from pathlib import Path

import numpy as np
import pytest
from small_meshes import checker, cube, write_textured_cube

from objectfolder.catalogue import read_catalogue
from objectfolder.geometry.ingest import ingest_object, textured_mesh_of
from objectfolder.geometry.length import with_length
from objectfolder.store import read_product, write_product

MATERIALS = ("ceramic", "glass", "wood", "plastic", "iron", "polycarbonate", "steel")


def test_product_holds_the_mesh_and_its_measures(tmp_path):
    product = ingest_object(write_textured_cube(tmp_path, side_m=0.1), None, None, "cube")
    attributes = product.attributes
    assert attributes["topology"]["watertight"]
    assert attributes["topology"]["components"] == 1
    assert attributes["solid"]["meaningful"]
    assert attributes["solid"]["volume_m3"] == pytest.approx(1e-3)
    np.testing.assert_allclose(
        attributes["solid"]["inertia_per_density_m5"], np.eye(3) * 1e-5 / 6, atol=1e-18
    )
    assert attributes["area_m2"] == pytest.approx(0.06)
    assert attributes["wall_thickness"]["effective_m"] == pytest.approx(2e-3 / 0.06)
    assert attributes["wall_thickness"]["median_m"] == pytest.approx(0.1, rel=1e-5)
    assert attributes["warnings"] == []
    assert product.arrays["vertices"].units == "m"
    assert product.arrays["vertices"].dims == ("vertex", "axis")


def test_product_survives_the_store_and_gives_the_mesh_back(tmp_path):
    product = ingest_object(write_textured_cube(tmp_path), None, 0.25, "cube")
    write_product(tmp_path / "cube.zarr.zip", product)
    mesh = textured_mesh_of(read_product(tmp_path / "cube.zarr.zip"))
    np.testing.assert_allclose(mesh.extents, 0.25)
    np.testing.assert_array_equal(mesh.textures[0][..., :3], checker())
    assert mesh.face_texture.dtype == np.int32
    assert (mesh.faces.dtype, mesh.vertices.dtype) == (np.int64, np.float64)


def test_equal_inputs_give_equal_bytes(tmp_path):
    for name in ("first", "second"):
        path = write_textured_cube(tmp_path / name)
        write_product(tmp_path / f"{name}.zarr.zip", ingest_object(path, None, None, "cube"))
    assert (tmp_path / "first.zarr.zip").read_bytes() == (tmp_path / "second.zarr.zip").read_bytes()


def test_digests_tell_a_new_shape_from_a_new_texture(tmp_path):
    digests = {
        name: ingest_object(path, None, length, "cube").attributes["digests"]
        for name, path, length in (
            ("base", write_textured_cube(tmp_path / "base"), 0.1),
            ("painted", write_textured_cube(tmp_path / "painted", texture=checker()[::-1]), 0.1),
            ("larger", write_textured_cube(tmp_path / "larger"), 0.2),
        )
    }
    assert digests["painted"]["geometry"] == digests["base"]["geometry"]
    assert digests["painted"]["texture"] != digests["base"]["texture"]
    assert digests["larger"]["geometry"] != digests["base"]["geometry"]
    assert digests["larger"]["texture"] == digests["base"]["texture"]


def test_length_is_the_longest_side():
    mesh, warnings = with_length(cube(2.0), 0.5, "cube")
    np.testing.assert_allclose(mesh.extents, 0.5)
    assert warnings == []


@pytest.mark.parametrize("object_id", ["025_mug", "Threshold_Porcelain_Teapot_White", "painted_wooden_stool"])
def test_real_scans(shared_objects: Path, object_id: str):
    product = ingest_object(shared_objects / object_id / "model.obj", None, None, object_id)
    assert product.attributes["topology"]["watertight"] == (object_id != "painted_wooden_stool")
    assert product["texture_0"].shape == (1024, 1024, 4)


@pytest.mark.slow
def test_all_real_scans_are_ingested_and_most_are_closed(shared_objects: Path):
    catalogue = read_catalogue(shared_objects / "catalogue.csv", MATERIALS)
    assert (len(catalogue.records), catalogue.errors) == (100, {})
    closed = 0
    for record in catalogue.records:
        attributes = ingest_object(record.mesh, record.texture, record.length_m, record.id).attributes
        closed += attributes["topology"]["watertight"] and attributes["topology"]["consistent"]
        assert attributes["cleaning"]["repeated_faces_dropped"] == 0
        assert attributes["cleaning"]["unorientable_patches"] == 0
        assert attributes["solid"]["meaningful"] or not attributes["topology"]["watertight"]
    assert closed == 94


def test_shape_alone_is_ingested_where_textures_are_missing(tmp_path):
    path = write_textured_cube(tmp_path)
    (tmp_path / "texture.png").unlink()
    product = ingest_object(path, None, None, "cube", with_textures=False)
    assert product["texture_0"].shape == (1, 1, 4)
