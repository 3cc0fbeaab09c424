"""Vertex positions as a file gives them: refused where no shape can be made of them."""

from pathlib import Path

import numpy as np

from objectfolder.errors import InputError

LARGEST = 1e15
"""Of a coordinate, in the file's own units: micrometres on the Moon have less."""

SMALLEST_EXTENT = 1e-15
"""Of the longest side, in the file's own units."""

LEAST_STEPS = 1000
"""Along the longest side, of positions stored in single precision."""


def refuse_unusable(path: Path, vertices: np.ndarray) -> None:
    """Raise `InputError` for positions (V, 3) that are not finite, or of no size that measures can take."""
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise InputError(
            str(path),
            f"{len(bad)} of {len(vertices)} vertices are not finite (the first is vertex {bad[0] + 1})",
            "Repair the mesh: NaN and infinite coordinates have no place",
        )
    if not len(vertices):
        return
    largest = float(np.abs(vertices).max())
    if largest > LARGEST:
        raise InputError(
            str(path),
            f"has a coordinate of {largest:g}, which no unit of length explains",
            "Repair the mesh: stray vertices far away are a fault of the export",
        )
    extent = float(np.ptp(vertices, axis=0).max())
    if 0 < extent < SMALLEST_EXTENT:
        raise InputError(str(path), f"is {extent:g} long in its own unit", "Export the mesh again, in metres")


def single_precision_step(vertices: np.ndarray) -> float:
    """Distance between neighbouring float32 numbers at the coordinate farthest from the origin."""
    return float(np.spacing(np.float32(np.abs(vertices).max()))) if len(vertices) else 0.0


def refuse_coarse(path: Path, vertices: np.ndarray, step: float) -> None:
    """Raise `InputError` where positions (V, 3), stored in steps of `step`, show little of the shape."""
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if extent > 0 and step * LEAST_STEPS > extent:
        raise InputError(
            str(path),
            f"is {extent:g} long but lies so far from the origin that its coordinates, stored in single "
            f"precision, have steps of {step:g}",
            "Move the mesh to the origin before it is exported",
        )
