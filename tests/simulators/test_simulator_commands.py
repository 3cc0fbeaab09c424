"""`objectfolder export --format mjcf` and `objectfolder scene` as a user types them, on one Object File."""

import json
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

import objectfolder
from objectfolder.products.store import Product, write_product
from objectfolder.simulators.parts_product import absent_parts, parts_product
from objectfolder.surface.convex_parts import ConvexParts
from objectfolder.surface.surface import Surface
from pipeline.cli import main
from pipeline.dataset.stages import COLLISION, OBJECT_FILES

pytestmark = pytest.mark.usefixtures("quiet")

MATERIALS = str(Path(__file__).parents[2] / "data" / "materials.csv")


@pytest.fixture
def bar(small_file: Path, tmp_path: Path) -> Path:
    """An Object File of a bar with the body that a data set would have given it."""
    mass = 2600 * 0.12 * 0.03 * 0.008
    inertia = [
        [mass / 12 * (0.03**2 + 0.008**2), 0, 0],
        [0, mass / 12 * (0.12**2 + 0.008**2), 0],
        [0, 0, mass / 12 * (0.12**2 + 0.03**2)],
    ]
    return with_body(small_file, tmp_path / "bar.safetensors", mass, [0.0, 0.0, 0.0], inertia)


def with_body(
    file: Path, path: Path, mass_kg: float | None, centre_m: object = None, inertia: object = None
) -> Path:
    body = {"mass_kg": mass_kg, "centre_of_mass_m": centre_m, "inertia_kg_m2": inertia, "filled_mass_kg": 1.0}
    objectfolder.load(file).with_description(body=body).save(path)
    return path


def run(*arguments: str) -> int:
    more = ("--materials", MATERIALS, "--texture-side", "64") if arguments[0] == "export" else ()
    return main([*arguments, *more])


def test_all_formats_of_one_object(bar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "out"
    assert run("export", str(bar), "--format", "all", "-o", str(output)) == 0
    assert "1 convex parts" in capsys.readouterr().out
    described = json.loads((output / "export.json").read_text())
    model = mujoco.MjModel.from_xml_path(str(output / "object.xml"))
    assert model.body_mass[1] == pytest.approx(described["mass_kg"], rel=1e-12)
    assert {"object.urdf", "model.sdf", "model.config", "object.usda", "ATTRIBUTION.txt"} <= {
        path.name for path in output.iterdir()
    }
    assert (output / "bar.safetensors").read_bytes() == bar.read_bytes()


def test_a_measured_mass_and_friction_replace_the_materials(
    bar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "out"
    options = ("--mass", "0.5", "--friction", "0.2", "--format", "mjcf")
    assert run("export", str(bar), *options, "-o", str(output), "--json") == 0
    [figures] = json.loads(capsys.readouterr().out)
    assert (figures["folder"], figures["mass_kg"], figures["licence"]) == (str(output), 0.5, "CC0-1.0")
    model = mujoco.MjModel.from_xml_path(str(output / "object.xml"))
    assert model.body_mass[1] == pytest.approx(0.5)
    assert model.geom_friction[model.ngeom - 1][0] == pytest.approx(0.2)
    assert not (output / "object.urdf").exists()


def test_a_scene_of_one_object_twice(bar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "table" / "scene.xml"
    options = ("--table", "0.5", "--texture-side", "64", "--json")
    assert run("scene", str(bar), str(bar), "-o", str(scene), *options) == 0
    assert mujoco.MjModel.from_xml_path(str(scene)).nbody == 3
    figures = {"file": str(scene), "objects": ["bar", "bar"], "table_m": 0.5}
    assert json.loads(capsys.readouterr().out) == figures
    assert run("scene", str(bar), "-o", str(scene)) == 1
    assert "is there already" in capsys.readouterr().err


@pytest.mark.slow
def test_a_scene_without_room_or_of_two_objects_of_one_name_leaves_nothing(
    bar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, more = tmp_path / "table" / "scene.xml", ("--texture-side", "64")
    assert run("scene", *[str(bar)] * 3, "-o", str(scene), "--table", "0.2", *more) == 1
    assert "no room on a table" in capsys.readouterr().err
    (tmp_path / "other").mkdir()
    namesake = tmp_path / "other" / bar.name
    namesake.write_bytes(bar.read_bytes())
    assert run("scene", str(bar), str(namesake), "-o", str(scene), *more) == 1
    assert "two of its objects are called bar" in capsys.readouterr().err
    assert not scene.parent.exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--format", "mjcf", "--mass", "-1"), "a mass of -1 kg"),
        (("--format", "mjcf", "--mass", "0"), "a mass of 0 kg"),
        (("--format", "mjcf", "--mass", "nan"), "a mass of nan kg"),
        (("--format", "mjcf", "--mass", "inf"), "a mass of inf kg in 28.8 cm3 is denser"),
        (("--format", "mjcf", "--mass", "90"), "a mass of 90 kg in 28.8 cm3 is denser than any solid"),
        (("--format", "mjcf", "--friction", "-1"), "friction -1"),
        (("--format", "mjcf", "--most-parts", "0"), "0 collision parts"),
        (("--format", "mjcf", "--threshold", "nan"), "a threshold of nan"),
    ],
    ids=[
        "mass",
        "no mass",
        "mass is no number",
        "endless mass",
        "absurd mass",
        "friction",
        "parts",
        "threshold",
    ],
)
def test_bad_options_are_one_line_and_leave_nothing(
    bar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], said: str
) -> None:
    assert run("export", str(bar), *options, "-o", str(tmp_path / "out")) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_unknown_format_is_one_line_that_names_the_known(
    bar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("export", str(bar), "--format", "stl", "-o", str(tmp_path / "out")) == 2
    error = capsys.readouterr().err
    assert '"mjcf", "urdf", "sdf", "usd", "all"' in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.fixture
def data_set(bar: Path, tmp_path: Path) -> Path:
    """A data set of the bar, whose parts are two boxes."""
    root = tmp_path / "set"
    OBJECT_FILES.path(root, "bar").parent.mkdir(parents=True)
    OBJECT_FILES.path(root, "bar").write_bytes(bar.read_bytes())
    halves = [trimesh.creation.box((0.06, 0.03, 0.008)) for _ in range(2)]
    for half, side in zip(halves, (-1, 1), strict=True):
        half.apply_translation((side * 0.03, 0, 0))
    hulls = tuple(Surface(np.array(half.vertices), np.array(half.faces)) for half in halves)
    store(root, parts_product(ConvexParts(hulls, 1.0, 0.0, 0.0)))
    return root


def store(root: Path, product: Product) -> None:
    path = COLLISION.path(root, "bar")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_product(path, product)


def test_the_parts_are_the_data_sets_unless_others_are_asked_for(data_set: Path, tmp_path: Path) -> None:
    arguments = ("export", "bar", "--root", str(data_set), "--format", "mjcf")
    assert run(*arguments, "-o", str(tmp_path / "own")) == 0
    assert run(*arguments, "--most-parts", "1", "-o", str(tmp_path / "one")) == 0
    parts = [len(list((tmp_path / name).glob("collision_*.obj"))) for name in ("own", "one")]
    assert parts == [2, 1]


def test_an_object_without_parts_says_why_and_how_it_has_some(
    data_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store(data_set, absent_parts("parting it takes more than 150 CPU-s"))
    arguments = ("export", "bar", "--root", str(data_set), "--format", "mjcf")
    assert run(*arguments, "-o", str(tmp_path / "out")) == 1
    error = capsys.readouterr().err
    assert "bar: it has no collision parts: parting it takes more than 150 CPU-s" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
    assert run(*arguments, "--most-parts", "1", "-o", str(tmp_path / "out")) == 0


@pytest.mark.parametrize(
    ("package", "options", "extra"),
    [
        ("pxr", ("--format", "all"), "simulators"),
        ("coacd", ("--format", "mjcf", "--threshold", "0.001"), "factory"),
    ],
)
def test_a_missing_package_is_one_line_and_leaves_nothing(
    bar: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    package: str,
    options: tuple[str, ...],
    extra: str,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr("objectfolder.simulators.collision.find_spec", lambda name: None)
    assert run("export", str(bar), *options, "-o", str(tmp_path / "out")) == 1
    error = capsys.readouterr().err
    assert f'pip install "objectfolder-factory[{extra}]"' in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_that_exists_is_kept(bar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "out"
    output.mkdir()
    (output / "mine.txt").write_text("mine")
    assert run("export", str(bar), "--format", "mjcf", "-o", str(output)) == 1
    error = capsys.readouterr().err
    assert "is no export" in error
    assert error.count("\n") == 1
    assert [path.name for path in output.iterdir()] == ["mine.txt"]


def test_the_mass_of_the_table_is_the_asset_s(bar: Path, tmp_path: Path) -> None:
    file, weighed = objectfolder.load(bar), tmp_path / "weighed.safetensors"
    file.with_description(object={"id": "weighed", "mass_kg": 0.25}).save(weighed)
    assert run("export", str(weighed), "--format", "mjcf", "-o", str(tmp_path / "out")) == 0
    described = json.loads((tmp_path / "out" / "object.json").read_text())
    assert (described["mass_kg"], described["mass_of"]) == (0.25, "measured")
    solid = file.description["body"]
    ratio = np.divide(described["inertia_kg_m2"], 0.25) - np.divide(solid["inertia_kg_m2"], solid["mass_kg"])
    assert np.abs(ratio).max() < 1e-15


def test_an_open_surface_has_the_mass_of_what_fills_it(small_file: Path, tmp_path: Path) -> None:
    filled = {"filled_centre_of_mass_m": [0.0, 0.0, 0.0], "filled_inertia_kg_m2": (np.eye(3) * 1e-3).tolist()}
    body = {"mass_kg": None, "centre_of_mass_m": None, "inertia_kg_m2": None, "filled_mass_kg": 1.0, **filled}
    path = tmp_path / "open.safetensors"
    objectfolder.load(small_file).with_description(body=body).save(path)
    assert run("export", str(path), "--format", "mjcf", "-o", str(tmp_path / "out")) == 0
    described = json.loads((tmp_path / "out" / "object.json").read_text())
    assert (described["mass_kg"], described["mass_of"]) == (1.0, "solid that sounds")


def test_an_open_surface_without_sound_has_no_asset(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = with_body(small_file, tmp_path / "open.safetensors", None)
    assert run("export", str(path), "--format", "urdf", "-o", str(tmp_path / "out")) == 1
    assert "open or torn" in capsys.readouterr().err
