"""Every kind of bad input, by name: one error with file or object, field, finding and remedy."""

import re
from pathlib import Path

import numpy as np
import pytest
from small_meshes import CUBE_FACES, CUBE_VERTICES, checker, write_textured_cube

from objectfolder.errors import InputError
from objectfolder.making.mesh.ingest import ingest_object
from pipeline.dataset.catalogue import read_catalogue

MATERIALS = ("ceramic", "steel", "wood")


def write_obj(path: Path, vertices, faces, *, coordinates: bool = False) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(vertex + 1) for vertex in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def refused(path: Path, texture: Path | None = None, length_m: float | None = None) -> InputError:
    with pytest.raises(InputError) as caught:
        ingest_object(path, texture_path=texture, length_m=length_m, object_id="thing")
    problem = caught.value
    assert "thing" in problem.where
    assert problem.remedy
    assert "\n" not in str(problem)
    return problem


def table(folder: Path, *rows: str, columns: str = "id,mesh,texture,material,length_m") -> Path:
    path = folder / "objects.csv"
    path.write_text("\n".join([columns, *rows]) + "\n")
    return path


@pytest.fixture
def good(tmp_path) -> Path:
    """Folder with one good object, `good/model.obj`."""
    write_textured_cube(tmp_path / "good")
    return tmp_path


def assert_only_bad_fails(path: Path, field: str, finding: str) -> InputError:
    """The object `bad` is refused with row and field; the object `good` is made."""
    catalogue = read_catalogue(path, MATERIALS)
    assert [record.id for record in catalogue.records] == ["good"]
    record = catalogue.records[0]
    ingest_object(record.mesh, texture_path=record.texture, length_m=record.length_m, object_id=record.id)
    problem = catalogue.errors["bad"]
    assert f"{path} line 2" in problem.where
    assert f"field {field}" in problem.where
    assert finding in problem.finding
    assert problem.remedy
    return problem


GOOD_ROW = "good,good/model.obj,,steel,as in file"


def test_missing_mesh(good):
    path = table(good, "bad,nowhere/model.obj,,steel,0.1", GOOD_ROW)
    assert_only_bad_fails(path, "mesh", "nowhere/model.obj does not exist")
    assert "does not exist" in refused(good / "nowhere.obj").finding


def test_missing_texture(good):
    path = table(good, "bad,good/model.obj,nowhere.png,steel,0.1", GOOD_ROW)
    assert_only_bad_fails(path, "texture", "nowhere.png does not exist")


def test_missing_material_library(good):
    (good / "good" / "model.mtl").unlink()
    problem = refused(good / "good" / "model.obj")
    assert "material library 'model.mtl', which is not there" in problem.finding


def test_unknown_material(good):
    path = table(good, "bad,good/model.obj,,stel,0.1", GOOD_ROW)
    problem = assert_only_bad_fails(path, "material", "'stel' is not known")
    assert "'steel'" in problem.remedy


def test_zero_negative_or_absurd_length(subtests, good):
    for length in ["0", "-0.1", "nan", "inf", "twelve", "0.0001", "116.98"]:
        with subtests.test(length=length):
            path = table(good, f"bad,good/model.obj,,steel,{length}", GOOD_ROW)
            assert_only_bad_fails(path, "length_m", "")


def test_length_in_millimetres(good):
    problem = refused(good / "good" / "model.obj", None, 116.98)
    assert "field length_m" in problem.where
    assert "millimetres" in problem.remedy
    assert "0.11698" in problem.remedy


def test_length_in_millimetres_that_would_pass_as_metres(good):
    """A 16 mm die given as 16, on a mesh that is in metres."""
    path = write_textured_cube(good / "die", side_m=0.016)
    problem = refused(path, None, 16.0)
    assert "1000 times" in problem.finding
    assert "0.016" in problem.remedy


def test_mesh_in_millimetres(good):
    path = write_textured_cube(good / "mm", side_m=80.0)
    problem = refused(path)
    assert "as in the file, is 80 m" in problem.finding
    assert "0.08" in problem.remedy
    product = ingest_object(path, length_m=0.08, object_id="thing")
    np.testing.assert_allclose(product.attributes["length"]["extents_m"], 0.08)


def test_large_objects_are_accepted_when_stated(good):
    product = ingest_object(good / "good" / "model.obj", length_m=24.0, object_id="ship")
    assert "unusual" in product.attributes["warnings"][0]


@pytest.mark.parametrize("text", ["", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "# nothing\n"])
def test_empty_mesh(tmp_path, text):
    path = tmp_path / "model.obj"
    path.write_text(text)
    assert "no faces" in refused(path).finding


def test_mesh_of_one_point(tmp_path):
    path = write_obj(tmp_path / "model.obj", np.zeros((3, 3)), [[0, 1, 2]])
    assert "no faces are left of 1: 1 collapse" in refused(path).finding


@pytest.mark.parametrize("value", ["nan", "inf", "1e999"])
def test_nan_vertices(tmp_path, value):
    path = tmp_path / "model.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 {value} 0\nf 1 2 3\n")
    problem = refused(path)
    assert "1 of 3 vertices are not finite (the first is vertex 3)" in problem.finding


def test_zero_area_faces_are_kept_and_reported(tmp_path):
    """A vertex half way along an edge of a cube: the sliver keeps the surface closed."""
    vertices = np.concatenate([0.1 * CUBE_VERTICES, 0.05 * (CUBE_VERTICES[[0]] + CUBE_VERTICES[[1]])])
    faces = [face for face in CUBE_FACES.tolist() if face != [0, 1, 5]]
    faces += [[0, 8, 5], [8, 1, 5], [0, 1, 8]]
    faces = [[0, 8, 5] if face == [0, 8, 5] else face for face in faces]
    mesh = write_obj(tmp_path / "model.obj", vertices, faces)
    attributes = ingest_object(mesh, object_id="thing").attributes
    assert attributes["topology"]["zero_area_faces"] == 1
    assert attributes["topology"]["watertight"]
    assert "1 faces have no area" in attributes["warnings"][0]


def test_open_surface_is_made_and_reported(tmp_path):
    mesh = write_obj(tmp_path / "model.obj", 0.1 * CUBE_VERTICES, CUBE_FACES[2:])
    attributes = ingest_object(mesh, object_id="thing").attributes
    assert not attributes["topology"]["watertight"]
    assert attributes["topology"]["boundary_edges"] == 4
    assert not attributes["solid"]["meaningful"]
    assert attributes["wall_thickness"] == {
        "effective_m": None,
        "median_m": pytest.approx(0.1, rel=1e-5),
        "thin_m": pytest.approx(0.1, rel=1e-5),
    }
    assert "not closed (4 boundary" in attributes["warnings"][0]


def test_several_components_are_made_and_reported(tmp_path):
    vertices = np.concatenate([0.1 * CUBE_VERTICES, 0.1 * CUBE_VERTICES + 0.5])
    mesh = write_obj(tmp_path / "model.obj", vertices, np.concatenate([CUBE_FACES, CUBE_FACES + 8]))
    attributes = ingest_object(mesh, object_id="thing").attributes
    assert attributes["topology"]["components"] == 2
    assert "2 separate pieces" in attributes["warnings"][0]
    assert attributes["solid"]["volume_m3"] == pytest.approx(0.002)


def test_no_uvs_with_a_texture(tmp_path):
    from PIL import Image

    mesh = write_obj(tmp_path / "model.obj", 0.1 * CUBE_VERTICES, CUBE_FACES)
    Image.fromarray(checker()).save(tmp_path / "texture.png")
    problem = refused(mesh, tmp_path / "texture.png", None)
    assert "12 of 12 faces have a texture but no texture coordinates" in problem.finding
    assert "Unwrap" in problem.remedy


def test_one_face_without_uvs_among_others_that_have_them(good):
    path = good / "good" / "model.obj"
    head, _, face = path.read_text().rpartition("f ")
    path.write_text(f"{head}f {re.sub(r'/[0-9/]+', '', face)}")
    assert "1 of 12 faces have a texture but no texture coordinates" in refused(path).finding


@pytest.mark.parametrize("content", [b"", b"not an image", b"\x89PNG\r\n\x1a\n broken"])
def test_texture_that_is_not_an_image(good, content):
    (good / "other.png").write_bytes(content)
    problem = refused(good / "good" / "model.obj", good / "other.png")
    assert "other.png" in problem.where
    assert "not a readable image" in problem.finding


def test_truncated_texture(good):
    path = good / "good" / "texture.png"
    path.write_bytes(path.read_bytes()[:-40])
    assert "not a readable image" in refused(good / "good" / "model.obj").finding


def test_texture_of_floating_point_values(good):
    from PIL import Image

    Image.fromarray(np.zeros((4, 4), dtype=np.float32)).save(good / "float.tif")
    problem = refused(good / "good" / "model.obj", good / "float.tif")
    assert "floating point" in problem.finding


@pytest.mark.parametrize("second", ["good", "GOOD"])
def test_duplicate_ids(good, second):
    path = table(good, GOOD_ROW, GOOD_ROW.replace("good,", f"{second},", 1))
    catalogue = read_catalogue(path, MATERIALS)
    assert not catalogue.records
    assert set(catalogue.errors) == {"good", second}
    assert re.search(r"line 3, field id: .* is also used in line 2", str(catalogue.errors[second]))


def test_mesh_of_an_unknown_format(tmp_path):
    path = tmp_path / "model.3ds"
    path.write_bytes(b"MM")
    problem = refused(path)
    assert "'.3ds' is not a known mesh format" in problem.finding
    assert ".glb" in problem.remedy


def test_obj_line_that_cannot_be_read(subtests, tmp_path):
    for line, finding in [
        ("f 1 2 9", "vertex 9 of 3"),
        ("f 1 3 0", "vertex 0 of 3, and others count from 1"),
        ("f 1 2", "three corners"),
        ("v 1 two 3", "could not convert"),
        ("vt 0 0\nf 1/1 2/1 3/2", "texture coordinate 2 of 1"),
    ]:
        with subtests.test(line=line):
            path = tmp_path / "model.obj"
            path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\n")
            problem = refused(path)
            assert f"model.obj line {4 + line.count(chr(10))}" in problem.where
            assert finding in problem.finding
