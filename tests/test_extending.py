"""Parts of other packages: the examples of docs/extending.md as a distribution, and broken ones."""

import json
import re
import shutil
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

import objectfolder
from objectfolder.errors import InputError
from objectfolder.live import LiveSound, open_simulation
from objectfolder.plugins import EXPORTS, SENSORS, SIMULATORS, SOURCE_GROUP
from objectfolder.touch import Press, press, read_sensor
from pipeline.cli import main
from pipeline.dataset.parameters import read_parameters
from pipeline.intake.sources.registry import Resolutions, source_named
from tests.conftest import REPOSITORY

PAGE = (REPOSITORY / "docs" / "extending.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r'```\w+ title="([\w.]+)"\n(.*?)```', PAGE, re.DOTALL))
MUG = objectfolder.EXAMPLES / "mug.safetensors"
Install = Callable[[str, Mapping[str, Mapping[str, str]], Mapping[str, str]], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """A function that installs a distribution: its name, entry points by group, and modules by file name."""
    before = set(sys.modules)
    count = [0]

    def installed(name: str, groups: Mapping[str, Mapping[str, str]], modules: Mapping[str, str]) -> None:
        count[0] += 1
        site = tmp_path / f"site{count[0]}"
        metadata = site / f"{name.replace('-', '_')}-1.0.dist-info"
        metadata.mkdir(parents=True)
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = [
            line
            for group, entries in groups.items()
            for line in (f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()))
        ]
        (metadata / "entry_points.txt").write_text("\n".join(lines))
        for file, code in modules.items():
            (site / file).write_text(code, encoding="utf-8")
        monkeypatch.syspath_prepend(site)

    yield installed
    for name in set(sys.modules) - before:
        if name.startswith("lab_"):
            del sys.modules[name]


@pytest.fixture
def lab(install: Install) -> None:
    """The package of the page."""
    project = tomllib.loads(FILES["pyproject.toml"])["project"]
    install(project["name"], project["entry-points"], {n: FILES[n] for n in FILES if n.startswith("lab_")})


@pytest.fixture
def shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    brick = tmp_path / "shelf" / "brick"
    brick.mkdir(parents=True)
    trimesh.creation.box((0.2, 0.1, 0.05)).export(brick / "scan.ply")
    monkeypatch.setenv("LAB_SHELF", str(brick.parent))
    return brick / "scan.ply"


@pytest.mark.usefixtures("lab")
def test_objects_of_a_source_are_listed_and_fetched(
    shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["fetch", "--list", "shelf"]) == 0
    assert capsys.readouterr().out == "shelf:brick\n"
    assert main(["fetch", "shelf:brick", "--resolution", "scan"]) == 0
    assert Path("data/fetched/shelf/brick/mesh.ply").read_bytes() == shelf.read_bytes()
    assert "Shelf of the lab,CC0-1.0,The lab,shelf:brick" in capsys.readouterr().out
    assert "shelf:brick,mesh.ply" in Path("data/source_hashes.csv").read_text()
    shelf.write_bytes(shelf.read_bytes() + b"\n")
    assert main(["fetch", "shelf:brick", "--refresh"]) == 1
    assert "shelf:brick" in capsys.readouterr().err
    assert main(["fetch", "shelf:brik"]) == 1
    assert "Did you mean shelf:brick?" in capsys.readouterr().err


@pytest.mark.usefixtures("lab")
def test_a_sensor_is_pressed_and_all_of_it_is_a_parameter(tmp_path: Path) -> None:
    names: dict[str, Any] = {}
    exec(FILES["press.py"], names)
    touches = names["touches"]
    flat = read_sensor("flat")
    assert (flat.name, flat.gel_sagitta_m) == ("Flat DIGIT", 0.0)
    assert touches.reachable.all()
    assert touches.mask.any()
    of_digit = press(names["mug"].surface, read_sensor("digit"), names["points"], Press(depth_m=0.001))
    assert (touches.rgb != of_digit.rgb).any()
    parameters = yaml.safe_load((REPOSITORY / "params.yaml").read_text(encoding="utf-8"))
    parameters["sizes"]["default"]["touch"]["sensor"] = "flat"
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(parameters))
    assert read_parameters(tmp_path / "params.yaml", "default").touch.sensor == flat.to_dict()


@pytest.mark.usefixtures("lab")
def test_an_object_in_a_simulator_is_heard(tmp_path: Path) -> None:
    (tmp_path / "mug").mkdir()
    mug = objectfolder.example("mug")
    mass_kg = mug.description["body"]["mass_kg"]
    (tmp_path / "mug" / "object.json").write_text(json.dumps({"mass_kg": mass_kg}))
    lifted = np.eye(4)
    lifted[2, 3] = 0.05
    simulation = open_simulation("falling", tmp_path / "scene.xml", {"0_mug": lifted})
    soft = 1e6, 0.3  # so that the mug gives way as a rigid body
    live = LiveSound(simulation, {"0_mug": mug}, restitution=0.5, others=soft)
    sound = np.concatenate(
        [live.block() for _ in range(70)]
    )  # 0.8 s; the fall lasts 0.1, then it bounces and lies
    impact, *bounces = live.impacts
    assert len(bounces) > 2
    assert impact.time_s == pytest.approx(np.sqrt(2 * 0.05 / 9.81), abs=0.002)
    assert impact.impulse_n_s[2] == pytest.approx(1.5 * mass_kg * np.sqrt(2 * 9.81 * 0.05), rel=0.02)
    assert abs(sound).max() > 0


@pytest.mark.usefixtures("lab")
def test_a_scene_is_played_in_a_simulator(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mug, mass_kg = tmp_path / "mug", objectfolder.example("mug").description["body"]["mass_kg"]
    mug.mkdir()
    shutil.copy(MUG, mug)
    (mug / "object.json").write_text(json.dumps({"mass_kg": mass_kg}))
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body name="0_mug"><freejoint/>'
        f'<geom type="sphere" size=".05" mass="{mass_kg}"/></body></worldbody></mujoco>'
    )
    command = [
        "play",
        str(scene),
        "--simulator",
        "falling",
        "--height",
        "32",
        "--width",
        "32",
        "--lift",
        "0.05",
    ]
    clip = str(tmp_path / "falling.mp4")
    assert main([*command, "--seconds", "0.2", "--json", "-o", clip]) == 0
    summary = json.loads(capsys.readouterr().out)
    # MuJoCo's sphere about the origin would meet the plane 5 cm higher, at once.
    assert (summary["file"], summary["collisions"]) == (clip, 1)
    assert summary["peak_pa"] > 0
    assert main([*command, "--no-browser"]) == 2
    assert "'falling' plays videos alone. Give --output too." in capsys.readouterr().err


@pytest.mark.usefixtures("lab")
def test_an_export_says_what_wrote_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "modal"
    assert main(["export", str(MUG), "--format", "modal-points", "-o", str(output)]) == 0
    assert "by lab-objects 1.0; CC0-1.0" in capsys.readouterr().out
    said = json.loads((output / "export.json").read_text())
    assert (said["format"], said["points"], said["modes"]) == ("modal-points", 64, 44)
    assert said["plugin"] == {"distribution": "lab-objects", "version": "1.0"}
    with np.load(output / "modal_points.npz") as stored:
        assert stored["gains"].shape == (64, 3, 44)
    assert (output / "ATTRIBUTION.txt").is_file()


BROKEN = "import no_such_library\n"


def test_a_broken_package_is_named_where_it_is_used_and_nowhere_else(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    groups = {group: {"broken": "lab_broken:part"} for group in (SOURCE_GROUP, SENSORS, SIMULATORS, EXPORTS)}
    install("lab-broken", groups, {"lab_broken.py": BROKEN})
    uses = (
        lambda: source_named("broken"),
        lambda: read_sensor("broken"),
        lambda: open_simulation("broken", tmp_path, {}),
    )
    for use in uses:
        with pytest.raises(InputError) as raised:
            use()
        assert raised.value.where == "plugin 'broken' of lab-broken 1.0"
        assert "ModuleNotFoundError: No module named 'no_such_library'" in raised.value.finding
        assert raised.value.remedy == "Mend it, or: pip uninstall lab-broken"
    assert main(["export", str(MUG), "--format", "broken", "-o", str(tmp_path / "none")]) == 1
    assert "plugin 'broken' of lab-broken 1.0: cannot be imported" in capsys.readouterr().err
    assert source_named("ycb").id == "ycb"
    assert Resolutions(["google_64k"]).source_object("ycb:a").resolution == "google_64k"
    assert read_sensor("digit").name == "DIGIT"
    names = "digit, digit-tacto, gelsight, gelsight-fots, gelsight-mini"
    with pytest.raises(InputError, match=f"Known: {names}, broken"):
        read_sensor("dgit")
    with pytest.raises(InputError, match="Known: mujoco, broken"):
        open_simulation("none", tmp_path, {})
    assert main(["export", str(MUG), "--format", "brken", "-o", str(tmp_path / "none")]) == 2
    assert '"all", "broken"' in capsys.readouterr().err


def test_two_parts_of_one_name_are_refused(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = {
        SOURCE_GROUP: {"ycb": "lab_one:A"},
        SENSORS: {"digit": "lab_one:A"},
        EXPORTS: {"mjcf": "lab_one:A"},
    }
    install("lab-one", {**own, SIMULATORS: {"twice": "lab_one:A"}}, {})
    install("lab-two", {SIMULATORS: {"twice": "lab_two:A"}}, {})
    for use in (lambda: source_named("ycb"), lambda: read_sensor("digit")):
        with pytest.raises(InputError, match=r"lab-one 1\.0 and of ObjectFolder Factory itself"):
            use()
    with pytest.raises(InputError, match=r"lab-two 1\.0 and of lab-one 1\.0\. Uninstall one: pip"):
        open_simulation("twice", tmp_path, {})
    assert main(["export", str(MUG), "--format", "mjcf", "-o", str(tmp_path / "none")]) == 1
    assert "ObjectFolder Factory itself" in capsys.readouterr().err
    assert source_named("gso").id == "gso"


WRONG = """
from pipeline.intake.sources.source import Source
number = 3
class unfinished(Source):
    id = "unfinished"
def call(*given):
    return 3
"""


@pytest.mark.parametrize(
    ("use", "finding"),
    [
        (lambda path: read_sensor("number"), "is of type int, and no Sensor of objectfolder"),
        (lambda path: source_named("number"), "makes no source"),
        (lambda path: source_named("unfinished"), "makes no source .*abstract"),
        (lambda path: source_named("call"), "lacks id, title"),
        (
            lambda path: open_simulation("call", path, {}),
            "makes an object of type int without mass_at_kg, .*pose",
        ),
    ],
)
def test_a_part_of_another_kind_is_refused(
    use: Callable[[Path], object], finding: str, install: Install, tmp_path: Path
) -> None:
    parts = {name: f"lab_wrong:{name}" for name in ("number", "call", "unfinished")}
    install("lab-wrong", dict.fromkeys((SOURCE_GROUP, SENSORS, SIMULATORS), parts), {"lab_wrong.py": WRONG})
    with pytest.raises(InputError, match=rf"of lab-wrong 1\.0: {finding}"):
        use(tmp_path)


def test_an_export_that_says_nothing_leaves_nothing(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install("lab-wrong", {EXPORTS: {"call": "lab_wrong:call"}}, {"lab_wrong.py": WRONG})
    output = tmp_path / "none"
    assert main(["export", str(MUG), "--format", "call", "-o", str(output)]) == 1
    assert (
        "plugin 'call' of lab-wrong 1.0: returns a value of type int. It must return a dict"
        in capsys.readouterr().err
    )
    assert not output.exists()
