"""Measured costs of tasks: ``.objectfolder/costs.csv``, beside the data set and outside its versions.

The table has a row for every task that ran here and for every query that was timed (products hold no
timings). Once it has grown large, it keeps the last rows of each object and stage.
"""

import contextlib
import csv
import io
import os
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock

from objectfolder.errors import InputError, SimulationError
from objectfolder.products.atomic import write_whole
from objectfolder.products.regular_file import open_regular, require_regular
from pipeline.dataset.partition_folders import data_sets
from pipeline.dataset.task import Outcome

COLUMNS = (
    "object", "stage", "fingerprint", "cpu_seconds", "wall_seconds", "peak_memory_mb", "key",
    "seconds_per_query",
)  # fmt: skip
QUERY = "query"  # stands as the stage of a timed query
REMEDY = "Delete it; runs note costs anew."
LARGEST = 1e12  # of any number in the table; what is larger is no measurement
KEPT_ROWS = 5  # of an object, stage and query
COMPACT_ABOVE_BYTES = 4 << 20


@dataclass(frozen=True)
class Cost:
    """A row of a table of costs; a number is None where it was not measured.

    Attributes
    ----------
    object_id, stage, fingerprint : whose task it was, and what it made; the stage is `QUERY` for a timed
        query
    cpu_s, wall_s : seconds of the task; CPU seconds include its child processes
    peak_memory_mb : peak of its processes in MB
    key, seconds_per_query : setting of the fidelity product that a query was timed at, and its seconds
    """

    object_id: str
    stage: str
    fingerprint: str = ""
    cpu_s: float | None = None
    wall_s: float | None = None
    peak_memory_mb: float | None = None
    key: str = ""
    seconds_per_query: float | None = None


def costs_path(root: Path) -> Path:
    """Return where the costs of a data set are kept."""
    return root / ".objectfolder" / "costs.csv"


def read_costs(path: Path) -> list[Cost]:
    """Return the rows of a table of costs, none where there is no file.

    A number that a kill cut short, or that cannot be, counts as not measured.

    Raises
    ------
    InputError
        The file is no text, or a table without the columns object and stage.
    """
    try:
        require_regular(path)
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = {"object", "stage"} - set(reader.fieldnames or ())
            if missing and reader.fieldnames:
                raise InputError(str(path), f"no column {' and '.join(sorted(missing))}", REMEDY)
            return [_cost(row) for row in reader]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except (csv.Error, UnicodeDecodeError, OSError) as error:
        raise InputError(str(path), f"not a table ({error})", REMEDY) from error


def known_costs(root: Path) -> list[Cost]:
    """Return the costs of a data set; none where the table cannot be read, for that must not stop a run."""
    try:
        return read_costs(costs_path(root))
    except InputError:
        return []


def costs_by_fingerprint(root: Path) -> dict[str, Cost]:
    """Return the last costs of the tasks that ran in a checkout, by the fingerprint of their products."""
    return {
        cost.fingerprint: cost
        for folder in data_sets(root)
        for cost in known_costs(folder)
        if cost.stage != QUERY and None not in (cost.wall_s, cost.cpu_s, cost.peak_memory_mb)
    }


def add_costs(root: Path, stage: str, outcome: Outcome) -> None:
    """Append the costs of a task and its queries to the table, at once.

    Raises
    ------
    SimulationError
        The table cannot be written.
    """
    task = (outcome.object_id, stage, outcome.fingerprint)
    figures = (round(outcome.cpu_s, 3), round(outcome.wall_s, 3), round(outcome.peak_bytes / 1e6, 1))
    rows: list[Sequence[object]] = [(*task, *figures, "", "")]
    for key, seconds in outcome.query_seconds.items():
        rows.append((outcome.object_id, QUERY, outcome.fingerprint, "", "", "", key, f"{seconds:.3g}"))
    _append(costs_path(root), _text(rows))


def compact(root: Path) -> None:
    """Keep the last rows of each object and stage, if the table of costs has grown large and would shrink.

    Raises
    ------
    SimulationError
        The table cannot be written.
    """
    path = costs_path(root)
    if not path.is_file() or path.stat().st_size < COMPACT_ABOVE_BYTES:
        return
    with _writing(path):
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if len(row) == len(COLUMNS)]  # no line that a kill cut
        last: dict[tuple[str, ...], deque[int]] = {}
        for index, row in enumerate(rows):
            last.setdefault((row[0], row[1], row[6]), deque(maxlen=KEPT_ROWS)).append(index)
        rows_left = sorted(index for indices in last.values() for index in indices)
        if len(rows_left) <= len(rows) // 2:
            write_whole(path, _text([rows[index] for index in rows_left]))


def _cost(row: Mapping[str, str | None]) -> Cost:
    cut = None in row.values()  # by a kill

    def measured(name: str) -> float | None:
        return None if cut else number(row.get(name))

    return Cost(
        row["object"] or "",
        row["stage"] or "",
        row.get("fingerprint") or "",
        measured("cpu_seconds"),
        measured("wall_seconds"),
        measured("peak_memory_mb"),
        row.get("key") or "",
        measured("seconds_per_query"),
    )


def number(text: str | None) -> float | None:
    """Return a number that can have been measured, None for anything else."""
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0 <= value < LARGEST else None


def unwritable(path: Path, error: OSError) -> SimulationError:
    """Return the error for a record of a run that cannot be written."""
    finding = f"cannot be written ({error.strerror or error})"
    return SimulationError(str(path), finding, "Make room, and run again: nothing finished is lost.")


def is_cut(path: Path) -> bool:
    """Return whether a kill cut the last line of a file short; False where there is no file."""
    try:
        with open_regular(path) as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) != b"\n"
    except OSError:  # no file, or an empty one
        return False


def _text(rows: Sequence[Sequence[object]]) -> str:
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue()


def _append(path: Path, text: str) -> None:
    with _writing(path), path.open("ab+") as file:
        if not file.tell():
            file.write(_text([COLUMNS]).encode())
        elif is_cut(path):
            file.write(b"\r\n")
        file.write(text.encode())


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Lock a table against other processes that write it; a failure is an error that names it."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(path.with_suffix(".lock")):
            if path.exists():
                require_regular(path)
            yield
    except OSError as error:
        raise unwritable(path, error) from error
