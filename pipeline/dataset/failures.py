"""``data/failures.json``: which objects of the data set failed, in which stages, and why.

It is part of the data set and under version control: the report and the last stage of ``dvc.yaml`` go by it.
Details, such as a traceback, are in the record of the run (`pipeline.run.run_record`).
"""

import json
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.products.atomic import atomic_write
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Failure

FAILURES = Path("data/failures.json")


@dataclass(frozen=True)
class FailedObject:
    """An object and a stage that failed, why, what to do, and the fingerprint that was wanted, if known."""

    object: str
    stage: str
    error: str
    remedy: str
    fingerprint: str = ""


def read_failures(root: Path) -> list[FailedObject]:
    """Return what failed, by object and stage in their order; nothing where nothing was ever made.

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
    root: Path, found: Iterable[FailedObject], stages: Sequence[Stage], others: Collection[str] = ()
) -> None:
    """Write the failures of a run that no earlier failure explains; keep those that it did not look at.

    Parameters
    ----------
    root
        Root of the data set; its path is left out of errors.
    found
        Failures of this run.
    stages
        Stages of this run: their earlier failures are forgotten.
    others
        Listed objects that were left out of this run: their earlier failures are kept.
    """
    try:
        earlier = read_failures(root)
    except InputError:
        earlier = []
    now = {stage.name: stage for stage in stages}
    known = {**STAGES, **now}
    every = [*(one for one in earlier if one.object in others or one.stage not in now), *found]
    failed = {(one.object, one.stage) for one in every}
    order = list(known | dict.fromkeys(one.stage for one in every))
    entries = [
        asdict(one) | {"error": one.error.replace(f"{root}/", "")}
        for one in sorted(every, key=lambda one: (one.object, order.index(one.stage)))
        if one.stage not in known
        or not any((one.object, before) in failed for before in known[one.stage].follows)
    ]
    with atomic_write(root / FAILURES) as file:
        file.write((json.dumps(entries, indent=1, ensure_ascii=False) + "\n").encode())


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
