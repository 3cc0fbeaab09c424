"""What `bench.senses.touch` measured, over objects, and beside its bars."""

from typing import Any

import numpy as np

MEASURES = ("cpu_s", "psnr_db", "psnr_contact_db", "psnr_contact_worst_db", "ssim", "bytes")

Row = dict[str, Any]


def summarised(
    speed: list[Row], elastic: list[Row], encoded: list[Row], opened: Row | None, bars: dict[str, float]
) -> Row:
    """Means over objects, and which bars are met by what."""
    sizes = _sizes(speed)
    times_pyrender = _times(speed, "pyrender")
    solves = {body: _harmonic(elastic, body) for body in ("half-space", "layer")}
    encoding = {
        "objects": len(encoded),
        "median_bytes": float(np.median([row["bytes"] for row in encoded])),
        "largest_bytes": max(row["bytes"] for row in encoded),
        "farthest_vertex_m": max(row["farthest_vertex_m"] for row in encoded),
        "pair_ms_median": float(np.median([row["pair_ms"] for row in encoded])),
        "pair_ms_worst": max(row["pair_ms"] for row in encoded),
        "unreachable_share": {row["object"]: row["unreachable_share"] for row in encoded},
        "images_deeper_than_their_label": sum(row["images_deeper_than_their_label"] for row in encoded),
    }
    encoding["turned_median_bytes"] = float(np.median([row["turned_bytes"] for row in encoded]))
    for case in ("normal", "tilted", "turned", "normal_reachable", "tilted_reachable"):
        values = [row[case]["psnr_contact_db"] for row in encoded if case in row]
        values = [value for value in values if value is not None]
        encoding[f"{case}_contact_psnr_db"] = float(np.mean(values))
        encoding[f"{case}_contact_psnr_worst_object_db"] = float(np.min(values))
    found = {
        f"touches_a_cpu_s_{height}x{width}, {samples} x {samples} samples": rate
        for (height, width, samples), rate in sizes.items()
    }
    pair_ms = encoding["pair_ms_worst"] if opened is None else opened["pair_ms"]
    met: Row = {}
    for samples in (1, 2):
        for size, bar in (("160x120", "160x120"), ("320x240", "320x240")):
            key = f"touches_a_cpu_s_{size}, {samples} x {samples} samples"
            if key in found:
                met[key] = found[key] >= bars[f"touches_a_cpu_s_{bar}"]
        times = times_pyrender.get(f"ours, {samples}")
        if times is not None:
            met[f"times_pyrender, {samples} x {samples} samples"] = times >= bars["times_pyrender"]
    met |= {f"elastic, {body}": rate >= bars["elastic_solves_a_cpu_s"] for body, rate in solves.items()}
    met["stored_surface_median_bytes"] = encoding["median_bytes"] <= bars["stored_surface_median_bytes"]
    met["contact_psnr_db"] = encoding["normal_contact_psnr_db"] >= bars["contact_psnr_db"]
    met["contact_psnr_tilted_db"] = encoding["tilted_contact_psnr_db"] >= bars["contact_psnr_tilted_db"]
    met["contact_psnr_tilted_db, turned"] = (
        encoding["turned_contact_psnr_db"] >= bars["contact_psnr_tilted_db"]
    )
    met["stored_surface_median_bytes, turned"] = (
        encoding["turned_median_bytes"] <= bars["stored_surface_median_bytes"]
    )
    met["pair_ms"] = pair_ms <= bars["pair_ms"]
    return {
        "ways": _ways(speed),
        "times_faster_than_pyrender": times_pyrender,
        "times_faster_than_ray_casting": _times(speed, "ray casting"),
        "sizes": [
            {"height": h, "width": w, "samples": s, "touches_a_cpu_s": rate}
            for (h, w, s), rate in sizes.items()
        ],
        "elastic_solves_a_cpu_s": solves,
        "elastic_touches_a_cpu_s": float(np.median([row["elastic_touches_a_cpu_s"] for row in elastic])),
        "encoding": encoding,
        "object_file": opened,
        "bars_met": {key: bool(value) for key, value in met.items()},
    }


def _ways(speed: list[Row]) -> list[Row]:
    """Mean of each measure over the objects that have the way."""
    groups: dict[tuple[str, Any], list[Row]] = {}
    for row in speed:
        for way in row["ways"]:
            groups.setdefault((way["way"], way["setting"]), []).append(way)
    means = []
    for (name, setting), ways in groups.items():
        mean: Row = {"way": name, "setting": setting, "objects": len(ways)}
        for key in (*MEASURES, "training_cpu_s", "training_steps", "psnr_contact_training_db"):
            values = [way[key] for way in ways if way.get(key) is not None]
            if values:
                mean[key] = float(np.mean(values))
        means.append(mean)
    return means


def _times(speed: list[Row], rival: str) -> dict[str, float]:
    """How many times the seconds of each of our settings a rival takes, median over objects."""
    ratios: dict[str, list[float]] = {}
    for row in speed:
        slow = next(way["cpu_s"] for way in row["ways"] if way["way"] == rival)
        for way in row["ways"]:
            if way["way"].startswith("ours"):
                ratios.setdefault(f"{way['way']}, {way['setting']}", []).append(slow / way["cpu_s"])
    return {key: float(np.median(values)) for key, values in ratios.items()}


def _sizes(speed: list[Row]) -> dict[tuple[int, int, int], float]:
    """Touches a CPU second, median over objects, by height, width and samples."""
    rates: dict[tuple[int, int, int], list[float]] = {}
    for row in speed:
        for size in row["sizes"]:
            key = (size["height"], size["width"], size["samples"])
            rates.setdefault(key, []).append(size["touches_a_cpu_s"])
    return {key: float(np.median(values)) for key, values in rates.items()}


def _harmonic(elastic: list[Row], body: str) -> float:
    """Solves a CPU second over all contacts of a body."""
    rows = [solve for row in elastic for solve in row["solves"] if solve["body"] == body]
    count = sum(row["contacts"] for row in rows)
    return float(count / sum(row["contacts"] / row["solves_a_cpu_s"] for row in rows))
