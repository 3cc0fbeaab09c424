"""``python -m learning TASK``: evaluate a task on the data set that is checked out, and write its figures."""

import argparse
import json
import time
from pathlib import Path

import torch

from learning import recognition, reconstruction, retrieval, stand_in
from learning.grasping import stability, touch_policy
from learning.page import write_page
from learning.runs import Objects
from learning.settings import read_settings

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
    """Run one task."""
    parser = argparse.ArgumentParser(prog="python -m learning", description=__doc__)
    parser.add_argument("task", choices=[*TASKS, "page"])
    parser.add_argument("--objects", type=int, metavar="N", help="take the first N objects alone")
    parser.add_argument("--params", type=Path, default=FOLDER / "params.yaml")
    asked = parser.parse_args()
    # The networks are small: beside other work, threads that wait for one another take five times as long.
    torch.set_num_threads(1)
    settings = read_settings(asked.params)
    objects = Objects(settings, asked.objects)
    if asked.task == "page":
        write_page(objects, settings, FOLDER / "results")
        return
    began, spent = time.perf_counter(), time.process_time()
    figures = TASKS[asked.task](objects, settings)
    print(
        f"{asked.task}: {len(objects)} objects, {time.perf_counter() - began:.0f} s, "
        f"{time.process_time() - spent:.0f} CPU-s"
    )
    path = FOLDER / "results" / f"{asked.task}.json"
    path.parent.mkdir(exist_ok=True)
    content = {"objects": list(objects.ids), "settings": settings.model_dump(), **figures}
    path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
