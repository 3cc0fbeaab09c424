"""Dark dots printed on a gel, found in pictures: a disc of their size is sought wherever it fits best.

Needs SciPy.
"""

import numpy as np

# Of the picture's height: dots that are searched for have these radii.
SMALLEST_DOT, LARGEST_DOT = 1 / 160, 1 / 16
SMALLEST_DOT_PIXELS = 1.2
# How much darker than its surroundings a dot is, as a share of them; and of the middle one of all dots.
LEAST_DARKNESS, LEAST_DOT_SHARE = 0.15, 0.4
# Of spots that are no larger than dots and round: the middle half of their areas tells the dots' size.
ROUND_SHARE = 0.6
LEAST_SPOTS = 9
# Of a dot's radius: how far about it its template reaches.
TEMPLATE_REACH = 1.6
TEMPLATE_RIM_PIXELS = 1.0


def dot_radius(picture: np.ndarray) -> float | None:
    """Return the radius in pixels of the dark dots in a picture (height, width, 3) uint8.

    None where it shows less than `LEAST_SPOTS` of them.
    """
    from scipy.ndimage import find_objects, label

    height = len(picture)
    dark = _darkness(picture, LARGEST_DOT * height)
    spots, count = label(dark > LEAST_DARKNESS)
    if count < LEAST_SPOTS:
        return None
    area = np.bincount(spots.ravel(), minlength=count + 1)[1:]
    boxes = find_objects(spots)
    sides = np.array([[part.stop - part.start for part in box] for box in boxes])
    least = np.pi * max(SMALLEST_DOT_PIXELS, SMALLEST_DOT * height) ** 2
    fills = area > ROUND_SHARE * np.pi / 4 * sides.max(axis=1) ** 2
    whole = fills & (area >= least) & (area <= np.pi * (LARGEST_DOT * height) ** 2)
    if whole.sum() < LEAST_SPOTS:
        return None
    # Dark spots are as wide as where their rims are half as dark as their middles.
    number = 1 + np.flatnonzero(whole)
    middle = np.median(dark[np.isin(spots, number)])
    wide = np.array([(dark[boxes[n - 1]] > middle / 2)[spots[boxes[n - 1]] == n].sum() for n in number])
    return float(np.sqrt(np.median(wide) / np.pi))


def find_dots(picture: np.ndarray, radius: float) -> np.ndarray:
    """Find the dark dots of a radius in a picture (height, width, 3) uint8.

    Returns
    -------
    np.ndarray
        (n, 2) float64 rows and columns of their centres; whole numbers are the middles of pixels.
    """
    from scipy.ndimage import maximum_filter
    from scipy.signal import fftconvolve

    dark = _darkness(picture, 2 * radius)
    template = _template(radius)
    border = len(template) // 2
    # A pixel beyond the picture is like its border.
    response = fftconvolve(np.pad(dark, border, mode="edge"), template, mode="valid")
    peaks = (response == maximum_filter(response, size=2 * int(np.ceil(radius)) + 1)) & (
        response > LEAST_DARKNESS
    )
    pixels = np.argwhere(peaks)
    strength = response[peaks]
    centres = np.array([_vertex(response, *pixel) for pixel in pixels]).reshape(-1, 2)
    strong = strength > LEAST_DOT_SHARE * np.median(strength) if len(strength) else np.zeros(0, bool)
    return np.asarray(centres[strong])


def _darkness(picture: np.ndarray, reach: float) -> np.ndarray:
    """How much darker a pixel (height, width) is than the gel about it within `reach`, as a share."""
    from scipy.ndimage import gaussian_filter, grey_closing

    # Coloured light leaves one channel dark everywhere: a dot is dark in all of them.
    value = gaussian_filter(picture.astype(np.float64).sum(axis=2), 0.7)
    side = 2 * int(np.ceil(reach)) + 1
    light = gaussian_filter(grey_closing(value, (side, side)), reach / 2)
    return np.asarray(np.clip(1 - value / np.maximum(light, 1.0), 0.0, 1.0))


def _template(radius: float) -> np.ndarray:
    """A disc less a ring about it, whose sum over an even picture is 0 and over a dot its darkness."""
    reach = int(np.ceil(TEMPLATE_REACH * radius + TEMPLATE_RIM_PIXELS))
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = np.clip((radius - np.hypot(down, right)) / TEMPLATE_RIM_PIXELS + 0.5, 0.0, 1.0)
    ring = (
        np.clip((TEMPLATE_REACH * radius - np.hypot(down, right)) / TEMPLATE_RIM_PIXELS + 0.5, 0.0, 1.0)
        - disc
    )
    return np.asarray(disc / disc.sum() - ring / ring.sum())


def _vertex(response: np.ndarray, row: int, column: int) -> np.ndarray:
    """Where the parabola through a peak and its neighbours is highest."""
    if not (0 < row < response.shape[0] - 1 and 0 < column < response.shape[1] - 1):
        return np.array([row, column], dtype=np.float64)
    block = response[row - 1 : row + 2, column - 1 : column + 2]
    down, right = np.indices((3, 3)) - 1
    terms = np.stack(
        [np.ones(9), *(part.ravel() for part in (down, right, down**2, down * right, right**2))], 1
    )
    _, a, b, c, d, e = np.linalg.lstsq(terms, block.ravel(), rcond=None)[0]
    step = np.linalg.lstsq([[2 * c, d], [d, 2 * e]], [-a, -b], rcond=None)[0]
    return np.array([row, column]) + np.clip(step, -1, 1)
