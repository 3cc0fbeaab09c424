"""The regular grid that dots of a picture lie in, of which some are missing and some are no dots.

Dots are numbered from neighbour to neighbour, then the grid of most of them numbers the others. Needs SciPy.
"""

from dataclasses import dataclass

import numpy as np

# Dots of a grid, their rows and columns, and the share of its places that have one, at least.
LEAST_DOTS, LEAST_LINES, LEAST_OCCUPIED = 9, 3, 0.5
# Shares of the pitch: how far from its place a dot may be, and all of them in rms.
PLACE_REACH, LARGEST_RMS = 0.3, 0.1
# Distance of a dot's neighbours in the grid, over the median distance of a dot to its nearest one.
NEIGHBOUR_RANGE = (0.7, 1.6)
# Share of the places of an outer row or column that have a dot, at least.
LEAST_BORDER = 1 / 3


@dataclass(frozen=True, eq=False)
class Lattice:
    """Dots in a grid.

    Parameters
    ----------
    dots
        (n,) which of the dots they are.
    numbers
        (n, 2) int64 row and column in the grid, from 0.
    origin
        (2,) pixel row and column of the grid's first place.
    pitch
        (2,) pixels from row to row and from column to column.
    turn
        Counterclockwise, radians.
    """

    dots: np.ndarray
    numbers: np.ndarray
    origin: np.ndarray
    pitch: np.ndarray
    turn: float

    @property
    def counts(self) -> np.ndarray:
        """Rows and columns (2,)."""
        return np.asarray(self.numbers.max(axis=0) + 1)

    def places(self, numbers: np.ndarray) -> np.ndarray:
        """Pixel rows and columns (m, 2) of places in the grid."""
        return np.asarray(self.origin + (numbers * self.pitch) @ _axes(self.turn))


def fit_lattice(pixels: np.ndarray, whole: np.ndarray) -> Lattice | None:
    """Return the grid of dots at pixels (n, 2), or None where they are in none.

    `whole` (n,) tells which dots the picture shows all of: only these are fitted.
    """
    if len(pixels) < LEAST_DOTS:
        return None
    steps = _steps(pixels)
    lattice = None if steps is None else _walked(pixels, whole, *steps)
    for trim in (False, True):
        lattice = None if lattice is None else _of_nearest(pixels, whole, lattice, trim=trim)
    if lattice is None:
        return None
    error = lattice_rms(lattice, pixels, whole)
    occupied = len(lattice.dots) >= LEAST_OCCUPIED * lattice.counts.prod()
    return lattice if occupied and error < LARGEST_RMS * lattice.pitch.min() else None


def lattice_rms(lattice: Lattice, pixels: np.ndarray, whole: np.ndarray) -> float:
    """Distance of the whole dots from their places, pixels, root mean square."""
    away = (pixels[lattice.dots] - lattice.places(lattice.numbers))[whole[lattice.dots]]
    return float(np.sqrt((away**2).sum(axis=1).mean()))


def _axes(turn: float) -> np.ndarray:
    """Unit steps (2, 2) in pixel row and column from row to row and from column to column."""
    return np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])


def _steps(pixels: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Pitch (2,) and turn by the steps from dots to their neighbours."""
    from scipy.spatial import cKDTree

    distance, index = (np.asarray(part) for part in cKDTree(pixels).query(pixels, k=5))
    near, far = np.median(distance[:, 1]) * np.array(NEIGHBOUR_RANGE)
    step = (pixels[index[:, 1:]] - pixels[:, None])[(distance[:, 1:] > near) & (distance[:, 1:] < far)]
    if len(step) < LEAST_DOTS:
        return None
    # Neighbours lie in four directions, a right angle apart.
    turn = float(np.angle(np.mean(np.exp(4j * np.arctan2(step[:, 1], step[:, 0])))) / 4)
    along = np.abs(step @ _axes(turn).T)
    ahead = along[:, 0] > along[:, 1]
    if ahead.all() or not ahead.any():
        return None
    return np.array([np.median(along[ahead, 0]), np.median(along[~ahead, 1])]), turn


def _walked(pixels: np.ndarray, whole: np.ndarray, pitch: np.ndarray, turn: float) -> Lattice | None:
    """The grid of the most dots that lead to one another from neighbour to neighbour."""
    from scipy.spatial import cKDTree

    tree, step = cKDTree(pixels), pitch[:, None] * _axes(turn)
    moves = [(number, number @ step) for number in np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])]
    best: dict[int, np.ndarray] = {}
    unvisited = set(range(len(pixels)))
    while unvisited:
        first = min(unvisited)
        numbers, queue = {first: np.zeros(2, dtype=np.int64)}, [first]
        for dot in queue:
            for number, move in moves:
                away, nearest = tree.query(pixels[dot] + move)
                neighbour = int(nearest)
                if away < PLACE_REACH * pitch.min() and neighbour not in numbers:
                    numbers[neighbour] = numbers[dot] + number
                    queue.append(neighbour)
        unvisited -= set(numbers)
        best = max(best, numbers, key=len)
    return _fitted(pixels, whole, np.array(list(best)), np.array(list(best.values())))


def _of_nearest(pixels: np.ndarray, whole: np.ndarray, lattice: Lattice, *, trim: bool) -> Lattice | None:
    """The grid of the dots that are nearest to the places of another; `trim`: with no bare border."""
    numbers = np.rint((pixels - lattice.origin) @ _axes(lattice.turn).T / lattice.pitch).astype(np.int64)
    away = np.hypot(*(pixels - lattice.places(numbers)).T)
    order = np.argsort(away, kind="stable")
    order = order[away[order] < PLACE_REACH * lattice.pitch.min()]
    # Of the dots at a place the nearest.
    first = np.unique(numbers[order], axis=0, return_index=True)[1]
    dots = order[np.sort(first)]
    while trim and len(dots) and (inner := _without_bare_border(numbers[dots])).sum() < len(dots):
        dots = dots[inner]
    return _fitted(pixels, whole, dots, numbers[dots])


def _without_bare_border(numbers: np.ndarray) -> np.ndarray:
    """Which dots (n,) are not in an outer row or column that is nearly empty."""
    inner = np.ones(len(numbers), dtype=bool)
    counts = np.ptp(numbers, axis=0) + 1
    for axis in (0, 1):
        for border in (numbers[:, axis].min(), numbers[:, axis].max()):
            line = numbers[:, axis] == border
            if line.sum() < LEAST_BORDER * counts[1 - axis]:
                inner &= ~line
    return inner


def _fitted(pixels: np.ndarray, whole: np.ndarray, dots: np.ndarray, numbers: np.ndarray) -> Lattice | None:
    """The grid of numbered dots, by least squares of the whole ones."""
    from scipy.optimize import least_squares

    used = whole[dots]
    lines = [len(np.unique(numbers[used, axis])) for axis in (0, 1)]
    if used.sum() < LEAST_DOTS or min(lines) < LEAST_LINES:
        return None
    numbers = numbers - numbers.min(axis=0)
    place, number = pixels[dots[used]], numbers[used]
    affine = np.linalg.lstsq(np.column_stack([np.ones(len(number)), number]), place, rcond=None)[0]
    turn = np.arctan2(affine[1, 1] - affine[2, 0], affine[1, 0] + affine[2, 1])

    def errors(x: np.ndarray) -> np.ndarray:
        return np.asarray((x[:2] + (number * x[2:4]) @ _axes(x[4]) - place).ravel())

    start = np.array([*affine[0], *np.hypot(*affine[1:].T), turn])
    x = least_squares(errors, start, x_scale=[1, 1, 0.1, 0.1, 0.01]).x
    return Lattice(dots, numbers, x[:2], x[2:4], float(x[4]))
