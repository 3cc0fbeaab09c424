"""Notebooks with what their cells put out: text, figures and the value of the last line.

    python docs/notebook_outputs.py docs/notebooks/NAME.ipynb ... [-o FOLDER]

Each is run in a new process and an empty folder, and written again, to FOLDER or where it was. Figures are
small JPEGs, and pictures in HTML are WebPs. Sounds are left out: who runs the cell hears them.
"""

import argparse
import ast
import base64
import contextlib
import io
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

DPI, QUALITY = 60, 75
SOUND = re.compile(r"<audio[^>]*>(?:.*?</audio>)?", re.DOTALL)
PICTURE = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=]+)")


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """Return a notebook with new outputs; its cells run in this process and folder, in order."""
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(cells, 1):
        tree = ast.parse("".join(cell["source"]), cell["id"])
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        value = None
        with contextlib.redirect_stdout(io.StringIO()) as text:
            exec(compile(tree, cell["id"], "exec"), names)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), cell["id"], "eval"), names)
        cell["execution_count"] = count
        cell["outputs"] = [*_text(text.getvalue()), *_figures(), *_value(value, count)]
    return notebook


def _text(text: str) -> list[dict[str, Any]]:
    lines = text.splitlines(keepends=True)
    return [{"name": "stdout", "output_type": "stream", "text": lines}] if lines else []


def _figures() -> list[dict[str, Any]]:
    if "matplotlib.pyplot" not in sys.modules:
        return []
    from matplotlib import pyplot

    outputs = []
    for number in pyplot.get_fignums():
        stored = io.BytesIO()
        settings = {"format": "jpeg", "dpi": DPI, "bbox_inches": "tight", "pil_kwargs": {"quality": QUALITY}}
        pyplot.figure(number).savefig(stored, **settings)
        data = {"image/jpeg": base64.b64encode(stored.getvalue()).decode(), "text/plain": ["<Figure>"]}
        outputs.append({"data": data, "metadata": {}, "output_type": "display_data"})
    pyplot.close("all")
    return outputs


def _value(value: object, count: int) -> list[dict[str, Any]]:
    if value is None:
        return []
    data = {"text/plain": repr(value).splitlines(keepends=True)}
    if hasattr(value, "_repr_html_"):
        html = SOUND.sub("<em>Run the cell to hear it.</em>", value._repr_html_())
        data["text/html"] = PICTURE.sub(_smaller, html).splitlines(keepends=True)
    return [{"data": data, "execution_count": count, "metadata": {}, "output_type": "execute_result"}]


def _smaller(picture: re.Match[str]) -> str:
    from PIL import Image

    stored = io.BytesIO()
    Image.open(io.BytesIO(base64.b64decode(picture[1]))).convert("RGB").save(stored, "WEBP", quality=QUALITY)
    return f"data:image/webp;base64,{base64.b64encode(stored.getvalue()).decode()}"


def main() -> None:
    """Run notebooks, each by this command in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("notebooks", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, help="folder (default: where they are)")
    parser.add_argument("--here", action="store_true", help="in this process and folder")
    arguments = parser.parse_args()
    for path in map(Path.absolute, arguments.notebooks):
        folder = (arguments.output or path.parent).absolute()
        if not arguments.here:
            with tempfile.TemporaryDirectory() as empty:
                command = [sys.executable, __file__, "--here", "-o", str(folder), str(path)]
                subprocess.run(command, cwd=empty, check=True)
            continue
        notebook = executed(json.loads(path.read_text(encoding="utf-8")))
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
        (folder / path.name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
