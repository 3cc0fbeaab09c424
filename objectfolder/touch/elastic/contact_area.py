"""The area of a contact, to parts of a cell, from the pressure on its cells.

Where a smooth object leaves the surface, pressure falls as the root of the distance from the border (Johnson
1985, Contact Mechanics, section 4.2: p^2 is linear in r^2 under Hertz). So the squared pressure, carried on
linearly past the last cells in contact, is 0 at the border. Under an edge of the object it does not fall;
there the border is taken halfway to the next cell.
"""

import numpy as np

PARTS = 8  # of a cell along each side


def covered_cells(pressure: np.ndarray) -> float:
    """Return the area in contact, in cells, of pressures (rows, columns) >= 0 constant on each cell.

    Of Hertz's contacts of 3 cells in radius and more, the radius is right to an eighth of a cell.

    Examples
    --------
    >>> y, x = np.mgrid[-9:10, -9:10]
    >>> hertz = np.sqrt(np.maximum(1 - (x**2 + y**2) / 6.0**2, 0))
    >>> round(covered_cells(hertz) / (np.pi * 6.0**2), 2)
    1.0
    """
    if not (pressure > 0).any():
        return 0.0
    rows, columns = (np.flatnonzero((pressure > 0).any(axis=axis)) for axis in (1, 0))
    field = _carried_on(np.pad(pressure[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] ** 2, 2))
    corners = np.stack([field[:-1, :-1], field[:-1, 1:], field[1:, :-1], field[1:, 1:]], axis=-1)
    whole = (corners > 0).all(axis=-1)
    border = corners[(corners > 0).any(axis=-1) & ~whole]
    down, right = (part.ravel() for part in np.mgrid[:PARTS, :PARTS] / PARTS + 0.5 / PARTS)
    weights = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right])
    return float(whole.sum()) + float((border @ weights > 0).sum()) / PARTS**2


def _carried_on(squared: np.ndarray) -> np.ndarray:
    """Give the cells round a contact the squared pressure that follows from those in it, below 0."""
    inside, largest = squared > 0, squared.max()
    total, count = np.zeros(squared.shape), np.zeros(squared.shape)
    for axis in (0, 1):
        for step in (1, -1):
            last, before = np.roll(squared, step, axis), np.roll(squared, 2 * step, axis)
            beyond = np.where(before > 0, 2 * last - before, -last)
            reached = ~inside & (last > 0)
            total += np.where(reached, np.where(beyond < 0, beyond, -last), 0.0)
            count += reached
    field = np.where(inside, squared, total / np.maximum(count, 1))
    # Cells that meet the contact at a corner only: as their neighbours.
    lone = ~inside & (count == 0)
    around = sum(np.roll(np.minimum(field, 0.0), step, axis) for axis in (0, 1) for step in (1, -1))
    return np.where(lone, np.where(around < 0, around / 2, -largest), field)
