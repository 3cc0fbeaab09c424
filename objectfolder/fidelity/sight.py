"""Rendered truth against an Object File, on held-out cameras and lights."""

from typing import Any

import numpy as np

from objectfolder.fidelity.images import psnr_db, ssim
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import Product
from objectfolder.vision.appearance import THIN
from objectfolder.vision.compositing import on_white, srgb_encode
from objectfolder.vision.network.thin_glass import index_of, slab
from objectfolder.vision.visionnet.visionnet import REFLECTANCE

FOREGROUND_ALPHA = 0.5
# Of thin glass, which is seen by what it shows and hides little: the same of what one clear wall reflects.
THIN_FOREGROUND_ALPHA = FOREGROUND_ALPHA * float(slab(np.ones(1), np.ones((1, 3)), index_of(0.5))[0][0, 0])
# Linear radiance of a channel from which on a pixel is lit: much of many views is dark, which is easy.
LIT_RADIANCE = 0.01
# A view of fewer lit pixels says nothing: of some pixels on an edge, which are all that a few views have lit.
LEAST_LIT_PIXELS = 10

SIGHT_DEFINITIONS = {
    "vision.psnr_db": "PSNR of 8-bit sRGB on white, held-out cameras and lights, mean of views",
    "vision.psnr_foreground_db": "The same over the pixels that the object covers by at least half",
    "vision.psnr_on_black_db": "Of thin glass: PSNR of the foreground of 8-bit sRGB on black, mean of views",
    "vision.psnr_alpha_db": "Of thin glass: PSNR of the foreground's alpha, mean of views",
    "vision.psnr_foreground_worst_db": "The least of these views",
    "vision.psnr_lit_db": "The same over the lit of these pixels (a channel above 0.01, linear), of views "
    f"with at least {LEAST_LIT_PIXELS} of them",
    "vision.ssim": "Structural similarity (Wang et al. 2004), Gaussian window of sigma 1.5, mean of views",
    "vision.albedo_psnr_db": "PSNR of 8-bit sRGB base colour at the centres of held-out pixels",
    "vision.roughness_psnr_db": "The same of roughness, linear, where it varies; metallic likewise",
    "vision.trivial": "The true silhouette filled with the mean colour of the object in the training views",
}


def foreground_alpha(views: Product) -> float:
    """Return the alpha from which on the object is taken to cover half of a pixel; views of glass say so."""
    thin = views.attributes.get("appearance", {}).get("glass") == THIN
    return THIN_FOREGROUND_ALPHA if thin else FOREGROUND_ALPHA


def held_out_truth(views: Product) -> tuple[np.ndarray, np.ndarray]:
    """Return the held-out views on white (n, h, w, 3) uint8 and their foreground masks (n, h, w)."""
    rgba = views["rgba"][views["held_out"]].astype(np.float32)
    return on_white(rgba), rgba[..., 3] >= foreground_alpha(views)


def lit_pixels(views: Product) -> np.ndarray:
    """Return the masks (n, h, w) of the foreground of held-out views that light reaches."""
    rgba = views["rgba"][views["held_out"]].astype(np.float32)
    alpha = rgba[..., 3]
    return np.asarray(
        (alpha >= foreground_alpha(views)) & (rgba[..., :3].max(axis=-1) > LIT_RADIANCE * alpha)
    )


def measure_within(
    truth: np.ndarray, within: np.ndarray, answer: np.ndarray, least_pixels: int = 1
) -> list[float]:
    """Return the PSNR of (n, h, w, 3) uint8 images in masks (n, h, w), dB, of views of enough pixels."""
    pairs = zip(truth, answer, within, strict=True)
    return [psnr_db(t, a, mask) for t, a, mask in pairs if np.count_nonzero(mask) >= least_pixels]


def held_out_answer(file: ObjectFile, views: Product, sub_rays: int | None = None) -> np.ndarray:
    """Render the held-out views from the Object File, (n, h, w, 3) uint8 on white."""
    held_out = views["held_out"]
    height, width = views["rgba"].shape[1:3]
    return file.render(
        file.frame.camera_to_object(views["camera_to_world"][held_out]),
        file.frame.to_object(views["light_position"][held_out]),
        resolution=(height, width),
        field_of_view_deg=float(views.attributes["field_of_view_deg"]),
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
    finite = [row for row in rows if np.isfinite(row["psnr_foreground_db"])]
    means: dict[str, Any] = {
        key: float(np.mean([row[key] for row in (finite if key == "psnr_foreground_db" else rows)]))
        for key in ("psnr_db", "psnr_foreground_db", "ssim")
    }
    for row in rows:
        if not np.isfinite(row["psnr_foreground_db"]):
            row["psnr_foreground_db"] = None
    return {**means, "per_view": rows}


def measure_glass(file: ObjectFile, views: Product) -> dict[str, float]:
    """Compare what thin glass shows and hides, apart: on white its highlights are white on white.

    Returns
    -------
    dict
        ``psnr_on_black_db`` and ``psnr_alpha_db``: means of the foreground of held-out views. Empty for
        opaque objects.
    """
    if file.vision.glass != THIN:
        return {}
    held_out = views["held_out"]
    true, within = views["rgba"][held_out].astype(np.float32), held_out_truth(views)[1]
    height, width = true.shape[1:3]
    answer = file.render_linear(
        file.frame.camera_to_object(views["camera_to_world"][held_out]),
        file.frame.to_object(views["light_position"][held_out]),
        resolution=(height, width),
        field_of_view_deg=float(views.attributes["field_of_view_deg"]),
    )

    def shown(rgba: np.ndarray) -> np.ndarray:
        return np.rint(255 * srgb_encode(rgba[..., :3]))

    def hidden(rgba: np.ndarray) -> np.ndarray:
        return np.rint(255 * rgba[..., 3:])

    return {
        f"psnr_{name}_db": float(np.mean(measure_within(part(true), within, part(answer))))
        for name, part in (("on_black", shown), ("alpha", hidden))
        if within.any()
    }


def measure_reflectance(file: ObjectFile, views: Product) -> dict[str, float]:
    """Compare reflectance at the centres of the held-out views' pixels, where truth and answer have some.

    Returns
    -------
    dict
        ``albedo_psnr_db`` (sRGB-encoded), and ``roughness_psnr_db`` and ``metallic_psnr_db`` where they
        vary: of 8 bits, all pixels pooled. Empty where the views or the file state none.
    """
    if not {"albedo", "roughness", "metallic", "mask"} <= set(views.arrays) or not file.vision.states(
        "albedo"
    ):
        return {}
    held_out, size = views["held_out"], views["mask"].shape[1:]
    cameras = file.frame.camera_to_object(views["camera_to_world"][held_out])
    answer = file.render_passes(
        cameras,
        ("mask", *REFLECTANCE),
        resolution=(int(size[0]), int(size[1])),
        field_of_view_deg=float(views.attributes["field_of_view_deg"]),
    )
    shared = answer["mask"] & views["mask"][held_out]
    measured = {}
    for name in REFLECTANCE:
        true, estimate = views[name][held_out][shared].astype(np.float64), answer[name][shared]
        if name == "albedo":
            true, estimate = srgb_encode(true), srgb_encode(estimate)
        elif np.ptp(true) == 0:
            continue
        measured[f"{name}_psnr_db"] = psnr_db(np.rint(255 * true), np.rint(255 * estimate))
    return measured


def trivial_answer(views: Product) -> np.ndarray:
    """Return the held-out silhouettes in the object's mean training colour, (n, h, w, 3) uint8."""
    training = views["rgba"][~views["held_out"]].astype(np.float64)
    covered = training[..., 3].sum()
    colour = training[..., :3].sum(axis=(0, 1, 2)) / max(covered, 1e-12)
    alpha = views["rgba"][views["held_out"]][..., 3:].astype(np.float64)
    return on_white(np.concatenate([colour * alpha, alpha], axis=-1))
