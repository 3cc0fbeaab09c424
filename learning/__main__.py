"""``python -m learning TASK``: evaluate a task on the data set that is checked out, and write its figures."""

import argparse
import json
import time
from pathlib import Path

import torch

from learning import recognition, reconstruction, retrieval, stand_in
from learning.grasping import stability, touch_policy
from learning.grasping.clips import FOLDER as CLIPS
from learning.grasping.clips import write_clips
from learning.page import PAGE, write_page
from learning.runs import Objects
from learning.settings import Settings, read_settings
from learning.workers import Workers, joined

FOLDER = Path("learning")
TASKS = {
    "recognition": recognition.evaluate,
    "retrieval": retrieval.evaluate,
    "reconstruction": reconstruction.evaluate,
    "stand_in": stand_in.evaluate,
    "grasping": stability.evaluate,
    "regrasping": touch_policy.evaluate,
}


def main() -> None:
    """Run one task, or all of them and the page."""
    parser = argparse.ArgumentParser(prog="python -m learning", description=__doc__)
    parser.add_argument("task", choices=[*TASKS, "clips", "page", "all"])
    parser.add_argument("--objects", type=int, metavar="N", help="take the first N objects alone")
    parser.add_argument("--cluster", metavar="PLACE", help="of cluster/, where it runs")
    parser.add_argument("--params", type=Path, default=FOLDER / "params.yaml")
    parser.add_argument("--results", type=Path, default=FOLDER / "results", metavar="FOLDER")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE")
    arguments = parser.parse_args()
    # The networks are small: beside other work, threads that wait for one another take five times as long.
    torch.set_num_threads(1)
    settings = read_settings(arguments.params)
    objects = Objects(settings, arguments.objects)
    if tasks := [task for task in TASKS if arguments.task in (task, "all")]:
        with joined(arguments.cluster) as workers:
            for task in tasks:
                _evaluate(task, objects, settings, workers, arguments.results)
    if arguments.task == "clips":
        print(*write_clips(objects, settings, arguments.page.parent / CLIPS.name), sep="\n")
    if arguments.task in ("page", "all"):
        write_page(objects, settings, arguments.results, arguments.page)


def _evaluate(task: str, objects: Objects, settings: Settings, workers: Workers, results: Path) -> None:
    began = time.perf_counter()
    figures = TASKS[task](objects, settings, workers)
    print(f"{task}: {len(objects)} objects, {time.perf_counter() - began:.0f} s", flush=True)
    results.mkdir(parents=True, exist_ok=True)
    content = {"objects": list(objects.ids), "settings": settings.model_dump(), **figures}
    text = json.dumps(content, indent=1, sort_keys=True) + "\n"
    (results / f"{task}.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
