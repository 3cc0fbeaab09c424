"""Objects that are in a table twice, and sets of pieces that are not."""

import pytest
from checked_rows import entry, shape

from pipeline.checking.duplicates import check
from pipeline.checking.finding import ERROR, NOTE, WARNING


@pytest.mark.parametrize(
    ("first", "second", "found"),
    [
        (
            {"source_id": "ycb:025_mug"},
            {"source_id": "ycb:025_mug"},
            "shares the source with a, and the material",
        ),
        ({"mesh": "mug.obj"}, {"mesh": "mug.obj"}, "shares the mesh file with a, and the material"),
        (
            {"of": shape(mesh="1", geometry="x")},
            {"of": shape(mesh="1", geometry="x")},
            "shares the bytes of the mesh with a, and the material",
        ),
        (
            {"of": shape(mesh="1", geometry="x")},
            {"of": shape(mesh="2", geometry="x")},
            "shares the cleaned surface with a, and the material",
        ),
    ],
)
def test_one_object_twice_is_told_once(first, second, found):
    (finding,) = check([entry("a", **first), entry("b", **second)])
    assert (finding.severity, finding.object_id, finding.found) == (ERROR, "b", found)


def test_one_mesh_in_two_materials_may_be_meant():
    (finding,) = check([entry("a", "steel", mesh="mug.obj"), entry("b", "wood", mesh="mug.obj")])
    assert finding.severity == WARNING
    assert "which is of steel" in finding.found


def test_pieces_of_a_set_share_a_texture():
    (finding,) = check(
        [
            entry("cup", of=shape(mesh="1", geometry="x", texture="t")),
            entry("saucer", of=shape(mesh="2", geometry="y", texture="t")),
        ]
    )
    assert (finding.severity, finding.field) == (NOTE, "texture")


def test_different_objects_and_empty_cells_share_nothing():
    rows = [entry("a", source_id="", mesh=""), entry("b", source_id="", mesh=""), entry("c", mesh="c.obj")]
    assert list(check(rows)) == []
    shapes = [shape(mesh=str(i), geometry=str(i), texture=None) for i in range(3)]
    assert list(check([entry(str(i), of=one) for i, one in enumerate(shapes)])) == []
