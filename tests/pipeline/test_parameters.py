"""``params.yaml`` is read strictly, and edited with its comments kept."""

import functools
import operator
import subprocess

import pytest
import yaml
from toys import REPOSITORY

from docs.parameter_table import page, parameters
from objectfolder.errors import InputError
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import FOLDER, read_sensor
from pipeline.dataset.parameters import CommonParameters, SizeParameters, read_parameters
from pipeline.dataset.selection import SELECTION, read_selection, select

TEXT = (REPOSITORY / "params.yaml").read_text()


def read(tmp_path, text):
    path = tmp_path / "params.yaml"
    path.write_text(text)
    return read_parameters(path)


def test_both_sizes_are_whole(tmp_path):
    default = read(tmp_path, TEXT)
    paper = read(tmp_path, TEXT.replace("size: default", "size: paper"))
    assert default.vision.resolution < paper.vision.resolution == 256
    assert paper.touch.at_vertices


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("training_views:", "trainingviews:", "unknown key sizes.default.vision.trainingviews. Did you mean"),
        ("seed: 0", "sead: 0", "params.yaml: unknown key sead. Did you mean seed?"),
        ("seed: 0", "", "params.yaml: no key seed"),
        ("size: default", "size: papr", "'papr' is not described. Known sizes are default, small, paper."),
        ("seed: 0", "seed: zero", "params.yaml: seed is 'zero'. It must be a valid integer."),
        ("seed: 0", "seed: true", "params.yaml: seed is True"),
        ("max_modes: 128", "max_modes: 2.5", "sizes.default.audio.max_modes is 2.5"),
        ("20000.0", "2e4", "write 1.0e-3, not 1e-3"),
        ("[0.0005, 0.002]", "[0.0005]", "no value sizes.default.touch.depth_m[1]"),
        ("[0.0005, 0.002]", "[0.0005, deep]", "sizes.default.touch.depth_m[1] is 'deep'"),
        ("sensor: digit", "sensor: digits", "default.touch.sensor: sensor: 'digits' is no known sensor"),
        ("sensor: digit", "sensor: 5", "sizes.default.touch.sensor is 5. Give a name or the path of a file."),
        ("      sensor: digit #", "      #", "no key sizes.default.touch.sensor"),
        ("      contact: rigid #", "      #", "no key sizes.default.touch.contact"),
        ("contact: rigid", "contact: soft", "touch.contact is 'soft'. It must be 'rigid' or 'elastic'."),
        ("renderer: compiled", "renderer: gl", "touch.renderer: renderer: 'gl'. Use compiled or pyrender."),
        ("    vision:\n", "    visions:\n", "unknown key sizes.default.visions. Did you mean"),
        ("seed: 0", "seed: [0", "cannot be read"),
        ("seed: 0", "seed: 1:30", "1:30 is another number in YAML 1.2"),
        ("seed: 0", "seed: 017", "017 is another number in YAML 1.2"),
        ("objects:\n", "objects:\n  only: [a]\n", "objects.only is no parameter any more. Delete that line."),
        ("objects:\n", "objects: [only]\nobject:\n", "unknown key object. Did you mean objects?"),
        ("table: data/starter.csv", 'table: "a\\0"', "objects.table is 'a\\x00'. It must be a path."),
        ("table: data/starter.csv", 'table: ""', "objects.table is ''. It must be a path."),
        ("meshes: data/starter", 'meshes: "a\\0"', "objects.meshes is 'a\\x00'. It must be a path."),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path, old, new, message):
    assert old in TEXT
    with pytest.raises(InputError) as raised:
        read(tmp_path, TEXT.replace(old, new, 1))
    assert message in str(raised.value)


NUMBERS = {
    parameter.name: parameter.bounds
    for parameter in (*parameters(CommonParameters), *parameters(SizeParameters))
    if parameter.bounds
}


def without(name, value):
    """The parameters with an absurd value, as text."""
    content = yaml.safe_load(TEXT)
    *sections, key = name.split(".")
    section = functools.reduce(operator.getitem, sections, content["sizes"]["small"] if sections else content)
    section[key] = [value, value] if name == "touch.depth_m" else value
    return yaml.safe_dump(content)


def refused(tmp_path, name, value):
    with pytest.raises(InputError) as raised:
        read(tmp_path, without(name, value))
    said = str(raised.value)
    assert "\n" not in said
    assert name in said
    return said


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_out_of_its_range_is_refused_with_key_value_and_range(tmp_path, name):
    bounds = NUMBERS[name]
    value = type(bounds.least)(2 * bounds.most + 1)
    said = refused(tmp_path, name, value)
    assert f"is {value}. It must be from {bounds}." in said
    assert len(said) < 200


@pytest.mark.release("pipeline.dataset")
@pytest.mark.parametrize("name", NUMBERS)
def test_no_absurd_value_is_taken(tmp_path, name):
    bounds = NUMBERS[name]
    for value in (
        float("nan"), float("inf"), -float("inf"), bounds.least - 1, -1e9, 10.0**300, 10**400, "3", True,
        {"a": 1},
    ):  # fmt: skip
        refused(tmp_path, name, value)


def test_depths_are_in_order_and_within_the_sensor(tmp_path):
    with pytest.raises(InputError, match=r"depth_m is \[0\.002, 0\.001\]\. The second must not be less"):
        read(tmp_path, TEXT.replace("[0.0005, 0.002]", "[0.002, 0.001]", 1))
    with pytest.raises(
        InputError, match=r"depth_m is \[0\.0005, 0\.04\]\. The sensor allows 0\.\d+ metres at most"
    ):
        read(tmp_path, TEXT.replace("[0.0005, 0.002]", "[0.0005, 0.04]", 1))


def test_the_page_of_parameters_is_that_of_the_code():
    """Write it again: python -m docs.parameter_table > docs/parameters.md."""
    assert (REPOSITORY / "docs/parameters.md").read_text() == page()


def test_what_is_read_is_the_sensor_itself_and_not_its_name(tmp_path):
    digit = read(tmp_path, TEXT).touch.sensor
    assert Sensor.from_dict(digit) == read_sensor("digit")
    mine = (FOLDER / "digit.yaml").read_text().replace("sigma_grey_levels: 3.0", "sigma_grey_levels: 1.0")
    (tmp_path / "sensors").mkdir()
    (tmp_path / "sensors" / "mine.yaml").write_text(mine)
    parameters = read(tmp_path, TEXT.replace("sensor: digit", "sensor: sensors/mine.yaml", 1))
    assert parameters.touch.sensor == {**digit, "noise_sigma_grey_levels": 1.0}


def test_the_compiled_renderer_is_no_parameter_of_a_product_and_another_is(tmp_path):
    pyrender = TEXT.replace("renderer: compiled", "renderer: pyrender", 1)
    assert "renderer" not in read(tmp_path, TEXT).values_at("touch")
    assert read(tmp_path, pyrender).values_at("touch")["renderer"] == "pyrender"
    with pytest.raises(InputError, match=r"sizes\.default\.touch\.renderer: .* no elastic contact"):
        read(tmp_path, pyrender.replace("contact: rigid", "contact: elastic", 1))


def test_a_mistake_in_the_size_not_selected_is_named(tmp_path):
    head, _, tail = TEXT.rpartition("max_modes")
    with pytest.raises(InputError, match=r"unknown key sizes\.paper\.audio\.max_mode\b"):
        read(tmp_path, f"{head}max_mode{tail}")


def test_selection_edits_only_what_it_says(tmp_path):
    path, chosen = tmp_path / "params.yaml", tmp_path / SELECTION
    path.write_text(TEXT)
    table = tmp_path / "mine.csv"
    table.write_text("id,mesh,material\ncup,meshes/a/cup.obj,glass\ndish,meshes/dish.obj,glass\n")
    assert select(tmp_path, None, None) == []
    assert path.read_text() == TEXT
    assert select(tmp_path, str(table), "cup, dish") == [
        f"params.yaml: objects.table is now {table} (was data/starter.csv)",
        "params.yaml: objects.meshes is now meshes (was data/starter)",
        "data/selection/only.txt: selected are now cup, dish (were all)",
    ]
    assert read_parameters(path).objects.table == str(table)
    assert read_selection(tmp_path) == ("cup", "dish")
    comments = [line.partition("#")[2] for line in TEXT.splitlines() if "#" in line]
    edited = path.read_text()
    assert [line.partition("#")[2] for line in edited.splitlines() if "#" in line] == comments
    assert select(tmp_path, None, "") == ["data/selection/only.txt: selected are now all (were cup, dish)"]
    assert (path.read_text(), chosen.exists()) == (edited, False)


def test_another_table_drops_ids_of_the_former(tmp_path):
    path = tmp_path / "params.yaml"
    path.write_text(TEXT)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "starter.csv").write_text("id,material\ncup,glass\n")
    (tmp_path / "mine.csv").write_text("id,material\n")
    select(tmp_path, None, "cup")
    select(tmp_path, "mine.csv", None)
    assert read_selection(tmp_path) == ()
    assert read_parameters(path).objects.meshes == "mine.csv"  # no folder without products has them


def test_an_id_that_the_table_lacks_is_refused_with_those_it_has(tmp_path):
    path, table = tmp_path / "params.yaml", tmp_path / "mine.csv"
    path.write_text(TEXT)
    table.write_text("id,mesh,material\ncup,cup.obj,glass\ndish,dish.obj,glass\n")
    with pytest.raises(InputError, match=r"--only: nix: not in .*mine\.csv\. Known are cup, dish\."):
        select(tmp_path, str(table), "cup,nix")
    assert (path.read_text(), read_selection(tmp_path)) == (TEXT, ())


def test_git_ignores_a_selection_and_one_that_cannot_be_read_is_named(tmp_path):
    ignored = ["git", "check-ignore", "--quiet", str(SELECTION)]
    assert subprocess.run(ignored, cwd=REPOSITORY, check=False).returncode == 0
    (tmp_path / SELECTION).parent.mkdir(parents=True)
    (tmp_path / SELECTION).write_bytes(b"\xff\n")
    with pytest.raises(InputError, match=r"data/selection/only\.txt: cannot be read .* Delete it"):
        read_selection(tmp_path)


def test_missing_table_is_named(tmp_path):
    path = tmp_path / "params.yaml"
    path.write_text(TEXT)
    with pytest.raises(InputError, match=r"nowhere\.csv: no such table"):
        select(tmp_path, "nowhere.csv", None)
    assert path.read_text() == TEXT
