"""The grid of markers on a gel by its untouched picture, and where each of them is in photographs of touches.

Dark dots printed on a gel are found in pictures: a disc of their size is sought wherever it fits best.
Needs SciPy.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.touch.sensor.magnification import pixels_per_metre
from objectfolder.touch.sensor.marker_grid import MarkerGrid
from objectfolder.touch.sensor.marker_lattice import Lattice, fit_lattice, lattice_rms
from objectfolder.touch.sensor.sensor import Sensor

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


# Share of the pitch that a dot may move.
LARGEST_DOT_SHIFT = 0.45
# Share of the dots that a photograph must show to be used.
LEAST_FOLLOWED = 0.75
# Share of them that a picture shows of a gel on which they are drawn.
LEAST_SHOWN = 0.5
# Beyond a dot's radius its rim still darkens the picture so far.
DOT_RIM_PIXELS = 2.0


@dataclass(frozen=True, eq=False)
class Tracking:
    """Markers in photographs.

    Parameters
    ----------
    grid
        Fitted to the untouched picture.
    rms_m
        Distance of its dots from the grid, root mean square; those that the picture's border cuts are not
        counted.
    rest_pixels
        (k, 2) float64 row and column of each dot there.
    pixels
        (n, k, 2) float64 the same in each photograph; NaN where a dot was not followed.
    largest_shift_m
        (n,) how far the dot moved that moved most, at the magnification of the gel's apex.
    hidden
        (n, height, width) bool: pixels of each photograph that dots darken.
    rest_hidden
        (height, width) bool, those of the untouched picture.
    """

    grid: MarkerGrid
    rms_m: float
    rest_pixels: np.ndarray
    pixels: np.ndarray
    largest_shift_m: np.ndarray
    hidden: np.ndarray
    rest_hidden: np.ndarray

    @property
    def followed(self) -> np.ndarray:
        """How many dots (n,) of each photograph were followed."""
        return np.asarray(np.isfinite(self.pixels[..., 0]).sum(axis=1))

    def fault(self, index: int) -> str:
        """Why a photograph cannot be used, or nothing."""
        count, markers = self.followed[index], len(self.rest_pixels)
        return "" if count >= LEAST_FOLLOWED * markers else f"{count} of {markers} markers followed"


def track_markers(photographs: np.ndarray, untouched: np.ndarray, sensor: Sensor) -> Tracking | None:
    """Find the grid of an untouched picture and its dots in photographs; None where it shows no grid.

    Parameters
    ----------
    photographs, untouched
        (n, height, width, 3) and (height, width, 3) uint8.
    sensor
        Whose magnification it is, of their size.

    Raises
    ------
    InputError
        A grid in the first photograph and none in the untouched picture.
    """
    regular = _regular_dots(untouched)
    if regular is None:
        if _regular_dots(photographs[0]) is not None:
            raise InputError(
                "photographs",
                "the first shows a grid of markers, the untouched picture none",
                "Take the untouched picture of the same gel.",
            )
        return None
    radius, dots, whole, lattice = regular
    shape, scale, rest = untouched.shape[:2], pixels_per_metre(sensor), dots[lattice.dots]
    pressed = [find_dots(photograph, radius) for photograph in photographs]
    reach = LARGEST_DOT_SHIFT * lattice.pitch.min()
    pixels = np.stack([_matched(rest, candidates, reach) for candidates in pressed])
    cut = _beyond_border(lattice.places(_surroundings(lattice.counts)), shape)
    missing = [np.concatenate([rest[np.isnan(place[:, 0])], cut]) for place in pixels]
    return Tracking(
        _grid(lattice, radius, shape, scale),
        lattice_rms(lattice, dots, whole) / scale,
        rest,
        pixels,
        np.nan_to_num(np.hypot(*np.moveaxis(pixels - rest, 2, 0))).max(axis=1) / scale,
        np.stack([_discs(shape, radius, *both) for both in zip(pressed, missing, strict=True)]),
        _discs(shape, radius, dots, cut),
    )


def without_markers(picture: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return a picture (height, width, 3) uint8 of a sensor with markers, filled where they hide the gel.

    A picture that shows less than half of them, as one of a simulated touch on which none were drawn, is
    returned as it is.
    """
    grid, shape = sensor.marker_grid, picture.shape[:2]
    if grid is None:
        return picture
    scale = pixels_per_metre(sensor)
    places = (np.array(shape) - 1) / 2 + grid.places_m() * scale
    inside = places[((places > 0) & (places < np.array(shape) - 1)).all(axis=1)]
    drawn = find_dots(picture, grid.dot_radius_m * scale)
    reach = LARGEST_DOT_SHIFT * scale * min(grid.row_pitch_m, grid.column_pitch_m)
    if np.isfinite(_matched(inside, drawn, reach)[:, 0]).mean() < LEAST_SHOWN:
        return picture
    return without_dots(picture, _discs(shape, grid.dot_radius_m * scale, drawn))


def without_dots(picture: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Return a picture (height, width, 3) uint8 whose hidden pixels go on smoothly from those about them.

    Their Laplacian is harmonic: a slope that varies evenly goes on through a dot.
    """
    from scipy.sparse import eye, kron
    from scipy.sparse.linalg import splu

    if not hidden.any():
        return picture
    height, width = hidden.shape
    laplacian = kron(_second_difference(height), eye(width)) + kron(eye(height), _second_difference(width))
    filled, unknown = picture.reshape(-1, 3).astype(np.float64), hidden.ravel()
    rows = (laplacian @ laplacian).tocsr()[unknown]
    filled[unknown] = splu(rows[:, unknown].tocsc()).solve(-(rows[:, ~unknown] @ filled[~unknown]))
    return np.clip(np.rint(filled), 0, 255).astype(np.uint8).reshape(picture.shape)


def _second_difference(count: int) -> Any:
    """Sparse second differences (count, count) of values that go on evenly beyond both ends."""
    from scipy.sparse import diags

    middle = np.full(count, -2.0)
    middle[[0, -1]] = -1.0
    return diags([np.ones(count - 1), middle, np.ones(count - 1)], [-1, 0, 1])


def _regular_dots(picture: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, Lattice] | None:
    """Radius of a picture's dots, where they are (n, 2), which of them it shows whole, and their grid."""
    radius = dot_radius(picture)
    if radius is None:
        return None
    dots = find_dots(picture, radius)
    whole = (np.minimum(dots, np.array(picture.shape[:2]) - 1 - dots) > radius).all(axis=1)
    lattice = fit_lattice(dots, whole)
    return None if lattice is None else (radius, dots, whole, lattice)


def _grid(lattice: Lattice, radius: float, shape: tuple[int, ...], scale: float) -> MarkerGrid:
    """The grid in metres of a lattice in a picture of a shape; `scale` is in pixels a metre."""
    down, right = (lattice.places((lattice.counts - 1) / 2) - (np.array(shape) - 1) / 2) / scale
    return MarkerGrid(
        rows=int(lattice.counts[0]),
        columns=int(lattice.counts[1]),
        row_pitch_m=float(lattice.pitch[0] / scale),
        column_pitch_m=float(lattice.pitch[1] / scale),
        rotation_deg=float(np.degrees(lattice.turn)),
        offset_down_m=float(down),
        offset_right_m=float(right),
        dot_radius_m=radius / scale,
    )


def _matched(rest: np.ndarray, seen: np.ndarray, reach: float) -> np.ndarray:
    """Where dots (k, 2) are among those seen (m, 2), NaN where none of these is within reach and theirs."""
    from scipy.spatial import cKDTree

    places = np.full(rest.shape, np.nan)
    if len(seen):
        distance, there = (np.asarray(part) for part in cKDTree(seen).query(rest))
        back = np.asarray(cKDTree(rest).query(seen)[1])
        chosen = (distance < reach) & (back[there] == np.arange(len(rest)))
        places[chosen] = seen[there[chosen]]
    return places


def _surroundings(counts: np.ndarray) -> np.ndarray:
    """Numbers (m, 2) of the places next to a grid of `counts` rows and columns."""
    numbers = np.stack([part.ravel() for part in np.indices((counts + 2).tolist())], axis=1) - 1
    return np.asarray(numbers[((numbers < 0) | (numbers == counts)).any(axis=1)])


def _beyond_border(places: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Those of places (m, 2) that a picture does not show: of a dot there it may show a part."""
    return np.asarray(places[((places < 0) | (places > np.array(shape) - 1)).any(axis=1)])


def _discs(shape: tuple[int, ...], radius: float, *centres: np.ndarray) -> np.ndarray:
    """Which pixels of a picture the dots at all the centres (n, 2) darken."""
    from scipy.spatial import cKDTree

    pixels = np.stack([part.ravel() for part in np.indices(shape)], axis=1)
    tree = cKDTree(np.concatenate(centres))
    near = tree.query(pixels, distance_upper_bound=radius + DOT_RIM_PIXELS)[0]
    return np.asarray(np.isfinite(near).reshape(shape))
