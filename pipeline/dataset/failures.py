"""``data/failures.json``: which objects of the data set failed, in which stages, and why.

It is part of the data set and under version control: the report and the last stage of ``dvc.yaml`` go by it.
Details, such as a traceback, are in the record of the run (`pipeline.run.run_record`).
"""

import contextlib
import json
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError, printable
from objectfolder.products.atomic import write_whole
from objectfolder.products.regular_file import read_regular
from pipeline.dataset.task import Failure

if TYPE_CHECKING:
    from pipeline.dataset.stage import Stage

FAILURES = Path("data/failures.json")
RETRY = Path("data/retry.json")


@dataclass(frozen=True)
class FailedObject:
    """An object and a stage that failed, why, what to do, and the fingerprint that was wanted, if known."""

    object: str
    stage: str
    error: str
    remedy: str
    fingerprint: str = ""

    @classmethod
    def of(cls, stage: str, failure: Failure, fingerprint: str = "") -> "FailedObject":
        """Return the failure of an object in a stage."""
        return cls(failure.object_id, stage, failure.error, failure.remedy, fingerprint)


def read_failures(root: Path) -> list[FailedObject]:
    """Return the failures in the order of objects and stages; none where no run has been recorded.

    Raises
    ------
    InputError
        A damaged file.
    """
    try:
        return parse_failures(read_regular(root / FAILURES))
    except FileNotFoundError:
        return []
    except OSError as error:
        raise _unreadable(error) from error


def parse_failures(text: bytes) -> list[FailedObject]:
    """Return what a ``data/failures.json`` holds.

    Raises
    ------
    InputError
        A damaged one.
    """
    try:
        return [FailedObject(**entry) for entry in json.loads(text)]
    except (ValueError, TypeError, RecursionError) as error:
        raise _unreadable(error) from error


def _unreadable(error: Exception) -> InputError:
    return InputError(str(FAILURES), f"cannot be read ({error})", "Delete it, and run `dvc repro`.")


def write_failures(
    root: Path, failures: Iterable[FailedObject], stages: Sequence["Stage"], others: Collection[str] = ()
) -> None:
    """Write the failures of a run that no earlier stage explains; keep those outside the run.

    Parameters
    ----------
    root
        Root of the data set; its path is left out of errors.
    failures
        Those of this run.
    stages
        Stages of this run: their earlier failures are forgotten.
    others
        Listed objects that were left out of this run: their earlier failures are kept.
    """
    from pipeline.dataset.stages import STAGES  # with what it imports, longer than reading the failures

    earlier: list[FailedObject] = []
    with contextlib.suppress(InputError):
        earlier = read_failures(root)
    run_stages = {stage.name: stage for stage in stages}
    all_stages = {**STAGES, **run_stages}
    rest = (entry for entry in earlier if entry.object in others or entry.stage not in run_stages)
    all_failures = [*rest, *failures]
    keys = {(failure.object, failure.stage) for failure in all_failures}
    order = list(all_stages | dict.fromkeys(failure.stage for failure in all_failures))
    entries = [
        asdict(failure) | {"error": failure.error.replace(f"{root}/", "")}
        for failure in sorted(all_failures, key=lambda failure: (failure.object, order.index(failure.stage)))
        if failure.stage not in all_stages
        or not any((failure.object, before) in keys for before in all_stages[failure.stage].follows)
    ]
    write_whole(root / FAILURES, json.dumps(entries, indent=1, ensure_ascii=False) + "\n")


def ask_for_retry(root: Path, failures: Sequence[FailedObject]) -> None:
    """Write ``data/retry.json`` anew, on which the stage `products` depends: the next `dvc repro` runs it.

    It is a cycle that DVC does not see. The stage `products` cannot ask itself, for DVC reads what a stage
    depends on after its command. No other command may write the file.
    """
    path = root / RETRY
    try:
        number = int(json.loads(read_regular(path))["round"])
    except (OSError, ValueError, TypeError, KeyError):
        number = 0
    keys = sorted({f"{failure.stage} {failure.object}" for failure in failures})
    write_whole(path, json.dumps({"round": number + 1, "failed": keys}, indent=1) + "\n")


def failure_table(failures: Sequence[FailedObject], width: int | None = None) -> str:
    """Return failures as a table of object, stage, error and remedy; empty without any."""
    from rich.table import Table  # most runs have no failure

    if not failures:
        return ""
    table = Table("object", "stage", "error", "remedy", box=None, padding=(0, 2, 0, 0), highlight=False)
    for failure in failures:
        table.add_row(*map(printable, (failure.object, failure.stage, failure.error, failure.remedy)))
    return table_text(table, width)


def table_text(table: object, width: int | None) -> str:
    """Return a table of `rich` as plain text `width` columns wide; None takes the terminal's width."""
    from rich.console import Console

    console = Console(width=width, markup=False, highlight=False, color_system=None)
    with console.capture() as capture:
        console.print(table)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())
