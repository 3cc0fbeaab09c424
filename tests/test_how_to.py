"""How-to pages, run: commands that ask Object Files alone, and Python. `test_docs` checks the others' names.

Tests of their rooms run `ask.md`, `extending.md`, `data-sets.md`, `storage.md`, `audit.md`, `sources.md`,
`objects.md` and, but for the data set that it makes, `make.md`. `view`, `demo` and `play` without a video
serve a page, which the tests of pages open. `tests/learning` runs the tasks of `learning.md`, smaller, and
`tests/pipeline` the schedulers of `cluster.md`, on one machine. `batch.md` runs on a processor, not a GPU.
"""

import re
import shlex
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import objectfolder
from pipeline.cli import main
from tests import worlds_of_mujoco

DOCS = Path(__file__).parents[1] / "docs"
FILES = ("mug", "bell")
SERVED = ("view", "demo", "play")
LEAST_COMMANDS = {"commands.md": 12, "gallery.md": 2, "export.md": 1, "simulators.md": 1, "data-sets.md": 1}


def blocks(page: str, language: str) -> list[str]:
    """Blocks of code of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def commands(page: str) -> list[list[str]]:
    """Commands of a page that ask Object Files and what earlier commands wrote, without their first word."""
    lines = [line for block in blocks(page, "console") for line in block.splitlines()]
    every = [shlex.split(line.removeprefix("$ "), comments=True) for line in lines]
    queries = []
    for words in (words[1:] for words in every if words[:1] == ["objectfolder"]):
        serves = words[0] in SERVED and "-o" not in words
        subject = words[1] if len(words) > 1 else ""
        if not serves and subject.endswith((".safetensors", "object_files", "scene.xml")):
            queries.append(words)
    return queries


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with Object Files, where commands and Python run."""
    (tmp_path / "data" / "object_files").mkdir(parents=True)
    for name in FILES:
        for place in (tmp_path, tmp_path / "data" / "object_files"):
            objectfolder.example(name).save(place / f"{name}.safetensors")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.release("docs", "objectfolder", "pipeline.publish", "pipeline.cli")
@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize(
    ("page", "least"),
    [("commands.md", 12), ("gallery.md", 2), ("export.md", 1), ("simulators.md", 1), ("data-sets.md", 1)],
)
def test_commands_of_a_page_run(page: str, least: int, folder: Path) -> None:
    queries = commands(page)
    assert len(queries) >= least
    for words in queries:
        output = folder / words[words.index("-o") + 1] if "-o" in words else folder
        if output != folder:
            shutil.rmtree(output, ignore_errors=True)  # pages show two ways to write one folder
        assert main(words) == 0, words
        assert output.exists(), words


@pytest.mark.release("docs", "objectfolder.live", "pipeline.publish", "pipeline.cli")
@pytest.mark.usefixtures("quiet")
def test_the_page_of_live_scenes_runs(folder: Path) -> None:
    for words in commands("live.md"):
        assert main([*words, *(("--seconds", "0.2") if words[0] == "play" else ())]) == 0, words
    assert (folder / "clip.mp4").stat().st_size > 1000
    names: dict[str, Any] = {}
    for block in blocks("live.md", "python"):
        exec(compile(block, "live.md", "exec"), names)
    assert abs(names["sound"]).max() > 0
    assert len(names["live"].impacts) > 0
    assert names["seen"].rgb.shape == (256, 256, 3)
    assert names["felt"].normal_n == pytest.approx(4.0, rel=0.2)
    assert np.shape(names["image"]) == names["felt"].image.rgb.shape
    assert set(names["observation"]) == {"image", "audio", "touch", "proprioception"}


@pytest.mark.release("docs", "objectfolder.batch")
@pytest.mark.usefixtures("folder")
def test_the_page_of_batches_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("mujoco_warp", "warp"):
        monkeypatch.setitem(sys.modules, name, worlds_of_mujoco)
    mug = objectfolder.example("mug")
    points, normals = mug.sample_contacts(3, seed=0)
    poses = mug.press(points, depth_m=0.001).sensor_to_object
    cameras, lights = mug.sample_views(3, seed=0)
    names: dict[str, Any] = {
        "points": points,
        "sensor_to_object": poses,
        "impulses_n_s": -normals,
        "cameras": cameras,
        "lights": lights,
    }
    for block in blocks("batch.md", "python"):
        for shown, run in (('"cuda"', '"cpu"'), ("1024", "8"), ("512", "4"), ("128)", "16)")):
            block = block.replace(shown, run)
        exec(compile(block, "batch.md", "exec"), names)
    assert names["touches"].depth_m.max() > 0
    assert names["held"].force_n.numpy() == pytest.approx(2.0, rel=0.1)
    assert names["images"].rgb.shape == names["touches"].rgb.shape
    assert abs(names["sounds"]).max() > 0
    assert names["views"].shape == (3, 16, 16, 3)
    assert names["fingers"].tactile_rgb_image.shape[0] == 16
    assert names["fingers"].penetration_depth.min() > 0.0001
    assert names["fingers"].tactile_depth_image.amax((1, 2, 3)).min() > 0.0001
