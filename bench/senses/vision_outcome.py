"""What `bench.senses.vision` measured, as means over objects, equal-error comparisons and a picture."""

from typing import Any

import numpy as np

from bench.record import save, subplots

COMPARED = (
    "VisionNet over its knob, Cycles over samples, ObjectFolder 1.0's network, textures unlit, lit and "
    "shadowed, and the mean colour in the true silhouette, against path-traced held-out views: PSNR of 8-bit "
    "sRGB on white (mean of views, and over pixels covered by at least half), SSIM, CPU seconds a view, bytes"
)
# A published VisionNet's error on its own data is 36 dB; this is what Cycles has with 16 samples.
WANTED_DB = 42.0
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
        "against_cycles_at_equal_error": {size: at_equal_error(found) for size, found in by_size.items()},
        "against_cycles_at_foreground_db": {size: at_foreground(found) for size, found in by_size.items()},
        f"seconds_at_{WANTED_DB:.0f}_db": {
            size: seconds_at(found, WANTED_DB) for size, found in by_size.items()
        },
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


def at_equal_error(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """How many times the CPU seconds of a setting Cycles takes to the same PSNR, for each object.

    Cycles' seconds at a PSNR are interpolated between its sample counts, their logarithm linearly. Beyond its
    ends there is no figure; the object is then counted as above or below.
    """
    compared: dict[tuple[str, Any], dict[str, Any]] = {}
    for row in rows:
        cycles = sorted(
            (way for way in row["ways"] if way["way"] == "Cycles"), key=lambda way: way["setting"]
        )
        errors = [way["psnr_db"] for way in cycles]
        for way in row["ways"]:
            if not way["way"].startswith("VisionNet"):
                continue
            entry = compared.setdefault(
                (way["way"], way["setting"]),
                {
                    "way": way["way"], "setting": way["setting"],
                    "times_faster": {}, "times_faster_alone": {},
                    "faster_than_paper_network": {},
                    "better_than_all_samples": [], "worse_than_one_sample": [],
                },
            )  # fmt: skip
            network = [one for one in row["ways"] if one["way"] == "ObjectFolder 1.0 network"]
            if network:
                entry["faster_than_paper_network"][row["object"]] = network[0]["cpu_s"] / way["cpu_s"]
            if way["psnr_db"] > errors[-1]:
                entry["better_than_all_samples"].append(row["object"])
            elif way["psnr_db"] < errors[0]:
                entry["worse_than_one_sample"].append(row["object"])
            else:
                for key, seconds in (("times_faster", "cpu_s"), ("times_faster_alone", "cpu_s_alone")):
                    log_s = np.interp(way["psnr_db"], errors, [np.log(one[seconds]) for one in cycles])
                    entry[key][row["object"]] = float(np.exp(log_s) / way["cpu_s"])
    for entry in compared.values():
        for key in ("times_faster", "times_faster_alone"):
            values = list(entry[key].values())
            entry[f"median_{key}"] = float(np.median(values)) if values else None
    return list(compared.values())


def at_foreground(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Cycles' CPU seconds at an error of the foreground over those of the cheapest setting that reaches it.

    Cycles' seconds are interpolated as in `at_equal_error`; an object is left out where all of its sample
    counts have more error or less.
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


def seconds_at(rows: list[dict[str, Any]], wanted_db: float) -> dict[str, dict[str, Any]]:
    """CPU seconds of each way's cheapest setting that reaches a PSNR, for each object; None if none does."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        for name in dict.fromkeys(way["way"] for way in row["ways"]):
            timed = [way for way in row["ways"] if way["way"] == name and way.get("cpu_s") is not None]
            reached = [way["cpu_s"] for way in timed if way["psnr_db"] >= wanted_db]
            if timed:
                entry = found.setdefault(name, {"objects": {}})
                entry["objects"][row["object"]] = min(reached, default=None)
    for entry in found.values():
        seconds = [value for value in entry["objects"].values() if value is not None]
        entry["mean"] = float(np.mean(seconds)) if seconds else None
        entry["not_reached"] = [name for name, value in entry["objects"].items() if value is None]
    return found


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
