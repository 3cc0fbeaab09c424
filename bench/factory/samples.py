"""Samples a CPU-second of `ObjectFolderDataset`, of truth and of Object Files, on a data set at hand.

``python -m bench samples ROOT`` takes batches of training samples on one core, as `DataLoader` gives
them without workers: in random order over all objects, and by `ObjectBatches`. What opening costs, once an
object, is measured by itself. Rounds in turn; medians. A sample of each batch is asked for alone, too, and
must be the same.
"""

import argparse
import time
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import DataLoader

from bench.record import arguments, conclude
from objectfolder.dataset import ObjectBatches, ObjectFolderDataset

ROUNDS = 3
# Samples a CPU-second that are enough, and how the samples are asked for.
CASES: tuple[tuple[str, str, int | None, dict[str, Any]], ...] = (
    ("views, 128x128", "vision", 200, {"source": "truth"}),
    ("sounds, 1 s", "audio", 500, {"source": "truth"}),
    ("touches, 160x120", "touch", 500, {"source": "truth"}),
    ("views, 4 sub-rays", "vision", 60, {"source": "object_file", "sub_rays": 4}),
    ("views, 64 sub-rays", "vision", None, {"source": "object_file", "sub_rays": 64}),
    ("sounds, 1 s", "audio", 300, {"source": "object_file"}),
    ("touches, 160x120", "touch", 400, {"source": "object_file"}),
)


def main() -> None:
    """Measure, print, write."""
    parser = arguments(__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("--batches", type=int, default=20)
    parser.add_argument("--batch-size", type=int, default=32)
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for case, sense, goal, settings in CASES:
        measurements = [measure(options, sense, settings, seed) for seed in range(ROUNDS)]
        row = {
            key: float(np.median([measurement[key] for measurement in measurements]))
            for key in measurements[0]
        }
        rows.append({"case": case, "source": settings["source"], "enough": goal, **row})
        print(rows[-1], flush=True)
    objects = len(list((options.root / "data" / "views").glob("*.zarr.zip")))
    settings = {
        "objects": objects,
        "batches": options.batches,
        "batch_size": options.batch_size,
        "rounds": ROUNDS,
    }
    compared = "Training samples a CPU-second in batches: shuffled over all objects, and of four at a time"
    conclude("samples", {"ways": rows}, settings, compared)


def measure(options: argparse.Namespace, sense: str, settings: dict[str, Any], seed: int) -> dict[str, float]:
    """Return samples a CPU-second of both orders, and the CPU seconds of opening an object."""
    samples = ObjectFolderDataset(options.root, sense, **settings)
    firsts = [start for start, _ in samples.ranges()]
    if seed == 0:
        samples.__getitems__(firsts)  # kernels are compiled
    samples = ObjectFolderDataset(options.root, sense, **settings)
    start = time.process_time()
    samples.__getitems__(firsts)
    opening = time.process_time() - start
    shuffled = torch.Generator().manual_seed(seed)
    loaders = {
        "shuffled": DataLoader(samples, options.batch_size, shuffle=True, generator=shuffled),
        "few_objects": DataLoader(
            samples, batch_sampler=ObjectBatches(samples, options.batch_size, seed=seed)
        ),
    }
    figures = {"opening_cpu_s": opening / len(firsts)}
    for name, loader in loaders.items():
        start = time.process_time()
        batches = list(islice(loader, options.batches))
        seconds = time.process_time() - start
        figures[name] = sum(len(batch["query"]) for batch in batches) / seconds
        for batch in batches:
            agree(samples, batch)
    return figures


def agree(samples: ObjectFolderDataset, batch: dict[str, Any]) -> None:
    """Fail where the first sample of a batch is another one when it is asked for alone."""
    place = samples.object_ids.index(batch["object_id"][0])
    index = next(i for i in range(*samples.ranges()[place]) if samples.place(i)[1] == int(batch["query"][0]))
    key = "sound" if samples.sense == "audio" else "image"
    assert torch.equal(samples[index][key], batch[key][0])
