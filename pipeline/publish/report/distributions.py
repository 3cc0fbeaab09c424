"""How a measure is spread over the objects, as a drawn histogram: positions only, the template draws them."""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.dataset.measures import Measure
from pipeline.publish.report import formats
from pipeline.publish.report.object_records import Record

WIDTH, HEIGHT = 280.0, 112.0
LEFT, RIGHT, TOP, BOTTOM = 6.0, 6.0, 12.0, 22.0
FEWEST_BARS, MOST_BARS = 8, 28


@dataclass(frozen=True)
class Bar:
    """A bar, and for how many objects it stands."""

    x: float
    y: float
    width: float
    height: float
    title: str


@dataclass(frozen=True)
class Distribution:
    """A histogram of one measure.

    Parameters
    ----------
    label, unit
        Of the measure.
    summary
        In words: how many objects, median, worst and which it is.
    bars, ticks
        Ticks are positions and texts.
    target_x
        Where the target lies; None without one or outside of the drawing.
    """

    label: str
    unit: str
    summary: str
    worst_object: str
    bars: list[Bar]
    ticks: list[tuple[float, str, str]]
    target_x: float | None
    target: str
    width: float = WIDTH
    height: float = HEIGHT
    base: float = HEIGHT - BOTTOM
    top: float = TOP


def measure_distribution(measure: Measure, records: Sequence[Record]) -> Distribution | None:
    """Draw a measure over the objects that have it; silent objects leave those of audio."""
    known = [
        (value, record.object_id)
        for record in records
        if (value := measure.of(record.attributes)) is not None
        and not (measure.sense == "audio" and record.silent)
    ]
    if not known:
        return None
    worst = measure.worst([value for value, _ in known])
    in_bytes = measure.unit == "bytes"
    return distribution(
        measure.label,
        "" if in_bytes else measure.unit,
        [value for value, _ in known],
        formats.short_bytes if in_bytes else lambda value: formats.number(value, measure.decimals),
        worst,
        next(object_id for value, object_id in known if value == worst),
        measure.target,
    )


def distribution(
    label: str,
    unit: str,
    values: Sequence[float],
    text: Callable[[float], str],
    worst: float,
    worst_object: str,
    target: float | None = None,
) -> Distribution:
    """Draw one or more values; bars are of equal width from the least to the greatest."""
    low, high = min(values), max(values)
    if high <= low:
        low, high = low - (abs(low) or 1.0) * 0.05, high + (abs(high) or 1.0) * 0.05
    count = min(MOST_BARS, max(FEWEST_BARS, round(2 * math.sqrt(len(values)))))
    tallies = [0] * count
    for value in values:
        tallies[min(count - 1, int((value - low) / (high - low) * count))] += 1
    pitch = (WIDTH - LEFT - RIGHT) / count
    room = HEIGHT - BOTTOM - TOP
    bars = []
    for index, tally in enumerate(tallies):
        edges = [text(low + (high - low) * place / count) for place in (index, index + 1)]
        tall = round(room * tally / max(tallies), 1)
        title = f"{tally} object{'' if tally == 1 else 's'} from {edges[0]} to {edges[1]} {unit}".rstrip()
        x = round(LEFT + index * pitch + 0.75, 1)
        bars.append(Bar(x, round(HEIGHT - BOTTOM - tall, 1), round(pitch - 1.5, 1), tall, title))
    objects = f"{len(values)} object{'' if len(values) == 1 else 's'}"
    return Distribution(
        label,
        unit,
        f"{objects}: median {text(statistics.median(values))}, worst {text(worst)}",
        worst_object,
        [bar for bar in bars if bar.height],
        [
            (LEFT, "start", text(low)),
            (WIDTH / 2, "middle", text((low + high) / 2)),
            (WIDTH - RIGHT, "end", text(high)),
        ],
        round(LEFT + (target - low) / (high - low) * (WIDTH - LEFT - RIGHT), 1)
        if target is not None and low <= target <= high
        else None,
        "" if target is None else text(target),
    )
