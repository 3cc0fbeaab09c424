"""One object from file to product: what is in it, and that it says the same each time."""

import csv
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from small_meshes import CUBE_FACES, CUBE_VERTICES, box, checker, cube, sphere, write_textured_cube

from objectfolder.errors import InputError
from objectfolder.making.materials import read_materials
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.making.mesh.walls import (
    CERTAIN,
    LIKELY,
    ONE_LAYER,
    POSSIBLE,
    THIN,
    TOO_THICK,
    WallMeasures,
    measure_walls,
    wall_findings,
)
from objectfolder.products.store import read_product, write_product
from objectfolder.surface.integrals import solid_properties
from objectfolder.surface.textured_mesh import textured_mesh_of
from pipeline.dataset.catalogue import read_catalogue
from pipeline.dataset.task import Request
from pipeline.tasks.objects import prepare_object

REPOSITORY = Path(__file__).parents[2]
MATERIALS = ("ceramic", "glass", "wood", "plastic", "iron", "polycarbonate", "steel")


def test_the_task_takes_the_axis_that_a_row_calls_up(tmp_path):
    path = tmp_path / "box.stl"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(path)
    product = prepare_object(Request("box", {"mesh": path}, {}, {"length_m": 0.3, "up": "x"}, 0))
    assert np.ptp(product["vertices"], axis=0)[2] == pytest.approx(0.1)


def test_product_holds_the_mesh_and_its_measures(tmp_path):
    product = ingest_object(write_textured_cube(tmp_path, side_m=0.1), object_id="cube")
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
    product = ingest_object(write_textured_cube(tmp_path), length_m=0.25, object_id="cube")
    write_product(tmp_path / "cube.zarr.zip", product)
    mesh = textured_mesh_of(read_product(tmp_path / "cube.zarr.zip"))
    np.testing.assert_allclose(mesh.extents, 0.25)
    np.testing.assert_array_equal(mesh.textures[0][..., :3], checker())
    assert mesh.face_texture.dtype == np.int32
    assert (mesh.faces.dtype, mesh.vertices.dtype) == (np.int64, np.float64)


def write_obj(path, vertices, faces):
    lines = ["v {:.17g} {:.17g} {:.17g}".format(*vertex) for vertex in vertices]
    lines += ["f {} {} {}".format(*corners) for corners in np.asarray(faces) + 1]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_ball_in_a_ball_that_faces_outward_like_it_is_a_doubt(tmp_path):
    vertices, faces = sphere(0.05, 3)
    both, inner = np.concatenate([vertices, 0.9 * vertices]), faces + len(vertices)
    volume = solid_properties(vertices, faces).volume_m3
    for name, layers, volume_share in (("solid", inner, 1), ("hollow", inner[:, ::-1], 1 - 0.9**3)):
        path = write_obj(tmp_path / f"{name}.obj", both, np.concatenate([faces, layers]))
        attributes = ingest_object(path, object_id=name).attributes
        assert attributes["solid"]["volume_m3"] == pytest.approx(volume_share * volume, rel=1e-3)
        doubts = [text for text in attributes["warnings"] if "turn their faces inwards" in text]
        assert len(doubts) == (name == "solid")


def test_faces_doubled_back_to_back_are_mended_and_named(tmp_path):
    path = write_obj(tmp_path / "m.obj", 0.1 * CUBE_VERTICES, [*CUBE_FACES, *CUBE_FACES[:, ::-1]])
    attributes = ingest_object(path, object_id="cube").attributes
    assert attributes["solid"]["volume_m3"] == pytest.approx(1e-3)
    assert "12 faces lay back to back with others and were left out" in attributes["warnings"]


def test_crossing_bars_count_their_overlap_once(tmp_path):
    """Two square bars of 100 x 10 x 10 mm, and turned in space: volume, centre and inertia in closed form."""
    bars = np.concatenate([CUBE_VERTICES * (0.1, 0.01, 0.01), CUBE_VERTICES * (0.01, 0.1, 0.01)])
    faces = np.concatenate([CUBE_FACES, CUBE_FACES + 8])
    turn = Rotation.from_rotvec([0.3, 0.7, -0.4]).as_matrix()
    long, core = 1e-5, 1e-6
    around = 2 * long * (0.1**2 + 0.01**2) / 12
    flat = long * (0.1**2 + 3 * 0.01**2) / 12 - core * 0.01**2 / 6
    inertia = np.diag([flat, flat, around - core * 0.01**2 / 6])
    for name, rotation, tolerance in (("upright", np.eye(3), 1e-6), ("turned", turn, 1e-3)):
        path = write_obj(tmp_path / f"{name}.obj", bars @ rotation.T + 0.3, faces)
        solid = ingest_object(path, object_id=name).attributes["solid"]
        assert solid["volume_m3"] == pytest.approx(2 * long - core, rel=tolerance)
        assert abs(solid["volume_m3"] - (2 * long - core)) <= 4 * solid["volume_uncertainty_m3"] + 1e-15
        np.testing.assert_allclose(solid["centre_of_mass_m"], 0.3, atol=1e-5)
        upright_inertia = rotation.T @ np.array(solid["inertia_per_density_m5"]) @ rotation
        np.testing.assert_allclose(upright_inertia, inertia, atol=tolerance * around)


def test_equal_inputs_give_equal_bytes(tmp_path):
    for name in ("first", "second"):
        path = write_textured_cube(tmp_path / name)
        write_product(
            tmp_path / f"{name}.zarr.zip",
            ingest_object(path, object_id="cube"),
        )
    assert (tmp_path / "first.zarr.zip").read_bytes() == (tmp_path / "second.zarr.zip").read_bytes()


def test_what_is_said_of_walls_moves_no_digest_of_shape_or_texture(tmp_path, monkeypatch):
    path = write_textured_cube(tmp_path / "a", side_m=0.3)
    said = ingest_object(path, object_id="cube").attributes
    assert [text.split(":")[0] for text in said["warnings"]] == ["too thick (possible)"]
    assert WallMeasures(**said["walls"]) == measure_walls(cube(0.3).surface)
    monkeypatch.setattr("objectfolder.making.mesh.ingest.wall_findings", lambda measures: ())
    silent = ingest_object(path, object_id="cube").attributes
    assert silent["warnings"] == []
    same = {name: silent["digests"][name] == said["digests"][name] for name in said["digests"]}
    assert same == {"body": False, "geometry": True, "texture": True, "normals": True}


def test_digests_tell_a_new_shape_from_a_new_texture(tmp_path):
    digests = {
        name: ingest_object(path, length_m=length, object_id="cube").attributes["digests"]
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


@pytest.mark.parametrize("object_id", ["025_mug", "Threshold_Porcelain_Teapot_White", "painted_wooden_stool"])
def test_real_scans(shared_objects: Path, object_id: str):
    product = ingest_object(shared_objects / object_id / "model.obj", object_id=object_id)
    assert product.attributes["topology"]["watertight"] == (object_id != "painted_wooden_stool")
    assert product["texture_0"].shape == (1024, 1024, 4)


@pytest.fixture(scope="module")
def ingested(shared_objects: Path) -> dict[str, tuple[str, dict]]:
    """Material and attributes of all shared scans."""
    catalogue = read_catalogue(shared_objects / "catalogue.csv", MATERIALS)
    assert (len(catalogue.records), catalogue.errors) == (100, {})
    return {
        record.id: (
            record.material,
            ingest_object(
                record.mesh, texture_path=record.texture, length_m=record.length_m, object_id=record.id
            ).attributes,
        )
        for record in catalogue.records
    }


@pytest.mark.release("objectfolder.making.mesh")
def test_all_real_scans_are_ingested_and_most_are_closed(ingested):
    closed = 0
    for _, attributes in ingested.values():
        closed += attributes["topology"]["watertight"] and attributes["topology"]["consistent"]
        assert attributes["cleaning"]["repeated_faces_dropped"] == 0
        assert attributes["cleaning"]["unorientable_patches"] == 0
        assert attributes["solid"]["meaningful"] or not attributes["topology"]["watertight"]
    assert closed == 94


SURE = (CERTAIN, LIKELY)
HINTS = (CERTAIN, LIKELY, POSSIBLE)


@pytest.fixture(scope="module")
def classes() -> dict[str, dict[str, str]]:
    """What is right or wrong with the walls of each scan, as seen in sections of all."""
    with (Path(__file__).parent / "walls_of_scans.csv").open(encoding="utf-8", newline="") as file:
        return {row["id"]: row for row in csv.DictReader(file)}


def flagged(
    ingested, classes, certainties, *, by_material: bool, by_mass: bool = False
) -> dict[str, set[str]]:
    """Scans with a finding about walls, by their class."""
    materials = read_materials(REPOSITORY / "data" / "materials.csv")
    scans: dict[str, set[str]] = {row["class"]: set() for row in classes.values()}
    for object_id, (material, attributes) in ingested.items():
        mass = classes[object_id]["mass_kg"]
        findings = wall_findings(
            WallMeasures(**attributes["walls"]),
            material=material if by_material else None,
            density_kg_m3=materials[material].density_kg_m3,
            mass_kg=float(mass) if mass and by_mass else None,
        )
        if any(
            finding.kind in (TOO_THICK, ONE_LAYER, THIN) and finding.certainty in certainties
            for finding in findings
        ):
            scans[classes[object_id]["class"]].add(object_id)
    return scans


@pytest.mark.release("objectfolder.making.mesh")
def test_walls_of_real_scans_that_cannot_be_are_found(ingested, classes):
    assert classes.keys() == ingested.keys()
    geometry = flagged(ingested, classes, HINTS, by_material=False)
    assert geometry["one layer"] == {"Television_01"}
    assert geometry["container"] == {"019_pitcher_base", "Threshold_Porcelain_Teapot_White"}
    assert geometry["right"] == geometry["hollow"] == geometry["unknown"] == set()

    sure = flagged(ingested, classes, SURE, by_material=True)
    assert (len(sure["container"]), len(sure["one layer"]), len(sure["filled"])) == (4, 1, 1)
    assert sure["right"] == sure["hollow"] == sure["unknown"] == set()

    hints = flagged(ingested, classes, HINTS, by_material=True)
    assert (len(hints["container"]), len(hints["filled"]), len(hints["hollow"])) == (12, 2, 9)
    assert all(object_id.startswith("Schleich_") for object_id in hints["right"])

    masses = flagged(ingested, classes, SURE, by_material=True, by_mass=True)
    assert (len(masses["container"]), masses["hollow"]) == (5, {"011_banana", "013_apple"})
    assert masses["right"] == set()


def test_a_mesh_that_no_object_file_holds_is_refused(tmp_path):
    count = 5000
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    lines = [f"v {np.cos(a):.9f} {np.sin(a):.9f} 0" for a in angle] + ["v 0 0 1", "v 0 0 -1"]
    for first in range(count):
        second = (first + 1) % count
        lines += [f"f {first + 1} {second + 1} {count + 1}", f"f {second + 1} {first + 1} {count + 2}"]
    path = tmp_path / "spindle.obj"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"up to 5000 corners of faces in one place\. Decimate it"):
        ingest_object(path, length_m=0.1, object_id="spindle")


def test_what_hardly_is_there_decides_no_size_in_silence(tmp_path):
    """A vertex without a face counts for nothing; a speck far away is named with the size without it."""
    vertices, faces = box((0, 0, 0), (0.1, 0.08, 0.06))
    speck, speck_faces = box((2, 0, 0), (2.001, 0.001, 0.001))
    lines = [f"v {x} {y} {z}" for x, y, z in [*vertices, [9, 9, 9], *speck]]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in [*faces, *(speck_faces + 9)]]
    path = tmp_path / "model.obj"
    path.write_text("\n".join(lines))
    assert load_mesh(path).extents.tolist() == pytest.approx([2.001, 0.08, 0.06])
    said = ingest_object(path).attributes["warnings"]
    assert any("2.001 m" in text and "without them it is 0.1 m" in text for text in said)
    path.write_text("\n".join(line for line in lines if line[0] == "v" or int(line.split()[1]) < 9))
    assert not any("longest side" in text for text in ingest_object(path).attributes["warnings"])
