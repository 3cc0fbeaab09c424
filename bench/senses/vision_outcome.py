"""What `bench.senses.vision` measured, as means over objects, and at equal error."""

from typing import Any

import numpy as np

COMPARED = (
    "VisionNet over its knob, Cycles over samples, ObjectFolder 1.0's network, textures unlit, lit and "
    "shadowed, and the mean colour in the true silhouette, against path-traced held-out views: PSNR of 8-bit "
    "sRGB on white (mean of views, and over pixels covered by at least half), SSIM, CPU seconds a view, bytes"
)
# Errors of the foreground at which CPU seconds are compared with those of Cycles.
FOREGROUND_DB = 40.0, 45.0, 50.0
MEASURES = ("psnr_db", "psnr_foreground_db", "ssim", "cpu_s", "cpu_s_alone", "bytes", "training_cpu_s")


def figures_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the rows of all objects and sizes with what follows from them, by size."""
    by_size: dict[str, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: row["size"]):
        by_size.setdefault(str(row["size"]), []).append(row)
    return {
        "rows": rows,
        "mean_over_objects": {size: mean_over_objects(group) for size, group in by_size.items()},
        "against_cycles_at_foreground_db": {size: at_foreground(group) for size, group in by_size.items()},
    }


def mean_over_objects(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean of every measure for each way and setting, over the objects that have it."""
    groups: dict[tuple[str, Any], list[dict[str, Any]]] = {}
    for row in rows:
        for way in row["ways"]:
            groups.setdefault((way["way"], way["setting"]), []).append(way)
    means = []
    for (name, setting), ways in groups.items():
        mean: dict[str, Any] = {"way": name, "setting": setting, "objects": len(ways)}
        for key in MEASURES:
            values = [way[key] for way in ways if way.get(key) is not None]
            mean[key] = float(np.mean(values)) if values else None
        means.append(mean)
    return means


def at_foreground(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Cycles' CPU seconds at an error of the foreground over those of the cheapest setting that reaches it.

    Cycles' seconds at an error are interpolated between its sample counts, their logarithm linearly; an
    object is left out where all of its sample counts have more error or less.
    """
    compared: dict[str, dict[str, Any]] = {}
    for level in FOREGROUND_DB:
        times: dict[str, float] = {}
        missed = []
        for row in rows:
            cycles = sorted(
                (way for way in row["ways"] if way["way"] == "Cycles"), key=lambda way: way["setting"]
            )
            own = [way for way in row["ways"] if way["way"] == "VisionNet, compiled"]
            seconds = [way["cpu_s"] for way in own if way["psnr_foreground_db"] >= level]
            errors = [way["psnr_foreground_db"] for way in cycles]
            if not seconds:
                missed.append(row["object"])
            elif errors[0] <= level <= errors[-1]:
                log_s = np.interp(level, errors, [np.log(way["cpu_s"]) for way in cycles])
                times[row["object"]] = float(np.exp(log_s) / min(seconds))
        compared[f"{level:.0f}"] = {
            "times_faster": times,
            "median_times_faster": float(np.median(list(times.values()))) if times else None,
            "not_reached": missed,
        }
    return compared
