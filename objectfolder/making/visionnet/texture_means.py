"""Textures about the places of a lattice on faces, compiled: else most of the time of encoding."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math

import numpy as np

from objectfolder.jit import arrayless, inner, kernel
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


def add_remainder(
    remainder: np.ndarray, weight: np.ndarray, values: np.ndarray, image: np.ndarray,
    texture_coordinates: np.ndarray, of_face: np.ndarray, lattice: FaceLattice, steps: np.ndarray,
) -> None:  # fmt: skip
    """Add to each value of a lattice what a texture has about it that the lattice has not.

    Each sample adds its difference to the four values that it lies between, by their shares of it.

    Parameters
    ----------
    remainder, weight
        (size, c) float64 sums of differences times shares, and (size,) of shares, changed.
    values
        (size, c) float64, as the texture 0 to 255.
    image, texture_coordinates, of_face, lattice, steps
        As of `add_texture`; samples off their face are left out.
    """
    _add_remainder(
        (remainder, weight), (values, lattice.owner), np.ascontiguousarray(image),
        np.ascontiguousarray(texture_coordinates, dtype=np.float64), np.ascontiguousarray(of_face),
        lattice.grids, steps, np.empty(3),
    )  # fmt: skip


@inner(arrayless(kernel))
def _texel(coordinates, weights, height, width):
    """Return left, right, top and under row of a texture at a place of a face, and how far between them."""
    u, v = 0.0, 0.0
    for corner in range(3):
        u += weights[corner] * coordinates[corner, 0]
        v += weights[corner] * coordinates[corner, 1]
    column, row = u % 1.0 * width - 0.5, (1.0 - v) % 1.0 * height - 0.5
    left, top = math.floor(column), math.floor(row)
    across, down = column - left, row - top
    right, under = (left + 1) % width, (top + 1) % height
    return left % width, right, top % height, under, across, down


@inner(arrayless(kernel))
def _bilinear(image, place, channel):
    """Return a channel in 0..1 at a place as of `_texel`."""
    left, right, top, under, across, down = place
    above = image[top, left, channel] * (1.0 - across)
    above += image[top, right, channel] * across
    below = image[under, left, channel] * (1.0 - across)
    below += image[under, right, channel] * across
    return (above * (1.0 - down) + below * down) / 255.0


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
                        place = _texel(coordinates[f], weights, height, width)
                        for channel in range(channels):
                            value = _bilinear(image, place, channel)
                            if cutoff >= 0.0:
                                value = 1.0 if value >= cutoff else 0.0
                            totals[at, channel] += value
                at += 1


@arrayless(kernel)
def _add_remainder(sums, lattice_values, image, coordinates, of_face, grids, steps, weights):
    (remainder, weight), (values, owner), (corners, columns, rows, start) = sums, lattice_values, grids
    height, width, channels = image.shape
    for f in range(len(of_face)):
        if not of_face[f]:
            continue
        for j in range(rows[f] + 1):
            for i in range(columns[f] + 1):
                for step_x in steps:
                    for step_y in steps:
                        x, y = i + step_x, j + step_y
                        along, aside = x / columns[f], y / rows[f]
                        if along < 0.0 or aside < 0.0 or along + aside > 1.0:
                            continue
                        weights[corners[f, 0]] = 1.0 - along - aside
                        weights[corners[f, 1]] = along
                        weights[corners[f, 2]] = aside
                        place = _texel(coordinates[f], weights, height, width)
                        left, top = min(int(x), columns[f] - 1), min(int(y), rows[f] - 1)
                        right, down = x - left, y - top
                        at = start[f] + top * (columns[f] + 1) + left
                        a, b = owner[at], owner[at + 1]
                        c, d = owner[at + columns[f] + 1], owner[at + columns[f] + 2]
                        of_a, of_b = (1.0 - right) * (1.0 - down), right * (1.0 - down)
                        of_c, of_d = (1.0 - right) * down, right * down
                        weight[a] += of_a
                        weight[b] += of_b
                        weight[c] += of_c
                        weight[d] += of_d
                        for channel in range(channels):
                            above = 255.0 * _bilinear(image, place, channel)
                            above -= values[a, channel] * of_a + values[b, channel] * of_b
                            above -= values[c, channel] * of_c + values[d, channel] * of_d
                            remainder[a, channel] += of_a * above
                            remainder[b, channel] += of_b * above
                            remainder[c, channel] += of_c * above
                            remainder[d, channel] += of_d * above
