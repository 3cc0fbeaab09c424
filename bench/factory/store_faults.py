"""Runs against an S3 server whose answers fail at random, each finished by an undisturbed run.

Run as ``python -m bench.factory.store_faults``. A proxy between client and server gives 500s and 503s (the
work done or not), answers too late, connections reset, bodies cut short in both directions, and times at
which nothing answers; on some runs local writes find the disk full. Trials done are kept in a file, so a run
of this that was interrupted goes on; several may share the work (``--seeds``).
"""

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from bench.record import REPOSITORY, arguments, conclude, save, subplots

TRIALS = 100
OBJECTS = {"ball": "1.0", "cup": "2.0", "dish": "3.0"}
PACKAGE = "toys_of_trials"


def make_trials(seeds: list[int], done: Path) -> None:
    """Append the outcomes of the trials with these seeds to a file, a JSON object a line."""
    sys.path.insert(0, str(REPOSITORY / "tests" / "pipeline"))
    import s3_server
    from store_trials import Trials
    from toys import Toys

    left = [seed for seed in seeds if seed not in {outcome["seed"] for outcome in read_trials(done)}]
    if not left:
        return
    with tempfile.TemporaryDirectory() as folder, s3_server.serving() as server:
        root = Path(folder) / "data set"
        root.mkdir()
        sys.path.insert(0, str(root))
        toys = Toys(root, PACKAGE)
        for object_id, content in OBJECTS.items():
            toys.add(object_id, content)
        trials = Trials(toys, server, Path(folder) / "worker")
        for seed in left:
            outcome = trials.run(seed)
            # Ports and folders of one run are nobody's business.
            outcome["errors"] = [error.replace(folder, "...") for error in outcome["errors"]]
            with open(done, "a", encoding="utf-8") as file:
                file.write(json.dumps(outcome) + "\n")


def read_trials(done: Path) -> list[dict[str, Any]]:
    """Outcomes so far, by seed."""
    if not done.exists():
        return []
    outcomes = {}
    for line in done.read_text(encoding="utf-8").splitlines():
        outcome = json.loads(line)
        outcomes[outcome["seed"]] = outcome
    return [outcomes[seed] for seed in sorted(outcomes)]


def figures_of(outcomes: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts over all trials."""
    sys.path.insert(0, str(REPOSITORY / "tests" / "pipeline"))
    from store_trials import is_right

    faults: Counter[str] = Counter()
    for outcome in outcomes:
        faults.update(outcome["faults"])
    return {
        "trials": len(outcomes),
        "trials_right": sum(is_right(outcome) for outcome in outcomes),
        "by_mode": dict(Counter(outcome["mode"] for outcome in outcomes)),
        "finished_at_once": sum(not outcome["errors"] for outcome in outcomes),
        "finished_by_the_next_run": sum(
            bool(outcome["errors"]) and outcome["equal_after_second"] for outcome in outcomes
        ),
        "requests": sum(outcome["requests"] for outcome in outcomes),
        "faults": dict(sorted(faults.items())),
        "requests_refused_in_outages": sum(outcome["refused"] for outcome in outcomes),
        "writes_that_found_the_disk_full": sum(outcome["writes_without_space"] for outcome in outcomes),
        "products_with_wrong_bytes": sum(outcome["wrong_after_first"] for outcome in outcomes),
        "objects_torn_in_the_store": sum(outcome["torn_in_store"] for outcome in outcomes),
        "files_half_written": sum(outcome["left_half_written"] for outcome in outcomes),
        "task_executions": sum(outcome["executions"] for outcome in outcomes),
        "finished_work_done_again": sum(outcome["finished_again"] for outcome in outcomes),
        "wrong": [outcome for outcome in outcomes if not is_right(outcome)],
    }


def draw(figures: dict[str, Any]) -> None:
    """Faults by kind, and how the runs came out."""
    figure, axes = subplots(figsize=(8, 4))
    faults = {**figures["faults"], "refused in outages": figures["requests_refused_in_outages"]}
    faults["local disk full"] = figures["writes_that_found_the_disk_full"]
    bars = axes.barh(list(faults), list(faults.values()))
    axes.bar_label(bars, padding=3)
    axes.invert_yaxis()
    axes.set_xlabel(f"faults among {figures['requests']} requests")
    right, trials = figures["trials_right"], figures["trials"]
    axes.set_title(f"After the next run {right} of {trials} runs had all products of an undisturbed run")
    save(figure, "store_faults")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, TRIALS), metavar=("FIRST", "END"))
    parser.add_argument("--done", type=Path, default=Path(tempfile.gettempdir()) / "store_faults.jsonl")
    options = parser.parse_args()
    make_trials(list(range(*options.seeds)), options.done)
    outcomes = read_trials(options.done)
    if len(outcomes) < TRIALS:
        print(f"{len(outcomes)} of {TRIALS} trials done")
        return
    figures = figures_of(outcomes)
    print(json.dumps({key: value for key, value in figures.items() if key != "wrong"}, indent=1))
    settings = {
        "server": "moto",
        "objects": len(OBJECTS),
        "stages": 3,
        "products": 4 * len(OBJECTS),
        "fault_rate": "uniform in 0.05 to 0.4 by the trial's seed",
        "outage": "three trials in ten: 1 to 59 requests refused",
        "disk_full": "a third of the trials: 2 to 20 % of file commits",
    }
    conclude(
        "store_faults",
        figures,
        settings,
        "toy stages through an S3 store whose requests fail at random; right: all products byte-equal to an "
        "undisturbed run's, no object or file torn at any time, no finished task executed again, and an "
        "error that names the store or folder where a run did not finish",
        draw,
    )


if __name__ == "__main__":
    main()
