"""The notebooks of the documents: every cell is executed, in order, in a process and a folder of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
NOTEBOOKS = sorted((REPOSITORY / "docs" / "notebooks").glob("*.ipynb"))
# What each is about. One runs with every change; the others fail where they alone use what is gone.
ALWAYS = "look_strike_press"
PACKAGES = {
    "audit_of_two_versions": ("pipeline.audit", "pipeline.cli", "pipeline.run"),
    "drop_and_listen": ("objectfolder.audio", "objectfolder.live", "objectfolder.vision"),
    "material_from_a_recording": ("objectfolder.audio", "objectfolder.solid"),
    "sound_of_thickness": ("objectfolder.audio", "objectfolder.mesh", "objectfolder.solid"),
    "squeeze_and_feel": ("objectfolder.live", "objectfolder.touch"),
    "train_on_touch": ("objectfolder.dataset", "objectfolder.touch"),
    "your_own_mesh": ("pipeline.cli", "pipeline.run", "pipeline.tasks"),
}
# What a notebook does with a cell: it runs it, and shows the value that its last line has.
EXECUTE = """
import ast, json, sys
names = {"__name__": "__main__"}
for cell in json.load(open(sys.argv[1], encoding="utf-8"))["cells"]:
    if cell["cell_type"] != "code":
        continue
    tree = ast.parse("".join(cell["source"]), cell["id"])
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, cell["id"], "exec"), names)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), cell["id"], "eval"), names)
        if hasattr(value, "_repr_html_"):
            assert any(tag in value._repr_html_() for tag in ("<img", "<audio", "<table"))
"""


def marked(path: Path) -> object:
    """A notebook with the mark of when it runs; an error where it is new and has no packages."""
    mark = () if path.stem == ALWAYS else pytest.mark.release("docs.notebooks", *PACKAGES[path.stem])
    return pytest.param(path, marks=mark, id=path.stem)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_what_it_put_out(path: Path) -> None:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["cells"][0]["cell_type"]) == (4, "markdown")
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert code
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])


@pytest.mark.slow
@pytest.mark.parametrize("path", [marked(path) for path in NOTEBOOKS])
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    binaries = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": binaries, "MPLBACKEND": "agg", "DVC_SITE_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", EXECUTE, str(path)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )
    assert done.returncode == 0, done.stdout + done.stderr
