"""Charts of the first page, drawn by matplotlib as SVG in the colours of the page, light or dark."""

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from pipeline.publish.report import formats
from pipeline.publish.report.effort import setting_medians, steps
from pipeline.publish.report.summary import MeasureSummary

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


class Chart:
    """A drawing; `svg` has it once the ``with`` of `drawing` is left."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.svg = Markup()


@contextmanager
def drawing(name: str, label: str, height: float = HEIGHT) -> Iterator[Chart]:
    """Draw one chart.

    Parameters
    ----------
    name
        Stands before every id of the drawing: ids of a page are unique.
    label
        What the chart shows, for those who cannot see it.
    height
        Of the drawing, inches.
    """
    with matplotlib.style.context(STYLE, after_reset=True):
        figure = Figure(figsize=(WIDTH, height))
        size = (1 - (LEFT + RIGHT) / WIDTH, 1 - (BOTTOM + TOP) / height)
        chart = Chart(figure.add_axes((LEFT / WIDTH, BOTTOM / height, *size)))
        yield chart
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = re.sub(r"<(metadata|style)\b.*?</\1>", "", text.getvalue().partition("<svg")[2], flags=re.DOTALL)
    svg = re.sub(r'( id="|href="#|url\(#)', lambda found: f"{found[1]}{name}-", svg)
    svg = re.sub("|".join(COLOURS), lambda found: COLOURS[found[0]], svg)
    opening, _, rest = svg.partition(">")
    box = re.search(r'viewBox="[^"]*"', opening)
    assert box is not None
    chart.svg = Markup(f'<svg {box[0]} role="img" aria-label="{escape(label)}">{rest}')


def speed_error_chart(name: str, title: str, rows: Sequence[Mapping[str, Any]], column: str) -> Markup | None:
    """Draw error against `column` (``seconds_per_query`` or ``bytes``), one thin curve an object.

    The bold curve is the median over objects, setting by setting; of more than `MOST_CURVES` objects the
    middle nine tenths are a band. None where fewer than two settings were measured or `column` does not
    change with the setting.

    Parameters
    ----------
    rows
        Rows of one sense, as `tables.speed_error_rows` gives them.
    """
    known = [row for row in rows if _drawable(row, column)]
    median = sorted(
        (row[column], row["error"], row["label"]) for row in setting_medians(rows) if _drawable(row, column)
    )
    if len({x for x, _, _ in median}) < 2:
        return None
    timed = column == "seconds_per_query"
    x_label, y_label = "seconds a query" if timed else "bytes", known[0]["error_unit"]
    objects = dict.fromkeys(row["object"] for row in known)
    with drawing(f"{name}-{column}", f"{title}: {y_label} against {x_label}") as chart:
        axes = chart.axes
        if len(objects) > MOST_CURVES:
            axes.fill_between(*_band(known, column), color=CURVE, alpha=0.28)
        for object_id in objects if len(objects) <= MOST_CURVES else ():
            own = sorted((row[column], row["error"]) for row in known if row["object"] == object_id)
            axes.plot(*zip(*own, strict=True), color=CURVE, alpha=0.6, linewidth=0.8)
        axes.plot([x for x, _, _ in median], [y for _, y, _ in median], "o-", color=ACCENT, markersize=4)
        for x, y, text in median:
            axes.annotate(text, (x, y), (0, 5), textcoords="offset points", ha="center", fontsize=7)
        axes.set(xlabel=x_label, ylabel=y_label, xscale="log")
        axes.margins(0.12)
        mark(axes.xaxis, formats.seconds if timed else formats.megabytes)
    return chart.svg


def histogram(summary: MeasureSummary) -> tuple[Markup, bool]:
    """Draw how a measure is spread over the objects; a dashed line stands at its target.

    Returns
    -------
    tuple
        The drawing, and whether the target lies within it.
    """
    measure, values = summary.measure, [value for value, _ in summary.values]
    target, text = measure.target, partial(formats.number, decimals=measure.decimals)
    if measure.unit == "bytes":
        text = partial(formats.megabytes)
    within = target is not None and min(values) <= target <= max(values)
    with drawing(measure.key, f"Histogram of {measure.label}", height=1.4) as chart:
        chart.axes.hist(values, bins="sqrt", color=ACCENT, alpha=0.75, rwidth=0.9)
        if target is not None and within:
            chart.axes.axvline(target, color=INK, linestyle="--", linewidth=1)
        chart.axes.xaxis.set_major_locator(MaxNLocator(4))
        chart.axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
        chart.axes.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    return chart.svg, within


def mark(axis: Axis, text: Callable[[float], str]) -> None:
    """Put few marks that `text` prints on a logarithmic axis."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,), numticks=6))
    axis.set_major_formatter(FuncFormatter(lambda value, _: text(value)))
    axis.set_minor_locator(NullLocator())


def _drawable(row: Mapping[str, Any], column: str) -> bool:
    return row["error"] is not None and (row[column] or 0) > 0


def _band(rows: Sequence[Mapping[str, Any]], column: str) -> tuple[list[float], list[float], list[float]]:
    """Return median place, low and high error of each setting."""
    found = []
    for step in steps(rows).values():
        errors = np.quantile([row["error"] for row in step], BAND)
        found.append((float(np.median([row[column] for row in step])), *errors.tolist()))
    x, low, high = zip(*sorted(found), strict=True)
    return list(x), list(low), list(high)
