"""Rendered truth against an Object File, on held-out cameras and lights."""

from typing import Any

import numpy as np

from objectfolder.fidelity.images import psnr_db, ssim
from objectfolder.object_file import ObjectFile
from objectfolder.products.store import Product
from objectfolder.vision.compositing import on_white

FOREGROUND_ALPHA = 0.5

DEFINITIONS = {
    "vision.psnr_db": "PSNR of 8-bit sRGB on white, held-out cameras and lights, mean of views",
    "vision.psnr_foreground_db": "The same over the pixels that the object covers by at least half",
    "vision.ssim": "Structural similarity (Wang et al. 2004), Gaussian window of sigma 1.5, mean of views",
    "vision.trivial": "The true silhouette filled with the mean colour of the object in the training views",
}


def held_out_truth(views: Product) -> tuple[np.ndarray, np.ndarray]:
    """Return the held-out views on white (n, h, w, 3) uint8 and their foreground masks (n, h, w)."""
    rgba = views["rgba"][views["held_out"]].astype(np.float32)
    return on_white(rgba), rgba[..., 3] >= FOREGROUND_ALPHA


def held_out_answer(file: ObjectFile, views: Product, sub_rays: int | None = None) -> np.ndarray:
    """Render the held-out views from the Object File, (n, h, w, 3) uint8 on white."""
    held_out = views["held_out"]
    height, width = views["rgba"].shape[1:3]
    return file.render(
        file.frame.camera_to_object(views["camera_to_world"][held_out]),
        file.frame.to_object(views["light_position"][held_out]),
        resolution=(height, width),
        field_of_view=float(views.attributes["field_of_view_deg"]),
        sub_rays=sub_rays,
    )


def measure_sight(truth: np.ndarray, foreground: np.ndarray, answer: np.ndarray) -> dict[str, Any]:
    """Compare (n, h, w, 3) uint8 images; foreground (n, h, w) bool.

    Returns
    -------
    dict
        ``psnr_db``, ``psnr_foreground_db``, ``ssim``: means over the views (foreground: over the views
        that show the object), and ``per_view``.
    """
    rows: list[dict[str, Any]] = [
        {"view": index, "psnr_db": psnr_db(t, a), "psnr_foreground_db": psnr_db(t, a, f), "ssim": ssim(t, a)}
        for index, (t, a, f) in enumerate(zip(truth, answer, foreground, strict=True))
    ]
    seen = [row for row in rows if np.isfinite(row["psnr_foreground_db"])]
    means: dict[str, Any] = {
        key: float(np.mean([row[key] for row in (seen if key == "psnr_foreground_db" else rows)]))
        for key in ("psnr_db", "psnr_foreground_db", "ssim")
    }
    for row in rows:
        if not np.isfinite(row["psnr_foreground_db"]):
            row["psnr_foreground_db"] = None
    return {**means, "per_view": rows}


def trivial_answer(views: Product) -> np.ndarray:
    """Return the held-out silhouettes in the object's mean training colour, (n, h, w, 3) uint8."""
    training = views["rgba"][~views["held_out"]].astype(np.float64)
    covered = training[..., 3].sum()
    colour = training[..., :3].sum(axis=(0, 1, 2)) / max(covered, 1e-12)
    alpha = views["rgba"][views["held_out"]][..., 3:].astype(np.float64)
    return on_white(np.concatenate([colour * alpha, alpha], axis=-1))
