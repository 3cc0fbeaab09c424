"""Pictures as data URIs, and thumbnails."""

import base64
import io
import zlib

import numpy as np

GREY = 128
THUMBNAIL_PIXELS = 96
NEARLY_WHITE = 250


def picture_uri(image: np.ndarray) -> str:
    """Return an (h, w, 3) uint8 image as a lossless data URI.

    By OpenCV's PNG, which has one filter: half the time of PIL's, which tries all, or of WebP's fastest way,
    for a fifth and a third more bytes on renders. WebP's slowest takes a hundred times as long for half.
    """
    import cv2

    # With a level of compression set, OpenCV would try all filters too.
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return _uri(encoded.tobytes())


def indexed_uri(levels: np.ndarray, palette: np.ndarray, transparent: int | None = None) -> str:
    """Return an (h, w) uint8 image of places in an (n, 3) palette as a data URI; one may be see-through."""
    from PIL import Image

    picture = Image.fromarray(np.ascontiguousarray(levels), "P")
    picture.putpalette(palette.astype(np.uint8).tobytes())
    options = {} if transparent is None else {"transparency": transparent}
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", compress_level=1, compress_type=zlib.Z_RLE, **options)
    return _uri(buffer.getvalue())


def thumbnail(views: np.ndarray | None) -> bytes:
    """Return a small WebP of the best lit of (n, h, w, 3) uint8 views on white; grey for none."""
    from PIL import Image

    if views is None or not len(views):
        chosen = np.full((1, 1, 3), GREY, np.uint8)
    else:
        chosen = views[int(np.argmax([_brightness(view) for view in views]))]
    image = Image.fromarray(np.ascontiguousarray(chosen))
    image.thumbnail((THUMBNAIL_PIXELS, THUMBNAIL_PIXELS))
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", quality=80, method=0)
    return buffer.getvalue()


def _uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _brightness(view: np.ndarray) -> float:
    """Return the mean brightness of what is not white, less where little of the picture is covered."""
    shown = view[(view < NEARLY_WHITE).any(axis=-1)]
    return float(shown.mean() * len(shown) ** 0.25) if len(shown) else 0.0
