"""Cycles in child processes: the parent never imports bpy."""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from objectfolder.child_process import last_words, run_module
from objectfolder.errors import SimulationError
from objectfolder.making.views.render_request import Scene, Shots, save_request

# Blender's memory grows with every render.
VIEWS_PER_PROCESS = 120
# The largest half-precision number.
LARGEST_HALF = 65504.0


def render_in_children(scene: Scene, shots: Shots) -> np.ndarray:
    """Render one set of shots: `render_series` of it alone, (n, height, width, 4)."""
    return render_series(scene, [shots])[0]


def render_series(scene: Scene, series: Sequence[Shots]) -> list[np.ndarray]:
    """Render sets of shots, `VIEWS_PER_PROCESS` views at most a child process.

    A view depends on its own seed and nothing else, so the split does not show in the images.

    Returns
    -------
    list of np.ndarray
        (n, height, width, 4) float16 scene-linear premultiplied RGBA, of each set.

    Raises
    ------
    SimulationError
        Blender missing, killed or failed; its last words are in the message.
    """
    counts = [len(shots.camera_to_world) for shots in series]
    images = [
        np.empty((count, shots.height, shots.width, 4), dtype=np.float16)
        for count, shots in zip(counts, series, strict=True)
    ]
    with tempfile.TemporaryDirectory(prefix="objectfolder-views-") as folder:
        for share in _shares(counts):
            paths = []
            for number, (index, part) in enumerate(share):
                paths += [Path(folder, f"request-{number}.npz"), Path(folder, f"result-{number}.npy")]
                save_request(paths[-2], scene, series[index].views(part))
            _run(*paths)
            for (index, part), result in zip(share, paths[1::2], strict=True):
                images[index][part] = np.clip(np.load(result), 0.0, LARGEST_HALF)
                result.unlink()
    return images


def _shares(counts: Sequence[int]) -> Iterator[list[tuple[int, slice]]]:
    """Yield what each process renders: sets by index, and which of their views."""
    share, room = list[tuple[int, slice]](), VIEWS_PER_PROCESS
    for index, count in enumerate(counts):
        start = 0
        while start < count:
            stop = min(count, start + room)
            share.append((index, slice(start, stop)))
            room -= stop - start
            start = stop
            if room == 0:
                yield share
                share, room = [], VIEWS_PER_PROCESS
    if share:
        yield share


def _run(*requests_and_results: Path) -> None:
    finished = run_module("objectfolder.making.views.cycles", *requests_and_results)
    if finished.returncode or not requests_and_results[-1].exists():
        raise SimulationError(
            "Cycles",
            f"the render process ended with status {finished.returncode}: {last_words(finished.stderr, 3)}",
            "Install the factory extra on Python 3.11 with Blender's system libraries (see README).",
        )
