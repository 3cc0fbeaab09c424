"""Failures as a table for people."""

import shutil
import textwrap
from collections.abc import Sequence

from pipeline.dataset.task import Failure


def failure_table(failures: Sequence[Failure], width: int | None = None) -> str:
    """Return failures as a table of object, error and remedy; empty without any."""
    if not failures:
        return ""
    width = width or shutil.get_terminal_size((110, 24)).columns
    first = min(32, max(6, *(len(failure.object_id) for failure in failures)))
    rest = max(24, (width - first - 4) // 2)
    lines = [f"{'object':<{first}}  {'error':<{rest}}  remedy"]
    for failure in failures:
        cells = (
            textwrap.wrap(failure.object_id, first) or [""],
            textwrap.wrap(failure.error, rest) or [""],
            textwrap.wrap(failure.remedy, rest) or [""],
        )
        for row in range(max(map(len, cells))):
            name, error, remedy = (cell[row] if row < len(cell) else "" for cell in cells)
            lines.append(f"{name:<{first}}  {error:<{rest}}  {remedy}".rstrip())
    return "\n".join(lines)
