"""Speed against error as drawn curves: positions only, the page's template draws them."""

import math
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.publish.report import formats
from pipeline.publish.report.formats import number

WIDTH, HEIGHT = 360.0, 230.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 14.0, 16.0, 44.0
LABEL_SPACE = 0.12
# More objects than these are drawn as a band, not one by one.
MOST_CURVES = 40


@dataclass(frozen=True)
class Tick:
    """A mark of an axis: position in the drawing, and its text."""

    position: float
    label: str


@dataclass(frozen=True)
class Marker:
    """A setting on the curve of the data set."""

    x: float
    y: float
    label: str
    anchor: str
    label_y: float


@dataclass(frozen=True)
class Chart:
    """A drawing of curves over a logarithmic horizontal axis."""

    x_label: str
    y_label: str
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    curves: list[str]
    band: str
    median: str
    markers: list[Marker]
    width: float = WIDTH
    height: float = HEIGHT
    left: float = LEFT
    right: float = WIDTH - RIGHT
    top: float = TOP
    bottom: float = HEIGHT - BOTTOM


def speed_error_chart(rows: Sequence[Mapping[str, Any]], column: str) -> Chart | None:
    """Draw error against `column` (``seconds_per_query`` or ``bytes``), one thin curve an object.

    The bold curve is the median over objects, setting by setting; of many objects the middle nine tenths
    are a band. None where fewer than two settings
    were measured or `column` does not change with the setting.

    Parameters
    ----------
    rows
        Rows of one sense, as `tables.speed_error_rows` gives them.
    """
    known = [row for row in rows if row["error"] is not None and (row[column] or 0) > 0]
    middle = sorted(
        (row[column], row["error"], row["label"])
        for row in setting_medians(rows)
        if row["error"] is not None and (row[column] or 0) > 0
    )
    if len({x for x, _, _ in middle}) < 2:
        return None
    x_axis = LogAxis([row[column] for row in known], LEFT, WIDTH - RIGHT)
    y_axis = Axis([row["error"] for row in known], HEIGHT - BOTTOM, TOP)
    paths: dict[str, list[tuple[float, float]]] = {}
    for row in known:
        paths.setdefault(row["object"], []).append((row[column], row["error"]))
    curves = []
    if len(paths) <= MOST_CURVES:
        for points in paths.values():
            curves.append(path_of([(x_axis.position(x), y_axis.position(y)) for x, y in sorted(points)]))
    markers = [_marker(x_axis.position(x), y_axis.position(y), label) for x, y, label in middle]
    seconds = column == "seconds_per_query"
    return Chart(
        "seconds a query" if seconds else "bytes",
        known[0]["error_unit"],
        x_axis.ticks(formats.seconds if seconds else formats.short_bytes),
        y_axis.ticks(),
        curves,
        "" if curves else _band(rows, column, x_axis, y_axis),
        path_of([(marker.x, marker.y) for marker in markers]),
        markers,
    )


def _band(rows: Sequence[Mapping[str, Any]], column: str, x_axis: "LogAxis", y_axis: "Axis") -> str:
    """Return the outline of the middle nine tenths of the objects, at the median place of each setting."""
    low, high = [], []
    for step in _steps(rows).values():
        known = [row for row in step if row["error"] is not None and (row[column] or 0) > 0]
        if len(known) < 2:
            continue
        x = x_axis.position(statistics.median(row[column] for row in known))
        cuts = statistics.quantiles([row["error"] for row in known], n=20, method="inclusive")
        low.append((x, y_axis.position(cuts[0])))
        high.append((x, y_axis.position(cuts[-1])))
    return path_of([*sorted(low), *sorted(high, reverse=True)])


def setting_medians(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row a setting with its label and medians over objects of error, seconds and bytes.

    Objects are matched step by step: the first setting of each, the second, and so on, because a number
    of modes differs between objects where a share of them does not.
    """
    steps = _steps(rows)
    medians: list[dict[str, Any]] = []
    settings = list(dict.fromkeys(setting for setting, _ in steps))
    order = sorted(steps, key=lambda step: (settings.index(step[0]), step[1]))
    for setting, step in ((name[0], steps[name]) for name in order):
        row = {"label": _label(setting, step), "error_unit": step[0]["error_unit"]}
        for column in ("error", "seconds_per_query", "bytes"):
            known = [each[column] for each in step if each[column] is not None]
            row[column] = statistics.median(known) if known else None
        medians.append(row)
    return medians


def _steps(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, int], list[Mapping[str, Any]]]:
    """Return the rows of all objects by setting and by the how-manieth of the object's it is."""
    steps: dict[tuple[str, int], list[Mapping[str, Any]]] = {}
    counts: Counter[tuple[str, str]] = Counter()
    for row in rows:
        own = (row["object"], row["setting"])
        steps.setdefault((row["setting"], counts[own]), []).append(row)
        counts[own] += 1
    return steps


def _label(setting: str, step: Sequence[Mapping[str, Any]]) -> str:
    name = setting.replace("_", " ")
    values = sorted({row["value"] for row in step if row["value"] is not None})
    if not values:
        return name
    return f"{name} {values[0]:g}" + (f" to {values[-1]:g}" if len(values) > 1 else "")


def path_of(points: Sequence[tuple[float, float]]) -> str:
    """Return the points of an SVG polyline."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _marker(x: float, y: float, label: str) -> Marker:
    share = (x - LEFT) / (WIDTH - RIGHT - LEFT)
    anchor = "start" if share < LABEL_SPACE else "end" if share > 1 - LABEL_SPACE else "middle"
    return Marker(round(x, 1), round(y, 1), label, anchor, round(y - 8 if y > TOP + 16 else y + 17, 1))


class Axis:
    """Values to positions, linear, with round marks."""

    def __init__(self, values: Sequence[float], start: float, end: float) -> None:
        low, high = min(values), max(values)
        room = 0.1 * (high - low) or max(abs(high), 1.0) * 0.1
        self.low, self.high, self.start, self.end = low - room, high + room, start, end

    def position(self, value: float) -> float:
        """Return where a value lies in the drawing."""
        share = (value - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self) -> list[Tick]:
        """Return marks at round values."""
        span = self.high - self.low
        step = 10.0 ** math.floor(math.log10(span))
        step = next(step * part for part in (0.1, 0.2, 0.5, 1, 2, 5) if span / (step * part) <= 6)
        first, last = math.ceil(self.low / step), math.floor(self.high / step)
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        values = [index * step for index in range(first, last + 1)]
        return [Tick(round(self.position(value), 1), number(value, digits)) for value in values]


class LogAxis:
    """Positive values to positions, logarithmic, marks at 1, 2 and 5 where there is room."""

    def __init__(self, values: Sequence[float], start: float, end: float) -> None:
        low, high = math.log10(min(values)), math.log10(max(values))
        room = max(0.08 * (high - low), 0.05)
        self.low, self.high, self.start, self.end = low - room, high + room, start, end

    def position(self, value: float) -> float:
        """Return where a value lies in the drawing."""
        return self.start + (math.log10(value) - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self, text: Callable[[float], str]) -> list[Tick]:
        """Return marks at round values, printed by `text`."""
        decades = range(math.floor(self.low), math.ceil(self.high) + 1)
        for parts in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
            values = [part * 10.0**decade for decade in decades for part in parts]
            values = [value for value in values if self.low <= math.log10(value) <= self.high]
            if len(values) >= 3:
                break
        values = values[:: max(1, math.ceil(len(values) / 6))]
        return [Tick(round(self.position(value), 1), text(value)) for value in values]
