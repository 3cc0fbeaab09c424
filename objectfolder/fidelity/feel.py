"""Simulated touches against an Object File, at held-out points of the surface."""

from typing import Any

import numpy as np

from objectfolder.fidelity.images import psnr_db, ssim
from objectfolder.products.store import Product

# Travel between the gel's first contact and the asked point: about what a gel's roundness makes, and more.
OFFSETS_M = (1e-4, 1e-3)

TOUCH_DEFINITIONS = {
    "touch.psnr_db": "Peak signal-to-noise ratio of the whole image, held-out points, mean of touches",
    "touch.psnr_contact_db": "The same over the pixels in contact in the truth or in the answer",
    "touch.ssim": "Structural similarity of the whole image, mean of touches",
    "touch.empty": "The image of no contact at all, measured in the same way",
    "touch.unreachable_share": "Touches, of all in the truth, that the sensor cannot make where it is asked "
    "to: another part of the object stops it first, or meets its housing",
    "touch.offset_over": "Touches where another part meets the gel more than 0.1 mm (1 mm) before the asked "
    "point does",
    "touch.beyond_label_m": "How much deeper in the gel than its label any image shows the object, at most",
}

# Of touches that pyrender drew.
PYRENDER_DEFINITIONS = {
    "touch.pyrender": "The touches as pyrender draws them against the compiled renderer, held-out points: "
    "signal-to-noise ratios as above, pixels in contact for both over those for either, and root mean square "
    "of the difference of depth where both are in contact",
}


def definitions(touches: Product) -> dict[str, str]:
    """Say what is measured of touches, by name."""
    return TOUCH_DEFINITIONS | (PYRENDER_DEFINITIONS if "compiled_rgb" in touches else {})


def measure_touches(
    truth: np.ndarray, truth_mask: np.ndarray, answer: np.ndarray, answer_mask: np.ndarray
) -> list[dict[str, Any]]:
    """Return ``psnr_db`` and ``psnr_contact_db`` of each touch; the latter is None where none is seen.

    Parameters are those of `measure_feel`.
    """
    region = truth_mask | answer_mask
    return [
        {"psnr_db": psnr_db(t, a), "psnr_contact_db": psnr_db(t, a, m) if m.any() else None}
        for t, a, m in zip(truth, answer, region, strict=True)
    ]


def measure_feel(
    truth: np.ndarray, truth_mask: np.ndarray, answer: np.ndarray, answer_mask: np.ndarray
) -> dict[str, Any]:
    """Compare tactile images (n, h, w, 3) uint8 with contact masks (n, h, w).

    Returns
    -------
    dict
        ``psnr_db``, ``psnr_contact_db``, ``ssim``: means over touches (contact: over those that touch).
    """
    rows = measure_touches(truth, truth_mask, answer, answer_mask)
    contact = in_contact(rows)
    return {
        "psnr_db": float(np.mean([row["psnr_db"] for row in rows])),
        "psnr_contact_db": float(np.mean(contact)) if contact else None,
        "psnr_contact_worst_db": float(np.min(contact)) if contact else None,
        "ssim": float(np.mean([ssim(t, a) for t, a in zip(truth, answer, strict=True)])),
    }


def in_contact(rows: list[dict[str, Any]]) -> list[float]:
    """Return ``psnr_contact_db`` of those touches of `measure_touches` in which something is in contact."""
    return [row["psnr_contact_db"] for row in rows if row["psnr_contact_db"] is not None]


def measure_renderers(touches: Product) -> dict[str, float | None]:
    """Compare the held-out touches of pyrender with those of the compiled renderer.

    Parameters
    ----------
    touches
        What `simulate_touches` returned.

    Returns
    -------
    dict
        ``pyrender_psnr_db``, ``pyrender_psnr_contact_db``, ``pyrender_psnr_contact_worst_db`` and
        ``pyrender_ssim`` as `measure_feel` has them, ``pyrender_mask_iou``, ``pyrender_depth_rms_m``; None
        where nothing is in contact. Empty for touches that pyrender did not draw.
    """
    if "compiled_rgb" not in touches:
        return {}
    opengl = {name: touches[name][touches["held_out"]] for name in ("rgb", "mask", "depth")}
    compiled = {name: touches[f"compiled_{name}"] for name in opengl}
    figures = measure_feel(compiled["rgb"], compiled["mask"], opengl["rgb"], opengl["mask"])
    overlap, either = opengl["mask"] & compiled["mask"], opengl["mask"] | compiled["mask"]
    difference = (opengl["depth"] - compiled["depth"])[overlap]
    figures["mask_iou"] = float(overlap.sum() / either.sum()) if either.any() else None
    figures["depth_rms_m"] = float(np.sqrt(np.mean(difference**2))) if overlap.any() else None
    return {f"pyrender_{name}": value for name, value in figures.items()}


def measure_reach(touches: Product) -> dict[str, float]:
    """Say of how much of an object the sensor can touch, from the labels of its touches.

    Parameters
    ----------
    touches
        What `simulate_touches` returned: all of them, those of training, too.

    Returns
    -------
    dict
        ``unreachable_share``, and of it ``unreachable_by_housing_share``, where the gel would reach;
        ``offset_over_100um_share`` and ``offset_over_1mm_share``; ``saturated_share``;
        ``beyond_label_m``, 0 where no image shows the object deeper in the gel than its label says. All 0
        where there are no touches.
    """
    count = max(len(touches["points"]), 1)
    blocked = ~touches["reachable"]
    offset, depth = touches["first_contact_offset_m"], touches["depth_m"]
    over = [float((offset > least).sum() / count) for least in OFFSETS_M]
    shown = touches["depth"].max(axis=(1, 2), initial=0.0)
    beyond = np.max(shown - touches["penetration_m"], initial=0.0)
    return {
        "unreachable_share": float(blocked.sum() / count),
        "unreachable_by_housing_share": float((blocked & (offset <= depth)).sum() / count),
        "offset_over_100um_share": over[0],
        "offset_over_1mm_share": over[1],
        "saturated_share": float(touches["saturated"].sum() / count),
        "beyond_label_m": float(max(beyond, 0.0)),
    }
