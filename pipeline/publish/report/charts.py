"""Charts of the first page, drawn by matplotlib as SVG in the colours of the page, light or dark."""

import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
import pandas
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from pipeline.publish.report.summary import MeasureSummary, error_words, setting_words
from pipeline.publish.report.templates import megabytes, number, seconds

# Placeholders for colours of the page's style while matplotlib draws.
COLOURS = {
    "#000001": "var(--ink)",
    "#000002": "var(--soft)",
    "#000003": "var(--line)",
    "#000004": "var(--accent)",
    "#000005": "var(--curve)",
}
INK, _, _, ACCENT, CURVE = COLOURS
STYLE = Path(__file__).parent / "template" / "charts.mplstyle"
WIDTH, HEIGHT = 3.6, 2.3  # inches
LEFT, RIGHT, TOP, BOTTOM = 0.55, 0.12, 0.12, 0.4  # margins in inches
EFFORTS = {"seconds_per_query": "seconds for one answer", "bytes": "size in the Object File"}
LABEL_POINTS = 7
LEAST_CHANGE = 1.1  # of the seconds: less is noise of the clock
MOST_CURVES = 40  # more objects are drawn as a band
BAND = (0.05, 0.95)


def drawing(
    name: str, label: str, draw: Callable[[Axes], None], height: float = HEIGHT, top: float = TOP
) -> Markup:
    """Return what `draw` draws as SVG.

    Parameters
    ----------
    name
        Stands before every id of the drawing: ids of a page are unique.
    label
        What the chart shows, for those who cannot see it.
    height
        Of the drawing, inches.
    top
        Margin, inches.
    """
    text = io.StringIO()
    with matplotlib.style.context(STYLE, after_reset=True):
        figure = Figure(figsize=(WIDTH, height))
        size = (1 - (LEFT + RIGHT) / WIDTH, 1 - (BOTTOM + top) / height)
        draw(figure.add_axes((LEFT / WIDTH, BOTTOM / height, *size)))
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = re.sub(r"<(metadata|style)\b.*?</\1>", "", text.getvalue().partition("<svg")[2], flags=re.DOTALL)
    svg = re.sub(r'( id="|href="#|url\(#)', lambda found: f"{found[1]}{name}-", svg)
    svg = re.sub("|".join(COLOURS), lambda found: COLOURS[found[0]], svg)
    box = f"0 0 {72 * WIDTH:g} {72 * height:g}"  # matplotlib writes points
    return Markup(f'<svg viewBox="{box}" role="img" aria-label="{escape(label)}">{svg.partition(">")[2]}')


def speed_error_chart(name: str, title: str, rows: Sequence[Mapping[str, Any]], column: str) -> Markup | None:
    """Draw error against `column` (``seconds_per_query`` or ``bytes``), one thin curve an object.

    The bold curve is the median over objects, setting by setting; of more than `MOST_CURVES` objects the
    middle nine tenths are a band. None where fewer than two settings were measured or `column` does not
    change with the setting; seconds have to by a factor of `LEAST_CHANGE`.

    Parameters
    ----------
    rows
        Rows of one sense, as `summary.speed_error_rows` gives them.
    """
    known = [row for row in rows if _drawable(row, column)]
    medians = [row for row in setting_medians(rows) if _drawable(row, column)]
    places = [row[column] for row in medians]
    timed = column == "seconds_per_query"
    if len(set(places)) < 2 or (timed and max(places) < LEAST_CHANGE * min(places)):
        return None
    text = seconds if timed else megabytes
    x_label = EFFORTS[column]
    y_label = error_words(known[0]["error_unit"])
    objects = dict.fromkeys(row["object"] for row in known)

    def curve(axes: Axes, own: Sequence[Mapping[str, Any]], style: str, **options: Any) -> None:
        points = sorted((row[column], row["error"]) for row in own)
        axes.plot(*zip(*points, strict=True), style, **options)

    def draw(axes: Axes) -> None:
        if len(objects) > MOST_CURVES:
            axes.fill_between(*_band(known, column), color=CURVE, alpha=0.28)
        else:
            for object_id in objects:
                own = [row for row in known if row["object"] == object_id]
                curve(axes, own, "-", color=CURVE, alpha=0.6, linewidth=0.8)
        curve(axes, medians, "o-", color=ACCENT, markersize=4)
        axes.set(xlabel=x_label, xscale="log")
        axes.set_title(y_label, loc="left", fontsize=8)
        axes.margins(0.12, 0.2)
        _label(axes, [(row[column], row["error"], row["label"]) for row in medians])
        low, high = axes.xaxis.get_view_interval()
        ticks = [low ** (1 - share) * high**share for share in (1 / 6, 1 / 2, 5 / 6)]
        axes.xaxis.set_major_locator(FixedLocator([float(f"{tick:.2g}") for tick in ticks]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
        axes.xaxis.set_minor_locator(NullLocator())

    return drawing(f"{name}-{column}", f"{title}: {y_label} against {x_label}", draw, top=0.28)


def _label(axes: Axes, places: Sequence[tuple[float, float, str]]) -> None:
    """Write words at points, each above or below at the first height where it meets no others."""
    axes.autoscale_view()
    left, right = (72 * inches for inches in (LEFT, WIDTH - RIGHT))
    boxes: list[tuple[float, float, float]] = []
    for x, y, words in places:
        point = axes.transData.transform((x, y)) * 72 / axes.figure.get_dpi()
        half = 0.3 * LABEL_POINTS * len(words)
        middle = min(max(point[0], left + half), right - half)
        heights = [sign * step * (LABEL_POINTS + 1) - 3 for step in (1, 2, 3) for sign in (1.3, -1)]

        def free(height: float, middle: float = middle, half: float = half, low: float = point[1]) -> bool:
            return all(
                abs(middle - other) >= half + width or abs(low + height - base) >= LABEL_POINTS
                for other, base, width in boxes
            )

        height = next(filter(free, heights), heights[0])
        boxes.append((middle, point[1] + height, half))
        offset = (middle - point[0], height)
        axes.annotate(words, (x, y), offset, textcoords="offset points", ha="center", fontsize=LABEL_POINTS)


def histogram(summary: MeasureSummary) -> tuple[Markup, bool]:
    """Draw how a measure is spread over the objects; a dashed line stands at its target.

    Returns
    -------
    tuple
        The drawing, and whether the target lies within it.
    """
    measure, values = summary.measure, [value for value, _ in summary.values]
    text = partial(number, decimals=measure.decimals)
    if measure.unit == "bytes":
        text = partial(megabytes)
    within = measure.target is not None and min(values) <= measure.target <= max(values)

    def draw(axes: Axes) -> None:
        axes.hist(values, bins="sqrt", color=ACCENT, alpha=0.75, rwidth=0.9)
        if measure.target is not None and within:
            axes.axvline(measure.target, color=INK, linestyle="--", linewidth=1)
        axes.xaxis.set_major_locator(MaxNLocator(4))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
        axes.yaxis.set_major_locator(MaxNLocator(3, integer=True))

    return drawing(measure.key, f"Histogram of {measure.label}", draw, height=1.4), within


def setting_medians(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row a setting with its label and medians over objects of error, seconds and bytes.

    Objects are matched step by step: the first setting of each, the second, and so on, because a number
    of modes differs between objects where a share of them does not.
    """
    medians: list[dict[str, Any]] = []
    for step in _steps(rows):
        row = {
            "label": setting_words(step["setting"].iloc[0], step["value"].min(), step["value"].max()),
            "error_unit": step["error_unit"].iloc[0],
        }
        for column in ("error", "seconds_per_query", "bytes"):
            median = float(step[column].median())
            row[column] = None if math.isnan(median) else median
        medians.append(row)
    return medians


def _steps(rows: Sequence[Mapping[str, Any]]) -> list[pandas.DataFrame]:
    """Return the rows of all objects by setting and by place among the object's rows of that setting."""
    if not rows:
        return []
    numbers = ("value", "error", "seconds_per_query", "bytes")
    table = pandas.DataFrame(rows).astype(dict.fromkeys(numbers, float))
    place = table.groupby(["object", "setting"]).cumcount()
    return [step for _, own in table.groupby("setting", sort=False) for _, step in own.groupby(place)]


def _drawable(row: Mapping[str, Any], column: str) -> bool:
    return row["error"] is not None and (row[column] or 0) > 0


def _band(rows: Sequence[Mapping[str, Any]], column: str) -> np.ndarray:
    """Return (3, settings) median place, low and high error of each setting."""
    found = [(step[column].median(), *step["error"].quantile(BAND)) for step in _steps(rows)]
    return np.array(sorted(found)).T
