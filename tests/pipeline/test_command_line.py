"""The `objectfolder` command as a user types it."""

import errno
import io
import json
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import namedtuple
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from scipy.io import wavfile

import objectfolder
from objectfolder.audio.synthesis import ContactBody
from objectfolder.errors import FormatError, InputError
from objectfolder.making.materials import Material, find_material, read_materials
from objectfolder.making.modes.modes import simulate_modes
from objectfolder.products.store import Product, read_product
from objectfolder.surface.surface import Surface
from pipeline.cli import COMMANDS, application, command_name, main
from pipeline.cli.examples import EXAMPLES
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.project_files import MATERIALS
from pipeline.run.converge import Summary
from pipeline.run.doubtful_size import COMMAND, refuse_doubtful_size
from pipeline.run.single_build import Building, Built
from pipeline.run.stage_run import StageRun
from tests.conftest import REPOSITORY

BAR = {
    "mass_kg": 0.0749,
    "filled_mass_kg": 0.0749,
    "centre_of_mass_m": [0.0, 0.0, 0.0],
    "inertia_kg_m2": [[6.0e-6, 0, 0], [0, 9.0e-5, 0], [0, 0, 9.5e-5]],
}
STEEL = find_material(read_materials(MATERIALS), "steel", "materials.csv")


def _last_line(capsys: pytest.CaptureFixture[str]) -> str:
    error = capsys.readouterr().err.strip()
    assert "\n" not in error, error
    return error


def test_help_shows_every_command_and_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    for functions in COMMANDS.values():
        for function in functions:
            name = function.__name__.replace("_", "-")
            assert f" {name} " in text
    assert "objectfolder build mug.obj --material ceramic" in text
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.endswith(f"{objectfolder.__version__}\n")


@pytest.mark.slow
def test_each_command_has_examples_that_parse(capsys: pytest.CaptureFixture[str]) -> None:
    names = [command_name(function) for functions in COMMANDS.values() for function in functions]
    assert sorted(EXAMPLES) == sorted(names)
    app = application()
    for name, lines in EXAMPLES.items():
        assert main([name, "--help"]) == 0
        text = " ".join(capsys.readouterr().out.split())
        for line in lines:
            words = shlex.split(line)
            assert words[0] == name
            app.parse_args(words, exit_on_error=False, print_error=False)  # raises where it does not parse
            assert f"objectfolder {' '.join(words[:2])}" in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["biuld", "mug.obj"], 'Unknown command "biuld". Did you mean "build"?'),
        (["info", "mug.safetensors", "--jsn"], "Unknown option: --jsn. Did you mean --json?"),
        (
            ["build", "mug.obj", "-o", "mug.safetensors"],
            "build: --material is missing. Materials are ceramic, ",
        ),
        (["info"], "info: FILE is missing. See objectfolder info --help."),
        (["info", "a.safetensors", "b.safetensors"], "b.safetensors: more arguments than the command takes"),
        (
            ["build", "a.obj", "--material", "steel", "--length", "12cm"],
            "--length 12cm: not a number of metres",
        ),
        (["build", "a.obj", "--material", "steel", "--length", "12cm"], "Write 0.12."),
        (["build", "a.obj", "--material", "steel", "--mass", "300 g"], "Write 0.3."),
        (
            ["strike", "a.safetensors", "--duration", "half"],
            "not a number of seconds. See",
        ),
        (
            ["strike", "a.safetensors", "--listener", "0.1", "0.2"],
            "--listener takes 3 values, 2 given. See",
        ),
        (
            ["strike", "a.safetensors", "--listener", "0", "0", "10cm"],
            "--listener 10cm: not a number. Write 0.1.",
        ),
        (
            ["render", "a.safetensors", "--light", "0", "0", "1", "1", "1", "a"],
            "--light a: not a number. See",
        ),
        (["fetch"], "names no objects"),
        (["export", "--format", "nerf", "-o", "x"], "names no objects, and --format nerf takes one"),
        (["export", "a", "b", "--format", "gltf", "-o", "x"], "names 2 objects, and --format gltf takes one"),
        (["plan", "--workers", "0"], 'Invalid value "(0,)" for --workers. Must be >= 1.'),
        (["plan", "--count", "many"], '"many" into int'),
    ],
)
@pytest.mark.usefixtures("quiet")
def test_wrong_usage_is_named(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    error = _last_line(capsys)
    assert error.startswith("objectfolder: ")
    assert said in error


def test_a_stage_that_is_none_is_told_from_those_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stage", "viewz"]) == 2
    assert "viewz: no such stage. Did you mean views?" in _last_line(capsys)


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (InputError("mug", "too thick", "Cut it."), 1, "mug: too thick. Cut it."),
        (FileNotFoundError(errno.ENOENT, "", "x.npy"), 1, "x.npy: no such file. Check the path."),
        (PermissionError(errno.EACCES, "Permission denied", "x.npy"), 1, "x.npy: Permission denied."),
        (OSError(errno.ENOSPC, "No space left on device", "x.npy"), 1, "x.npy"),
        (OSError(errno.ENOSPC, "No space left on device"), 1, "full-folder"),
        (OSError(errno.EMFILE, "Too many open files", "x.npy"), 1, "ulimit -n 1024"),
        (FileNotFoundError(errno.ENOENT, "No usable temporary directory found"), 1, "Set TMPDIR"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_ends_a_command_decides_its_status_and_is_one_line(
    error: BaseException,
    status: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(path: Path) -> None:
        raise error

    monkeypatch.setattr(objectfolder, "load", fail)
    monkeypatch.setattr(tempfile, "gettempdir", lambda: "full-folder")
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage(9, 0, 9 if folder == "." else 0))
    assert main(["info", "x.safetensors"]) == status
    line = _last_line(capsys)
    assert line.startswith("objectfolder: ")
    assert said in line


def test_the_full_folder_is_the_outputs_where_an_error_names_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(objectfolder, "load", fail)
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage(9, 0, 9 * (folder != str(tmp_path))))
    for output in (["-o", str(tmp_path / "new" / "a")], [f"--output={tmp_path}"]):
        assert main(["render", "x.safetensors", "--turntable", *output]) == 1
        assert f"{tmp_path}: no space left" in _last_line(capsys)


def test_letters_that_a_terminal_has_not_are_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    output = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(output, encoding="ascii"))
    monkeypatch.setattr(objectfolder, "load", lambda path: print("Tasse \u676f") or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main(["info", "x.safetensors"])
    sys.stdout.flush()
    assert output.getvalue() == b"Tasse \\u676f\n"


@pytest.mark.parametrize(
    ("module", "words", "said"),
    [
        (
            "pipeline.run.single_build.build_object_file",
            ["build", "x.obj", "--material", "steel", "-o", "x.safetensors"],
            "interrupted. What is finished is kept; the same command does the rest.",
        ),
        (
            "pipeline.publish.queries.mesh_modes.solve_modes",
            ["modes", "x.obj", "--material", "steel"],
            "interrupted. Nothing is kept; the same command begins anew.",
        ),
        ("objectfolder.load", ["info", "x.safetensors"], "interrupted."),
    ],
)
def test_an_interrupted_command_says_what_is_kept(
    module: str,
    words: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, interrupt)
    assert main(words) == 130
    assert _last_line(capsys) == f"objectfolder: {said}"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_command_as_the_keyboard_does(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(number)
    monkeypatch.setattr(objectfolder, "load", lambda path: signal.raise_signal(number))
    assert main(["info", "x.safetensors"]) == 130
    assert signal.getsignal(number) == before


def test_the_command_starts_fast_and_imports_nothing_heavy() -> None:
    heavy = ["numpy", "torch", "dask", "distributed", "dvc", "pydantic", "scipy", "yaml"]
    code = f"import sys, pipeline.cli as c; c.main(['--help']); print(sys.modules.keys() & set({heavy}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY)
    assert done.stdout.splitlines()[-1] == "set()"


def test_info_tells_licence_size_and_fidelity(small_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(small_file)]) == 0
    text = capsys.readouterr().out
    assert "CC0-1.0" in text
    assert "264 triangles" in text
    assert "PSNR" in text
    assert main(["info", str(small_file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["object"]["id"] == "bar"


def test_info_tells_what_is_doubtful(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body = {
        "watertight": True, "components": 1, "mass_kg": 0.07, "filled_mass_kg": 0.07, "wall_median_m": None,
        "inertia_kg_m2": None,
        "warnings": ["its walls are doubtful"],
    }  # fmt: skip
    objectfolder.load(small_file).with_description(body=body).save(tmp_path / "bar.safetensors")
    assert main(["info", str(tmp_path / "bar.safetensors")]) == 0
    assert "warning      its walls are doubtful\n" in capsys.readouterr().out


def test_sampled_queries_feed_render_strike_and_press(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    queries, file = tmp_path / "queries", str(small_file)
    assert main(["sample", file, "--views", "2", "--contacts", "3", "--seed", "4", "-o", str(queries)]) == 0
    views = np.load(queries / "views.npy")
    assert views.shape == (2, 6)
    bar = objectfolder.load(small_file)
    np.testing.assert_allclose(np.linalg.norm(bar.frame.to_unit(views[:, :3]), axis=1), 2.5)
    np.testing.assert_allclose(np.linalg.norm(bar.frame.to_unit(views[:, 3:]), axis=1), 1.0)

    images = tmp_path / "images"
    assert (
        main(["render", file, "--views", str(queries / "views.npy"), "--resolution", "20", "-o", str(images)])
        == 0
    )
    cameras, lights = bar.sample_views(2, seed=4)
    for index, expected in enumerate(bar.render(cameras, lights, resolution=20)):
        image = np.asarray(Image.open(images / f"{index:04d}.png")).astype(int)
        # A pose is made again from its position, to rounding.
        assert np.abs(image - expected).max() <= 1

    sounds, contacts = tmp_path / "sounds", ["--points", str(queries / "points.npy")]
    strike = ["strike", file, *contacts, "--forces", str(queries / "forces.npy"), "--duration", "0.1"]
    strike.append("--overwrite")
    assert main([*strike, "--gain", "1", "-o", str(sounds)]) == 0
    assert "written times" not in capsys.readouterr().out
    points, normals = bar.sample_contacts(3, seed=4)
    struck = bar.strike(points, -normals, duration_s=0.1)
    for index, expected in enumerate(struck):
        rate, sound = wavfile.read(sounds / f"{index:04d}.wav")
        assert rate == 44100
        assert sound.dtype == np.float32
        np.testing.assert_array_equal(sound, expected)
    assert main([*strike, "-o", str(sounds)]) == 0
    gain = 10 ** (-3 / 20) / np.abs(struck).max()
    assert f" m/s, written times {gain:.3g} (--gain 1 keeps m/s)" in capsys.readouterr().out
    for index, expected in enumerate(struck):
        np.testing.assert_allclose(wavfile.read(sounds / f"{index:04d}.wav")[1], gain * expected, rtol=1e-6)

    ears = ["--listener", "0.5", "-0.1", "0.3", "--listener", "0.5", "0.1", "0.3"]
    assert (
        main([*strike, "--striker", "glass", "0.004", "0.002", *ears, "--gain", "2", "-o", str(sounds)]) == 1
    )
    assert "mass" in capsys.readouterr().err
    bar = bar.with_description(body=BAR)
    bar.save(tmp_path / "bar.safetensors")
    strike[1] = str(tmp_path / "bar.safetensors")
    assert (
        main([*strike, "--striker", "glass", "0.004", "0.002", *ears, "--gain", "2", "-o", str(sounds)]) == 0
    )
    assert " Pa, written times 2" in capsys.readouterr().out
    expected = bar.strike(
        points,
        -normals,
        duration_s=0.1,
        pulse=ContactBody(6.2e10, 0.2, 0.004, 0.002),
        listener=np.array([[0.5, -0.1, 0.3], [0.5, 0.1, 0.3]]),
    )
    for index in range(3):
        _, sound = wavfile.read(sounds / f"{index:04d}.wav")
        np.testing.assert_array_equal(sound, 2 * expected[index].T)

    touches = tmp_path / "touches"
    assert main(["press", file, *contacts, "--depth", "0.0015", "-o", str(touches)]) == 0
    assert len(json.loads((touches / "labels.json").read_text())["reachable"]) == 3
    expected_touches = bar.press(points, 0.0015)
    np.testing.assert_array_equal(np.load(touches / "depth.npy"), expected_touches.depth_m)
    np.testing.assert_array_equal(np.asarray(Image.open(touches / "0002.png")), expected_touches.rgb[2])


def test_a_number_draws_queries_as_python_does(small_file: Path, tmp_path: Path) -> None:
    bar, file = objectfolder.load(small_file).with_description(body=BAR), str(tmp_path / "bar.safetensors")
    bar.save(file)
    views, strikes, touches = tmp_path / "views", tmp_path / "strikes", tmp_path / "touches"
    assert main(["render", file, "--views", "2", "--seed", "4", "--resolution", "20", "-o", str(views)]) == 0
    for index, expected in enumerate(bar.render(*bar.sample_views(2, seed=4), resolution=20)):
        np.testing.assert_array_equal(np.asarray(Image.open(views / f"{index:04d}.png")), expected)
    few = ["--points", "2", "--seed", "5"]
    lying = ["--support", "lying"]
    assert main(["strike", file, *few, *lying, "--duration", "0.1", "--gain", "1", "-o", str(strikes)]) == 0
    points, normals = bar.sample_contacts(2, seed=5, reachable=False)
    struck = bar.strike(points, velocities_m_s=-normals, duration_s=0.1, pulse="wood", support="lying")
    for index, expected in enumerate(struck):
        np.testing.assert_array_equal(wavfile.read(strikes / f"{index:04d}.wav")[1], expected)
    assert main(["press", file, *few, "-o", str(touches)]) == 0
    fitting, _ = bar.sample_contacts(2, seed=5)
    np.testing.assert_array_equal(np.load(touches / "depth.npy"), bar.press(fitting).depth_m)
    np.save(tmp_path / "points.npy", points)
    read = [
        "strike",
        file,
        "--points",
        str(tmp_path / "points.npy"),
        *lying,
        "--duration",
        "0.1",
        "--gain",
        "1",
    ]
    assert main([*read, "-o", str(tmp_path / "again")]) == 0
    sound = wavfile.read(tmp_path / "again" / "0001.wav")[1]
    np.testing.assert_allclose(sound, expected, atol=1e-3 * np.abs(expected).max())


def test_a_turntable_is_of_lit_pictures(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    turn = ["render", str(small_file), "--turntable", "--overwrite", "-o", str(tmp_path / "turned")]
    assert main([*turn, "--views", "3", "--resolution", "128"]) == 0  # few pixels are mixed with white
    pictures = np.stack(
        [np.asarray(Image.open(tmp_path / "turned" / f"000{index}.png")) for index in range(3)]
    )
    brightest = pictures[(pictures < 250).any(axis=-1)].max(axis=-1) / 255
    assert 0.8 <= np.quantile(brightest, 0.95) <= 0.95
    assert np.mean(brightest < 0.05) < 0.1
    with Image.open(tmp_path / "turned" / "turntable.gif") as turning:
        assert turning.n_frames == 3
    assert main([*turn, "--light", "0", "0", "1", "1", "1", "1"]) == 2
    assert "--turntable has its own cameras and light" in capsys.readouterr().err.replace(":", "")


@pytest.mark.parametrize(
    ("words", "figures"),
    [
        ("sample FILE --anywhere --views 2 --contacts 3 -o out", {"views": 2, "contacts": 3}),
        ("render FILE --views 1 --resolution 16 -o out", {"images": 1, "height": 16, "passes": []}),
        ("render FILE --turntable --views 2 --resolution 16 -o out", {"images": 2, "turntable": True}),
        (
            "strike FILE --beater impulse --points 2 --duration 0.05 -o out",
            {"sounds": 2, "unit": "m/s", "duration_s": 0.05},
        ),
        ("press FILE --points 1 -o out", {"touches": 1, "reachable": 1}),
        (
            "build box.stl --material steel -o out.safetensors",
            {"file": "out.safetensors", "cpu_s": {"views": 1.5}, "looks": "1 plain colour", "warnings": []},
        ),
    ],
)
def test_figures_are_json_where_that_is_asked_for(
    words: str,
    figures: dict[str, object],
    small_file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def build(building: Building, output: Path, confirm: object) -> Built:
        shutil.copyfile(small_file, output)
        return Built({"views": 1.5}, "1 plain colour", ())

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pipeline.run.single_build.build_object_file", build)
    assert main([*words.replace("FILE", str(small_file)).split(), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert figures.items() <= answer.items()
    if words.startswith("build"):
        assert answer["fidelity"] == objectfolder.load(small_file).description["fidelity"]


def test_failures_are_json_where_that_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["failures", "--json", "--root", str(tmp_path)]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out) == []
    failure = {
        "object": "mug",
        "stage": "views",
        "error": "too dark",
        "remedy": "Add light.",
        "fingerprint": "",
    }
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "failures.json").write_text(json.dumps([failure]))
    assert main(command) == 1
    assert json.loads(capsys.readouterr().out) == [failure]


def test_what_a_run_did_is_json_where_that_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failure = FailedObject("bell", "views", "too dark", "Add light.", "")
    views = Summary("views", ("die",), (), ("mug",), (), (failure,))
    run = StageRun(stages=(views,), exit_code=1, notes=("products removed of objects: jug",))
    monkeypatch.setattr("pipeline.run.stage_run.make_products", lambda *_: run)
    assert main(["products", "--json"]) == 1
    [stage] = json.loads(capsys.readouterr().out)["stages"]
    assert (stage["kept"], stage["computed"], stage["failures"][0]["error"]) == (["die"], ["mug"], "too dark")
    assert main(["products"]) == 1
    assert capsys.readouterr().out == "products removed of objects: jug\n"


def test_each_command_that_prints_figures_prints_json_too() -> None:
    commands = {command_name(command): command for group in COMMANDS.values() for command in group}
    without = {name for name, command in commands.items() if "json" not in signature(command).parameters}
    # These print the paths that they wrote, or what they changed, or an address, or nothing.
    assert without == {"cards", "code", "demo", "inputs", "select", "starter", "view"}


def test_answers_of_two_runs_are_not_mixed(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "queries"
    sample = ["sample", str(small_file), "--anywhere", "-o", str(folder)]
    assert main(sample) == 0
    (folder / "0000.png").touch()
    assert main(sample) == 1
    assert "holds answers of another run. Name another folder" in capsys.readouterr().err
    assert main([*sample, "--overwrite"]) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["forces.npy", "points.npy", "views.npy"]
    (folder / "notes.txt").touch()
    assert main([*sample, "--overwrite"]) == 1
    assert "holds notes.txt, which no query wrote" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["build", "mug.obj", "--material", "ceramic"], "-o"),
        (["scene", "mug"], "-o"),
        (["play", "scene.xml"], "-o"),
        (["audit"], "--html"),
        (["add", "mug.obj", "--material", "ceramic", "--licence", "CC0-1.0"], "--preview"),
    ],
)
def test_a_file_is_replaced_only_where_that_is_asked_for(
    words: list[str],
    option: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "result").touch()
    command = [*words, option, str(tmp_path / "result")]
    assert main(command) == 1
    refusal = "result: is there already. Name another file, or give --overwrite."
    assert _last_line(capsys).endswith(refusal)
    assert main([*command, "--overwrite"]) == 1  # nothing else is there
    assert refusal not in capsys.readouterr().err
    assert main([*words, option, str(tmp_path)]) == 1
    assert "is a folder. Name a file." in _last_line(capsys)


@pytest.mark.parametrize(
    ("sides", "length_m", "words"),
    [
        (
            (2.0, 0.1, 0.02),
            None,
            "2 m long by the file, as if normalised. State --length in metres, or give --yes.",
        ),
        ((0.9, 0.9, 0.9), None, "box.stl: 5723 kg of steel. State --length in metres, or give --yes."),
        ((90, 90, 90), 0.3, "box.stl: 212 kg of steel. Correct --length or --material, or give --yes."),
        ((90, 1, 1), 1.5, None),
        (
            (0.008, 0.001, 0.001),
            None,
            "0.008 m long by the file. State --length in metres, or give --yes.",
        ),
    ],
)
def test_a_doubtful_size_is_refused(
    sides: tuple[float, float, float], length_m: float | None, words: str | None, tmp_path: Path
) -> None:
    trimesh.creation.box(sides).export(tmp_path / "box.stl")
    building = Building(mesh=tmp_path / "box.stl", material="steel", length_m=length_m)
    if words is None:
        refuse_doubtful_size(building, STEEL, COMMAND)
        return
    with pytest.raises(InputError) as error:
        refuse_doubtful_size(building, STEEL, COMMAND)
    assert str(error.value).endswith(words)


@pytest.mark.parametrize(
    ("stray", "mass_kg", "words"),
    [
        ("v 9 9 9", None, None),
        ("v 9 9 9", 0.3, None),
        ("v 9 9 9", 12.0, "12 kg stated, where a solid of steel has 0.37"),
        ("v 9 9 9\nv 9 9 8.9999\nv 9 8.9999 9\nf 9 10 11", None, "without them it is 0.12 m"),
    ],
)
def test_what_no_face_uses_has_no_size_and_specks_are_refused(
    stray: str, mass_kg: float | None, words: str | None, tmp_path: Path
) -> None:
    box = trimesh.creation.box((0.12, 0.02, 0.02))
    (tmp_path / "box.obj").write_text(f"{box.export(file_type='obj')}\n{stray}\n")
    building = Building(mesh=tmp_path / "box.obj", material="steel", mass_kg=mass_kg)
    if words is None:
        refuse_doubtful_size(building, STEEL, COMMAND)
        return
    with pytest.raises(InputError, match=words):
        refuse_doubtful_size(building, STEEL, COMMAND)


def test_a_folder_is_no_object_file(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(tmp_path)]) == 1
    assert "a folder, not an Object File. Name an Object File" in _last_line(capsys)
    with pytest.raises(FormatError, match=r"a folder, not an Object File\. Open .*bar\.safetensors"):
        objectfolder.load(small_file.parent)


# rich, which prints the help, ends the process by itself.
@pytest.mark.parametrize(
    ("words", "status"),
    [(["info", str(objectfolder.EXAMPLES / "mug.safetensors")], 141), (["--help"], 1)],
    ids=["a table", "help"],
)
def test_output_that_nobody_reads_ends_a_command_silently(words: list[str], status: int) -> None:
    command = [sys.executable, "-m", "pipeline.cli", *words]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=REPOSITORY, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stderr is not None
        child.stdout.close()
        error = child.stderr.read()
        assert child.wait() == status
    assert error == ""


def test_modes_of_an_object_file_are_those_it_stores(
    small_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    modes = objectfolder.load(small_file).modes
    stored = modes.frequencies_hz
    assert main(["modes", str(small_file), "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed["frequencies_hz"] == stored.tolist()
    np.testing.assert_allclose(listed["loss_factors"], modes.loss_factors)
    assert main(["modes", str(small_file)]) == 0
    table = capsys.readouterr().out
    assert f"{len(stored)} modes below 20000 Hz in glass" in table
    assert "damping: Rayleigh's law (alpha_per_s 1, beta_s 1e-07)" in table
    assert main(["modes", "box.obj"]) == 2
    assert "--material: not given. Materials are ceramic, " in _last_line(capsys)


def test_errors_are_one_line_with_a_remedy(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(tmp_path / "none.safetensors")]) == 1
    assert "none.safetensors: no such file. Check the path." in _last_line(capsys)
    np.save(tmp_path / "flat.npy", np.zeros(6))
    assert (
        main(["render", str(small_file), "--views", str(tmp_path / "flat.npy"), "-o", str(tmp_path / "x")])
        == 1
    )
    assert "Give an (n, 6) array" in _last_line(capsys)
    np.save(tmp_path / "pickle.npy", np.array([{}], dtype=object), allow_pickle=True)
    assert (
        main(["press", str(small_file), "--points", str(tmp_path / "pickle.npy"), "-o", str(tmp_path / "x")])
        == 1
    )
    assert "pickle.npy" in _last_line(capsys)
    np.save(tmp_path / "far.npy", np.ones((1, 3)))
    assert (
        main(["press", str(small_file), "--points", str(tmp_path / "far.npy"), "-o", str(tmp_path / "x")])
        == 1
    )
    assert "mm off the surface" in _last_line(capsys)


def test_a_wrong_material_or_mesh_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh, output = tmp_path / "box.obj", ["-o", str(tmp_path / "box.safetensors")]
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)
    assert main(["build", str(mesh), "--material", "cheese", *output]) == 1
    assert "ceramic" in _last_line(capsys)
    assert main(["build", str(tmp_path / "no.obj"), "--material", "glass", *output]) == 1
    assert "no.obj" in _last_line(capsys)
    assert main(["build", str(mesh), "--material", "glass", "--length", "-1", *output]) == 2
    assert "--length" in _last_line(capsys)
    assert not (tmp_path / "box.safetensors").exists()


def test_modes_of_a_mesh_are_those_solved_to_what_is_asked_for(
    small_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    solved, parameters = read_product(small_file.with_name("modes.zarr.zip")), signature(simulate_modes)
    call: dict[str, Any] = {}

    def simulate(surface: Surface, material: Material, **options: object) -> Product:
        parameters.bind(surface, material, **options)
        call.update(options, extents_m=np.ptp(surface.bounds, axis=0).tolist(), material=material.name)
        reached = {"accuracy_reached": True, "warnings": []}
        missed = {"accuracy_reached": False, "warnings": ["0.001 cents wanted"]}
        return Product(
            solved.arrays, solved.attributes | (reached if options["accuracy_cents"] == 30 else missed)
        )

    monkeypatch.setattr("objectfolder.making.modes.modes.simulate_modes", simulate)
    mesh = tmp_path / "beam.stl"
    trimesh.creation.box((0.1, 0.01, 0.005)).export(mesh)
    command = ["modes", str(mesh), "--material", "ceramic", "--max-frequency", "6000", "--length", "0.2"]
    assert main([*command, "--accuracy-cents", "30", "--json"]) == 0
    assert (call["material"], call["max_frequency_hz"], call["name"]) == ("ceramic", 6000, "beam.stl")
    assert call["extents_m"] == pytest.approx([0.2, 0.02, 0.01], rel=1e-3)
    result = json.loads(capsys.readouterr().out)
    assert {"dampings_per_s", "count_certificate", "error_estimate_cents", "seconds"} <= set(result)
    assert result["frequencies_hz"] == solved["frequencies_hz"].tolist()
    assert result["accuracy_reached"]
    assert main([*command, "--accuracy-cents", "0.001"]) == 1
    assert "0.001 cents wanted" in capsys.readouterr().out


@pytest.mark.slow
def test_build_makes_a_verified_file_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = yaml.safe_load((REPOSITORY / "params.yaml").read_text())
    sizes = content["sizes"]["default"]
    sizes["vision"].update(
        resolution=24, training_views=4, training_samples=4, held_out_views=2, held_out_samples=16
    )
    sizes["audio"].update(
        max_frequency_hz=4000.0,
        accuracy_cents=100.0,
        training_points=120,
        held_out_points=20,
        radiation="sphere",
    )
    sizes["touch"].update(touches=2, held_out_touches=4)
    sizes["encode"]["visionnet"].update(steps=20)
    sizes["encode"]["audionet"].update(goal_db=-15.0)
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(content))
    mesh, output = tmp_path / "box.ply", tmp_path / "box.safetensors"
    trimesh.creation.box((0.1, 0.04, 0.01)).export(mesh)
    build = ["build", str(mesh), "--material", "steel", "--length", "0.2", "--keep", str(tmp_path / "truth")]
    build += ["--params", str(tmp_path / "params.yaml"), "-o", str(output)]
    assert main(build) == 0
    text = capsys.readouterr().out
    assert "vision" in text
    assert "CPU-s" in text
    box = objectfolder.load(output)
    assert box.vision.computed
    assert np.ptp(box.surface.bounds, axis=0).max() == pytest.approx(0.2, rel=1e-3)
    assert box.description["fidelity"]["audio"]["audible"]
    first = output.read_bytes()
    views = (tmp_path / "truth" / "data" / "views" / "box.zarr.zip").stat().st_mtime_ns
    assert main([*build, "--overwrite"]) == 0
    assert output.read_bytes() == first
    assert (tmp_path / "truth" / "data" / "views" / "box.zarr.zip").stat().st_mtime_ns == views


@pytest.mark.parametrize("command", ["status", "products", "plan", "audit", "verify"])
def test_outside_a_data_set_a_command_says_where_to_go(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--root", str(tmp_path)]) == 1
    assert "o to the root of" in _last_line(capsys)


def test_the_last_report_is_summed_up_in_a_line_a_sense(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", "--summary", "--root", str(tmp_path)]) == 1
    assert "metrics.json: no such file" in _last_line(capsys)
    (tmp_path / "reports").mkdir()
    metrics = {
        "vision": {
            "psnr_db": {"mean": 52.83, "worst": 47.1},
            "psnr_foreground_db": {"mean": 45.25, "worst": 40.12},
        },
        "audio": {"silent_objects": 1, "gain_error_db": {"mean": None, "worst": None}},
        "touch": {},
    }
    (tmp_path / "reports" / "metrics.json").write_text(json.dumps(metrics))
    (tmp_path / "data" / "object_files").mkdir(parents=True)
    (tmp_path / "data" / "object_files" / "mug.safetensors").touch()
    assert main(["report", "--summary", "--root", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    figures = "45.2 dB in the mean, 40.1 at worst (of the full image 52.8 in the mean)"
    assert lines[0] == f"Sight:        PSNR of the foreground, held-out views, {figures}"
    assert lines[1] == "Sound:        gain error at held-out points none measured"
    assert lines[2].startswith("Touch:")
    assert lines[-1] == "Look:         objectfolder view data/object_files/mug.safetensors"
    assert main(["report", "--summary", "--json", "--root", str(tmp_path)]) == 0
    figures_of = json.loads(capsys.readouterr().out)
    assert figures_of["headlines"][0] == {
        "measure": "vision.psnr_foreground_db",
        "mean": 45.25,
        "worst": 40.12,
    }
    assert figures_of["full_image_db"] == 52.83
    assert main(["report", "--json", "--root", str(tmp_path)]) == 2
