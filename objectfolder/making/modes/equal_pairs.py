"""The two modes of a pair of a body of revolution, which have one frequency, though its elements split them.

Modes that vary as cos(n theta) and sin(n theta) around the axis, n >= 1, are one shape turned by a quarter of
its period. The body has them at one frequency. Elements repeat after a step around the axis only, and their
functions are chosen mode by mode, so that two frequencies come out, which would be heard as a beat.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from objectfolder.making.modes.boundary import Boundary
from objectfolder.making.modes.spectrum import Spectrum

Floats = NDArray[np.float64]
# Rings of points at which shapes are compared with themselves turned by a point: less than half a period of
# any n. Over whole rings shapes of different n are orthogonal.
RINGS, AROUND = 16, 72
TURN_RAD = 2 * np.pi / AROUND
# How far two modes of a pair may be apart, cents, for the two to be compared.
MOST_SPLIT_CENTS = 20.0
# What the turn mixes a mode with others, over what it mixes it with its partner, at most.
MOST_MIXED = 0.1
# Distance, at most, of a pair's turned shapes from a rotation by n times the turn, and of n from an integer.
MOST_TURNED_DIFFERENCE, MOST_FROM_INTEGER = 0.02, 0.3


@dataclass(frozen=True)
class Axis:
    """Axis of revolution: a point on it, metres, and its direction, both (3,)."""

    point_m: Floats
    direction: Floats


def with_equal_pairs(spectrum: Spectrum, boundary: Boundary, axis: Axis) -> tuple[Spectrum, list[float]]:
    """A spectrum in which the modes of each pair have the mean of their eigenvalues, and what split them.

    A pair are two modes within `MOST_SPLIT_CENTS` that, turned about the axis by a small angle, are one
    another's combination as cos(n theta) and sin(n theta) are, n >= 1. To first order what splits a pair
    leaves the mean of its eigenvalues as it is. Residuals remain those against the elements' own eigenvalues.

    Parameters
    ----------
    spectrum
        Of the elements that `boundary` bounds.
    axis
        Of the body that they stand for.

    Returns
    -------
    spectrum, split_cents
        Modes in ascending order, and by how many cents the frequencies of each pair were apart.
    """
    values = spectrum.eta_squared
    pairs = _pairs(values, *_turned_products(spectrum.vectors, boundary, axis))
    if not pairs:
        return spectrum, []
    equal = values.copy()
    for pair in pairs:
        equal[pair] = values[pair].mean()
    order = np.argsort(equal, kind="stable")
    errors = spectrum.error_cents
    return replace(
        spectrum,
        eta_squared=equal[order],
        vectors=spectrum.vectors[:, :, order],
        residuals=spectrum.residuals[order],
        error_cents=errors[order] if len(errors) else errors,
    ), [float(600 * np.log2(values[pair[1]] / values[pair[0]])) for pair in pairs]


def _turned_products(vectors: Floats, boundary: Boundary, axis: Axis) -> tuple[Floats, Floats]:
    """Products of shapes at points of the surface, (k, k), and of shapes with shapes turned, (k, k)."""
    turns = Rotation.from_rotvec(TURN_RAD * np.arange(AROUND)[:, None] * axis.direction).as_matrix()
    start = boundary.surface.sample(RINGS, 0).points - axis.point_m
    points = np.einsum("nab,rb->nra", turns, start) + axis.point_m
    shapes, _ = boundary.evaluate(vectors, points.reshape(-1, 3), 0.0)
    shapes = shapes.reshape(AROUND, RINGS, 3, -1)
    back = np.einsum("ba,nrbk->nrak", turns[1], np.roll(shapes, -1, axis=0)).reshape(-1, 3, len(shapes.T))
    shapes = shapes.reshape(back.shape)
    gram = np.einsum("pai,paj->ij", shapes, shapes)
    across = np.einsum("pai,paj->ij", shapes, back)
    return gram, across


def _pairs(values: Floats, gram: Floats, across: Floats) -> list[list[int]]:
    """Pairs [lower, upper] of modes that a turn mixes as cos(n theta) and sin(n theta)."""
    size = np.sqrt(np.diag(gram))
    mixed = np.abs(across - across.T) / (2 * size * size[:, None])
    near = 600 * np.abs(np.log2(values[:, None] / values)) <= MOST_SPLIT_CENTS
    mixed[~near] = 0.0
    partner = mixed.argmax(axis=1)
    modes = np.arange(len(values))
    others = mixed.copy()
    others[modes, partner] = 0.0
    alone = others.max(axis=1) <= MOST_MIXED * mixed[modes, partner]
    pairs = [[lower, upper] for lower, upper in enumerate(partner.tolist()) if lower < upper]
    return [
        pair
        for pair in pairs
        if partner[pair[1]] == pair[0]
        and alone[pair].all()
        and _is_pair(gram[np.ix_(pair, pair)], across[np.ix_(pair, pair)])
    ]


def _is_pair(gram: Floats, across: Floats) -> bool:
    """Whether the turn makes of two shapes what a rotation by n times its angle makes, n >= 1."""
    mixing = np.linalg.solve(gram, across)
    cosine, sine = (mixing[0, 0] + mixing[1, 1]) / 2, (mixing[1, 0] - mixing[0, 1]) / 2
    rotation = np.array([[cosine, -sine], [sine, cosine]]) / np.hypot(cosine, sine)
    number = abs(np.arctan2(sine, cosine)) / TURN_RAD
    return bool(
        number > 0.5
        and abs(number - round(number)) <= MOST_FROM_INTEGER
        and np.abs(mixing - rotation).max() <= MOST_TURNED_DIFFERENCE
    )
