"""The package as it is installed: from a wheel, in another folder, with nothing but what it depends on."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import urllib.request
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

import objectfolder
from objectfolder.errors import QueryError
from pipeline.cli import COMMANDS
from pipeline.publish.wheel import build_wheel
from tests.conftest import REPOSITORY

UV = (sys.executable, "-m", "uv")
FILES = ("pyproject.toml", "params.yaml", "README.md", "LICENSE")  # of the root that a wheel is made of
EXAMPLES = ("bell", "bowl", "mug", "plate")
LARGEST_BYTES = 1_700_000
VERSIONS = ("3.11", "3.13")  # the factory's own, and the latest, with other releases of the core's packages
LARGEST_CORE_BYTES = 450e6  # as packages bring it, without bytecode
# The first lines of the README in Python, then commands with their arguments: all in one process, which
# compiles a kernel once.
FIRST_LINES = """
{python}
assert picture.std() > 0
assert (images.shape, sounds.shape, touches.rgb.shape) == ((4, 256, 256, 3), (4, 88200), (4, 160, 120, 3))
assert touches.reachable.all()
assert touches.depth_m.max() > 0
assert objectfolder.__file__.startswith({folder!r}), objectfolder.__file__
from pipeline.cli import main
for words, status in {commands!r}:
    assert main(words) == status, words
"""
# Small answers of the commands that the README shows.
SMALL = {"render": ["--views", "2", "--resolution", "24"], "strike": ["--points", "2", "--duration", "0.1"]}


def _tracked(*paths: str) -> list[str]:
    """Return the files of folders that git tracks."""
    command = ["git", "ls-files", "-z", *paths]
    listed = subprocess.run(command, cwd=REPOSITORY, capture_output=True, check=True, text=True).stdout
    return listed.rstrip("\0").split("\0")


@pytest.fixture(scope="module")
def installed(make_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """A folder with the package as the wheel has it."""

    def install(folder: Path) -> None:
        source = folder / "source"
        for file in _tracked("objectfolder", "pipeline", "data", *FILES):
            (source / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(REPOSITORY / file, source / file, follow_symlinks=False)
        build = ["build", "--wheel", "--no-build-isolation", "--python", sys.executable, "-o", str(folder)]
        subprocess.run([*UV, *build, "-q", "--offline", str(source)], check=True)
        (wheel,) = folder.glob("*.whl")
        install = ["pip", "install", "--no-deps", "--target", str(folder / "site"), str(wheel)]
        subprocess.run([*UV, *install, "-q", "--offline"], check=True)
        shutil.rmtree(source)

    return make_once("installed", install) / "site"


def _interpreter(version: str) -> str:
    """Return an interpreter that runs, or the version, which uv then finds or fetches.

    The names that pyenv puts on the path run for the versions that a shell chose alone.
    """
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    for chosen in sorted(pyenv.glob(f"versions/{version}.*/bin/python")):
        return str(chosen)
    for name in (f"python{version}", "python3", "python"):
        for folder in os.get_exec_path():
            program = shutil.which(name, path=folder)
            if program is None:
                continue
            argv = [program, "-c", "import sys; print('%d.%d' % sys.version_info[:2], sys.executable)"]
            said = subprocess.run(argv, capture_output=True, text=True, check=False).stdout.split(maxsplit=1)
            if said[:1] == [version]:
                return said[1].strip()
    return version


def _blocks(kind: str) -> list[str]:
    """Return the README's blocks of code of a language."""
    return re.findall(
        rf"```{kind}\n(.*?)```", (REPOSITORY / "README.md").read_text(encoding="utf-8"), re.DOTALL
    )


@pytest.fixture(scope="module", params=VERSIONS)
def bare(request: pytest.FixtureRequest, installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment of a Python version with the wheel, and the packages that it depends on, alone."""
    folder = tmp_path_factory.mktemp("bare") / "environment"
    process = subprocess.run(
        [*UV, "venv", "-q", "--python", _interpreter(request.param), str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if process.returncode:
        pytest.skip(f"no Python {request.param}: {process.stderr.strip()}")
    (wheel,) = installed.parent.glob("*.whl")
    python = folder / "bin" / "python"
    subprocess.run([*UV, "pip", "install", "-q", "--python", str(python), str(wheel)], check=True)
    (site,) = (folder / "lib").glob("python*/site-packages")
    _share_kernels(site)
    return folder


def _share_kernels(site: Path) -> None:
    """Give an installed package the kernels of the checkout, whose files are the same: numba takes those.

    What another version of Python or of numba has compiled, it leaves.
    """
    for path in REPOSITORY.glob("objectfolder/**/*.nb[ci]"):
        copy = site / path.relative_to(REPOSITORY)
        copy.parent.mkdir(exist_ok=True)
        shutil.copy2(path, copy)
    for path in site.glob("objectfolder/**/*.py"):
        stat = (REPOSITORY / path.relative_to(site)).stat()
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


@pytest.mark.release("objectfolder", "pipeline.cli")
def test_the_readmes_first_lines_and_every_help_work_from_the_core(bare: Path, tmp_path: Path) -> None:
    """A command that needs more says so in a line; the core is without torch, and not large."""
    (site,) = (bare / "lib").glob("python*/site-packages")
    assert not (site / "torch").exists()
    size = sum(file.stat().st_size for file in site.rglob("*") if file.is_file() and file.suffix != ".pyc")
    assert size <= LARGEST_CORE_BYTES

    names = [function.__name__.replace("_", "-") for group in COMMANDS.values() for function in group]
    shown = [shlex.split(line, comments=True)[1:] for line in _blocks("console")[1].splitlines()]
    assert [words[0] for words in shown] == ["strike", "view"]
    mug = "mug.safetensors"
    shown.insert(1, ["render", mug, "-o", "images"])
    ran = [
        ["--version"],
        ["--help"],
        *([name, "--help"] for name in names),
        *([*words, *SMALL[words[0]]] for words in shown[:2]),
        ["info", mug, "--json"],
        ["modes", mug],
        ["sample", mug, "-o", "queries"],
        ["press", mug, "--points", "1", "-o", "touches"],
        ["export", mug, "--format", "gltf", "--vertex-colours", "-o", "glb"],
    ]
    refused = [["build", "a.obj", "--material", "steel", "-o", "a.safetensors"], ["status"], ["plan"]]
    program = FIRST_LINES.format(
        python="\n".join(_blocks("python")),
        folder=str(site),
        commands=[(words, 0) for words in ran] + [(words, 1) for words in refused],
    )
    done = subprocess.run(
        [str(bare / "bin" / "python"), "-P", "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    said = [line for line in done.stderr.splitlines() if " needs " in line]
    assert len(said) == len(refused), done.stderr
    for words, line in zip(refused, said, strict=True):
        assert line.startswith(f"objectfolder: {words[0]} needs ")
        assert line.endswith('pip install "objectfolder-factory[factory]"')

    view = [str(bare / "bin" / "objectfolder"), *shown[2], "--no-browser"]
    with subprocess.Popen(view, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = server.stdout.readline().split()[1]
        with urllib.request.urlopen(address) as page:
            assert b"<html" in page.read()
        server.terminate()
    assert server.returncode == 0


COMMANDS_OF_A_WHEEL = """
import objectfolder
from pipeline.cli import main
assert objectfolder.__file__.startswith({folder!r}), objectfolder.__file__
box = "box.stl", "--material"
assert main(["add", *box, "steel", "--licence", "CC0-1.0", "--table", "t.csv", "--no-preview"]) == 0
assert main(["check", "t.csv", "--no-meshes"]) == 0
assert main(["build", *box, "steel", "--size", "none", "-o", "box.safetensors"]) == 1
assert main(["modes", *box, "none"]) == 1
"""


@pytest.mark.slow
def test_a_wheel_has_every_file_and_its_commands_find_their_tables(installed: Path, tmp_path: Path) -> None:
    assert [file for file in _tracked("objectfolder", "pipeline") if not (installed / file).is_file()] == []
    trimesh.creation.box((0.1, 0.04, 0.01)).export(tmp_path / "box.stl")
    done = subprocess.run(
        [sys.executable, "-P", "-c", COMMANDS_OF_A_WHEEL.format(folder=str(installed))],
        cwd=tmp_path,
        env={"PYTHONPATH": str(installed), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Known sizes are default" in done.stderr
    assert re.search("unknown material 'none'. Known are .*steel", done.stderr)
    assert "from pipeline.cli import main" in (installed / "bin" / "objectfolder").read_text()


# Kernels of one sound, then how many of them a process compiled.
STRIKE = """
import objectfolder
mug = objectfolder.example("mug")
points, normals = mug.sample_contacts(1, seed=0, reachable=False)
sound = mug.strike(points, -normals, duration_s=0.1)
assert abs(sound).max() > 0
"""
MISSES = """
import sys
from numba.core.dispatcher import Dispatcher
kernels = {id(value): value for module in list(sys.modules.values()) for value in vars(module).values()
           if isinstance(value, Dispatcher) and module.__name__.startswith("objectfolder.")}
hits, misses = (sum(sum(getattr(kernel.stats, name).values()) for kernel in kernels.values())
                for name in ("cache_hits", "cache_misses"))
print(objectfolder.__file__, hits > 0, misses)
"""


@pytest.mark.slow
@pytest.mark.release("objectfolder.audio.synthesis", "pipeline.publish")
def test_a_wheel_with_kernels_compiles_none_elsewhere(tmp_path: Path) -> None:
    site = tmp_path / "site"
    shutil.unpack_archive(build_wheel(tmp_path, STRIKE), site, "zip")
    answer = subprocess.run(
        [sys.executable, "-c", STRIKE + MISSES],
        cwd=site,
        env={"PYTHONPATH": str(site), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.split() == [str(site / "objectfolder" / "__init__.py"), "True", "0"]
    assert "compiling kernels" not in answer.stderr


def test_examples_are_small_and_say_how_faithful_they_are() -> None:
    assert sorted(path.stem for path in objectfolder.EXAMPLES.iterdir()) == list(EXAMPLES)
    assert sum(path.stat().st_size for path in objectfolder.EXAMPLES.iterdir()) <= LARGEST_BYTES
    for name in EXAMPLES:
        said = objectfolder.example(name).description
        assert said["object"]["licence"] == "CC0-1.0"
        assert said["fidelity"]["vision"]["psnr_db"] > 45
        assert said["fidelity"]["audio"]["gain_error_db"] < -41
        touch = said["fidelity"]["touch"]  # the untouched gel's figure says how far pictures are apart
        assert touch["psnr_contact_db"] > touch["empty_psnr_contact_db"] + 38
        assert "/" not in str(said["provenance"]["inputs"])


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_answer_sight_sound_and_touch(name: str) -> None:
    file = objectfolder.example(name)
    points, normals = file.sample_contacts(2, seed=0, reachable=False)
    pictures = file.pictures(2, 48)
    assert pictures.shape == (2, 48, 48, 3)
    visible = (pictures < 250).any(axis=-1)
    assert visible.mean() > 0.2
    assert not visible[:, [0, -1]].any(), "all of it is in the image"
    assert not visible[:, :, [0, -1]].any(), "all of it is in the image"
    assert np.abs(file.strike(points, -normals, 0.2)).max() > 0
    assert file.press(points).depth_m.max() > 0


def test_reachable_contacts_are_those_a_sensor_fits_at(monkeypatch: pytest.MonkeyPatch) -> None:
    mug = objectfolder.example("mug")
    anywhere = mug.sample_contacts(60, seed=1, reachable=False)[0]
    points, normals = mug.sample_contacts(60, seed=1)
    fits = mug.press(anywhere).reachable
    assert 0.3 < fits.mean() < 0.9  # no sensor fits inside of the handle
    assert mug.press(points).reachable.all()
    assert np.array_equal(points[: fits.sum()], anywhere[fits])
    assert len(np.unique(points, axis=0)) == len(normals) == 60
    assert np.array_equal(points, mug.sample_contacts(60, seed=1)[0])
    assert len(mug.sample_contacts(0, seed=1)[0]) == 0
    monkeypatch.setattr("objectfolder.touch.touch_queries.MOST_ATTEMPTS", 1)
    with pytest.raises(QueryError, match="of 60 contacts drawn can be reached"):
        mug.sample_contacts(60, seed=1)


def test_version_and_authors_are_the_same_wherever_they_are_stated() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    cited = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    assert project["version"] == objectfolder.__version__ == cited["version"]
    assert project["authors"] == cited["authors"]
    assert project["license"] == cited["license"]


def test_another_example_is_refused() -> None:
    with pytest.raises(QueryError, match="'cup' is no example"):
        objectfolder.example("cup")


def test_the_image_for_users_is_pinned_small_and_not_roots() -> None:
    """What a linter of Dockerfiles asks for; where there is Docker, CI builds it."""
    text = (REPOSITORY / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    steps = [line.split(maxsplit=1) for line in text.splitlines() if line and not line.startswith("#")]
    assert steps[0][0] == "FROM"
    assert re.fullmatch(r"[\w./-]+:\d+\.\d+-slim-\w+", steps[0][1])
    assert {name for name, _ in steps} <= {"FROM", "COPY", "RUN", "USER", "WORKDIR", "ENTRYPOINT", "CMD"}
    assert [value for name, value in steps if name == "USER"] == ["user"]
    ignored = (REPOSITORY / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert ignored[0] == "*"
    for name, value in steps:
        if name == "COPY":
            for source in value.split()[:-1]:
                assert (REPOSITORY / source).exists(), source
                assert f"!{source}" in ignored, source
        if name in ("ENTRYPOINT", "CMD"):
            assert json.loads(value)
    installed = " ".join(value for name, value in steps if name == "RUN")
    assert "--no-cache-dir" in installed
    assert "apt-get" not in installed
