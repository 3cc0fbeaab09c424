"""Alpha of thin glass without noise: rendered apart, where chance decides a path's place in the pixel alone.

A path of the picture itself chooses at each wall whether to go on, so that alpha has the noise of that: about
a hundredth of 256 paths.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from objectfolder.vision.truth.cycles_process import render_series
from objectfolder.vision.truth.render_request import Scene, Shots

ALPHA_SAMPLES = 256


def with_alpha_apart(scene: Scene, images: Sequence[np.ndarray], series: Sequence[Shots]) -> list[np.ndarray]:
    """Return sets of rendered views (n, h, w, 4) with the alpha of their thin glass rendered apart.

    The radiance stays: it is premultiplied. What is not thin glass stays as it is.
    """
    if not scene.appearance.thin:
        return list(images)
    how: dict[str, Any] = {
        "samples": ALPHA_SAMPLES,
        "most_samples": None,
        "bounces": 0,
        "alpha_alone": True,
    }
    apart = [replace(shots, **how) for shots in series]
    result = [image.copy() for image in images]
    for image, alpha in zip(result, render_series(scene, apart), strict=True):
        image[..., 3] = alpha[..., 3]
    return result
