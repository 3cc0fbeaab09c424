"""The starter set: closed, thin-walled where it should be, textured, and the same bytes each time."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.surface.textured_mesh import textured_mesh_of
from pipeline.dataset.catalogue import read_catalogue
from pipeline.intake.starter.write import STARTER_OBJECTS, write_starter_set

REPOSITORY = Path(__file__).parents[2]
SLOW_FIXTURES = ("products",)
MATERIALS = ("ceramic", "glass", "wood", "plastic", "iron", "polycarbonate", "steel")


@pytest.fixture(scope="module")
def starter(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    write_starter_set(folder / "starter")
    (folder / "starter.csv").write_bytes((REPOSITORY / "data" / "starter.csv").read_bytes())
    return folder


@pytest.fixture(scope="module")
def products(starter):
    catalogue = read_catalogue(starter / "starter.csv", MATERIALS)
    assert catalogue.errors == {}
    return {
        r.id: ingest_object(r.mesh, texture_path=r.texture, length_m=r.length_m, object_id=r.id)
        for r in catalogue.records
    }


def test_table_lists_the_whole_set_in_many_materials(starter):
    records = read_catalogue(starter / "starter.csv", MATERIALS).records
    assert {record.id for record in records} == set(STARTER_OBJECTS)
    assert {"bowl", "mug", "plate", "fork", "die", "bell"} <= set(STARTER_OBJECTS)
    assert len({record.material for record in records}) >= 5
    assert all(record.licence and record.attribution for record in records)


@pytest.mark.parametrize("name", STARTER_OBJECTS)
def test_object_is_one_clean_solid(products, name):
    attributes = products[name].attributes
    assert attributes["topology"]["watertight"]
    assert attributes["topology"]["components"] == 1
    assert attributes["topology"]["zero_area_faces"] == 0
    assert attributes["warnings"] == []
    assert set(attributes["cleaning"].values()) == {0}
    assert 2000 <= len(products[name]["faces"]) <= 10000


@pytest.mark.parametrize("name", STARTER_OBJECTS)
def test_object_does_not_cut_through_itself(products, name):
    """Just inside the surface its winding number is 1, just outside 0."""
    mesh = textured_mesh_of(products[name])
    samples = mesh.surface.sample(60, seed=1)
    normals = mesh.surface.face_normals[samples.face]
    corners = mesh.vertices[mesh.faces]
    for side, expected in ((-2e-5, 1.0), (2e-5, 0.0)):
        for point in samples.points + side * normals:
            assert winding_number(point, corners) == pytest.approx(expected, abs=1e-6)


def winding_number(point: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
    products = [np.einsum("ij,ij->i", p, q) * r for p, q, r in ((a, b, lc), (b, c, la), (c, a, lb))]
    return float(2 * np.arctan2(numerator, la * lb * lc + sum(products)).sum() / (4 * np.pi))


def test_walls_are_as_thick_as_meant(products):
    thickness = {name: product.attributes["wall_thickness"]["median_m"] for name, product in products.items()}
    expected = {"bowl": 0.003, "mug": 0.0035, "plate": 0.0045, "fork": 0.0022, "die": 0.016, "spatula": 0.007}
    for name, wall in expected.items():
        assert thickness[name] == pytest.approx(wall, rel=0.03), name


def test_die_has_dimples_that_sum_to_seven_on_opposite_sides(products):
    vertices = products["die"]["vertices"]
    from pipeline.intake.starter.die import _FACES, _PIP_DEPTH, _PIP_OFFSET, _pip_centres

    opposite = {(axis, sign): pips for axis, sign, _, _, pips in _FACES}
    assert all(opposite[axis, 1] + opposite[axis, -1] == 7 for axis in range(3))
    for axis, sign, first, second, pips in _FACES:
        for centre in _PIP_OFFSET * _pip_centres(pips):
            near = np.linalg.norm(vertices[:, [first, second]] - centre, axis=1) < 0.0006
            depth = 0.008 - (sign * vertices[near & (sign * vertices[:, axis] > 0), axis]).min()
            assert depth == pytest.approx(_PIP_DEPTH, rel=0.25)


@pytest.mark.parametrize("name", STARTER_OBJECTS)
def test_texture_has_features_and_coordinates_stay_in_it(products, name):
    texture, coordinates = products[name]["texture_0"], products[name]["texture_coordinates"]
    assert texture.shape == (512, 512, 4)
    assert texture[..., :3].astype(float).std(axis=(0, 1)).max() > 15
    assert 0 <= coordinates.min() <= coordinates.max() <= 1


@pytest.mark.slow
def test_same_bytes_each_time(starter, tmp_path):
    write_starter_set(tmp_path)
    for path in sorted((starter / "starter").rglob("*.*")):
        again = tmp_path / path.relative_to(starter / "starter")
        assert hashlib.sha256(path.read_bytes()).digest() == hashlib.sha256(again.read_bytes()).digest(), (
            path.name
        )
