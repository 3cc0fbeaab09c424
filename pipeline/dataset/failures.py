"""``data/failures.json``: which objects of the data set failed, in which stage, and why.

It is part of the data set and under version control: the report and the last stage of ``dvc.yaml`` go by it.
"""

import json
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.products.atomic import atomic_write
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Failure

FAILURES = Path("data/failures.json")
ORDER = {name: number for number, name in enumerate(STAGES)}


@dataclass(frozen=True)
class FailedObject:
    """The first stage in which an object failed, why, and what to do."""

    object: str
    stage: str
    error: str
    remedy: str


def read_failures(root: Path) -> list[FailedObject]:
    """Return the objects that failed, in the order of their ids; none where nothing was ever made.

    Raises
    ------
    InputError
        A damaged file.
    """
    try:
        return [FailedObject(**entry) for entry in json.loads((root / FAILURES).read_text(encoding="utf-8"))]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            str(FAILURES), f"cannot be read ({error})", "Delete it, and run `dvc repro`."
        ) from error


def write_failures(
    root: Path,
    found: Iterable[tuple[str, Failure]],
    stages: Collection[str],
    others: Collection[str] = (),
) -> None:
    """Write the failures of a run, and keep those of objects and stages that it did not look at.

    Parameters
    ----------
    root
        Root of the data set; its path is left out of errors.
    found
        Stage and failure of this run.
    stages
        Stages of this run: their earlier failures are forgotten.
    others
        Listed objects that were left out of this run: their earlier failures are kept.
    """
    kept = [one for one in _readable(root) if one.object in others or one.stage not in stages]
    new = [
        FailedObject(failure.object_id, stage, failure.error.replace(f"{root}/", ""), failure.remedy)
        for stage, failure in found
    ]
    first: dict[str, FailedObject] = {}
    for one in sorted([*kept, *new], key=lambda one: (one.object, ORDER.get(one.stage, len(ORDER)))):
        first.setdefault(one.object, one)
    text = json.dumps([asdict(one) for one in first.values()], indent=1, ensure_ascii=False)
    with atomic_write(root / FAILURES) as file:
        file.write(f"{text}\n".encode())


def failure_table(failures: Sequence[Failure], width: int | None = None) -> str:
    """Return failures as a table of object, error and remedy; empty without any."""
    # Imported here: most runs have no failure.
    from rich.console import Console
    from rich.table import Table

    if not failures:
        return ""
    table = Table("object", "error", "remedy", box=None, padding=(0, 2, 0, 0), highlight=False)
    for failure in failures:
        table.add_row(failure.object_id, failure.error, failure.remedy)
    console = Console(width=width, markup=False, highlight=False, color_system=None)
    with console.capture() as shown:
        console.print(table)
    return "\n".join(line.rstrip() for line in shown.get().splitlines())


def _readable(root: Path) -> Sequence[FailedObject]:
    try:
        return read_failures(root)
    except InputError:
        return []
