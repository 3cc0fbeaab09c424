"""What integrals over a closed surface count more than once: where pieces overlap, or lie in one another.

Along a column the winding number goes up by one at each face that is entered and down at each that is left.
Where it is 2 or more, the space belongs to as many pieces. Columns are upright, one drawn in each cell of a
grid; along them the lengths are exact.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.openings import patches_of
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
COLUMNS_AT_ONCE = 16384
CELLS_AT_ONCE = 2_000_000
GAUSS = 0.5 / np.sqrt(3)  # from the middle over the length: two points integrate cubics exactly


@dataclass(frozen=True)
class CountedAgain:
    """What is to be taken away from an integral over a closed surface, as points.

    Attributes
    ----------
    points : (n, 3)
    volumes : (n,) cubic units of length
    uncertainty : standard error of their sum
    """

    points: Floats
    volumes: Floats
    uncertainty: float


NOTHING = CountedAgain(np.zeros((0, 3)), np.zeros(0), 0.0)


def counted_again(surface: Surface, *, columns: int = COLUMNS_AT_ONCE, seed: int = 0) -> CountedAgain:
    """Where patches of a closed surface with outward faces overlap, and how often too much.

    A surface of which no two patches have bounding boxes that meet counts nothing again. Of two boxes along
    the axes the overlap is exact.

    Examples
    --------
    >>> from trimesh.creation import box
    >>> bars = box((4, 1, 1)) + box((1, 4, 1))
    >>> again = counted_again(Surface(bars.vertices, bars.faces))
    >>> round(float(again.volumes.sum()), 9), again.uncertainty < 1e-9
    (1.0, True)
    """
    box = _common_box(surface)
    if box is None:
        return NOTHING
    low, size = box[0][:2], (box[1] - box[0])[:2]
    counts = np.maximum(1, np.round(size * np.sqrt(columns / np.prod(size)))).astype(np.int64)
    counts = np.minimum(counts, columns)
    at = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1)
    places = low + (at + np.random.default_rng(seed).random(at.shape)) * size / counts
    column, height, step = _crossings(surface, low, size / counts, places)
    if len(column) == 0:
        return NOTHING
    order = np.lexsort((height, column))
    column, height, step = column[order], height[order], step[order]
    within = column[1:] == column[:-1]
    total = np.cumsum(step)
    first = np.searchsorted(column, column)
    times = np.where(within, (total - (total - step)[first])[:-1] - 1, 0)
    again = np.flatnonzero(times > 0)
    length, middle = height[again + 1] - height[again], (height[again + 1] + height[again]) / 2
    ends = middle + length * GAUSS * np.array([[-1.0], [1.0]])
    ground = np.tile(places.reshape(-1, 2)[column[again]], (2, 1))
    each = float(np.prod(size / counts))
    volumes = each * times[again] * length
    of_column = np.bincount(column[again], volumes, int(np.prod(counts)))
    error = float(of_column.std()) * np.sqrt(len(of_column))
    return CountedAgain(np.column_stack([ground, ends.ravel()]), np.tile(volumes / 2, 2), error)


def _common_box(surface: Surface) -> tuple[Floats, Floats] | None:
    """Lower and upper corner (3,) around all that the bounding boxes of any two patches have in common."""
    patch = patches_of(surface.edges)
    count = int(patch.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    corners = surface.vertices[surface.faces]
    np.minimum.at(low, patch, corners.min(axis=1))
    np.maximum.at(high, patch, corners.max(axis=1))
    order = np.argsort(low[:, 0], kind="stable")
    low, high = low[order], high[order]
    boxes = []
    for index, end in enumerate(np.searchsorted(low[:, 0], high[:, 0])):
        lower = np.maximum(low[index], low[index + 1 : end])
        upper = np.minimum(high[index], high[index + 1 : end])
        meet = (lower < upper).all(axis=1)
        if meet.any():
            boxes.append((lower[meet].min(axis=0), upper[meet].max(axis=0)))
    if not boxes:
        return None
    lowest, highest = np.array(boxes).swapaxes(0, 1)
    return lowest.min(axis=0), highest.max(axis=0)


def _crossings(
    surface: Surface, low: Floats, cell: Floats, places: Floats
) -> tuple[Integers, Floats, Integers]:
    """Column, height and step of the winding number of each crossing of a face with a column, (n,) each.

    Parameters
    ----------
    low, cell
        (2,) corner of the grid, and sides of its cells.
    places
        (n, m, 2) the column in each cell.
    """
    corners = surface.vertices[surface.faces]
    shape = np.array(places.shape[:2])
    first = np.clip(np.floor((corners[:, :, :2].min(axis=1) - low) / cell), 0, shape).astype(np.int64)
    last = np.clip(np.ceil((corners[:, :, :2].max(axis=1) - low) / cell), 0, shape).astype(np.int64)
    cells = np.prod(last - first, axis=1)
    crossings = []
    starts = np.searchsorted(np.cumsum(cells), np.arange(0, cells.sum(), CELLS_AT_ONCE))
    for faces in np.split(np.arange(len(cells)), starts[1:]):
        face = np.repeat(faces, cells[faces])
        number = np.arange(len(face)) - np.repeat(np.cumsum(cells[faces]) - cells[faces], cells[faces])
        width = (last - first)[face, 1]
        row, line = first[face, 0] + number // width, first[face, 1] + number % width
        crossings.append(_crossed(corners[face], places[row, line], row * shape[1] + line))
    return tuple(np.concatenate(parts) for parts in zip(*crossings, strict=True))


def _crossed(corners: Floats, places: Floats, column: Integers) -> tuple[Integers, Floats, Integers]:
    """Of triangles (n, 3, 3) and columns at (n, 2), those that cross: column, height and step."""
    away = corners[:, :, :2] - places[:, None]
    after = np.roll(away, -1, axis=1)
    # Twice the areas that the column makes with each side, and the corner across from it.
    areas = np.roll(away[..., 0] * after[..., 1] - away[..., 1] * after[..., 0], -1, axis=1)
    inside = (areas > 0).all(axis=1) | (areas < 0).all(axis=1)
    areas, total = areas[inside], areas[inside].sum(axis=1)
    height = np.einsum("nk,nk->n", areas, corners[inside, :, 2]) / total
    return column[inside], height, -np.sign(total).astype(np.int64)
