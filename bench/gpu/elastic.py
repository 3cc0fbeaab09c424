"""Elastic touches: against single presses after a number of steps, and how many a second."""

from functools import partial
from typing import Any

import numpy as np

from bench.gpu.run import Run, objects, touches
from bench.gpu.stages import stages


def elastic_equality(run: Run) -> dict[str, Any]:
    """Against single elastic presses, by depths and by forces, after some numbers of steps."""
    from objectfolder.batch import Batch

    files, count = objects(), 4 if run.on_cpu else 24
    which, points, settings = touches(count, files)
    depths = settings.pop("depth_m")
    figures: dict[str, Any] = {"touches": count}
    for load in ({"depth_m": depths}, {"force_n": 4000 * depths}):
        true = []
        for index, file in enumerate(files):
            rows = np.flatnonzero(which == index)
            press = {name: value[rows] for name, value in {**settings, **load}.items()}
            true.append((rows, file.press(points[rows], contact="elastic", **press)))
        for precision, steps in (
            ("single", 12), ("single", 16), ("single", 20), ("single", 24), ("single", 32), ("double", 40)
        ):  # fmt: skip
            batch = Batch(files, run.device, precision=precision).touch
            answer = batch.press(which, points, contact="elastic", steps=steps, **settings, **load)
            figures[f"{next(iter(load))}_{precision}_{steps}"] = elastic_errors(answer, true)
    return figures


def elastic_errors(answer: Any, true: list[tuple[np.ndarray, Any]]) -> dict[str, Any]:
    """How a batch of elastic touches differs from single ones, of which each object has some rows."""
    order = np.concatenate([rows for rows, _ in true])
    host = {name: value.cpu().numpy()[order] for name, value in vars(answer).items() if name != "shear"}
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
        which, points, settings = touches(count, files)
        out = TouchImages.empty(count, batch.sensor, run.device)
        place = run.torch.as_tensor
        tensors = {name: place(value, device=run.device) for name, value in settings.items()}
        at, depths = [place(part, device=run.device) for part in (which, points)], tensors.pop("depth_m")
        for name, load in (("depth_m", depths), ("force_n", 4000 * depths)):
            for steps in (16, 20, 24, 32) if count == 4096 else (24,):
                work = partial(
                    batch.press, *at, **tensors, **{name: load}, contact="elastic", steps=steps, out=out
                )
                seconds, residual = run.seconds(work, 3), work().relative_residual
                figures[f"{name}_{count}_{steps}_steps"] = {
                    "per_s": round(count / seconds, 1),
                    "residual_largest": float(residual.max()),
                    "residual_99_percent": float(residual.quantile(0.99)),
                    "pressed": float((residual > 0).double().mean()),
                }
        if count != 16384:
            figures[f"milliseconds_{count}"] = stages(run, work)
    return {**figures, "peak_gib": run.peak_gib()}
