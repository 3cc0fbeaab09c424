"""``python -m learning TASK``: evaluate a task on the data set that is checked out, and write its figures."""

import argparse
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from learning import recognition, reconstruction, retrieval, stand_in, touch
from learning.dask_workers import joined
from learning.grasping import policy_comparison, stability
from learning.grasping.clips import FOLDER as CLIPS
from learning.grasping.clips import write_clips
from learning.meshes import Meshes
from learning.page import PAGE, settings_path, write_page
from learning.runs import Objects, code_digest
from learning.settings import Settings, read_settings
from learning.workers import Workers

FOLDER = Path("learning")
CODE = FOLDER / "code.json"
TASKS = {
    "recognition": recognition.evaluate,
    "retrieval": retrieval.evaluate,
    "reconstruction": reconstruction.evaluate,
    "stand_in": stand_in.evaluate,
    "grasping": stability.evaluate,
    "regrasping": policy_comparison.evaluate,
}


def main() -> None:
    """Run one task, or all of them and the page."""
    parser = argparse.ArgumentParser(prog="python -m learning", description=__doc__)
    parser.add_argument("task", choices=[*TASKS, "touch", "clips", "code", "page", "all"])
    parser.add_argument("--objects", type=int, metavar="N", help="take the first N objects alone")
    parser.add_argument("--meshes", type=Path, metavar="FOLDER", help="of NAME/model.obj, for touch alone")
    parser.add_argument("--cluster", metavar="PLACE", help="of cluster/, where it runs")
    parser.add_argument("--params", type=Path, default=FOLDER / "params.yaml")
    parser.add_argument("--results", type=Path, default=FOLDER / "results", metavar="FOLDER")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE")
    arguments = parser.parse_args()
    if arguments.task == "code":
        _write_code_digests()
        return
    # The networks are small: beside other work, threads that wait for one another take five times as long.
    torch.set_num_threads(1)
    settings = read_settings(arguments.params)
    if arguments.task == "touch":
        if arguments.meshes is None:
            parser.error("touch needs --meshes FOLDER")
        meshes = Meshes(arguments.meshes, settings.touch_at_vertices.sensor, arguments.objects)
        with joined(arguments.cluster) as workers:
            _evaluate("touch", touch.evaluate, meshes, settings, workers, arguments.results)
        return
    objects = Objects(settings, arguments.objects)
    if tasks := [task for task in TASKS if arguments.task in (task, "all")]:
        with joined(arguments.cluster) as workers:
            for task in tasks:
                _evaluate(task, TASKS[task], objects, settings, workers, arguments.results)
    if arguments.task == "clips":
        print(*write_clips(objects, settings, arguments.page.parent / CLIPS.name), sep="\n")
    if arguments.task in ("page", "all"):
        write_page(objects, settings, arguments.results, arguments.page)


def _evaluate(
    task: str,
    evaluate: Callable[[Any, Settings, Workers], Mapping[str, Any]],
    objects: Objects | Meshes,
    settings: Settings,
    workers: Workers,
    results: Path,
) -> None:
    began = time.perf_counter()
    figures = evaluate(objects, settings, workers)
    print(f"{task}: {len(objects)} objects, {time.perf_counter() - began:.0f} s", flush=True)
    path = results / f"{task}.json"
    _write(path, figures)
    _write(settings_path(path), {"objects": list(objects.ids), "settings": settings.model_dump()})


def _write_code_digests() -> None:
    """Write a digest of the code of each task and of the page, by which DVC tells a comment from a change."""
    tasks = {task: code_digest(evaluate.__module__) for task, evaluate in TASKS.items()}
    _write(CODE, tasks | {"page": code_digest(write_page.__module__)})


def _write(path: Path, content: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
