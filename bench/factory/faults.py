"""Kills at random moments: whether a data set comes out as if nothing had happened, and what is done twice.

Run as ``python -m bench faults``; it goes on where it was interrupted. Each round makes a data set
of toys (three stages, four products an object, tasks of 50 to 200 ms; ``tests/pipeline/ground.py``) on two
workers, kills workers, children of workers, the driver or the scheduler at random moments, and lets the run
go on, or runs again, until all is made. A child that runs again what
its kill cut short is spared: a second kill is a failure.
"""

import random
import re
import shutil
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.record import REPOSITORY, RESULTS, arguments, conclude, stored, versions

# What disturbs runs serves the tests as well; tests are no package, so their folder is put on the path first.
sys.path.insert(0, str(REPOSITORY / "tests" / "pipeline"))

from disturbed import ADDRESS, CHILD, DRIVER, LOCAL, SCHEDULER, TASK_S, WORKER, Round, undisturbed
from ground import Ground

CONTENTS = {f"object_{index:02}": f"{index}.5" for index in range(8)}


@dataclass(frozen=True)
class Kind:
    """Rounds of one kind: where the workers are, what is killed, how often in a round and in all."""

    place: str
    what: str
    kills: int
    in_all: int


PLAN = {
    "worker of a local cluster": Kind(LOCAL, WORKER, 5, 30),
    "worker that joined a scheduler": Kind(ADDRESS, WORKER, 5, 20),
    "child under a local cluster": Kind(LOCAL, CHILD, 5, 30),
    "child under a worker that joined": Kind(ADDRESS, CHILD, 5, 20),
    "driver with a local cluster": Kind(LOCAL, DRIVER, 5, 30),
    "driver of a scheduler elsewhere": Kind(ADDRESS, DRIVER, 5, 20),
    "scheduler": Kind(ADDRESS, SCHEDULER, 5, 50),
}
COMPARED = (
    "products of disturbed runs against those of an undisturbed one, byte by byte; executions of each task "
    "and object, written down by the tasks themselves, against when their products stood; every product "
    "read whenever it changed; processes and temporary files left"
)


def one_round(root: Path, expected: dict[str, str], kind: Kind, seed: int) -> dict[str, Any]:
    """Make a data set with kills; return what was done and what is wrong."""
    ground = Ground(root, CONTENTS)
    disturbed = Round(ground, kind.place, seed, TASK_S)
    disturbed.disturb([kind.what] * kind.kills)
    wrong = {key: value for key, value in disturbed.verdict(expected).items() if value}
    outcome = {"seed": seed, "commit": versions()["commit"], **disturbed.record(), "wrong": wrong}
    if wrong:
        output = (ground.root / "output.log").read_text()[-4000:].replace(f"{ground.root}/", "")
        outcome["output"] = re.sub(r"/[\w./-]*/(?=site-packages/|python3|pipeline/|driver)", "", output)
    return outcome


def kills_of(done: list[dict[str, Any]]) -> int:
    """Return how many kills rounds had; one that ends before its last moment comes has fewer."""
    return sum(len(record["kills"]) for record in done)


def summary(rounds: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return counts over all rounds of each kind."""
    counts = {}
    for kind, records in rounds.items():
        kills = [killed for record in records for killed in record["kills"]]
        counts[kind] = {
            "kills": len(kills),
            "that_cut_a_task_short": sum(bool(killed["running"]) for killed in kills),
            "tasks_cut_short": sum(len(killed["running"]) for killed in kills),
            "finished_when_killed": sum(killed["finished"] for killed in kills),
            "works": sum(record["works"] for record in records),
            "executions": sum(record["executions"] for record in records),
            "done_twice_without_need": sum(
                sum(record["wrong"].get("finished_work_redone", {}).values()) for record in records
            ),
            "products_read_while_running": sum(record["products_read_by_the_watcher"] for record in records),
            "rounds": len(records),
            "rounds_with_something_wrong": sum(bool(record["wrong"]) for record in records),
            "wrong": dict(Counter(name for record in records for name in record["wrong"])),
        }
    return counts


def record(rounds: dict[str, list[dict[str, Any]]]) -> None:
    settings = {"objects": len(CONTENTS), "stages": 3, "products": 4, "workers": 2, "task_ms": [50, 200]}
    conclude("faults", {"summary": summary(rounds), "rounds": rounds}, settings, COMPARED)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--only", nargs="+", default=list(PLAN), choices=list(PLAN), metavar="KIND")
    parser.add_argument("--fresh", action="store_true", help="forget the rounds recorded so far")
    parser.add_argument("--keep", action="store_true", help="keep the folders of rounds that went wrong")
    options = parser.parse_args()
    rounds_before = stored("faults")["figures"]["rounds"] if (RESULTS / "faults.json").exists() else {}
    rounds = {
        kind: [] if options.fresh and kind in options.only else rounds_before.get(kind, []) for kind in PLAN
    }
    base = Path(tempfile.mkdtemp(prefix="faults-"))
    expected = undisturbed(Ground(base / "undisturbed", CONTENTS))
    # In turn, so that an interrupted bench has some of every kind.
    while lacking := [name for name in options.only if kills_of(rounds[name]) < PLAN[name].in_all]:
        for name in lacking:
            done = rounds[name]
            folder = f"{list(PLAN).index(name)}_{len(done)}"
            seed = random.Random(f"{name} {len(done)}").randrange(1 << 31)
            done.append(one_round(base / folder, expected, PLAN[name], seed))
            print(folder, name, done[-1]["wrong"] or "as undisturbed", flush=True)
            record(rounds)
            if not (options.keep and done[-1]["wrong"]):
                shutil.rmtree(base / folder)
    if not options.keep:
        shutil.rmtree(base)
