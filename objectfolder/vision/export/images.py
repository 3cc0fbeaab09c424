"""Scene-linear premultiplied RGBA to image files that other programs read."""

import os
from pathlib import Path

import numpy as np
from PIL import Image

from objectfolder.errors import InputError
from objectfolder.vision.compositing import srgb_encode

EXR_FLAG = "OPENCV_IO_ENABLE_OPENEXR"


def straight_srgb(rgba: np.ndarray) -> np.ndarray:
    """Return (..., 4) uint8 sRGB with straight alpha of scene-linear premultiplied RGBA.

    Blended over white as the web does it (encoded values, by alpha) this is `compositing.on_white` to within
    the rounding of 8 bits. Colour is 0 where alpha is.
    """
    values = np.asarray(rgba, dtype=np.float64)
    alpha = np.clip(values[..., 3:], 0.0, 1.0)
    colour = np.divide(values[..., :3], alpha, out=np.zeros_like(values[..., :3]), where=alpha > 0)
    return np.round(np.concatenate([srgb_encode(colour), alpha], axis=-1) * 255.0).astype(np.uint8)


def write_png(path: Path, rgba: np.ndarray) -> None:
    """Write (h, w, 4) scene-linear premultiplied RGBA as 8-bit sRGB PNG with straight alpha."""
    Image.fromarray(straight_srgb(rgba), "RGBA").save(path, compress_level=6)


def write_exr(path: Path, rgba: np.ndarray) -> None:
    """Write (h, w, 4) float16 scene-linear premultiplied RGBA as OpenEXR of half floats: nothing is lost.

    Raises
    ------
    InputError
        OpenCV is missing, or was used in this process before its OpenEXR support was switched on.
    """
    os.environ.setdefault(EXR_FLAG, "1")
    try:
        import cv2
    except ImportError as error:
        raise InputError(
            str(path), "OpenEXR is written by OpenCV, which is not installed",
            "Install opencv-python-headless, or leave EXR out.",
        ) from error  # fmt: skip
    values = np.ascontiguousarray(rgba[..., [2, 1, 0, 3]], dtype=np.float32)
    half = [cv2.IMWRITE_EXR_TYPE, cv2.IMWRITE_EXR_TYPE_HALF]
    try:
        written = cv2.imwrite(str(path), values, half)
    except cv2.error as error:
        raise InputError(
            str(path), f"OpenCV does not write OpenEXR ({str(error).strip().splitlines()[0]})",
            f"Set {EXR_FLAG}=1 before the program starts, or leave EXR out.",
        ) from error  # fmt: skip
    if not written:
        raise InputError(str(path), "OpenCV wrote no file", "Check that there is room on the disk.")
