"""Speed against error of rivals, from the results of comparisons that were run apart (``bench/results``)."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.dataset.measures import number_at
from pipeline.publish.report.charts import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    Axis,
    LogAxis,
    Tick,
    path_of,
)
from pipeline.publish.report.formats import seconds

# Shapes tell curves apart without their colour.
SHAPES = ("circle", "square", "triangle", "diamond", "cross", "ring", "box", "plus")


@dataclass(frozen=True)
class Way:
    """One way to do it: a curve over its settings.

    Parameters
    ----------
    name, shape
        Whose curve, and which of `SHAPES` its points are.
    ours
        Whether it is what the factory does.
    points, path
        (x, y) in the drawing; the path is empty for a single point.
    """

    name: str
    shape: str
    ours: bool
    points: list[tuple[float, float]]
    path: str


@dataclass(frozen=True)
class RivalChart:
    """Error against CPU seconds of several ways, from one comparison."""

    title: str
    x_label: str
    y_label: str
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    ways: list[Way]
    compared: str
    width: float = WIDTH
    height: float = HEIGHT
    left: float = LEFT
    right: float = WIDTH - RIGHT
    top: float = TOP
    bottom: float = HEIGHT - BOTTOM


Points = dict[str, list[tuple[float, float]]]


def rival_charts(results: Path) -> list[RivalChart]:
    """Return a chart for each comparison that is there and reads as expected; others are left out."""
    charts = []
    for name, title, x_label, y_label, logarithmic, read in COMPARISONS:
        try:
            content = json.loads((results / f"{name}.json").read_text(encoding="utf-8"))
            ways = read(content["figures"])
            compared = str(content.get("compared") or "")
        except (OSError, ValueError, LookupError, TypeError, AttributeError):
            continue
        drawn = _chart(title, x_label, y_label, logarithmic, ways, compared)
        if drawn is not None:
            charts.append(drawn)
    return charts


def _chart(
    title: str, x_label: str, y_label: str, logarithmic: bool, ways: Points, compared: str
) -> RivalChart | None:
    ways = {name: sorted(points) for name, points in ways.items() if points}
    every = [point for points in ways.values() for point in points]
    if len(every) < 2:
        return None
    x_axis = LogAxis([x for x, _ in every], LEFT, WIDTH - RIGHT)
    kind = LogAxis if logarithmic else Axis
    y_axis = kind([y for _, y in every], HEIGHT - BOTTOM, TOP)
    curves = []
    for index, (name, points) in enumerate(ways.items()):
        places = [(round(x_axis.position(x), 1), round(y_axis.position(y), 1)) for x, y in points]
        ours = name.startswith(("VisionNet", "ours", "AudioNet"))
        path = path_of(places) if len(places) > 1 else ""
        curves.append(Way(name, SHAPES[index % len(SHAPES)], ours, places, path))
    y_ticks = y_axis.ticks(lambda value: f"{value:g}") if isinstance(y_axis, LogAxis) else y_axis.ticks()
    return RivalChart(title, x_label, y_label, x_axis.ticks(seconds), y_ticks, curves, compared)


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


COMPARISONS: tuple[tuple[str, str, str, str, bool, Callable[[Mapping[str, Any]], Points]], ...] = (
    ("vision", "Sight, 128x128", "CPU seconds an image", "PSNR, dB", False, _sight),
    (
        "discretisation",
        "Sound, modes of a bowl",
        "CPU seconds an object",
        "median error, cents",
        True,
        _sound,
    ),
    ("touch", "Touch, 120x160", "CPU seconds a touch", "contact PSNR, dB", False, _feel),
)
