"""How far one 8-bit image is from another."""

import numpy as np

from objectfolder.extras import needs_extra


def psnr_db(truth: np.ndarray, answer: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio, dB, of 8-bit images: 10 log10(255^2 / mean squared error).

    Parameters
    ----------
    truth, answer
        (h, w, 3) uint8.
    mask
        (h, w) bool, the pixels to compare; all by default.

    Returns
    -------
    float
        At most 20 log10(255 * sqrt(12)) = 58.9 dB: an error below the rounding of 8 bits is not
        distinguished, so equal images do not make a mean infinite. NaN where the mask is empty.
    """
    difference = truth.astype(np.float64) - answer.astype(np.float64)
    if mask is not None:
        difference = difference[mask]
    if difference.size == 0:
        return float("nan")
    return float(10 * np.log10(255.0**2 / max(float(np.mean(difference**2)), 1 / 12)))


def ssim(truth: np.ndarray, answer: np.ndarray) -> float:
    """Structural similarity of (h, w, 3) uint8 images (Wang et al. 2004: Gaussian window, sigma 1.5)."""
    with needs_extra("factory"):
        from skimage.metrics import structural_similarity
    return float(
        structural_similarity(
            truth,
            answer,
            channel_axis=-1,
            data_range=255,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
        )
    )
