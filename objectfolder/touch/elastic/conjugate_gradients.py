"""Conjugate gradients for pressures that cannot pull: Polonsky & Keer 1999, Wear 231.

The gradient of the energy is the gap left between the object and the displaced surface. Each iteration
moves along a direction conjugate to the last over the cells in contact, lets go of the cells whose pressure
falls below zero, and takes in the cells that the object overlaps. Under a given force the sum of the
pressures is kept, and the indentation is the multiplier of that condition.
"""

import numpy as np

from objectfolder.errors import SimulationError
from objectfolder.touch.elastic.influence import Compliance


def minimise(
    compliance: Compliance,
    gap_m: np.ndarray,
    start_pa: np.ndarray,
    *,
    indentation_m: float | None,
    total_pa: float | None,
    tolerance: float,
    maximum_iterations: int,
) -> tuple[np.ndarray, float, int]:
    """Find pressure (rows, columns), indentation, and iterations spent.

    Parameters
    ----------
    gap_m
        (rows, columns) at indentation 0, +inf where there is no object.
    start_pa
        (rows, columns) >= 0, some of it positive; only its shape counts.
    indentation_m, total_pa
        One of them: the indentation, or the sum of the pressures.
    tolerance
        Largest violation of gap = 0 in contact and gap >= 0, over the largest penetration.

    Raises
    ------
    SimulationError
        No convergence, or influence coefficients that are not positive definite.
    """
    nearest = float(gap_m.min())
    pressure, displacement = _scaled(compliance, start_pa, gap_m, indentation_m, total_pa)
    direction, before, conjugate = np.zeros_like(pressure), 1.0, False
    for iteration in range(maximum_iterations + 1):
        touching = pressure > 0
        gap = displacement + gap_m
        indentation = float(gap[touching].mean()) if indentation_m is None else indentation_m
        gap -= indentation
        gradient = np.where(touching, gap, 0.0)
        violation = max(float(np.abs(gradient).max()), -float(gap.min()))
        if violation <= (allowed := tolerance * (indentation - nearest)):
            return pressure, indentation, iteration
        squared = float(np.vdot(gradient, gradient))
        direction = gradient + (squared / before if conjugate else 0.0) * np.where(touching, direction, 0.0)
        if total_pa is not None:
            direction -= np.where(touching, direction.sum() / np.count_nonzero(touching), 0.0)
        change = compliance.displacement(direction)
        step = _step(gradient, direction, change, violation)
        moved = pressure - step * direction
        overlapping = ~touching & (gap < 0)
        moved[overlapping] = -step * gap[overlapping]
        before, conjugate = squared, not overlapping.any()
        if conjugate and float(moved.min()) >= 0:
            pressure, displacement = moved, displacement - step * change
        else:
            pushed = np.maximum(moved, 0.0)
            pressure, displacement = _scaled(compliance, pushed, gap_m, indentation_m, total_pa)
    raise SimulationError(
        "elastic contact",
        f"gaps wrong by {violation:.3g} m after {maximum_iterations} iterations, {allowed:.3g} m wanted",
        "Allow more iterations or a larger tolerance.",
    )


def _step(gradient: np.ndarray, direction: np.ndarray, change: np.ndarray, violation_m: float) -> float:
    """How far along a direction, which displaces the surface by `change`, the energy is least."""
    curvature = float(np.vdot(change, direction))
    if not curvature > 0:
        raise SimulationError(
            "elastic contact",
            f"a pressure without work, gaps wrong by {violation_m:.2g} m",
            "Use a larger tolerance, or cells smaller than the layer is thick.",
        )
    return float(np.vdot(gradient, direction)) / curvature


def _scaled(
    compliance: Compliance,
    pressure: np.ndarray,
    gap: np.ndarray,
    indentation: float | None,
    total: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Multiple of a pressure that has the wanted sum, or else the least energy, and its displacement."""
    displacement, loaded = compliance.displacement(pressure), pressure > 0
    if total is not None:
        factor = total / float(pressure[loaded].sum())
    else:
        work = float(((indentation or 0.0) - gap[loaded]) @ pressure[loaded])
        factor = work / float(displacement[loaded] @ pressure[loaded])
    return pressure * factor, displacement * factor
