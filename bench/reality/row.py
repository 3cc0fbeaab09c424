"""A line of the comparison with real things, and the page that they fill."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby


@dataclass(frozen=True)
class Aim:
    """What a figure of a line is to reach: at least a value, or at most; of its size, whatever its sign."""

    figure: str
    least: float | None = None
    most: float | None = None

    def verdict(self, figures: Mapping[str, float]) -> str:
        """Return the aim, and whether the figure meets it or by how much not."""
        value = abs(figures[self.figure])
        short = (self.least or 0.0) - value if self.least is not None else value - (self.most or 0.0)
        bound = f"at least {self.least:g}" if self.least is not None else f"at most {self.most:g}"
        outcome = "met" if short <= 0 else f"**missed by {short:.3g}**"
        return f"{self.figure} {bound}: {outcome}"


@dataclass(frozen=True)
class Row:
    """How far one quantity of the product is from its measurement.

    Attributes
    ----------
    sense : sound or touch, by which the page groups its lines
    thing : what was measured, with whose instrument
    quantity : what is compared, with its unit
    figures : distances of the product from the measurement by name, such as ``median`` and ``worst``
    repeatability : how far the measurement is from itself; empty where nobody says
    fitted : what was fitted to this thing, and to which part of it; empty where nothing was
    held_out : which part of the measurement the figures are of
    source : citation of the measurement
    cpu_s : CPU seconds that the product took
    aims : what some of the figures are to reach
    """

    sense: str
    thing: str
    quantity: str
    figures: dict[str, float]
    repeatability: str
    fitted: str
    held_out: str
    source: str
    cpu_s: float
    aims: tuple[Aim, ...] = ()


INTRODUCTION = """\
# How far each sense is from the world

The product against measurements of real things. Each line says what was fitted to the thing, and which part
of its measurement was held out, of which the figures are. Aims were set before; a line without one informs.
`make reality` computes the page from a folder of measurements, which are not part of the repository; the
sources name who published them. The figures are those of `bench/results/reality.json`.
"""
COLUMNS = (
    "thing", "quantity", "product against measurement", "aim", "measurement against itself", "fitted",
    "held out", "CPU-s",
)  # fmt: skip
HEADER = f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}\n"


def page(rows: Iterable[Row], pictures: Mapping[str, str] | None = None) -> str:
    """Return ``docs/reality.md``: a table for each sense, then its picture, if any; then the sources."""
    ordered = list(rows)
    parts = [INTRODUCTION]
    for sense, lines in groupby(ordered, lambda row: row.sense):
        parts.append(f"\n## {sense.capitalize()}\n{HEADER}" + "".join(map(_line, lines)))
        if pictures and sense in pictures:
            parts.append(f"\n![{sense.capitalize()} against measurements]({pictures[sense]})\n")
    sources = dict.fromkeys(f"- {row.thing}: {row.source}\n" for row in ordered)
    parts.append("\n## Sources\n" + "".join(sources))
    return "".join(parts)


def _line(row: Row) -> str:
    figures = ", ".join(f"{name} {value:.3g}" for name, value in row.figures.items())
    cells = (
        row.thing,
        row.quantity,
        figures,
        "; ".join(aim.verdict(row.figures) for aim in row.aims) or "none",
        row.repeatability or "not known",
        row.fitted or "nothing",
        row.held_out,
        f"{row.cpu_s:.1f}",
    )
    return f"| {' | '.join(cells)} |\n"
