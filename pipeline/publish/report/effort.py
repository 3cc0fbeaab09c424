"""What more or less effort of a sense gives, setting by setting."""

import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any


def setting_medians(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row a setting with its label and medians over objects of error, seconds and bytes.

    Objects are matched step by step: the first setting of each, the second, and so on, because a number
    of modes differs between objects where a share of them does not.
    """
    medians: list[dict[str, Any]] = []
    by_step = steps(rows)
    settings = list(dict.fromkeys(setting for setting, _ in by_step))
    for setting, index in sorted(by_step, key=lambda step: (settings.index(step[0]), step[1])):
        step = by_step[setting, index]
        row = {"label": _label(setting, step), "error_unit": step[0]["error_unit"]}
        for column in ("error", "seconds_per_query", "bytes"):
            known = [each[column] for each in step if each[column] is not None]
            row[column] = statistics.median(known) if known else None
        medians.append(row)
    return medians


def steps(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, int], list[Mapping[str, Any]]]:
    """Return the rows of all objects by setting and by its place among the object's rows of that setting."""
    found: dict[tuple[str, int], list[Mapping[str, Any]]] = {}
    counts: Counter[tuple[str, str]] = Counter()
    for row in rows:
        own = (row["object"], row["setting"])
        found.setdefault((row["setting"], counts[own]), []).append(row)
        counts[own] += 1
    return found


def _label(setting: str, step: Sequence[Mapping[str, Any]]) -> str:
    name = setting.replace("_", " ")
    values = sorted({row["value"] for row in step if row["value"] is not None})
    if not values:
        return name
    return f"{name} {values[0]:g}" + (f" to {values[-1]:g}" if len(values) > 1 else "")
