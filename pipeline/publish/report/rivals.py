"""Speed against error of rivals, from the results of comparisons that were run apart (``bench/results``)."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from pipeline.dataset.measures import number_at
from pipeline.publish.report.charts import curves

Points = dict[str, list[tuple[float, float]]]


class Comparison(NamedTuple):
    """A file of results, the labels of its chart, and the function that finds the points of each way."""

    name: str
    title: str
    x_label: str
    y_label: str
    logarithmic: bool
    points: Callable[[Mapping[str, Any]], Points]


def rival_charts(results: Path) -> list[tuple[str, Markup]]:
    """Return title and chart of each comparison that is there and reads as expected, without the others."""
    charts = []
    for name, title, x_label, y_label, logarithmic, points in COMPARISONS:
        try:
            figures = json.loads((results / f"{name}.json").read_text(encoding="utf-8"))["figures"]
            ways = {way: sorted(found) for way, found in points(figures).items()}
        except (OSError, ValueError, LookupError, TypeError, AttributeError):
            continue
        if sum(map(len, ways.values())) > 1:
            charts.append((title, curves(name, title, x_label, y_label, logarithmic, ways)))
    return charts


def _gathered(rows: Any, x: str, y: str) -> Points:
    """Return the points of rows that say their way, x and y."""
    ways: Points = {}
    for row in rows:
        place, error = number_at(row, x), number_at(row, y)
        if place and place > 0 and error is not None:
            ways.setdefault(str(row["way"]), []).append((place, error))
    return ways


def _sight(figures: Mapping[str, Any]) -> Points:
    return _gathered(figures["mean_over_objects"]["128"], "cpu_s", "psnr_db")


def _feel(figures: Mapping[str, Any]) -> Points:
    return _gathered(figures["summary"]["ways"], "cpu_s", "psnr_contact_db")


def _sound(figures: Mapping[str, Any]) -> Points:
    """Ways of the discretisation are named with their setting behind them: ``ours, 5 cents``."""
    rows = [
        {"way": name.split(",")[0].split(" 1")[0], **way}
        for name, way in figures["bowl"]["ways"].items()
        if (number_at(way, "median_cents") or 0) > 0
    ]
    return _gathered(rows, "total_cpu_s", "median_cents")


COMPARISONS = (
    Comparison("vision", "Sight, 128x128", "CPU seconds an image", "PSNR, dB", False, _sight),
    Comparison(
        "discretisation",
        "Sound, modes of a bowl",
        "CPU seconds an object",
        "median error, cents",
        True,
        _sound,
    ),
    Comparison("touch", "Touch, 120x160", "CPU seconds a touch", "contact PSNR, dB", False, _feel),
)
