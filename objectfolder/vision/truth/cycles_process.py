"""Cycles in child processes: the parent never imports bpy, and a child renders one sample count."""

import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from objectfolder.child_process import last_words, run_module
from objectfolder.errors import SimulationError
from objectfolder.vision.truth.render_request import Scene, Shots, save_request

# Blender's memory grows with every render.
VIEWS_PER_PROCESS = 120
# The largest half-precision number.
LARGEST_HALF = 65504.0


def render_in_children(scene: Scene, shots: Shots) -> np.ndarray:
    """Render every shot, `VIEWS_PER_PROCESS` at most a child process.

    A view depends on its own seed and nothing else, so the split does not show in the images.

    Returns
    -------
    np.ndarray
        (n, height, width, 4) float16 scene-linear premultiplied RGBA.

    Raises
    ------
    SimulationError
        Blender missing, killed or failed; its last words are in the message.
    """
    count = len(shots.camera_to_world)
    images = np.empty((count, shots.height, shots.width, 4), dtype=np.float16)
    with tempfile.TemporaryDirectory(prefix="objectfolder-views-") as folder:
        for start in range(0, count, VIEWS_PER_PROCESS):
            part = slice(start, min(start + VIEWS_PER_PROCESS, count))
            request, result = Path(folder, "request.npz"), Path(folder, "result.npy")
            save_request(
                request,
                scene,
                dataclasses.replace(
                    shots,
                    camera_to_world=shots.camera_to_world[part],
                    light_position=shots.light_position[part],
                    seeds=shots.seeds[part],
                ),
            )
            _run(request, result)
            images[part] = np.clip(np.load(result), 0.0, LARGEST_HALF)
            result.unlink()
    return images


def render_series(scene: Scene, series: Sequence[Shots]) -> list[np.ndarray]:
    """Render several sets of few shots, of one sample count, in one child process.

    Arrays and errors are those of `render_in_children`.
    """
    with tempfile.TemporaryDirectory(prefix="objectfolder-views-") as folder:
        paths = []
        for index, shots in enumerate(series):
            paths += [Path(folder, f"request-{index}.npz"), Path(folder, f"result-{index}.npy")]
            save_request(paths[-2], scene, shots)
        _run(*paths)
        return [np.clip(np.load(path), 0.0, LARGEST_HALF).astype(np.float16) for path in paths[1::2]]


def _run(*requests_and_results: Path) -> None:
    finished = run_module("objectfolder.vision.truth.cycles", *requests_and_results)
    if finished.returncode or not requests_and_results[-1].exists():
        raise SimulationError(
            "Cycles",
            f"the render process ended with status {finished.returncode}: {last_words(finished.stderr, 3)}",
            "Install the factory extra on Python 3.11 with Blender's system libraries (see README).",
        )
