"""Views: against single renders, and how many a second."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from bench.gpu.run import EFFORTS, LEARNED, Run, objects


def sight_equality(run: Run, names: Sequence[str] = LEARNED) -> dict[str, Any]:
    """PSNR against `render`, of images and of the pixels whose centres show the object."""
    from objectfolder.batch import Batch

    files, count = objects(names), 2 if run.on_cpu else 8
    batch = Batch(files, run.device).sight
    figures: dict[str, Any] = {"views": 2 * count}
    views = [file.sample_views(count, seed=1, lit=True) for file in files]
    which = np.repeat([0, 1], count)
    cameras, lights = (np.concatenate(parts) for parts in zip(*views, strict=True))
    true = np.concatenate([file.render(*view, 128) for file, view in zip(files, views, strict=True)])
    shown = [
        file.render_passes(view[0], ["mask"], resolution=128)["mask"]
        for file, view in zip(files, views, strict=True)
    ]
    mask = np.concatenate(shown)
    for effort, settings in EFFORTS.items():
        image = batch.render(which, cameras, lights, 128, **settings)
        again = batch.render(which, cameras, lights, 128, **settings)
        squares = ((image.cpu().numpy().astype(float) - true) ** 2).mean(axis=3)
        within = (squares * mask).sum(axis=(1, 2)) / mask.sum(axis=(1, 2))
        for name, error in (("psnr_db", squares.mean(axis=(1, 2))), ("psnr_shown_db", within)):
            psnr = 10 * np.log10(255**2 / error)
            figures[f"{name}_{effort}"] = {"least": float(psnr.min()), "mean": float(psnr.mean())}
        figures[f"same_bytes_twice_{effort}"] = bool((image == again).all())
    return figures


def sight_speed(run: Run, names: Sequence[str] = LEARNED) -> dict[str, Any]:
    """Views of 128 x 128 pixels a second, each with a lamp of its own and its shadow."""
    from objectfolder.batch import Batch

    files = objects(names)
    figures: dict[str, Any] = {}
    for label, subset in ((names[0], files[:1]), (names[1], files[1:]), ("both", files)):
        batch = Batch(subset, run.device).sight
        for count in (1, 4) if run.on_cpu else (1, 256, 1024, 4096):
            random = np.random.default_rng(0)
            which = np.sort(random.integers(0, len(subset), count))
            cameras, lights = np.empty((count, 4, 4)), np.empty((count, 3))
            for index, file in enumerate(subset):
                rows = np.flatnonzero(which == index)
                if len(rows):
                    cameras[rows], lights[rows] = file.sample_views(len(rows), seed=2, lit=True)
            place = run.torch.as_tensor
            views = [place(part, device=run.device) for part in (which, cameras, lights)]
            for effort, settings in list(EFFORTS.items())[:2]:
                seconds = run.seconds(partial(batch.render, *views, 128, **settings), 3)
                figures[f"{label}_{count}_{effort}_per_s"] = round(count / seconds, 1)
    figures["peak_gib"] = run.peak_gib()
    return figures
