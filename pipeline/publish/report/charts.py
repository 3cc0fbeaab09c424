"""Charts of the first page as SVG in the colours of the page, light or dark."""

import math
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from pipeline.publish.report.measured_objects import MeasureSummary
from pipeline.publish.report.summary import error_words, setting_words
from pipeline.publish.report.templates import MINUS, megabytes, seconds

WIDTH, HEIGHT = 260.0, 166.0  # units of a drawing, in which text is 8 high
LEFT, RIGHT, TOP, BOTTOM = 40.0, 9.0, 9.0, 29.0  # margins
EFFORTS = {"seconds_per_query": "seconds for one answer", "bytes": "size in the Object File"}
LABEL_HEIGHT = 7.0
LETTER = 0.6  # width of a letter in heights of the text, at most
LEAST_CHANGE = 1.1  # of the seconds: less is noise of the clock
MOST_CURVES = 40  # more objects are drawn as a band
BAND = (0.05, 0.95)
Point = tuple[float, float]


class Chart:
    """A drawing with axes over ranges of two numbers.

    Parameters
    ----------
    label
        What the chart shows, for those who cannot see it.
    x, y
        Lowest and highest number.
    title
        Above the drawing; empty for none.
    height
        Of the drawing.
    log
        Whether `x` goes by ratios.
    """

    def __init__(
        self, label: str, x: Point, y: Point, title: str = "", height: float = HEIGHT, *, log: bool = False
    ) -> None:
        self._label, self._x, self._y, self._height, self._log = label, x, y, height, log
        self._top = TOP + (12.0 if title else 0.0)
        self._marks: list[str] = []
        if title:
            self.text(LEFT, self._top - 6, title, "start", "ink", 8)

    def at(self, x: float, y: float) -> Point:
        """Return where two numbers lie in the drawing."""
        scale = math.log if self._log else float
        low, high = map(scale, self._x)
        across = (scale(x) - low) / (high - low)
        up = (y - self._y[0]) / (self._y[1] - self._y[0])
        bottom = self._height - BOTTOM
        return LEFT + across * (WIDTH - RIGHT - LEFT), bottom + up * (self._top - bottom)

    def path(self, points: Sequence[Point], style: str) -> None:
        """Draw a line through numbers; `style` is its CSS."""
        way = " L".join(f"{x:.1f} {y:.1f}" for x, y in (self.at(*point) for point in points))
        self._marks.append(f'<path d="M{way}" style="{style}"/>')

    def dot(self, x: float, y: float) -> None:
        """Draw a dot at two numbers."""
        across, down = self.at(x, y)
        self._marks.append(f'<circle cx="{across:.1f}" cy="{down:.1f}" r="2.4" style="fill: var(--accent)"/>')

    def text(self, x: float, y: float, words: str, anchor: str, colour: str, size: float) -> None:
        """Write words at a place of the drawing."""
        style = f"fill: var(--{colour}); font-size: {size:g}px; text-anchor: {anchor}"
        self._marks.append(f'<text x="{x:.1f}" y="{y:.1f}" style="{style}">{escape(words)}</text>')

    def axes(
        self, x_ticks: Sequence[float], x_text: Callable[[float], str], y_ticks: Sequence[float], x_label: str
    ) -> None:
        """Draw both axes: numbers at their ticks, a line across at those of y, and a label below."""
        bottom = self._height - BOTTOM
        for value in y_ticks:
            self.path([(self._x[0], value), (self._x[1], value)], "stroke: var(--line); stroke-width: 0.8")
            self.text(LEFT - 4, self.at(self._x[0], value)[1] + 3, _plain(value), "end", "soft", 8)
        for value in x_ticks:
            words = x_text(value)
            place = min(self.at(value, self._y[0])[0], WIDTH - LETTER / 2 * 8 * len(words))
            self.text(place, bottom + 11, words, "middle", "soft", 8)
        edge = [(self._x[0], self._y[1]), (self._x[0], self._y[0]), (self._x[1], self._y[0])]
        self.path(edge, "fill: none; stroke: var(--soft); stroke-width: 0.8")
        self.text((LEFT + WIDTH - RIGHT) / 2, bottom + 24, x_label, "middle", "soft", 8)

    def labels(self, places: Sequence[tuple[float, float, str]]) -> None:
        """Write words at points, each above or below at the first height where it meets no others."""
        boxes: list[tuple[float, float, float]] = []
        for x, y, words in places:
            across, down = self.at(x, y)
            half = LETTER / 2 * LABEL_HEIGHT * len(words)
            middle = min(max(across, LEFT + half), WIDTH - RIGHT - half)
            lines = [down + 3 - sign * step * (LABEL_HEIGHT + 1) for step in (1, 2, 3) for sign in (1.3, -1)]

            def free(line: float, middle: float = middle, half: float = half) -> bool:
                return all(
                    abs(middle - other) >= half + width or abs(line - base) >= LABEL_HEIGHT
                    for other, base, width in boxes
                )

            line = next(filter(free, lines), lines[0])
            boxes.append((middle, line, half))
            self.text(middle, line, words, "middle", "ink", LABEL_HEIGHT)

    def svg(self) -> Markup:
        """Return the drawing."""
        box = f"0 0 {WIDTH:g} {self._height:g}"
        label = f'role="img" aria-label="{escape(self._label)}"'
        return Markup(f'<svg viewBox="{box}" {label}>{"".join(self._marks)}</svg>')


def speed_error_chart(title: str, rows: Sequence[Mapping[str, Any]], column: str) -> Markup | None:
    """Draw error against `column` (``seconds_per_query`` or ``bytes``), one thin curve an object.

    The bold curve is the median over objects, setting by setting; of more than `MOST_CURVES` objects the
    middle nine tenths are a band. None where fewer than two settings were measured or `column` does not
    change with the setting; seconds have to by a factor of `LEAST_CHANGE`.

    Parameters
    ----------
    rows
        Rows of one sense, as `summary.speed_error_rows` gives them.
    """
    drawable = [row for row in rows if _drawable(row, column)]
    medians = [row for row in setting_medians(rows) if _drawable(row, column)]
    bold = sorted((row[column], row["error"]) for row in medians)
    places = [place for place, _ in bold]
    is_time = column == "seconds_per_query"
    if len(set(places)) < 2 or (is_time and max(places) < LEAST_CHANGE * min(places)):
        return None
    curves: dict[str, list[Point]] = {}
    for row in drawable:
        curves.setdefault(row["object"], []).append((row[column], row["error"]))
    shapes = [sorted(points) for points in curves.values()]
    style = "fill: none; stroke: var(--curve); stroke-width: 0.8; opacity: 0.6"
    if len(shapes) > MOST_CURVES:
        across, low, high = _band(drawable, column)
        lower, upper = (list(zip(across, edge, strict=True)) for edge in (low, high))
        shapes, style = [[*lower, *reversed(upper)]], "fill: var(--curve); opacity: 0.28"
    every = [point for shape in [*shapes, bold] for point in shape]
    x = _widened([math.log(place) for place, _ in every], 0.12)
    y = _widened([error for _, error in every], 0.2)
    words, x_label = error_words(drawable[0]["error_unit"]), EFFORTS[column]
    chart = Chart(f"{title}: {words} against {x_label}", (math.exp(x[0]), math.exp(x[1])), y, words, log=True)
    ticks = [math.exp(x[0] + share * (x[1] - x[0])) for share in (1 / 6, 1 / 2, 5 / 6)]
    text = seconds if is_time else megabytes
    chart.axes([float(f"{tick:.2g}") for tick in ticks], text, round_numbers(*y, 5), x_label)
    for shape in shapes:
        chart.path(shape, style)
    chart.path(bold, "fill: none; stroke: var(--accent); stroke-width: 1.5")
    for point in bold:
        chart.dot(*point)
    chart.labels([(row[column], row["error"], row["label"]) for row in medians])
    return chart.svg()


def histogram(summary: MeasureSummary) -> tuple[Markup, bool]:
    """Draw how a measure is spread over the objects; a dashed line stands at its target.

    Returns
    -------
    tuple
        The drawing, and whether the target lies within it.
    """
    measure, values = summary.measure, [value for value, _ in summary.values]
    within = measure.target is not None and min(values) <= measure.target <= max(values)
    counts, edges = np.histogram(values, bins="sqrt")
    x, highest = _widened(edges.tolist(), 0.05), 1.05 * float(counts.max())
    chart = Chart(f"Histogram of {measure.label}", x, (0.0, highest), height=101)
    heights = [value for value in round_numbers(0, highest, 3) if value == int(value)]
    chart.axes(round_numbers(*x, 4), measure.text, heights, "")
    for count, low, high in zip(counts.tolist(), edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        left, right = low + 0.05 * (high - low), high - 0.05 * (high - low)
        bar = [(left, 0.0), (left, count), (right, count), (right, 0.0)]
        chart.path(bar, "fill: var(--accent); opacity: 0.75")
    if measure.target is not None and within:
        line = [(measure.target, 0.0), (measure.target, highest)]
        chart.path(line, "stroke: var(--ink); stroke-width: 1; stroke-dasharray: 4 2")
    return chart.svg(), within


def round_numbers(low: float, high: float, most: int) -> list[float]:
    """Return at most `most` + 1 round numbers from `low` to `high`, evenly spaced."""
    least = (high - low) / most
    power = 10 ** math.floor(math.log10(least))
    step = next(factor * power for factor in (1, 2, 2.5, 5, 10) if factor * power >= least * (1 - 1e-9))
    return [step * index for index in range(math.ceil(low / step), math.floor(high / step) + 1)]


def setting_medians(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row a setting with its label and medians over objects of error, seconds and bytes.

    Objects are matched step by step: the first setting of each, the second, and so on, because a number
    of modes differs between objects where a share of them does not.
    """
    medians: list[dict[str, Any]] = []
    for step in _steps(rows):
        values = _known(step, "value")
        label = setting_words(step[0]["setting"], min(values, default=None), max(values, default=None))
        row = {"label": label, "error_unit": step[0]["error_unit"]}
        for column in ("error", "seconds_per_query", "bytes"):
            numbers = _known(step, column)
            row[column] = statistics.median(numbers) if numbers else None
        medians.append(row)
    return medians


def _steps(rows: Sequence[Mapping[str, Any]]) -> list[list[Mapping[str, Any]]]:
    """Return the rows of all objects by setting and by place among the object's rows of that setting."""
    steps: dict[str, dict[int, list[Mapping[str, Any]]]] = {}
    before: Counter[tuple[str, str]] = Counter()
    for row in rows:
        own = row["object"], row["setting"]
        steps.setdefault(row["setting"], {}).setdefault(before[own], []).append(row)
        before[own] += 1
    return [places[place] for places in steps.values() for place in sorted(places)]


def _known(rows: Sequence[Mapping[str, Any]], column: str) -> list[float]:
    return [row[column] for row in rows if row[column] is not None]


def _drawable(row: Mapping[str, Any], column: str) -> bool:
    return row["error"] is not None and (row[column] or 0) > 0


def _band(rows: Sequence[Mapping[str, Any]], column: str) -> list[tuple[float, ...]]:
    """Return median place, low and high error of each setting, by place."""
    points = [
        (statistics.median(_known(step, column)), *np.quantile(_known(step, "error"), BAND).tolist())
        for step in _steps(rows)
    ]
    return list(zip(*sorted(points), strict=True))


def _widened(values: Sequence[float], share: float) -> Point:
    """Return the range of values with a share of its length more at both ends; of one value one around it."""
    low, high = min(values), max(values)
    more = share * (high - low) or 0.5
    return low - more, high + more


def _plain(value: float) -> str:
    return f"{value:g}".replace("-", MINUS)
