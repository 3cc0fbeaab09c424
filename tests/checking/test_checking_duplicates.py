"""Objects that are in a table twice, and sets of pieces that are not."""

import pytest
from checked_rows import entry, shape

from pipeline.intake.check.duplicate_rule import check
from pipeline.intake.check.entry import ERROR, NOTE, WARNING


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
            {"of": shape(mesh="1")},
            {"of": shape(mesh="1")},
            "shares the bytes of the mesh with a, and the material",
        ),
        (
            {"of": shape(mesh="1")},
            {"of": shape((0.04, 0.1, 0.06), mesh="2")},
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
            entry("cup", of=shape(mesh="1", faces=20, texture="t")),
            entry("saucer", of=shape(mesh="2", faces=30, texture="t")),
        ]
    )
    assert (finding.severity, finding.field) == (NOTE, "texture")


def test_the_same_shape_in_another_size_is_another_object():
    small, large = shape((0.02, 0.02, 0.02), mesh="1"), shape((0.03, 0.03, 0.03), mesh="2")
    assert list(check([entry("die", of=small), entry("large_die", of=large)])) == []


def test_different_objects_and_empty_cells_share_nothing():
    rows = [entry("a", source_id="", mesh=""), entry("b", source_id="", mesh=""), entry("c", mesh="c.obj")]
    assert list(check(rows)) == []
    shapes = [shape(mesh=str(i), faces=10 + i, texture=None) for i in range(3)]
    assert list(check([entry(str(i), of=measures) for i, measures in enumerate(shapes)])) == []
