"""Strikes: against single ones, and how many a second."""

from functools import partial
from typing import Any

import numpy as np

from bench.gpu.run import Run, objects, touches


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
        seconds = run.seconds(partial(batch.strike, *at, pushes, 1.0, out=out), 5)
        figures[f"strikes_per_s_{count}"] = round(count / seconds, 1)
    figures["peak_gib"] = run.peak_gib()
    return figures


def hundred_modes(run: Run) -> dict[str, Any]:
    """Strikes a second of one second of a hundred modes, the product alone."""
    from objectfolder.audio.synthesis.oscillators import Oscillators
    from objectfolder.audio.synthesis.resonators import Resonators
    from objectfolder.audio.synthesis.sources import Source
    from objectfolder.batch.sound import Table, full_precision, write

    random = np.random.default_rng(0)
    modes = 100
    omega = 2 * np.pi * np.sort(random.uniform(300, 18000, modes))
    oscillators = Oscillators.checked(omega**2, random.uniform(5, 80, modes), 44100)
    still = np.zeros(modes)
    source = Source(Resonators.of(oscillators, (still, still + 1)), still + 1, None, 0.0)
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
