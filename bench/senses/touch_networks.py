"""The papers' networks for touch, and what needs no renderer, on the touches of one object."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench.rivals.touch.networks import RIVALS, fit_touch_network
from objectfolder.fidelity.feel import measure_feel
from objectfolder.products.store import Product
from objectfolder.touch.truth.touches import Press

# Touches that were trained on, judged to tell learning from generalising.
SHOWN = 24

Error = Callable[[np.ndarray], dict[str, Any]]


def press_query(asked: dict[str, Any], samples: int = 2) -> tuple[np.ndarray, Press]:
    """Points, and how to press there."""
    query = {name: values for name, values in asked.items() if name != "points"}
    return asked["points"], Press(**query, samples=samples)


class NetworkRows:
    """Rows of the networks, and of what needs no renderer.

    Parameters
    ----------
    touches
        What the networks are fitted to, and the held-out touches.
    asked
        The latter: ``points``, and what `Press` takes.
    error
        Judges images of them.
    """

    def __init__(self, touches: Product, asked: dict[str, Any], error: Error) -> None:
        self._touches, self._asked, self._error = touches, asked, error
        self._chosen = np.flatnonzero(~touches["held_out"])
        shown = self._chosen[:SHOWN]
        self._seen = {name: touches[name][shown] for name in asked}
        self._seen_rgb, self._seen_mask = touches["rgb"][shown], touches["mask"][shown]

    def rows(self, budget_cpu_s: float) -> list[dict[str, Any]]:
        """Return the row of each; `budget_cpu_s` is that of each network's fit."""
        networks = [self._network(name, budget_cpu_s) for name in RIVALS]
        return [*networks, self._mean_image()]

    def _network(self, name: str, budget_cpu_s: float) -> dict[str, Any]:
        fitted = fit_touch_network(name, self._touches, budget_cpu_s=budget_cpu_s, seed=0)
        start = time.process_time()
        images = fitted.render(**self._asked)
        return {
            "way": f"{name} network",
            "setting": None,
            "cpu_s": (time.process_time() - start) / len(images),
            "bytes": fitted.bytes,
            "training_cpu_s": fitted.training.cpu_s,
            "training_steps": fitted.training.steps,
            "psnr_contact_training_db": self._on_training(fitted.render(**self._seen)),
        } | self._error(images)

    def _mean_image(self) -> dict[str, Any]:
        mean = self._touches["rgb"][self._chosen].mean(axis=0, dtype=np.float64)
        image = np.rint(mean).astype(np.uint8)
        return {
            "way": "mean image",
            "setting": None,
            "bytes": image.nbytes,
            "psnr_contact_training_db": self._on_training(np.broadcast_to(image, self._seen_rgb.shape)),
        } | self._error(np.broadcast_to(image, (len(self._asked["points"]), *image.shape)))

    def _on_training(self, images: np.ndarray) -> Any:
        return measure_feel(self._seen_rgb, self._seen_mask, images, self._seen_mask)["psnr_contact_db"]
