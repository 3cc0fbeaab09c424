"""The table of objects. Its faults that concern one object are in test_bad_input."""

import dataclasses
import shlex
from pathlib import Path

import pytest
from small_meshes import write_textured_cube

from objectfolder.errors import InputError
from objectfolder.making.materials import read_materials
from pipeline.dataset.catalogue import read_catalogue
from pipeline.dataset.records import row_of

REPOSITORY = Path(__file__).parents[1]
MATERIALS = ("ceramic", "glass", "wood", "plastic", "iron", "polycarbonate", "steel")


@pytest.fixture
def folder(tmp_path) -> Path:
    write_textured_cube(tmp_path / "cube")
    return tmp_path


def write(folder: Path, text: str) -> Path:
    path = folder / "objects.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_row_with_every_field(folder):
    path = write(
        folder,
        "\ufeffid,name,mesh,texture,material,length_m,source,licence,attribution,roughness,metallic\n"
        'cube,"Cube, plain",cube/model.obj,cube/texture.png,wood,0.25,here,CC0-1.0,me,0.4,1\n\n',
    )
    (record,) = read_catalogue(path, MATERIALS).records
    assert (record.id, record.name, record.material, record.length_m) == ("cube", "Cube, plain", "wood", 0.25)
    assert record.mesh == folder / "cube" / "model.obj"
    assert record.texture == folder / "cube" / "texture.png"
    assert (record.source, record.licence, record.attribution) == ("here", "CC0-1.0", "me")
    assert (record.roughness, record.metallic) == (0.4, 1.0)


def test_row_with_the_least(folder):
    (record,) = read_catalogue(write(folder, "material,id\nsteel,cube\n"), MATERIALS).records
    assert (record.name, record.mesh, record.texture) == ("cube", folder / "cube" / "model.obj", None)
    assert (record.length_m, record.roughness, record.metallic) == (None, None, None)


@pytest.mark.parametrize("length", ["as in file", "As in file", ""])
def test_length_as_in_file(folder, length):
    path = write(folder, f"id,mesh,material,length_m\ncube,cube/model.obj,steel,{length}\n")
    assert read_catalogue(path, MATERIALS).records[0].length_m is None


def test_table_that_cannot_be_used(subtests, folder):
    for text, finding in [
        ("id;mesh;material\ncube;cube/model.obj;steel\n", "separated by semicolons: separate them by commas"),
        ("id\tmesh\tmaterial\ncube\tcube/model.obj\tsteel\n", "separated by tabs: separate them by commas"),
        ("id,mesh\ncube,cube/model.obj\n", "has no column 'material'. Add a column 'material'"),
        (
            "id,material,lenght_m\ncube,steel,0.1\n",
            "has no column 'length_m'. Rename 'lenght_m' to 'length_m'",
        ),
        ("id,material,id\ncube,steel,cube\n", "repeats the column id"),
        ("id,material\ncube,steel,0.1\n", "line 2: has 3 cells for 2 columns"),
        ("id,material\n", "lists no objects"),
        ("", "has no column 'id'"),
        ('id,material\n"cube,steel\n', "is not a CSV table"),
    ]:
        with subtests.test(text=text):
            with pytest.raises(InputError) as caught:
                read_catalogue(write(folder, text), MATERIALS)
            assert finding in str(caught.value)


def test_table_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"objects\.csv: the table of objects does not exist"):
        read_catalogue(tmp_path / "objects.csv", MATERIALS)


def test_table_that_is_not_text(folder):
    path = folder / "objects.csv"
    path.write_bytes(b"id,material\n\xff\xfe\x00,steel\n")
    with pytest.raises(InputError, match="is not a CSV table in UTF-8"):
        read_catalogue(path, MATERIALS)


@pytest.mark.parametrize(
    ("field", "value"), [("roughness", "1.5"), ("metallic", "shiny"), ("roughness", "nan")]
)
def test_appearance_out_of_range(folder, field, value):
    path = write(folder, f"id,material,{field}\ncube,steel,{value}\n")
    problem = read_catalogue(path, MATERIALS).errors["cube"]
    assert f"field {field}" in problem.where
    assert "not a number in 0..1" in problem.finding


def test_walls_and_shells_are_metres_and_optional(folder):
    text = (
        "id,mesh,material,wall_m,shell_m\nbowl,cube/model.obj,steel,0.0025,\ncan,cube/model.obj,steel,,2e-4\n"
    )
    records = read_catalogue(write(folder, text + "die,cube/model.obj,wood,,\n"), MATERIALS).records
    assert [(record.wall_m, record.shell_m) for record in records] == [
        (0.0025, None),
        (None, 2e-4),
        (None, None),
    ]


@pytest.mark.parametrize("field", ["wall_m", "shell_m", "mass_kg"])
@pytest.mark.parametrize("value", ["0", "-0.001", "3 mm", "nan", "inf"])
def test_walls_and_masses_are_positive(folder, field, value):
    path = write(folder, f"id,material,{field}\ncube,steel,{value}\n")
    problem = read_catalogue(path, MATERIALS).errors["cube"]
    assert f"field {field}" in problem.where
    assert "is not a positive number" in problem.finding


@pytest.mark.parametrize("field", ["length_m", "roughness", "wall_m"])
@pytest.mark.parametrize("value", ["1_0", "0_1", "\u0661"])
def test_numbers_that_only_python_reads_are_refused(folder, field, value):
    path = write(folder, f"id,material,{field}\ncube,steel,{value}\n")
    problem = read_catalogue(path, MATERIALS).errors["cube"]
    assert f"field {field}" in problem.where
    assert repr(value) in problem.finding


def test_a_wall_and_a_shell_exclude_each_other(folder):
    path = write(folder, "id,material,wall_m,shell_m\ncube,steel,0.002,0.002\n")
    problem = read_catalogue(path, MATERIALS).errors["cube"]
    assert "stated together with wall_m" in problem.finding


def test_a_unit_left_out_of_a_column_is_named(folder):
    with pytest.raises(InputError, match=r"has no column 'wall_m'\. Rename 'wall_mm' to 'wall_m'"):
        read_catalogue(write(folder, "id,material,wall_mm\ncube,steel,2\n"), MATERIALS)


def test_what_is_not_fetched_names_the_command_that_fetches_it(folder):
    text = (
        "id,mesh,texture,material,source_id\nmug,ycb/mug.obj,,steel,ycb:025_mug\n"
        "cube,cube/model.obj,none.png,steel,gso:Pok\u00e9mon's Box\nown,none.obj,,steel,\n"
    )
    errors = read_catalogue(write(folder, text), MATERIALS).errors
    assert errors["mug"].remedy == "objectfolder fetch ycb:025_mug"
    assert "field texture" in errors["cube"].where
    # A remedy can be pasted into a shell, whatever a table's author wrote.
    assert shlex.split(errors["cube"].remedy) == ["objectfolder", "fetch", "gso:Pok\u00e9mon's Box"]
    assert errors["own"].remedy == "Correct the path or add the file"


def test_a_row_that_waits_for_its_files_has_no_other_fault(folder):
    text = "id,mesh,material,length_m,source_id\nmug,ycb/mug.obj,stel,0.1,ycb:025_mug\n"
    assert "Did you mean 'steel'" in read_catalogue(write(folder, text), MATERIALS).errors["mug"].remedy


def test_a_source_is_kept_and_means_nothing_to_what_is_made(folder):
    text = "id,mesh,material,source_id,notes\ncube,cube/model.obj,steel,ycb:000_cube,any\n"
    (record,) = read_catalogue(write(folder, text), MATERIALS).records
    assert record.source_id == "ycb:000_cube"
    steel = read_materials(REPOSITORY / "data" / "materials.csv")["steel"]
    assert row_of(record, steel) == row_of(dataclasses.replace(record, source_id=""), steel)


def test_tables_that_come_with_the_factory():
    starter = read_catalogue(REPOSITORY / "data" / "starter.csv", MATERIALS)
    papers = read_catalogue(REPOSITORY / "data" / "objects.csv", MATERIALS)
    assert len(starter.records) + len(starter.errors) == 7
    assert len(papers.records) + len(papers.errors) == 100
    # Nothing is wrong with a row but that its mesh may not be fetched yet.
    assert {error.remedy.partition(" ")[0] for error in papers.errors.values()} <= {"objectfolder"}


def test_several_bad_rows_are_all_reported(folder):
    text = "id,mesh,material,length_m\na,a.obj,steel,1\nb,cube/model.obj,gold,1\nc,cube/model.obj,steel,-1\n"
    catalogue = read_catalogue(write(folder, text + "d,cube/model.obj,steel,1\n"), MATERIALS)
    assert list(catalogue.errors) == ["a", "b", "c"]
    assert [record.id for record in catalogue.records] == ["d"]


def test_catalogue_of_real_scans_works_as_it_is(shared_objects: Path):
    catalogue = read_catalogue(shared_objects / "catalogue.csv", MATERIALS)
    assert (len(catalogue.records), catalogue.errors) == (100, {})
    mug = next(record for record in catalogue.records if record.id == "025_mug")
    assert (mug.material, mug.length_m, mug.texture) == ("steel", None, mug.mesh.parent / "texture.jpg")
    assert (mug.licence, mug.source) == ("CC BY 4.0", "YCB")
