"""Pictures of the page: decays of struck things, and how near simulated touches are to photographs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.reality.row import Row
from bench.record import subplots

DECAYS, PHOTOGRAPHS = "reality_decays.svg", "reality_photographs.svg"
DECIBELS = (("mean", "o", "tab:blue"), ("worst", "v", "tab:blue"), ("no touch", "x", "tab:gray"))


def draw(rows: Sequence[Row], folder: Path) -> None:
    """Write `DECAYS` and `PHOTOGRAPHS` of the rows into a folder."""
    decays = [row for row in rows if "factor" in row.quantity]
    _points(
        decays, (("rms", "o", "tab:blue"), ("median", "|", "tab:blue")), "decay, factor off", folder / DECAYS
    )
    touches = [row for row in rows if "PSNR" in row.quantity]
    _points(touches, DECIBELS, "PSNR, dB", folder / PHOTOGRAPHS)


def _points(rows: Sequence[Row], marks: Sequence[tuple[str, str, str]], label: str, path: Path) -> None:
    from matplotlib import pyplot, rc_context

    # Text as text, and no date: the same figures make the same file.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "reality"}):
        figure, axes = subplots(figsize=(8, 0.6 + 0.42 * len(rows)))
        _draw(axes, rows, marks)
        axes.set_xlabel(label)
        figure.savefig(path, metadata={"Date": None})
        pyplot.close(figure)


def _draw(axes: Any, rows: Sequence[Row], marks: Sequence[tuple[str, str, str]]) -> None:
    for name, marker, colour in marks:
        shown = [(row.figures[name], place) for place, row in enumerate(rows) if name in row.figures]
        if shown:
            axes.plot(*zip(*shown, strict=True), marker, color=colour, label=name, clip_on=False)
    labels = [f"{row.thing}\n{row.quantity.split(', PSNR')[0]}".replace("`", "") for row in rows]
    axes.set_yticks(range(len(rows)), labels, fontsize=7)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(axis="x", alpha=0.3)
    axes.legend(fontsize=7)
