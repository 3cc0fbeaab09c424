"""The notebooks of the documents: every cell is executed, and puts out what is stored, where that is."""

import base64
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

REPOSITORY = Path(__file__).parents[1]
NOTEBOOKS = sorted((REPOSITORY / "docs" / "notebooks").glob("*.ipynb"))
# What each is about. One runs with every change; the others fail where they alone use what is gone.
ALWAYS = "look_strike_press"
PACKAGES = {
    "audit_of_two_versions": ("pipeline.audit", "pipeline.cli", "pipeline.run"),
    "drop_and_listen": ("objectfolder.audio", "objectfolder.live", "objectfolder.vision"),
    "material_from_a_recording": ("objectfolder.audio", "objectfolder.making"),
    "sound_of_thickness": ("objectfolder.audio", "objectfolder.making"),
    "squeeze_and_feel": ("objectfolder.live", "objectfolder.touch"),
    "train_on_touch": ("objectfolder.dataset", "objectfolder.touch"),
    "your_own_mesh": ("pipeline.cli", "pipeline.run", "pipeline.tasks"),
}
OUTPUTS = REPOSITORY / "docs" / "notebook_outputs.py"
LARGEST_BYTES = 200_000
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
# Of numbers and of levels of pictures: another processor rounds otherwise.
RELATIVE, LEVELS = 0.05, 8


def marked(path: Path) -> object:
    """A notebook with the mark of when it runs; an error where it is new and has no packages."""
    mark = () if path.stem == ALWAYS else pytest.mark.release("docs.notebooks", *PACKAGES[path.stem])
    return pytest.param(path, marks=mark, id=path.stem)


def outputs(path: Path) -> list[dict[str, Any]]:
    """All outputs of a notebook, in order."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    return [output for cell in cells for output in cell.get("outputs", [])]


def text_of(output: dict[str, Any]) -> str:
    return "".join(output.get("text") or output["data"]["text/plain"])


def last_place(number: str) -> float:
    """What the last digit of a printed number is worth."""
    mantissa, _, exponent = number.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def picture(output: dict[str, Any]) -> np.ndarray:
    """A figure, small and so without what fonts differ in; one pixel where there is none."""
    stored = output.get("data", {}).get("image/jpeg")
    if stored is None:
        return np.zeros(1)
    with Image.open(io.BytesIO(base64.b64decode(stored))) as image:
        return np.asarray(image.convert("RGB").resize((32, 32)), dtype=float)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_small_and_with_all_it_puts_out_or_nothing(path: Path) -> None:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["cells"][0]["cell_type"]) == (4, "markdown")
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] in ([None] * len(code), [*range(1, len(code) + 1)])
    assert bool(outputs(path)) == (code[0]["execution_count"] is not None)
    assert outputs(path) or path.stem != ALWAYS
    assert path.stat().st_size < LARGEST_BYTES
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])


@pytest.mark.slow
@pytest.mark.parametrize("path", [marked(path) for path in NOTEBOOKS])
def test_a_notebook_puts_out_what_is_stored(path: Path, tmp_path: Path) -> None:
    binaries = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": binaries, "MPLBACKEND": "agg", "DVC_SITE_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, str(OUTPUTS), "--here", "-o", str(tmp_path / "new"), str(path)]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=900
    )
    assert done.returncode == 0, done.stdout + done.stderr
    cells, stored_cells = outputs(tmp_path / "new" / path.name), outputs(path)
    assert cells
    for new, stored in zip(cells, stored_cells or cells, strict=True):
        assert new["output_type"] == stored["output_type"]
        texts = [text_of(output) for output in (new, stored)]
        words, numbers = zip(*((NUMBER.sub("#", text), NUMBER.findall(text)) for text in texts), strict=True)
        assert words[0] == words[1]
        for number, truth in zip(*numbers, strict=True):
            assert float(number) == pytest.approx(float(truth), rel=RELATIVE, abs=last_place(truth)), texts
        assert np.abs(picture(new) - picture(stored)).mean() < LEVELS
