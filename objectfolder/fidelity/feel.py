"""Simulated touches against an Object File, at held-out points of the surface."""

from typing import Any

import numpy as np

from objectfolder.fidelity.images import psnr_db, ssim

DEFINITIONS = {
    "touch.psnr_db": "Peak signal-to-noise ratio of the whole image, held-out points, mean of touches",
    "touch.psnr_contact_db": "The same over the pixels in contact in the truth or in the answer",
    "touch.ssim": "Structural similarity of the whole image, mean of touches",
    "touch.empty": "The image of no contact at all, measured in the same way",
}


def measure_feel(
    truth: np.ndarray, truth_mask: np.ndarray, answer: np.ndarray, answer_mask: np.ndarray
) -> dict[str, Any]:
    """Compare tactile images (n, h, w, 3) uint8 with contact masks (n, h, w).

    Returns
    -------
    dict
        ``psnr_db``, ``psnr_contact_db``, ``ssim``: means over touches (contact: over those that touch).
    """
    region = truth_mask | answer_mask
    contact = [psnr_db(t, a, m) for t, a, m in zip(truth, answer, region, strict=True) if m.any()]
    return {
        "psnr_db": float(np.mean([psnr_db(t, a) for t, a in zip(truth, answer, strict=True)])),
        "psnr_contact_db": float(np.mean(contact)) if contact else None,
        "psnr_contact_worst_db": float(np.min(contact)) if contact else None,
        "ssim": float(np.mean([ssim(t, a) for t, a in zip(truth, answer, strict=True)])),
    }
