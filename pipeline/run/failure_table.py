"""Failures as a table for people."""

from collections.abc import Sequence

from pipeline.dataset.task import Failure


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
