"""Textures summed about the places of a lattice on faces, compiled: else most of the time of encoding."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math

import numpy as np

from objectfolder.jit import arrayless, kernel
from objectfolder.vision.network.face_lattice import FaceLattice

NO_CUTOFF = -1.0


def add_texture(
    totals: np.ndarray, image: np.ndarray, texture_coordinates: np.ndarray, of_face: np.ndarray,
    lattice: FaceLattice, steps: np.ndarray, cutoff: float | None = None,
) -> None:  # fmt: skip
    """Add to each place of some faces the sum of a texture's values about it.

    Values are those of `texture_lookup.bilinear` at `FaceLattice.places`, in double precision.

    Parameters
    ----------
    totals
        (p, c) float64, changed.
    image
        (h, w, c) uint8, row 0 on top; it repeats.
    texture_coordinates
        (F, 3, 2) u, v of the corners.
    of_face
        (F,) bool: whether a face has this texture.
    lattice, steps
        A lattice on these faces, and the (t,) offsets along both edges, as of `FaceLattice.places`. Each
        place gets t * t values.
    cutoff
        Add 1 where a value, 0 to 1, reaches it, and 0 elsewhere; None adds the value.
    """
    _add_texture(
        totals, np.ascontiguousarray(image), np.ascontiguousarray(texture_coordinates, dtype=np.float64),
        np.ascontiguousarray(of_face), lattice.grids, steps, NO_CUTOFF if cutoff is None else float(cutoff),
        np.empty(3),
    )  # fmt: skip


@arrayless(kernel)
def _add_texture(totals, image, coordinates, of_face, grids, steps, cutoff, weights):
    corners, columns, rows, start = grids
    height, width, channels = image.shape
    for f in range(len(of_face)):
        if not of_face[f]:
            continue
        at = start[f]
        for j in range(rows[f] + 1):
            for i in range(columns[f] + 1):
                for step_x in steps:
                    for step_y in steps:
                        x = min(max((i + step_x) / columns[f], 0.0), 1.0)
                        y = min(max((j + step_y) / rows[f], 0.0), 1.0)
                        beyond = max(x + y, 1.0)
                        x, y = x / beyond, y / beyond
                        weights[corners[f, 0]] = min(max(1.0 - x - y, 0.0), 1.0)
                        weights[corners[f, 1]] = x
                        weights[corners[f, 2]] = y
                        u, v = 0.0, 0.0
                        for corner in range(3):
                            u += weights[corner] * coordinates[f, corner, 0]
                            v += weights[corner] * coordinates[f, corner, 1]
                        column, row = u % 1.0 * width - 0.5, (1.0 - v) % 1.0 * height - 0.5
                        left, top = math.floor(column), math.floor(row)
                        across, down = column - left, row - top
                        right, under = (left + 1) % width, (top + 1) % height
                        left, top = left % width, top % height
                        for channel in range(channels):
                            above = image[top, left, channel] * (1.0 - across)
                            above += image[top, right, channel] * across
                            below = image[under, left, channel] * (1.0 - across)
                            below += image[under, right, channel] * across
                            value = (above * (1.0 - down) + below * down) / 255.0
                            if cutoff >= 0.0:
                                value = 1.0 if value >= cutoff else 0.0
                            totals[at, channel] += value
                at += 1
