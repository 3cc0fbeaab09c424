"""The figures of a version's report, which git has at every revision: no cache and no remote is needed."""

import csv
import io
import json
from collections.abc import Mapping
from typing import Any

from objectfolder.errors import FormatError
from pipeline.audit.fidelity import MEASURES, FidelityChange, changes
from pipeline.audit.versions import METRICS, PER_OBJECT, Version
from pipeline.dataset.lock_file import RESTORE

MEAN = "mean"  # in place of an object's id

Attributes = Mapping[str, Mapping[str, Any]]


def figures_by_object(version: Version) -> dict[str, Attributes] | None:
    """Return the measures of each object in ``per_object.csv``, nested as in attributes of fidelity products.

    Returns
    -------
    dict, optional
        By object id; None where the version has no such table.
    """
    texts = [text for own in version.data_sets if (text := own.texts.get(PER_OBJECT)) is not None]
    rows = (row for text in texts for row in csv.DictReader(io.StringIO(text.decode(errors="replace"))))
    return {row.get("id") or "": _nested(row) for row in rows} if texts else None


def changes_of_means(old: bytes | None, new: bytes | None) -> list[FidelityChange]:
    """Return the means that differ between two texts of ``metrics.json``; none where one is absent.

    Raises
    ------
    FormatError
        A text that is not JSON of an object.
    """
    return [] if old is None or new is None else changes(MEAN, _means(old), _means(new))


def _means(text: bytes) -> Attributes:
    try:
        metrics = dict(json.loads(text))
    except (ValueError, TypeError, RecursionError) as error:
        raise FormatError(METRICS, f"no JSON of an object ({error})", RESTORE) from error
    metrics["bytes"] = {"total": metrics.get("bytes")}
    figures = {}
    for key, measure in MEASURES.items():
        section = metrics.get(measure.sense)
        means = section.get(measure.name) if isinstance(section, dict) else None
        figures[key] = means.get("mean") if isinstance(means, dict) else None
    return _nested(figures)


def _nested(flat: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    tree: dict[str, dict[str, Any]] = {}
    for key, measure in MEASURES.items():
        tree.setdefault(measure.sense, {})[measure.name] = _number(flat.get(key))
    return tree


def _number(cell: Any) -> float | None:
    """Return the number in a cell; None for an empty cell or one that is not a number."""
    try:
        return float(cell)
    except (TypeError, ValueError, OverflowError):
        return None
