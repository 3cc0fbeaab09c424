"""Cycles in processes that stay, so that Blender starts once for many scenes."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from objectfolder.making.views.cycles import render
from objectfolder.making.views.render_request import Scene, Shots

# By samples a pixel, of which Blender takes one number a process.
RENDERERS: dict[int, ProcessPoolExecutor] = {}


def render_in_kept(scene: Scene, shots: Shots) -> np.ndarray:
    """Render as `render_in_children` does, in the process of this number of samples."""
    if shots.samples not in RENDERERS:
        RENDERERS[shots.samples] = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    images: np.ndarray = RENDERERS[shots.samples].submit(render, scene, shots).result()
    return images.astype(np.float16)


def end_renderers() -> None:
    """End the processes."""
    while RENDERERS:
        RENDERERS.popitem()[1].shutdown()
