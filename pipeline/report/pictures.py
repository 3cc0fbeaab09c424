"""Pictures as data URIs: truth, Object File and their difference."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from objectfolder.fidelity.images import psnr_db

DIFFERENCE_FACTOR = 8
GREY = 128


@dataclass(frozen=True)
class PicturePair:
    """Three pictures of one held-out query."""

    label: str
    psnr_db: float
    truth: str
    answer: str
    difference: str
    width: int
    height: int


def picture_uri(image: np.ndarray) -> str:
    """Return an (h, w, 3) uint8 image as a lossless WebP data URI."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(buffer, "WEBP", lossless=True, quality=80, method=4)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def difference_picture(truth: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """Return grey plus `DIFFERENCE_FACTOR` times (answer - truth), clipped to uint8."""
    difference = answer.astype(np.int32) - truth.astype(np.int32)
    return np.clip(GREY + DIFFERENCE_FACTOR * difference, 0, 255).astype(np.uint8)


def picture_pairs(truth: np.ndarray, answer: np.ndarray, count: int) -> list[PicturePair]:
    """Return up to `count` pairs from the worst to the best by full-image PSNR.

    Parameters
    ----------
    truth, answer
        (k, h, w, 3) uint8.
    """
    scores = [psnr_db(*pair) for pair in zip(truth, answer, strict=True)]
    order = np.argsort(scores, kind="stable")
    shown = np.unique(np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(int))
    pairs = []
    for rank, label in zip(shown, _labels(len(shown)), strict=True):
        index = int(order[rank])
        pairs.append(
            PicturePair(
                label,
                scores[index],
                picture_uri(truth[index]),
                picture_uri(answer[index]),
                picture_uri(difference_picture(truth[index], answer[index])),
                truth.shape[2],
                truth.shape[1],
            )
        )
    return pairs


def _labels(count: int) -> Sequence[str]:
    if count == 3:
        return ("worst", "median", "best")
    return ("worst", *[f"rank {rank}" for rank in range(2, count)], "best")[:count]
