"""What is measured on one device, with the objects and touches that it is measured on."""

import json
import os
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(os.environ.get("BENCH_RESULTS", Path(__file__).parents[1] / "results"))
LIMIT_S = 230.0
BATCHES = (1, 256, 4096, 16384)
REPEATS = 9
# Examples in the package by how their light is found.
LEARNED, KNOWN = ("mug", "bell"), ("bowl", "plate")
# Rays of an uneven pixel, rays of coverage, and the contrast of an uneven pixel; the second is the default.
EFFORTS: dict[str, dict[str, Any]] = {
    f"{sub_rays}_{coverage_rays}_{contrast}": {
        "sub_rays": sub_rays,
        "coverage_rays": coverage_rays,
        "contrast": contrast,
    }
    for sub_rays, coverage_rays, contrast in (
        (10, 0, 0.15), (11, 48, 0.15), (16, 256, 0.05), (32, 256, 0.02), (64, 256, 0.02)
    )
}  # fmt: skip
STARTED = time.monotonic()


class Run:
    """What is measured, on one device, and written after each part."""

    def __init__(self, on_cpu: bool, name: str) -> None:
        import torch

        self.torch, self.on_cpu, self.name = torch, on_cpu, name
        self.device = "cpu" if on_cpu else "cuda"
        self.batches = (1, 8) if on_cpu else BATCHES
        self.figures: dict[str, Any] = {}

    def part(self, name: str, work: Callable[["Run"], Any]) -> None:
        begin = time.monotonic()
        if begin - STARTED > LIMIT_S and not self.on_cpu:
            self.figures[name] = {"error": "no time was left"}
        else:
            try:
                self.figures[name] = work(self)
            except Exception as error:  # whatever it is, the other parts are measured
                where = traceback.format_exc().splitlines()[-12:]
                self.figures[name] = {"error": f"{type(error).__name__}: {error}"[:2000], "where": where}
        if isinstance(self.figures[name], dict):
            self.figures[name]["wall_s"] = round(time.monotonic() - begin, 2)
        print(name, json.dumps(self.figures[name]), flush=True)
        RESULTS.mkdir(parents=True, exist_ok=True)
        text = json.dumps(content(self.figures, self.name), indent=1)
        (RESULTS / f"{self.name}.json").write_text(f"{text}\n", encoding="utf-8")

    def seconds(self, work: Callable[[], Any], repeats: int = REPEATS) -> float:
        """Median seconds of some work after a first time, by events of the device."""
        work()
        if self.on_cpu:
            begin = time.process_time()
            work()
            return time.process_time() - begin
        times = []
        for _ in range(repeats):
            begin, end = (self.torch.cuda.Event(enable_timing=True) for _ in range(2))
            begin.record()
            work()
            end.record()
            end.synchronize()
            times.append(begin.elapsed_time(end) / 1e3)
        return float(np.median(times))

    def peak_gib(self) -> float:
        return 0.0 if self.on_cpu else round(self.torch.cuda.max_memory_allocated() / 2**30, 3)


def content(figures: dict[str, Any], name: str) -> dict[str, Any]:
    """Results in the form of `bench.record`, of which the host of a card needs nothing."""
    return {
        "name": name,
        "compared": "objectfolder.batch on a device against single queries on the CPU beside it; throughput",
        "figures": {name: part for name, part in figures.items() if name != "versions"},
        "settings": {
            "objects": [*LEARNED],
            "objects_of_known_material": [*KNOWN],
            "image_px": [160, 120],
            "view_px": 128,
            "repeats": REPEATS,
        },
        "versions": figures.get("versions", {}),
    }


def versions(run: Run) -> dict[str, Any]:
    import numba
    import scipy

    warnings.simplefilter("ignore")  # that small batches do not fill a card
    figures = {
        "python": sys.version.split()[0],
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
        "torch": run.torch.__version__,
        "torch_cuda": run.torch.version.cuda,
    }
    try:
        import numba_cuda

        figures["numba_cuda"] = numba_cuda.__version__
    except ImportError as error:
        figures["numba_cuda"] = str(error)
    if run.on_cpu:
        return {**figures, "card": "none: a CPU"}
    command = [
        "nvidia-smi",
        "--query-gpu=name,driver_version,memory.total,clocks.sm",
        "--format=csv,noheader",
    ]
    figures["nvidia_smi"] = subprocess.run(
        command, capture_output=True, text=True, check=False
    ).stdout.strip()
    figures["card"] = run.torch.cuda.get_device_name(0)
    from numba import cuda

    figures["numba_cuda_module"] = Path(cuda.__file__).parent.as_posix().rpartition("site-packages/")[2]
    figures["compute_capability"] = list(cuda.get_current_device().compute_capability)
    return figures


def objects(names: Sequence[str] = LEARNED) -> list[Any]:
    import objectfolder

    return [objectfolder.example(name) for name in names]


def touches(count: int, files: list[Any], seed: int = 0) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Objects, points and the rest of presses, mixed; from 4,096 on they repeat."""
    random, draws = np.random.default_rng(seed), min(count, 4096)
    which = random.integers(0, len(files), draws)
    points = np.empty((draws, 3))
    for index, file in enumerate(files):
        rows = np.flatnonzero(which == index)
        points[rows] = file.sample_contacts(len(rows), seed=seed, reachable=False)[0]
    ranges = {"depth_m": (0.0002, 0.002), "tilt_deg": (0.0, 30.0), "azimuth_deg": (0.0, 360.0)}
    ranges["roll_deg"] = (0.0, 360.0)
    turns = {name: np.resize(random.uniform(*limits, draws), count) for name, limits in ranges.items()}
    return np.resize(which, count), np.resize(points, (count, 3)), turns
