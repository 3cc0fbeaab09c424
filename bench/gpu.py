"""Answers and throughput of `objectfolder.batch` on a graphics processor: ``python -m bench.gpu``.

Unattended, within 4 minutes, after nothing but numba-cuda and torch is installed. Each part is written to
``bench/results/gpu.json`` when it is done; one that fails leaves its error there, and the next begins.
``--cpu`` runs every line on a CPU, with small batches.
"""

import argparse
import json
import os
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(os.environ.get("BENCH_RESULTS", Path(__file__).with_name("results"))) / "gpu.json"
LIMIT_S = 230.0
BATCHES = (1, 256, 4096, 16384)
REPEATS = 9
STARTED = time.monotonic()


class Run:
    """What is measured, on one device, and written after each part."""

    def __init__(self, on_cpu: bool) -> None:
        import torch

        self.torch, self.on_cpu = torch, on_cpu
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
        RESULTS.parent.mkdir(parents=True, exist_ok=True)
        RESULTS.write_text(json.dumps(content(self.figures), indent=1) + "\n", encoding="utf-8")

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


def content(figures: dict[str, Any]) -> dict[str, Any]:
    """Results in the form of `bench.record`, of which the host of a card needs nothing."""
    return {
        "name": "gpu",
        "compared": "objectfolder.batch on a device against single queries on the CPU beside it; throughput",
        "figures": {name: part for name, part in figures.items() if name != "versions"},
        "settings": {"objects": ["mug", "bell"], "image_px": [160, 120], "view_px": 128, "repeats": REPEATS},
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
    asked = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total,clocks.sm", "--format=csv,noheader"]
    figures["nvidia_smi"] = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()
    figures["card"] = run.torch.cuda.get_device_name(0)
    from numba import cuda

    figures["numba_cuda_module"] = Path(cuda.__file__).parent.as_posix().rpartition("site-packages/")[2]
    figures["compute_capability"] = list(cuda.get_current_device().compute_capability)
    return figures


def objects() -> list[Any]:
    import objectfolder

    return [objectfolder.example("mug"), objectfolder.example("bell")]


def touches(
    count: int, files: list[Any], seed: int = 0
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Objects, points and the rest of presses, mixed."""
    random = np.random.default_rng(seed)
    which = random.integers(0, len(files), count)
    points = np.empty((count, 3))
    for index, file in enumerate(files):
        rows = np.flatnonzero(which == index)
        points[rows] = file.sample_contacts(len(rows), seed=seed, reachable=False)[0]
    ranges = {"depth_m": (0.0002, 0.002), "tilt_deg": (0.0, 30.0), "azimuth_deg": (0.0, 360.0)}
    ranges["roll_deg"] = (0.0, 360.0)
    return which, points, {name: random.uniform(*limits, count) for name, limits in ranges.items()}


def touch_equality(run: Run, precision: str, count: int) -> dict[str, Any]:
    """Against `press`, one touch at a time."""
    from objectfolder.batch import Batch

    files = objects()
    batch = Batch(files, run.device, precision=precision)
    which, points, asked = touches(count, files)
    answer = batch.touch.press(which, points, **asked)
    again = batch.touch.press(which, points, **asked)
    alone = batch.touch.press(which[3:4], points[3:4], **{name: value[3:4] for name, value in asked.items()})
    host = {name: value.cpu().numpy() for name, value in vars(answer).items()}
    same = all(bool((getattr(again, name) == value).all()) for name, value in vars(answer).items())
    single = all(bool((getattr(alone, name)[0] == value[3]).all()) for name, value in vars(answer).items())
    worst = dict.fromkeys(("pose", "offset_m", "depth_um_where_masks_agree", "rgb_levels"), 0.0)
    pixels = masks = brighter = reach = 0
    for index, file in enumerate(files):
        rows = np.flatnonzero(which == index)
        true = file.press(points[rows], **{name: value[rows] for name, value in asked.items()})
        differs = host["mask"][rows] != true.mask
        levels = np.abs(host["rgb"][rows].astype(int) - true.rgb)
        depth = np.abs(host["depth_m"][rows].astype(float) - true.depth_m)[~differs]
        masks, pixels = masks + int(differs.sum()), pixels + differs.size
        brighter += int((levels > 1).sum())
        reach += int((host["reachable"][rows] != true.reachable).sum())
        for name, value in (
            ("pose", np.abs(host["sensor_to_object"][rows] - true.sensor_to_object).max()),
            ("offset_m", np.abs(host["first_contact_offset_m"][rows] - true.first_contact_offset_m).max()),
            ("depth_um_where_masks_agree", 1e6 * depth.max()),
            ("rgb_levels", levels.max()),
        ):
            worst[name] = max(worst[name], float(value))
    return {
        "touches": count,
        "pixels": pixels,
        "mask_pixels_that_differ": masks,
        "share_above_one_level": brighter / (3 * pixels),
        "reachable_that_differ": reach,
        **worst,
        "same_bytes_twice": same,
        "alone_as_in_batch": single,
    }


def touch_speed(run: Run, precision: str) -> dict[str, Any]:
    """Touches a second: looked through the gel at given poses, and from points on."""
    from objectfolder.batch import Batch, TouchImages

    files = objects()
    batch = Batch(files, run.device, precision=precision).touch
    rates: dict[str, Any] = {}
    for count in run.batches:
        which, points, asked = touches(min(count, 4096), files)
        reps = -(-count // len(which))
        which, points = np.tile(which, reps)[:count], np.tile(points, (reps, 1))[:count]
        asked = {name: np.tile(value, reps)[:count] for name, value in asked.items()}
        out = TouchImages.empty(count, batch.sensor, run.device)
        place = run.torch.as_tensor
        at = place(which, device=run.device), place(points, device=run.device)
        numbers = {name: place(value, device=run.device) for name, value in asked.items()}
        poses = batch.press(*at, **numbers, out=out).sensor_to_object
        see = run.seconds(lambda: batch.see(at[0], poses, out=out))  # noqa: B023
        press = run.seconds(lambda: batch.press(*at, **numbers, out=out))  # noqa: B023
        rates[str(count)] = {
            "see_per_s": round(count / see, 1),
            "press_per_s": round(count / press, 1),
            "touched": float((out.mask.flatten(1).any(1)).float().mean()),
        }
    return {**rates, "peak_gib": run.peak_gib()}


def stages(run: Run, work: Callable[[], Any]) -> dict[str, float]:
    """Milliseconds of each kernel, and of the networks of sight, synchronised after each."""
    from objectfolder.batch import sight
    from objectfolder.batch.targets import Body

    figures: dict[str, float] = {}

    def timed(name: str, plain: Callable[..., Any], *arguments: Any) -> Any:
        if not run.on_cpu:
            run.torch.cuda.synchronize()
        begin = time.perf_counter()
        answer = plain(*arguments)
        if not run.on_cpu:
            run.torch.cuda.synchronize()
        figures[name] = round(figures.get(name, 0.0) + 1e3 * (time.perf_counter() - begin), 3)
        return answer

    call = Body.__call__
    parts = {"network": (sight._Network, "answer"), "hits": (sight._Rays, "hits")}
    plain = {name: getattr(*part) for name, part in parts.items()}
    work()
    Body.__call__ = lambda body, *given: timed(body.name, call, body, *given)  # type: ignore[method-assign]
    for name, part in parts.items():
        setattr(*part, lambda *given, name=name: timed(name, plain[name], *given))
    try:
        timed("all", work)
    finally:
        Body.__call__ = call  # type: ignore[method-assign]
        for name, part in parts.items():
            setattr(*part, plain[name])
    return figures


def touch_stages(run: Run) -> dict[str, Any]:
    from objectfolder.batch import Batch

    files = objects()
    batch = Batch(files, run.device).touch
    count = run.batches[-1]
    which, points, asked = touches(min(count, 4096), files)
    reps = -(-count // len(which))
    which, points = np.tile(which, reps)[:count], np.tile(points, (reps, 1))[:count]
    asked = {name: np.tile(value, reps)[:count] for name, value in asked.items()}
    return {"touches": count, "milliseconds": stages(run, lambda: batch.press(which, points, **asked))}


def sight_stages(run: Run) -> dict[str, Any]:
    """Stages of many views, and what other rays, precisions and orders would give."""
    from objectfolder.batch import Batch, sight

    torch = run.torch

    def unfused(bias: Any, first: Any, second: Any) -> Any:
        return torch.addmm(bias, first, second).relu_()

    file, count = objects()[0], 2 if run.on_cpu else 1024
    cameras, lights = file.sample_views(count, seed=5, lit=True)
    true = file.render(cameras[:8], lights[:8], 128)
    given = [torch.as_tensor(part, device=run.device) for part in (cameras, lights)]
    figures: dict[str, Any] = {"views": count}
    for label, rays, where, name, value in (
        ("plain", 10, sight, "HALF", sight.HALF),
        ("8_rays", 8, sight, "HALF", sight.HALF),
        ("12_rays", 12, sight, "HALF", sight.HALF),
        ("float16", 10, sight, "HALF", torch.float16),
        ("tf32", 10, sight, "HALF", torch.float32),
        ("single", 10, sight, "HALF", torch.float32),
        ("rows_of_pixels", 10, sight, "TILE", (1, 1)),
        ("relu_apart", 10, torch, "_addmm_activation", unfused),
    ):
        before = getattr(where, name)
        setattr(where, name, value)
        torch.set_float32_matmul_precision("high" if label == "tf32" else "highest")
        try:
            batch = Batch([file], run.device).sight
            figures[label] = stages(run, lambda: batch.render(0, *given, 128, sub_rays=rays))  # noqa: B023
            taken = run.seconds(lambda: batch.render(0, *given, 128, sub_rays=rays), 5)  # noqa: B023
            image = batch.render(0, given[0][:8], given[1][:8], 128, sub_rays=rays)
        finally:
            setattr(where, name, before)
        figures[label]["views_per_s"] = round(count / taken, 1)
        error = ((image.cpu().numpy().astype(float) - true[: len(image)]) ** 2).mean(axis=(1, 2, 3))
        figures[label]["psnr_db_least"] = float(10 * np.log10(255**2 / error.max()))
    torch.set_float32_matmul_precision("highest")
    return figures


def sound(run: Run) -> dict[str, Any]:
    """Against `strike`, and strikes a second."""
    from objectfolder.batch import Batch

    files = objects()
    batch = Batch(files, run.device).sound
    which, points, _ = touches(32, files)
    impulses = np.random.default_rng(1).normal(size=(len(which), 3))
    worst = 0.0
    run.torch.set_float32_matmul_precision("high")  # TF32, which must not show in the answer
    got = batch.strike(which, points, impulses, 1.0).cpu().numpy()
    run.torch.set_float32_matmul_precision("highest")
    for index, file in enumerate(files):
        rows = which == index
        true = np.asarray(file.strike(points[rows], impulses[rows], 1.0))
        worst = max(worst, float((np.abs(got[rows] - true).max(1) / np.abs(true).max(1)).max()))
    figures: dict[str, Any] = {"error_over_peak": worst, "strikes": len(which)}
    figures["modes"] = [len(file.modes.eigenvalues) for file in files]
    for count in run.batches:
        which, points, _ = touches(min(count, 4096), files)
        reps = -(-count // len(which))
        which, points = np.sort(np.tile(which, reps)[:count]), np.tile(points, (reps, 1))[:count]
        place = run.torch.as_tensor
        at = place(which, device=run.device), place(points, device=run.device)
        pushes = run.torch.ones_like(at[1])
        out = run.torch.empty((count, 44100), dtype=run.torch.float32, device=run.device)
        taken = run.seconds(lambda: batch.strike(*at, pushes, 1.0, out=out), 5)  # noqa: B023
        figures[f"strikes_per_s_{count}"] = round(count / taken, 1)
    figures["peak_gib"] = run.peak_gib()
    return figures


def hundred_modes(run: Run) -> dict[str, Any]:
    """Strikes a second of one second of a hundred modes, the product alone."""
    from objectfolder.audio.synthesis.oscillators import Oscillators
    from objectfolder.audio.synthesis.struck_body import Source
    from objectfolder.batch.sound import Table, full_precision, write

    random = np.random.default_rng(0)
    modes = 100
    omega = 2 * np.pi * np.sort(random.uniform(300, 18000, modes))
    oscillators = Oscillators.checked(omega**2, random.uniform(5, 80, modes), 44100)
    still = np.zeros(modes)
    source = Source(oscillators, (still, still + 1), np.arange(modes), still + 1, None, 0.0)
    table = Table(source, 44100, None, run.torch.device(run.device))
    count = run.batches[-1]
    place = run.torch.as_tensor
    gains = place(random.normal(size=(count, 3, modes)), device=run.device)
    pushes = place(random.normal(size=(count, 3)), device=run.device)
    out = run.torch.empty((count, 44100), dtype=run.torch.float32, device=run.device)

    def work() -> None:
        with full_precision():
            write([table], gains, pushes, pushes, out, None)

    return {"strikes": count, "per_s": round(count / run.seconds(work, 5), 1)}


def sight_equality(run: Run) -> dict[str, Any]:
    """PSNR against `render`."""
    from objectfolder.batch import Batch

    files, count = objects(), 2 if run.on_cpu else 8
    batch = Batch(files, run.device).sight
    figures: dict[str, Any] = {"views": 2 * count}
    views = [file.sample_views(count, seed=1, lit=True) for file in files]
    which = np.repeat([0, 1], count)
    cameras, lights = (np.concatenate(parts) for parts in zip(*views, strict=True))
    true = np.concatenate([file.render(*view, 128) for file, view in zip(files, views, strict=True)])
    for rays in (10, 16):
        image = batch.render(which, cameras, lights, 128, sub_rays=rays)
        again = batch.render(which, cameras, lights, 128, sub_rays=rays)
        error = ((image.cpu().numpy().astype(float) - true) ** 2).mean(axis=(1, 2, 3))
        psnr = 10 * np.log10(255**2 / error)
        figures[f"psnr_db_{rays}_rays"] = {"least": float(psnr.min()), "mean": float(psnr.mean())}
        figures[f"same_bytes_twice_{rays}_rays"] = bool((image == again).all())
    return figures


def sight_speed(run: Run) -> dict[str, Any]:
    """Views of 128 x 128 pixels a second, one lamp with shadow."""
    from objectfolder.batch import Batch

    files = objects()
    figures: dict[str, Any] = {}
    for label, chosen in (("mug", files[:1]), ("bell", files[1:]), ("both", files)):
        batch = Batch(chosen, run.device).sight
        for count in (1, 4) if run.on_cpu else (1, 256, 1024, 4096):
            random = np.random.default_rng(0)
            which = np.sort(random.integers(0, len(chosen), count))
            cameras, lights = np.empty((count, 4, 4)), np.empty((count, 3))
            for index, file in enumerate(chosen):
                rows = np.flatnonzero(which == index)
                if len(rows):
                    cameras[rows], lights[rows] = file.sample_views(len(rows), seed=2, lit=True)
            place = run.torch.as_tensor
            given = [place(part, device=run.device) for part in (which, cameras, lights)]
            for rays in (10, 16):
                taken = run.seconds(lambda: batch.render(*given, 128, sub_rays=rays), 3)  # noqa: B023
                figures[f"{label}_{count}_{rays}_rays_per_s"] = round(count / taken, 1)
    figures["peak_gib"] = run.peak_gib()
    return figures


def hundred_objects(run: Run) -> dict[str, Any]:
    """Memory of a hundred objects with all senses: the two examples, fifty times."""
    from objectfolder.batch import Batch

    if not run.on_cpu:
        run.torch.cuda.empty_cache()
        run.torch.cuda.reset_peak_memory_stats()
        before = run.torch.cuda.memory_allocated()
    batch = Batch(objects() * (2 if run.on_cpu else 50), run.device)
    made = batch.touch, batch.sound, batch.sight
    if run.on_cpu:
        return {"objects": len(batch.files)}
    gib = (run.torch.cuda.memory_allocated() - before) / 2**30
    return {"objects": len(batch.files), "resident_gib": round(gib, 3), "senses": len(made)}


def compile_for_cpu() -> None:
    """Fill the cache of compiled kernels that single queries take."""
    file = objects()[1]
    points, _ = file.sample_contacts(1, reachable=False)
    file.press(points)
    file.render(*file.sample_views(1), 16)
    file.strike(points, duration_s=0.1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cpu", action="store_true", help="run all lines on a CPU")
    parser.add_argument("--compile", action="store_true", help="compile single queries, and nothing else")
    asked = parser.parse_args()
    if asked.compile:
        return compile_for_cpu()
    run = Run(asked.cpu)
    # Beside the kernels for the device, which this process compiles meanwhile.
    compiling = subprocess.Popen([sys.executable, "-m", "bench.gpu", "--compile"])
    run.part("versions", versions)
    run.part("touch_speed_single", lambda run: touch_speed(run, "single"))
    run.part("hundred_modes", hundred_modes)
    run.part("sight_speed", sight_speed)
    run.part("cpu_kernels", lambda run: {"exit": compiling.wait(timeout=400 if run.on_cpu else 100)})
    small = run.on_cpu
    run.part("touch_equality_single", lambda run: touch_equality(run, "single", 8 if small else 192))
    run.part("touch_equality_double", lambda run: touch_equality(run, "double", 8 if small else 96))
    run.part("sound", sound)
    run.part("sight_equality", sight_equality)
    run.part("touch_stages", touch_stages)
    run.part("sight_stages", sight_stages)
    run.part("hundred_objects", hundred_objects)
    run.part("touch_speed_double", lambda run: touch_speed(run, "double"))
    return None


if __name__ == "__main__":
    main()
