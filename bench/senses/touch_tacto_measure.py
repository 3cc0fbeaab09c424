"""Measures of `bench.senses.touch_tacto`: PSNR with a stated ceiling, and where errors lie."""

from typing import Any

import numpy as np
from scipy.ndimage import binary_dilation

ROUNDING = 1 / 12
# Mean squared error of one level in one value of an image of 160 x 120.
ONE_LEVEL = 1 / (160 * 120 * 3)
NEAR_EDGE = 2


def psnr_db(
    truth: np.ndarray, answer: np.ndarray, mask: np.ndarray | None = None, least: float = ROUNDING
) -> float:
    """PSNR, dB, of 8-bit images (h, w, 3) over `mask`; the mean squared error counts as at least `least`."""
    difference = truth.astype(np.float64) - answer
    if mask is not None:
        difference = difference[mask]
    return float(10 * np.log10(255**2 / max(float(np.mean(difference**2)), least)))


def edge_share(truth: np.ndarray, answer: np.ndarray, mask: np.ndarray) -> float:
    """Share of the squared error within `NEAR_EDGE` pixels of the outline of `mask` (h, w)."""
    squares = ((truth.astype(np.float64) - answer) ** 2).sum(axis=-1)
    edge = binary_dilation(mask, iterations=NEAR_EDGE) & binary_dilation(~mask, iterations=NEAR_EDGE)
    return float(squares[edge].sum() / max(squares.sum(), 1e-300))


def over_poses(rows: list[dict[str, Any]]) -> dict[str, float | int]:
    """Means and worsts over poses."""
    found: dict[str, float | int] = {"poses": len(rows)}
    for measure in ("raw_psnr", "contact_psnr", "calibrated_psnr"):
        values = [row[f"{measure}_db"] for row in rows if row[f"{measure}_db"] is not None]
        found[f"{measure}_mean_db"], found[f"{measure}_worst_db"] = (
            float(np.mean(values)),
            float(np.min(values)),
        )
        empty = [row[f"empty_{measure}_db"] for row in rows if row[f"empty_{measure}_db"] is not None]
        found[f"empty_{measure}_mean_db"] = float(np.mean(empty))
    for measure in ("raw_ssim", "calibrated_ssim"):
        values = [row[measure] for row in rows]
        found[f"{measure}_mean"], found[f"{measure}_worst"] = float(np.mean(values)), float(np.min(values))
        found[f"empty_{measure}_mean"] = float(np.mean([row[f"empty_{measure}"] for row in rows]))
    found["error_at_edges_mean"] = float(np.mean([row["error_at_edges"] for row in rows]))
    found["tacto_cpu_s_median"] = float(np.median([row["tacto_cpu_s"] for row in rows]))
    return found
