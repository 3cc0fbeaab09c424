"""Modes of every scan of a catalogue: seconds, estimated errors, and what failed and why.

    python -m bench.senses.scans --folder FOLDER [--objects CATALOGUE.csv] [--part 1/2]

Each object's row is kept in FOLDER and not measured again,
so that a run can be stopped, taken up and shared between processes with `--part`; the process that finds all
rows there writes the result. Solved modes are kept as ``modes/ID.zarr.zip`` for the objects of
`bench.senses.audionet`.
"""

import os
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import conclude, cpu_seconds, kept, save, subplots
from bench.senses.audionet import HELD_OUT_POINTS, OBJECTS, TRAINING_POINTS
from bench.senses.catalogue import Scans, scan_arguments
from objectfolder.audio.modes.modes import modes_of_solid, waves_of
from objectfolder.errors import ObjectFolderError
from objectfolder.products.store import write_product
from objectfolder.solid.filling import fill

MAX_FREQUENCY_HZ, MAX_MODES = 20_000.0, 128


def main() -> None:
    parser = scan_arguments("modes of every scan of a catalogue", "rows and modes")
    parser.add_argument("--part", default="1/1", help="which share of the objects, as 1/2")
    given = parser.parse_args()
    scans = Scans(given.objects)
    # Those that another comparison reads come first.
    names = sorted(scans.ids, key=lambda name: (name not in OBJECTS, name))
    paths = {name: given.folder / f"{name}.json" for name in names}
    share, shares = map(int, given.part.split("/"))
    for name in names[share - 1 :: shares]:
        print(name, kept(paths[name], lambda at=name: measure(scans, at, given.folder)), flush=True)
    if all(path.exists() for path in paths.values()):
        table = {name: kept(path, dict) for name, path in paths.items()}
        conclude("scans", figures(table), settings(), COMPARED, draw)


COMPARED = (
    "Estimated error of the first 50 audible modes of each object (objectfolder/audio/modes/adaptive.py) and "
    "CPU seconds of filling and solving, mode shapes at points included; defaults of simulate_modes"
)


def settings() -> dict[str, Any]:
    return {
        "max_frequency_hz": MAX_FREQUENCY_HZ,
        "max_modes": MAX_MODES,
        "points": f"4000 and 400, {TRAINING_POINTS} and {HELD_OUT_POINTS} for those of bench.senses.audionet",
        "threads": os.environ.get("OPENBLAS_NUM_THREADS", "all"),
        "times": "CPU seconds, child processes included",
    }


def measure(scans: Scans, name: str, folder: Path) -> dict[str, Any]:
    """One object's row."""
    surface, material = scans.surface(name), scans.material(name)
    many = name in OBJECTS
    forget_peak_memory()
    start = cpu_seconds()
    try:
        solid = fill(surface, waves=waves_of(material, MAX_FREQUENCY_HZ, MAX_MODES), name=name)
        filled = cpu_seconds()
        modes = modes_of_solid(
            surface,
            solid,
            material,
            max_frequency_hz=MAX_FREQUENCY_HZ,
            max_modes=MAX_MODES,
            training_points=TRAINING_POINTS if many else 4000,
            held_out_points=HELD_OUT_POINTS if many else 400,
            seed=0,
        )
    except ObjectFolderError as error:
        return {"failure": str(error), "cpu_s": cpu_seconds() - start}
    except Exception:
        return {"failure": traceback.format_exc(limit=1), "cpu_s": cpu_seconds() - start}
    done = cpu_seconds()
    if many:
        (folder / "modes").mkdir(exist_ok=True)
        write_product(folder / "modes" / f"{name}.zarr.zip", modes)
    errors = modes["error_estimates_cents"]
    errors = errors[np.isfinite(errors)]
    attributes = modes.attributes
    what = attributes["discretisation"]
    return {
        "failure": None,
        "modes": len(modes["eigenvalues"]),
        "certificate_holds": attributes["count_certificate"]["holds"],
        "error_cents": errors.tolist(),
        "error_median_cents": float(np.median(errors)) if len(errors) else None,
        "error_worst_cents": float(errors.max()) if len(errors) else None,
        "unknowns": what["unknowns"],
        "elements": what["elements"],
        "way": what.get("way"),
        "volume_error": what.get("volume_error"),
        "surface_error_rms_m": what.get("surface_error_rms_m"),
        "transfer_distance_max_m": attributes["transfer_distance_max_m"],
        "fill_cpu_s": filled - start,
        "solve_cpu_s": done - filled,
        "cpu_s": done - start,
        "peak_memory_mb": peak_memory_mb(),
    }


def forget_peak_memory() -> None:
    """Begin the largest memory of this process anew (Linux, proc(5): clear_refs)."""
    Path("/proc/self/clear_refs").write_text("5")


def peak_memory_mb() -> float:
    """Return the largest resident memory since `forget_peak_memory`, in MB of 10^6 bytes."""
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
    return int(line.split()[1]) * 1024 / 1e6


def figures(table: dict[str, dict[str, Any]]) -> dict[str, Any]:
    solved = [row for row in table.values() if row["failure"] is None]
    audible = [row for row in solved if row["modes"]]
    pooled = np.concatenate([row["error_cents"] for row in audible])
    seconds = [row["cpu_s"] for row in table.values()]
    return {
        "objects": {
            name: {k: v for k, v in row.items() if k != "error_cents"} for name, row in table.items()
        },
        "answered": len(solved),
        "failed": {name: row["failure"] for name, row in table.items() if row["failure"]},
        "without_an_audible_mode": len(solved) - len(audible),
        "error_cents": {
            "median_over_all_modes": float(np.median(pooled)),
            "median_over_objects_of_their_median": median(audible, "error_median_cents"),
            "median_over_objects_of_their_worst": median(audible, "error_worst_cents"),
            "share_of_modes_within_10": float(np.mean(pooled <= 10)),
        },
        "cpu_s": {"median": float(np.median(seconds)), "largest": max(seconds), "sum": sum(seconds)},
        "peak_memory_mb": {
            "median": median(solved, "peak_memory_mb"),
            "largest": max(row["peak_memory_mb"] for row in solved),
        },
    }


def median(rows: list[dict[str, Any]], key: str) -> float:
    return float(np.median([row[key] for row in rows]))


def draw(figures: dict[str, Any]) -> None:
    shown = [row for row in figures["objects"].values() if row["failure"] is None and row["modes"]]
    picture, axes = subplots(figsize=(7, 4.5))
    seconds = [row["cpu_s"] for row in shown]
    axes.scatter(seconds, [row["error_median_cents"] for row in shown], s=18, label="median of its modes")
    axes.scatter(seconds, [row["error_worst_cents"] for row in shown], s=18, marker="x", label="worst mode")
    axes.axhline(10, color="grey", linewidth=0.8)
    axes.set(
        xscale="log", yscale="log", xlabel="CPU seconds, filling and solving", ylabel="estimated error, cents"
    )
    axes.legend()
    axes.set_title("Scans: estimated error of the first 50 audible modes")
    save(picture, "scans")


if __name__ == "__main__":
    main()
