"""The papers' networks for touch, and what needs no renderer, on the touches of one object."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench.rivals.touch.deformation_network import NAME as SECOND
from bench.rivals.touch.deformation_network import render_deformation
from bench.rivals.touch.fitting import RIVALS, fit_touch_rival
from objectfolder.fidelity.feel import measure_feel
from objectfolder.products.store import Product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet
from objectfolder.touch.truth.press import press
from objectfolder.touch.truth.touches import Press

# Touches that were trained on, judged to tell learning from generalising.
SHOWN = 24

Error = Callable[[np.ndarray], dict[str, Any]]


def press_query(asked: dict[str, Any], samples: int = 2) -> tuple[np.ndarray, Press]:
    """Points, and how to press there."""
    query = {name: values for name, values in asked.items() if name != "points"}
    return asked["points"], Press(**query, samples=samples)


def network_rows(
    surface: Surface, touches: Product, asked: dict[str, Any], error: Error, budget_cpu_s: float
) -> list[dict[str, Any]]:
    """Rows of the networks, of the mean image, and of the stored surface under this renderer.

    Parameters
    ----------
    surface
        The source mesh.
    touches
        What the networks are fitted to, and the held-out touches.
    asked
        The latter: ``points``, and what `Press` takes.
    error
        Judges images of them.
    budget_cpu_s
        Of each network's fit.
    """
    chosen = np.flatnonzero(~touches["held_out"])
    shown = chosen[:SHOWN]
    seen_rgb, seen_mask = touches["rgb"][shown], touches["mask"][shown]
    seen = {name: touches[name][shown] for name in asked}

    def on_training(images: np.ndarray) -> Any:
        return measure_feel(seen_rgb, seen_mask, images, seen_mask)["psnr_contact_db"]

    rows = []
    for name in RIVALS:
        fitted = fit_touch_rival(name, touches, budget_cpu_s=budget_cpu_s, seed=0)
        start = time.process_time()
        images = fitted.render(**asked)
        seconds = (time.process_time() - start) / len(images)
        rows.append(
            {
                "way": f"{name} network",
                "setting": None,
                "cpu_s": seconds,
                "bytes": fitted.bytes,
                "training_cpu_s": fitted.training.cpu_s,
                "training_steps": fitted.training.steps,
                "first_loss": float(fitted.training.losses[:5].mean()),
                "last_loss": float(fitted.training.losses[-20:].mean()),
                "psnr_contact_training_db": on_training(fitted.render(**seen)),
            }
            | error(images)
        )
    mean = np.rint(touches["rgb"][chosen].mean(axis=0, dtype=np.float64)).astype(np.uint8)
    rows.append(
        {
            "way": "mean image",
            "setting": None,
            "cpu_s": None,
            "bytes": mean.nbytes,
            "psnr_contact_training_db": on_training(np.broadcast_to(mean, seen_rgb.shape)),
        }
        | error(np.broadcast_to(mean, (len(asked["points"]), *mean.shape)))
    )
    exact = press(surface, Sensor(), *press_query(asked, 1))
    rows.append(
        {"way": f"{SECOND}, a perfect network", "setting": None, "cpu_s": None, "bytes": None}
        | error(np.stack([render_deformation(Sensor(), depth) for depth in exact.depth]))
    )
    encoded = encode_surface(surface)
    net = TouchNet(decode_surface(encoded))
    net.press(asked["points"][:1])
    start = time.process_time()
    images = net.press(*press_query(asked)).rgb
    rows.append(
        {
            "way": "TouchNet, stored surface",
            "setting": 2,
            "cpu_s": (time.process_time() - start) / len(images),
            "bytes": sum(array.nbytes for array in encoded.values()),
            "psnr_contact_training_db": on_training(net.press(*press_query(seen)).rgb),
        }
        | error(images)
    )
    return rows
