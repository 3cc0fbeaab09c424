"""Pictures of held-out queries and their answers in one small file, for people to look at."""

import io

import numpy as np

QUALITY = 80
METHOD = 2  # of 0 to 6; 6 takes three times as long for a tenth fewer bytes
GREY, AMPLIFIED = 128, 8
SHEET_PIXELS = 16383  # of a side of a WebP


def webp(picture: np.ndarray) -> np.ndarray:
    """Return the bytes, uint8, of an (h, w, 3) RGB or (h, w, 4) RGBA uint8 picture as a WebP with loss.

    Examples
    --------
    >>> webp(np.full((20, 30, 3), 200, np.uint8))[8:12].tobytes()
    b'WEBP'
    """
    from PIL import Image  # not of those who only ask an Object File

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "WEBP", quality=QUALITY, method=METHOD)
    return np.frombuffer(buffer.getvalue(), np.uint8)


def sheet(truth: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """Return a WebP with a row a query: truth, answer, and `AMPLIFIED` times their difference around grey.

    Parameters
    ----------
    truth, answer
        (n, h, w, 3) uint8; of more queries than a WebP can be high, the first ones are kept.

    Returns
    -------
    ndarray
        Bytes, uint8; none where there is no query.

    Examples
    --------
    >>> pictures = np.full((5, 20, 30, 3), 200, np.uint8)
    >>> from PIL import Image
    >>> Image.open(io.BytesIO(sheet(pictures, pictures).tobytes())).size
    (90, 100)
    """
    if not len(truth):
        return np.zeros(0, np.uint8)
    count = SHEET_PIXELS // truth.shape[1]
    truth, answer = truth[:count], answer[:count]
    difference = np.clip(GREY + AMPLIFIED * (answer.astype(np.int16) - truth), 0, 255).astype(np.uint8)
    return webp(np.concatenate([truth, answer, difference], axis=2).reshape(-1, 3 * truth.shape[2], 3))
