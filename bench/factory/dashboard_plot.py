"""The picture of ``bench.factory.dashboard``: what a report of a thousand objects takes."""

from collections.abc import Mapping
from typing import Any

from bench.record import save, subplots

TARGET_CPU_S = 60.0
TARGET_MS = 100.0


def plot(figures: Mapping[str, Any]) -> None:
    figure, (left, right) = subplots(1, 2, figsize=(9, 3.2))
    rows = {f"all pages, {pairs} queries a sense": each["cpu_s"] for pairs, each in figures["whole"].items()}
    rows |= {
        "one object changed": figures["one_changed"]["cpu_s"],
        "nothing changed": figures["again"]["cpu_s"],
    }
    bars(left, rows, TARGET_CPU_S, "CPU seconds, 1,000 objects", "{:.1f}")
    times = {
        name.removesuffix("_ms").replace("_", " "): each["median"]
        for name, each in figures["browser"].items()
        if name.endswith("_ms") and name not in ("loaded_ms", "first_contentful_paint_ms")
    }
    bars(right, times, TARGET_MS, "milliseconds to the next paint, median", "{:.0f}")
    save(figure, "dashboard")


def bars(axes: Any, rows: Mapping[str, float], target: float, label: str, form: str) -> None:
    places = range(len(rows))
    drawn = axes.barh(places, list(rows.values()), color="#1b5c95")
    axes.bar_label(drawn, [form.format(value) for value in rows.values()], padding=3)
    axes.axvline(target, color="#444", linestyle="--", linewidth=1)
    axes.set_yticks(places, list(rows))
    axes.invert_yaxis()
    axes.set_xlim(0, 1.15 * max(target, *rows.values()))
    axes.set_xlabel(label)
    axes.spines[["top", "right"]].set_visible(False)
