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
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from pipeline.publish.report.summary import MeasureSummary
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
MOST_CURVES = 40  # more objects are drawn as a band
BAND = (0.05, 0.95)


def drawing(name: str, label: str, draw: Callable[[Axes], None], height: float = HEIGHT) -> Markup:
    """Return what `draw` draws as SVG.

    Parameters
    ----------
    name
        Stands before every id of the drawing: ids of a page are unique.
    label
        What the chart shows, for those who cannot see it.
    height
        Of the drawing, inches.
    """
    text = io.StringIO()
    with matplotlib.style.context(STYLE, after_reset=True):
        figure = Figure(figsize=(WIDTH, height))
        size = (1 - (LEFT + RIGHT) / WIDTH, 1 - (BOTTOM + TOP) / height)
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
    change with the setting.

    Parameters
    ----------
    rows
        Rows of one sense, as `summary.speed_error_rows` gives them.
    """
    known = [row for row in rows if _drawable(row, column)]
    medians = [row for row in setting_medians(rows) if _drawable(row, column)]
    if len({row[column] for row in medians}) < 2:
        return None
    text = seconds if column == "seconds_per_query" else megabytes
    x_label = "seconds a query" if column == "seconds_per_query" else "bytes"
    y_label = known[0]["error_unit"]
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
        for row in medians:
            place = (row[column], row["error"])
            axes.annotate(row["label"], place, (0, 5), textcoords="offset points", ha="center", fontsize=7)
        axes.set(xlabel=x_label, ylabel=y_label, xscale="log")
        axes.margins(0.12)
        low, high = axes.xaxis.get_view_interval()
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,), numticks=6))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
        axes.xaxis.set_minor_locator(NullLocator())

    return drawing(f"{name}-{column}", f"{title}: {y_label} against {x_label}", draw)


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
        label, low, high = step["setting"].iloc[0].replace("_", " "), step["value"].min(), step["value"].max()
        if not math.isnan(low):
            label += f" {low:g}" + (f" to {high:g}" if high > low else "")
        row = {"label": label, "error_unit": step["error_unit"].iloc[0]}
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
