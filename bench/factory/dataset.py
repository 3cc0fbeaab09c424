"""Samples a CPU-second of `ObjectFolderDataset` against reading whole products, on a data set at hand.

``python -m bench.factory.dataset ROOT`` takes training samples of the ground truth in random order over all
objects. The naive way is what a first script does: `read_product` of the sample's object with the arrays
that the sample needs, and one row of each. Both end with the same image or sound. Three rounds in turn;
medians.
"""

import argparse
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import arguments, conclude, save, subplots
from objectfolder.audio.synthesis import mode_bank
from objectfolder.dataset import ObjectFolderDataset
from objectfolder.products.store import read_product
from objectfolder.vision.compositing import on_white

ROUNDS = 3
NAIVE = {"vision": ("views", ("rgba",)), "touch": ("touches", ("rgb", "depth", "mask"))}


def main() -> None:
    """Measure, print, write."""
    parser = arguments(__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("--samples", type=int, default=300)
    parser.add_argument("--naive-samples", type=int, default=20)
    given = parser.parse_args()
    rows = [measure(given.root, sense, given) for sense in ("vision", "audio", "touch")]
    figures = {"ways": rows, "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3}
    objects = len(list((given.root / "data" / "views").glob("*.zarr.zip")))
    settings = {
        "objects": objects,
        "samples": given.samples,
        "naive_samples": given.naive_samples,
        "rounds": ROUNDS,
    }
    compared = "Training samples a CPU-second: rows of open products against whole arrays"
    conclude("dataset", figures, settings, compared, draw)


def measure(root: Path, sense: str, given: argparse.Namespace) -> dict[str, Any]:
    """Return samples a CPU-second of one sense, ours and naive, of the same samples."""
    samples = ObjectFolderDataset(root, sense)
    order = np.random.default_rng(0).permutation(len(samples))[: given.samples].tolist()
    agree(samples, root, sense, order[:3])
    rates: dict[str, list[float]] = {"ours": [], "naive": []}
    for _ in range(ROUNDS):
        fresh = ObjectFolderDataset(root, sense)  # nothing is open yet: opening counts
        rates["ours"].append(rate(lambda index, of=fresh: of[index], order))
        rates["naive"].append(
            rate(lambda index: naive(samples, root, sense, index), order[: given.naive_samples])
        )
    medians = {way: float(np.median(values)) for way, values in rates.items()}
    row = {"sense": sense, "length": len(samples), **medians, "ratio": medians["ours"] / medians["naive"]}
    print(row)
    return row


def rate(take: Callable[[int], Any], order: list[int]) -> float:
    """Return calls a CPU-second."""
    start = time.process_time()
    for index in order:
        take(index)
    return len(order) / (time.process_time() - start)


def naive(samples: ObjectFolderDataset, root: Path, sense: str, index: int) -> np.ndarray:
    """Return the image or sound of a sample from the whole arrays of its product."""
    object_id, row = samples.place(index)
    if sense == "audio":
        modes = read_product(root / f"data/modes/{object_id}.zarr.zip")
        rows = np.flatnonzero(~modes["held_out"])
        impulse = np.eye(3)[int(np.searchsorted(rows, row)) % 3]
        gains = (impulse @ modes["mode_shapes"][row].astype(np.float64)) * modes["radiation_weights"]
        sound = mode_bank(modes["eigenvalues"], modes["dampings_per_s"], gains[None], 1.0, 44100.0)
        return sound[0].astype(np.float32)
    kind, names = NAIVE[sense]
    product = read_product(root / f"data/{kind}/{object_id}.zarr.zip", names)
    rgb = product["rgb"][row] if sense == "touch" else on_white(product["rgba"][row].astype(np.float32))
    return rgb.transpose(2, 0, 1).astype(np.float32) / np.float32(255)


def agree(samples: ObjectFolderDataset, root: Path, sense: str, indices: list[int]) -> None:
    """Fail where the two ways differ: their times would mean nothing."""
    key = "sound" if sense == "audio" else "image"
    for index in indices:
        np.testing.assert_array_equal(samples[index][key].numpy(), naive(samples, root, sense, index))


def draw(figures: dict[str, Any]) -> None:
    """Write the plot."""
    rows = figures["ways"]
    figure, axes = subplots(figsize=(6, 3))
    places = np.arange(len(rows))
    for offset, way, label in ((-0.2, "ours", "ObjectFolderDataset"), (0.2, "naive", "whole arrays")):
        bars = axes.bar(places + offset, [row[way] for row in rows], 0.38, label=label)
        axes.bar_label(bars, fmt="%.3g")
    axes.set_xticks(places, [row["sense"] for row in rows])
    axes.set_yscale("log")
    axes.set_ylabel("samples a CPU-second")
    axes.margins(y=0.4)
    axes.legend()
    save(figure, "dataset")


if __name__ == "__main__":
    main()
