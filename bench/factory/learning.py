"""The learning tasks on a large data set: their headline figures beside the published ones.

    python -m bench.factory.learning FOLDER

FOLDER has the results of ``python -m learning TASK --results FOLDER``. Tables of who is confused with whom
are left out: a hundred objects have tens of thousands of entries.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.record import arguments, conclude, save, subplots
from learning.page import PUBLISHED_RECOGNITION, settings_path

COMPARED = (
    "Tasks of learning/ on the Object Files of one data set, beside published recognition; objects, samples "
    "and networks differ"
)


def main() -> None:
    record("learning", "recognition", COMPARED, draw)


def record(name: str, needed: str, compared: str, draw: Callable[[dict[str, Any]], None]) -> None:
    """Record the results in the folder that the command line names, one of which is needed."""
    parser = arguments("figures of the learning tasks")
    parser.add_argument("folder", type=Path, help=f"with {needed}.json and others")
    folder = parser.parse_args().folder
    results = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")}
    if needed not in results:
        parser.error(f"{folder} has no {needed}.json: `python -m learning {needed} --results {folder}`")
    made_with = json.loads(settings_path(folder / f"{needed}.json").read_text(encoding="utf-8"))
    settings, objects = made_with["settings"], made_with["objects"]
    settings["data"].pop("root")
    figures = {task: trimmed(task_figures) for task, task_figures in results.items()}
    conclude(name, {"objects": objects, **figures}, settings, compared, draw)


def trimmed(figures: Any) -> Any:
    """Return figures without tables of confusion."""
    if not isinstance(figures, dict):
        return figures
    return {key: trimmed(value) for key, value in figures.items() if key != "confusion"}


def draw(figures: dict[str, Any]) -> None:
    recognition = figures["recognition"]
    picture, axes = subplots(figsize=(7, 4))
    names = list(PUBLISHED_RECOGNITION)
    rows = {"published": list(PUBLISHED_RECOGNITION.values())}
    for protocol in ("sample", "region"):
        if protocol in recognition:
            rows[f"split by {protocol}"] = [recognition[protocol][name]["accuracy_percent"] for name in names]
    for index, (label, values) in enumerate(rows.items()):
        axes.bar([place + 0.27 * index for place in range(len(names))], values, 0.25, label=label)
    axes.set_xticks([place + 0.27 for place in range(len(names))], names)
    axes.set(ylabel="named rightly, %", title=f"Recognition among {len(figures['objects'])} objects")
    axes.legend(loc="lower right")
    save(picture, "learning")


if __name__ == "__main__":
    main()
