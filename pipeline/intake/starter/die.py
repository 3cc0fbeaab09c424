"""A die with dimpled, painted pips."""

import numpy as np

from objectfolder.surface.textured_mesh import TexturedMesh
from pipeline.intake.starter.patterns import (
    SIZE,
    flat,
    paint,
    smooth_noise,
    smooth_step,
    to_texture,
    unit_square,
)
from pipeline.intake.starter.shape import Shape, join, quads

_HALF, _EDGE = 0.008, 0.0016
"""Half the side and the radius of the edges, metres."""

_FLAT_CELLS, _EDGE_CELLS = 20, 2
_PIP_RADIUS, _PIP_DEPTH, _PIP_OFFSET = 0.0016, 0.0006, 0.0037

# Outward axis, then the two axes of a face such that their cross product points outwards, and its number.
_FACES = (
    (2, 1, 0, 1, 1), (2, -1, 1, 0, 6), (0, 1, 1, 2, 2), (0, -1, 2, 1, 5), (1, 1, 2, 0, 3), (1, -1, 0, 2, 4),
)  # fmt: skip

_TILES = 3
"""Columns of the texture's 3 x 2 tiles, one a face."""


def die() -> TexturedMesh:
    """Die of 16 mm with rounded edges; opposite faces sum to seven; white pips on marbled red."""
    edge = _EDGE * np.linspace(0, 1, _EDGE_CELLS + 1)[:-1]
    flat_part = np.linspace(-_HALF + _EDGE, _HALF - _EDGE, _FLAT_CELLS + 1)
    steps = np.concatenate([-_HALF + edge, flat_part, (_HALF - edge)[::-1]])
    count = len(steps)
    lattice: dict[tuple[int, ...], int] = {}
    points: list[np.ndarray] = []
    parts: list[Shape] = []
    for number_of_face, (axis, sign, first, second, pips) in enumerate(_FACES):
        indices = np.zeros((count, count), dtype=np.int64)
        for row in range(count):
            for column in range(count):
                key = [0, 0, 0]
                key[axis], key[first], key[second] = (count - 1) * (sign > 0), column, row
                if tuple(key) not in lattice:
                    lattice[tuple(key)] = len(points)
                    points.append(_rounded(steps[key]))
                indices[row, column] = lattice[tuple(key)]
        for index in np.unique(indices):
            points[index] = _dimpled(points[index], axis, sign, first, second, pips)
        parts.append(quads(indices, _tile_coordinates(number_of_face, steps)))
    return join(np.array(points), parts).textured(_texture())


def _rounded(point: np.ndarray) -> np.ndarray:
    """Move a point of the cube's surface to the cube with rounded edges."""
    core = np.clip(point, -_HALF + _EDGE, _HALF - _EDGE)
    return core + _EDGE * (point - core) / np.linalg.norm(point - core)


def _pip_centres(pips: int) -> np.ndarray:
    """Centres (pips, 2) on a face, in units of the offset of a corner pip."""
    diagonal = [(-1, -1), (1, 1)]
    antidiagonal = [(-1, 1), (1, -1)]
    centres = (
        [(0, 0)] * (pips % 2)
        + diagonal * (pips > 1)
        + antidiagonal * (pips > 3)
        + [(-1, 0), (1, 0)] * (pips == 6)
    )
    return np.array(centres, dtype=np.float64)


def _dimpled(point: np.ndarray, axis: int, sign: int, first: int, second: int, pips: int) -> np.ndarray:
    """Press a spherical cap into the face around each pip."""
    offset = point[[first, second]] - _PIP_OFFSET * _pip_centres(pips)
    distance = np.linalg.norm(offset, axis=1).min()
    if distance >= _PIP_RADIUS or abs(point[axis]) < _HALF - 1e-9:
        return point
    sphere = (_PIP_RADIUS**2 + _PIP_DEPTH**2) / (2 * _PIP_DEPTH)
    pressed = point.copy()
    pressed[axis] -= sign * (np.sqrt(sphere**2 - distance**2) - (sphere - _PIP_DEPTH))
    return pressed


def _tile_coordinates(face: int, steps: np.ndarray) -> np.ndarray:
    """Texture coordinates (n, n, 2) of a face's grid in its tile, with a margin around."""
    inside = 0.04 + 0.92 * (steps + _HALF) / (2 * _HALF)
    column, row = face % _TILES, face // _TILES
    u, v = (column + inside) / _TILES, (row + inside) / 2
    return np.stack(np.meshgrid(u, v), axis=-1)


def _texture() -> np.ndarray:
    u, v = unit_square()
    image = flat((0.66, 0.08, 0.10))
    image = paint(image, (0.42, 0.03, 0.12), smooth_step((smooth_noise(7, 7, 71) - 0.42) / 0.16))
    for face, (*_, pips) in enumerate(_FACES):
        column, row = face % _TILES, face // _TILES
        x = ((u * _TILES - column) - 0.5) * 2 * _HALF / 0.92
        y = ((v * 2 - row) - 0.5) * 2 * _HALF / 0.92
        texel = 2 * _HALF * _TILES / SIZE
        for centre in _PIP_OFFSET * _pip_centres(pips):
            distance = np.hypot(x - centre[0], y - centre[1])
            image = paint(image, (0.96, 0.95, 0.90), smooth_step((_PIP_RADIUS - distance) / texel + 0.5))
    return to_texture(image)
