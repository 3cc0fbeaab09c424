"""Answers and throughput of `objectfolder.batch` on a graphics processor: ``python -m bench.gpu``.

Unattended, within 4 minutes, after nothing but numba-cuda and torch is installed. Each part is written to
``bench/results/gpu.json`` when it is done; one that fails leaves its error there, and the next begins.
``--cpu`` runs every line on a CPU, with small batches; names of parts run those alone, into the file that
``--name`` names.
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
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(os.environ.get("BENCH_RESULTS", Path(__file__).with_name("results")))
LIMIT_S = 230.0
BATCHES = (1, 256, 4096, 16384)
REPEATS = 9
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


def touches(count: int, files: list[Any], seed: int = 0) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Objects, points and the rest of presses, mixed; from 4,096 on they repeat."""
    random, drawn = np.random.default_rng(seed), min(count, 4096)
    which = random.integers(0, len(files), drawn)
    points = np.empty((drawn, 3))
    for index, file in enumerate(files):
        rows = np.flatnonzero(which == index)
        points[rows] = file.sample_contacts(len(rows), seed=seed, reachable=False)[0]
    ranges = {"depth_m": (0.0002, 0.002), "tilt_deg": (0.0, 30.0), "azimuth_deg": (0.0, 360.0)}
    ranges["roll_deg"] = (0.0, 360.0)
    turns = {name: np.resize(random.uniform(*limits, drawn), count) for name, limits in ranges.items()}
    return np.resize(which, count), np.resize(points, (count, 3)), turns


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
    # The force that a rigid gel bears is no number.
    known = {
        name: value for name, value in vars(answer).items() if name not in {"force_n", "relative_residual"}
    }
    same = all(bool((getattr(again, name) == value).all()) for name, value in known.items())
    single = all(bool((getattr(alone, name)[0] == value[3]).all()) for name, value in known.items())
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
        which, points, asked = touches(count, files)
        out = TouchImages.empty(count, batch.sensor, run.device)
        place = run.torch.as_tensor
        at = place(which, device=run.device), place(points, device=run.device)
        numbers = {name: place(value, device=run.device) for name, value in asked.items()}
        poses = batch.press(*at, **numbers, out=out).sensor_to_object
        see = run.seconds(partial(batch.see, at[0], poses, out=out))
        press = run.seconds(partial(batch.press, *at, **numbers, out=out))
        rates[str(count)] = {
            "see_per_s": round(count / see, 1),
            "press_per_s": round(count / press, 1),
            "touched": float((out.mask.flatten(1).any(1)).float().mean()),
        }
    return {**rates, "peak_gib": run.peak_gib()}


def elastic_equality(run: Run) -> dict[str, Any]:
    """Against single elastic presses, by depths and by forces, after some numbers of steps."""
    from objectfolder.batch import Batch

    files, count = objects(), 4 if run.on_cpu else 24
    which, points, asked = touches(count, files)
    depths = asked.pop("depth_m")
    figures: dict[str, Any] = {"touches": count}
    for load in ({"depth_m": depths}, {"force_n": 4000 * depths}):
        true = []
        for index, file in enumerate(files):
            rows = np.flatnonzero(which == index)
            given = {name: value[rows] for name, value in {**asked, **load}.items()}
            true.append((rows, file.press(points[rows], contact="elastic", **given)))
        for precision, steps in (
            ("single", 12), ("single", 16), ("single", 20), ("single", 24), ("single", 32), ("double", 40)
        ):  # fmt: skip
            batch = Batch(files, run.device, precision=precision).touch
            answer = batch.press(which, points, contact="elastic", steps=steps, **asked, **load)
            figures[f"{next(iter(load))}_{precision}_{steps}"] = elastic_errors(answer, true)
    return figures


def elastic_errors(answer: Any, true: list[tuple[np.ndarray, Any]]) -> dict[str, Any]:
    """How a batch of elastic touches differs from single ones, of which each object has some rows."""
    order = np.concatenate([rows for rows, _ in true])
    host = {name: value.cpu().numpy()[order] for name, value in vars(answer).items()}
    truth = {
        name: np.concatenate([getattr(part, name) for _, part in true]) for name in host if name[:3] != "rel"
    }
    levels = np.abs(host["rgb"].astype(int) - truth["rgb"])
    pressed = truth["force_n"] > 0
    ratio = host["force_n"][pressed] / truth["force_n"][pressed]
    return {
        "mask_pixels_that_differ": int((host["mask"] != truth["mask"]).sum()),
        "pixels": host["mask"].size,
        "rgb_levels": int(levels.max()),
        "share_above_one_level": float((levels > 1).mean()),
        "depth_um": float(1e6 * np.abs(host["depth_m"].astype(float) - truth["depth_m"]).max()),
        "force_relative": float(np.abs(ratio - 1).max()),
        "penetration_um": float(1e6 * np.abs(host["penetration_m"] - truth["penetration_m"]).max()),
        "reachable_that_differ": int((host["reachable"] != truth["reachable"]).sum()),
        "residual_largest": float(host["relative_residual"].max()),
        "residual_median": float(np.median(host["relative_residual"])),
    }


def elastic_speed(run: Run) -> dict[str, Any]:
    """Elastic touches a second from points on, by steps, and where the time goes."""
    from objectfolder.batch import Batch, TouchImages

    files = objects()
    batch = Batch(files, run.device).touch
    figures: dict[str, Any] = {}
    for count in (2, 3) if run.on_cpu else (256, 4096, 16384):
        which, points, asked = touches(count, files)
        out = TouchImages.empty(count, batch.sensor, run.device)
        place = run.torch.as_tensor
        given = {name: place(value, device=run.device) for name, value in asked.items()}
        at, depths = [place(part, device=run.device) for part in (which, points)], given.pop("depth_m")
        for name, load in (("depth_m", depths), ("force_n", 4000 * depths)):
            for steps in (16, 20, 24, 32) if count == 4096 else (24,):
                work = partial(
                    batch.press, *at, **given, **{name: load}, contact="elastic", steps=steps, out=out
                )
                taken, residual = run.seconds(work, 3), work().relative_residual
                figures[f"{name}_{count}_{steps}_steps"] = {
                    "per_s": round(count / taken, 1),
                    "residual_largest": float(residual.max()),
                    "residual_99_percent": float(residual.quantile(0.99)),
                    "pressed": float((residual > 0).double().mean()),
                }
        if count != 16384:
            figures[f"milliseconds_{count}"] = stages(run, work)
    return {**figures, "peak_gib": run.peak_gib()}


def stages(run: Run, work: Callable[[], Any]) -> dict[str, float]:
    """Milliseconds of each kernel, and of the networks of sight, synchronised after each."""
    from objectfolder.batch import elastic, sight
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
    parts = {
        "network": (sight._Network, "answer"),
        "hits": (sight._Rays, "hits"),
        "displacement": (elastic.Layer, "displacement"),
    }
    plain = {name: getattr(*part) for name, part in parts.items()}
    work()
    Body.__call__ = lambda body, *arguments: timed(body.name, call, body, *arguments)  # type: ignore[method-assign]
    for name, part in parts.items():
        setattr(*part, lambda *arguments, name=name: timed(name, plain[name], *arguments))
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
    which, points, asked = touches(count, files)
    return {"touches": count, "milliseconds": stages(run, lambda: batch.press(which, points, **asked))}


def sight_stages(run: Run) -> dict[str, Any]:
    from objectfolder.batch import Batch

    file, count = objects()[0], 2 if run.on_cpu else 1024
    views = file.sample_views(count, seed=5, lit=True)
    cameras, lights = (run.torch.as_tensor(part, device=run.device) for part in views)
    batch = Batch([file], run.device).sight
    return {"views": count, "milliseconds": stages(run, lambda: batch.render(0, cameras, lights, 128))}


def sound(run: Run) -> dict[str, Any]:
    """Against `strike`, and strikes a second."""
    from objectfolder.batch import Batch

    files = objects()
    batch = Batch(files, run.device).sound
    which, points, _ = touches(32, files)
    impulses = np.random.default_rng(1).normal(size=(len(which), 3))
    worst = 0.0
    run.torch.set_float32_matmul_precision("high")  # TF32, which must not show in the answer
    sounds = batch.strike(which, points, impulses, 1.0).cpu().numpy()
    run.torch.set_float32_matmul_precision("highest")
    for index, file in enumerate(files):
        rows = which == index
        true = np.asarray(file.strike(points[rows], impulses[rows], 1.0))
        worst = max(worst, float((np.abs(sounds[rows] - true).max(1) / np.abs(true).max(1)).max()))
    figures: dict[str, Any] = {"error_over_peak": worst, "strikes": len(which)}
    figures["modes"] = [len(file.modes.eigenvalues) for file in files]
    for count in run.batches:
        which, points, _ = touches(count, files)
        which = np.sort(which)
        place = run.torch.as_tensor
        at = place(which, device=run.device), place(points, device=run.device)
        pushes = run.torch.ones_like(at[1])
        out = run.torch.empty((count, 44100), dtype=run.torch.float32, device=run.device)
        taken = run.seconds(partial(batch.strike, *at, pushes, 1.0, out=out), 5)
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
            views = [place(part, device=run.device) for part in (which, cameras, lights)]
            for rays in (10, 16):
                taken = run.seconds(partial(batch.render, *views, 128, sub_rays=rays), 3)
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
    file.press(points, contact="elastic")
    file.render(*file.sample_views(1), 16)
    file.strike(points, duration_s=0.1)


PARTS: dict[str, Callable[[Run], Any]] = {
    "touch_speed_single": lambda run: touch_speed(run, "single"),
    "elastic_speed": elastic_speed,
    "hundred_modes": hundred_modes,
    "sight_speed": sight_speed,
    "touch_equality_single": lambda run: touch_equality(run, "single", 8 if run.on_cpu else 192),
    "touch_equality_double": lambda run: touch_equality(run, "double", 8 if run.on_cpu else 96),
    "elastic_equality": elastic_equality,
    "sound": sound,
    "sight_equality": sight_equality,
    "touch_stages": touch_stages,
    "sight_stages": sight_stages,
    "hundred_objects": hundred_objects,
    "touch_speed_double": lambda run: touch_speed(run, "double"),
}


# Parts that compare with single queries, whose kernels are compiled by then.
SINGLE_QUERIES = {
    "touch_equality_single",
    "touch_equality_double",
    "elastic_equality",
    "sound",
    "sight_equality",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; by default all")
    parser.add_argument("--name", default="gpu", help="of the file of results")
    parser.add_argument("--cpu", action="store_true", help="run all lines on a CPU")
    parser.add_argument("--compile", action="store_true", help="compile single queries, and nothing else")
    asked = parser.parse_args()
    if unknown := set(asked.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    if asked.compile:
        return compile_for_cpu()
    run = Run(asked.cpu, asked.name)
    chosen = [name for name in PARTS if name in (asked.parts or PARTS)]
    # Beside the kernels for the device, which this process compiles meanwhile.
    compiling = subprocess.Popen([sys.executable, "-m", "bench.gpu", "--compile"])
    run.part("versions", versions)
    for name in chosen:
        if name in SINGLE_QUERIES and "cpu_kernels" not in run.figures:
            run.part("cpu_kernels", lambda run: {"exit": compiling.wait(timeout=400 if run.on_cpu else 100)})
        run.part(name, PARTS[name])
    compiling.wait()
    return None


if __name__ == "__main__":
    main()
