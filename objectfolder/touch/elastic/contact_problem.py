"""Frictionless contact of a rigid object with an elastic surface: pressure, displacement, force.

The pressure p >= 0 displaces the surface by u = K p, so that the gap left, g = u + gap - indentation, is
>= 0, and p g = 0: a convex quadratic problem for `conjugate_gradients.py`, here posed on the part of the
grid where contact may be, and checked on all of it.

The area of the contact is told to parts of a cell, from the pressure on its cells. Where a smooth object
leaves the surface, pressure falls as the root of the distance from the border (Johnson 1985, Contact
Mechanics, section 4.2: p^2 is linear in r^2 under Hertz). So the squared pressure, carried on linearly past
the last cells in contact, is 0 at the border. Under an edge of the object it does not fall; there the
border is taken halfway to the next cell.
"""

from dataclasses import dataclass

import numpy as np

from objectfolder.errors import InputError
from objectfolder.touch.elastic.conjugate_gradients import minimise
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.influence import compliance

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


PRESS_TOLERANCE = 1e-5
PRESS_ITERATIONS = 500
# Boxes grow in steps of this number of cells, so that the influence of one serves many contacts.
_BOX_STEP = 8


@dataclass(frozen=True, eq=False)
class Contact:
    """A solved contact on a grid of cells.

    Parameters
    ----------
    pressure_pa
        (rows, columns) float64 >= 0, constant on each cell.
    displacement_m
        (rows, columns) float64 of the surface, into the elastic body; negative where it bulges out.
    gap_m
        (rows, columns) float64 left between object and displaced surface: 0 in contact to the residual.
    indentation_m
        How far the object came on from the position in which `solve_contact` was given the gap.
    pitch_m
        Distance of rows and of columns.
    relative_residual
        Largest violation, |gap| in contact or penetration outside, over the largest penetration of the
        undeformed surface; at most the tolerance asked for.
    iterations
        Of conjugate gradients.
    """

    pressure_pa: np.ndarray
    displacement_m: np.ndarray
    gap_m: np.ndarray
    indentation_m: float
    pitch_m: tuple[float, float]
    relative_residual: float
    iterations: int

    @property
    def mask(self) -> np.ndarray:
        """(rows, columns) bool: cells in contact."""
        return np.asarray(self.pressure_pa > 0)

    @property
    def contact_area_m2(self) -> float:
        """Area in contact, projected on the plane of the grid, to parts of a cell; see `covered_cells`."""
        return covered_cells(self.pressure_pa) * self.pitch_m[0] * self.pitch_m[1]

    @property
    def force_n(self) -> float:
        """Integral of the pressure."""
        return float(self.pressure_pa.sum()) * self.pitch_m[0] * self.pitch_m[1]

    @property
    def peak_pressure_pa(self) -> float:
        """Largest pressure on a cell."""
        return float(self.pressure_pa.max(initial=0.0))

    @property
    def reaches_border(self) -> bool:
        """Whether cells at the border of the grid are in contact, so that contact beyond it is missing."""
        p = self.pressure_pa
        return bool(p[0].any() or p[-1].any() or p[:, 0].any() or p[:, -1].any())


def solve_contact(
    gap_m: np.ndarray,
    pitch_m: float | tuple[float, float],
    elastomer: Elastomer,
    *,
    indentation_m: float | None = None,
    force_n: float | None = None,
    initial_pressure_pa: np.ndarray | None = None,
    tolerance: float = PRESS_TOLERANCE,
    maximum_iterations: int = PRESS_ITERATIONS,
) -> Contact:
    """Press a rigid height field into an elastic surface, to an indentation or with a force.

    Parameters
    ----------
    gap_m
        (rows, columns) from the undeformed surface to the object at the centres of the cells, at
        indentation 0; of any sign, infinite where there is no object.
    pitch_m
        Distance of rows and of columns, or one number for both.
    elastomer
        What is pressed; outside the grid its surface is free.
    indentation_m, force_n
        One of them: how far the object comes on, or the force it is pressed with.
    initial_pressure_pa
        (rows, columns) to start from, such as that of a slightly different contact.
    tolerance
        Largest `Contact.relative_residual`.
    maximum_iterations
        Of conjugate gradients.

    Raises
    ------
    InputError
        A gap that is not a grid of numbers, a pitch that is not positive, not one of indentation and
        force, a force below 0 or one with nothing to press on.
    SimulationError
        No convergence.

    Examples
    --------
    >>> import numpy as np
    >>> from objectfolder.touch import Elastomer
    >>> y, z = np.meshgrid(*[np.linspace(-0.004, 0.004, 65)] * 2)
    >>> ball = (y**2 + z**2) / (2 * 0.02)  # of a radius of 20 mm
    >>> contact = solve_contact(ball, 0.000125, Elastomer(1e6, 0.5, None), indentation_m=0.0002)
    >>> hertz_n = 4 / 3 * 1e6 / (1 - 0.5**2) * 0.02**0.5 * 0.0002**1.5
    >>> round(contact.force_n / hertz_n, 2)
    1.0
    """
    gap, pitch = _checked(gap_m, pitch_m)
    _check_load(gap, indentation_m, force_n, initial_pressure_pa)
    nearest = float(gap.min())
    if force_n is not None:
        reach = nearest if force_n == 0 else _indentation_estimate(gap, pitch, elastomer, force_n)
        fixed = nearest if force_n == 0 else None
    else:
        reach = fixed = float(indentation_m or 0.0)
    if fixed is not None and fixed <= nearest:
        nothing = np.zeros(gap.shape)
        return Contact(nothing, nothing.copy(), gap - fixed, fixed, pitch, 0.0, 0)
    start = _start(gap, reach, initial_pressure_pa)
    total = None if force_n is None else force_n / (pitch[0] * pitch[1])
    cells = (gap < reach) | (start > 0)
    return _solved(gap, pitch, elastomer, start, cells, (fixed, total), tolerance, maximum_iterations)


def force_depth_curve(
    gap_m: np.ndarray,
    pitch_m: float | tuple[float, float],
    elastomer: Elastomer,
    indentations_m: np.ndarray,
    *,
    tolerance: float = PRESS_TOLERANCE,
) -> list[Contact]:
    """Contacts at indentations (n,), each solved from the one before.

    Parameters and errors are those of `solve_contact`.

    Examples
    --------
    >>> import numpy as np
    >>> from objectfolder.touch import Elastomer
    >>> y, z = np.meshgrid(*[np.linspace(-0.004, 0.004, 65)] * 2)
    >>> ball, gel = (y**2 + z**2) / (2 * 0.02), Elastomer(1e6, 0.5, None)
    >>> one, two = force_depth_curve(ball, 0.000125, gel, np.array([0.0001, 0.0002]))
    >>> round(two.force_n / one.force_n, 1)  # Hertz: 2 to the power of 1.5
    2.8
    """
    contacts: list[Contact] = []
    for indentation in np.asarray(indentations_m, dtype=np.float64):
        before = contacts[-1].pressure_pa if contacts and contacts[-1].force_n > 0 else None
        contacts.append(
            solve_contact(
                gap_m,
                pitch_m,
                elastomer,
                indentation_m=float(indentation),
                initial_pressure_pa=before,
                tolerance=tolerance,
            )
        )
    return contacts


def _checked(
    gap_m: np.ndarray, pitch_m: float | tuple[float, float]
) -> tuple[np.ndarray, tuple[float, float]]:
    gap = np.asarray(gap_m, dtype=np.float64)
    if gap.ndim != 2 or gap.size == 0 or np.isnan(gap).any() or np.isneginf(gap).any():
        raise InputError(
            "gap_m", f"shape {gap.shape} or values are not a grid of heights", "Use +inf where there is none."
        )
    pitch = np.broadcast_to(np.asarray(pitch_m, dtype=np.float64), (2,))
    if not (np.isfinite(pitch).all() and (pitch > 0).all()):
        raise InputError("pitch_m", f"{pitch_m}", "It must be positive.")
    return gap, (float(pitch[0]), float(pitch[1]))


def _check_load(
    gap: np.ndarray,
    indentation_m: float | None,
    force_n: float | None,
    initial_pressure_pa: np.ndarray | None,
) -> None:
    if (indentation_m is None) == (force_n is None):
        raise InputError("indentation_m, force_n", "both or neither given", "Give one of them.")
    if initial_pressure_pa is not None and np.shape(initial_pressure_pa) != gap.shape:
        raise InputError("initial_pressure_pa", f"shape {np.shape(initial_pressure_pa)}", "Use the gap's.")
    for name, value in (("indentation_m", indentation_m), ("force_n", force_n)):
        if value is not None and not np.isfinite(value):
            raise InputError(name, f"{value}", "It must be a number.")
    if force_n is not None and (force_n < 0 or (force_n > 0 and not np.isfinite(gap).any())):
        raise InputError("force_n", f"{force_n} N cannot be carried", "Nothing pulls, or is in reach.")


def _solved(
    gap: np.ndarray,
    pitch: tuple[float, float],
    elastomer: Elastomer,
    start: np.ndarray,
    cells: np.ndarray,
    load: tuple[float | None, float | None],
    tolerance: float,
    maximum_iterations: int,
) -> Contact:
    """Solve on a box of the grid round some cells; grow it until none beyond is in contact.

    The load is an indentation, or the sum of the pressures.
    """
    nearest = float(gap.min())
    whole = compliance(elastomer, gap.shape, pitch, gap.shape)
    iterations = 0
    while True:
        box = _box(cells)
        part = compliance(elastomer, gap.shape, pitch, gap[box].shape)
        pressure, reached, spent = minimise(
            part,
            gap[box],
            start[box],
            indentation_m=load[0],
            total_pa=load[1],
            tolerance=tolerance,
            maximum_iterations=maximum_iterations - iterations,
        )
        iterations += spent
        start = np.zeros(gap.shape)
        start[box] = pressure
        displacement = whole.displacement(start)
        final_gap = displacement + gap - reached
        scale = reached - nearest
        missed = final_gap < -tolerance * scale
        missed[box] = False
        if not missed.any():
            break
        cells = cells | missed
    touching = start > 0
    residual = max(float(np.abs(final_gap[touching]).max()), -float(final_gap.min())) / scale
    return Contact(start, displacement, final_gap, float(reached), pitch, residual, iterations)


def _indentation_estimate(
    gap: np.ndarray, pitch: tuple[float, float], elastomer: Elastomer, force: float
) -> float:
    """Indentation near which the object carries a force: that of a punch as wide as the penetration.

    2 E* (mean penetration) sqrt(area / pi) is 6 % above Hertz for a sphere, and less than a layer carries:
    the box that follows from it is wide enough, or grown.
    """
    values = np.sort(gap[np.isfinite(gap)])
    count = np.arange(1, len(values) + 1)
    penetration = count * values - np.cumsum(values)
    cell = pitch[0] * pitch[1]
    carried = 2 * elastomer.contact_modulus_pa * penetration * np.sqrt(cell / np.pi / count)
    index = int(np.searchsorted(carried, force))
    if index < len(values):
        return float(values[index])
    mean = force / (2 * elastomer.contact_modulus_pa * np.sqrt(cell * len(values) / np.pi))
    return float(values.mean() + mean)


def _start(gap: np.ndarray, reach: float, pressure: np.ndarray | None) -> np.ndarray:
    """Pressure to start from: any multiple of what is right."""
    if pressure is not None:
        loaded = pressure > 0
        start = np.where(loaded, pressure, 0.0)
        # A pressure where the object is not does no work, and no multiple of it is near.
        if float(((reach - gap[loaded]) * start[loaded]).sum()) > 0:
            return np.asarray(start, dtype=np.float64)
    start = np.maximum(reach - gap, 0.0)
    return start if start.any() else np.where(gap == gap.min(), 1.0, 0.0)


def _box(cells: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns that hold all cells that are true, in steps."""
    slices = []
    for axis in (0, 1):
        lines = np.flatnonzero(cells.any(axis=1 - axis))
        size = cells.shape[axis]
        length = min(-(-(int(lines[-1] - lines[0]) + 3) // _BOX_STEP) * _BOX_STEP, size)
        first = min(max(int(lines[0] + lines[-1] + 1 - length) // 2, 0), size - length)
        slices.append(slice(first, first + length))
    return slices[0], slices[1]
