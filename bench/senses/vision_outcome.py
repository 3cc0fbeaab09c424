"""What `bench.senses.vision` measured, as means over objects, equal-error comparisons and a picture."""

from typing import Any

import numpy as np

from bench.record import save, subplots

COMPARED = (
    "VisionNet over its knob, Cycles over samples, ObjectFolder 1.0's network, textures unlit, lit and "
    "shadowed, and the mean colour in the true silhouette, against path-traced held-out views: PSNR of 8-bit "
    "sRGB on white (mean of views, and over pixels covered by at least half), SSIM, CPU seconds a view, bytes"
)
# Errors of the foreground at which CPU seconds are compared with those of Cycles.
FOREGROUND_DB = 40.0, 45.0, 50.0
MEASURES = ("psnr_db", "psnr_foreground_db", "ssim", "cpu_s", "cpu_s_alone", "bytes", "training_cpu_s")
LOOKS = {
    "VisionNet, compiled": ("tab:blue", "o-"),
    "VisionNet, reference": ("tab:cyan", "o-"),
    "Cycles": ("tab:red", "s-"),
    "ObjectFolder 1.0 network": ("tab:purple", "D"),
    "unlit texture": ("tab:gray", "v"),
    "lambert texture": ("tab:olive", "^"),
    "shadowed lambert texture": ("tab:green", "P"),
}
OTHER_LOOK = ("tab:brown", "o-")


def figures_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the rows of all objects and sizes with what follows from them, by size."""
    by_size: dict[str, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: row["size"]):
        by_size.setdefault(str(row["size"]), []).append(row)
    return {
        "rows": rows,
        "mean_over_objects": {size: mean_over_objects(found) for size, found in by_size.items()},
        "against_cycles_at_foreground_db": {size: at_foreground(found) for size, found in by_size.items()},
    }


def mean_over_objects(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean of every measure for each way and setting, over the objects that have it."""
    found: dict[tuple[str, Any], list[dict[str, Any]]] = {}
    for row in rows:
        for way in row["ways"]:
            found.setdefault((way["way"], way["setting"]), []).append(way)
    means = []
    for (name, setting), ways in found.items():
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


def label(way: dict[str, Any], most_objects: int) -> str:
    """Name of a way with what sets it apart from the others in a picture."""
    trained = "" if way["training_cpu_s"] is None else f", {way['training_cpu_s']:.0f} CPU s of training"
    objects = "" if way["objects"] == most_objects else f", {way['objects']} of {most_objects} objects"
    return f"{way['way']}{trained}{objects}"


def draw(figures: dict[str, Any]) -> None:
    """PSNR against seconds and against bytes, a row a size."""
    means = figures["mean_over_objects"]
    floors = {
        size: np.mean([row["truth_noise_floor_db"] for row in figures["rows"] if str(row["size"]) == size])
        for size in means
    }
    figure, axes = subplots(
        len(means), 2, figsize=(12, 4.4 * len(means)), squeeze=False, sharey="row", layout=None
    )
    for (size, found), (by_time, by_size) in zip(means.items(), axes, strict=True):
        objects = max(way["objects"] for way in found)
        for title in dict.fromkeys(way["way"] for way in found):
            ways = [way for way in found if way["way"] == title]
            colour, mark = LOOKS.get(title, OTHER_LOOK)
            if ways[0]["cpu_s"] is None:
                trivial = ways[0]["psnr_db"]
                by_time.axhline(trivial, color="black", lw=0.8, ls=":", label=f"{title} in the true outline")
                continue
            errors = [way["psnr_db"] for way in ways]
            by_time.plot(
                [way["cpu_s"] for way in ways], errors, mark, color=colour, label=label(ways[0], objects)
            )
            by_size.plot([way["bytes"] / 1e6 for way in ways], errors, mark[0], color=colour)
            if ways[0]["cpu_s_alone"] is not None:
                seconds = [way["cpu_s_alone"] for way in ways]
                by_time.plot(
                    seconds, errors, "s--", mfc="none", color=colour, label=f"{title}, one view alone"
                )
            for way in ways:
                if way["setting"] is not None:
                    by_time.annotate(
                        str(way["setting"]), (way["cpu_s"], way["psnr_db"]), fontsize=7,
                        xytext=(3, -9), textcoords="offset points",
                    )  # fmt: skip
        by_time.set(xscale="log", xlabel="CPU seconds a view, one thread", ylabel="PSNR on white, dB")
        by_time.set_title(
            f"{size} x {size}, objects: {objects}; noise floor of the truth {floors[size]:.0f} dB",
            fontsize=10,
        )
        by_size.set(xlabel="MB", xlim=(0, None))
        by_time.grid(alpha=0.3)
        by_size.grid(alpha=0.3)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="lower center", ncols=3, fontsize=8)
    figure.tight_layout(rect=(0, 0.5 / figure.get_figheight(), 1, 1))
    save(figure, "vision")
