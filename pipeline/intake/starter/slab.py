"""Flat things with an outline, as a grid with cells left out: a top, a bottom, and walls where it ends."""

import numpy as np

from pipeline.intake.starter.shape import Shape, join, quads


def slab(middle: np.ndarray, thickness: np.ndarray, cells: np.ndarray) -> Shape:
    """Solid between two copies of a grid of points, apart in z.

    Texture coordinates: u along the rows' x; the top in the lower, the bottom in the upper half of v, the
    walls in a strip above.

    Parameters
    ----------
    middle
        (rows, columns, 3) points half way, metres; x grows with the row, y with the column.
    thickness
        (rows, columns) metres.
    cells
        (rows - 1, columns - 1) bool, where there is material.
    """
    rows, columns = thickness.shape
    half = np.zeros_like(middle)
    half[..., 2] = thickness / 2
    vertices = np.concatenate([(middle + half).reshape(-1, 3), (middle - half).reshape(-1, 3)])
    top = np.arange(rows * columns).reshape(rows, columns)
    bottom = top + rows * columns
    low, high = middle[..., :2].min(axis=(0, 1)), middle[..., :2].max(axis=(0, 1))
    u, across = np.moveaxis((middle[..., :2] - low) / (high - low), -1, 0)
    u = 0.01 + 0.98 * u
    top_coordinates = np.stack([u, 0.02 + 0.43 * across], axis=-1)
    bottom_coordinates = np.stack([u, 0.49 + 0.43 * across], axis=-1)
    # The walls' u also follows y, so that walls across x have some width in the texture.
    wall_u = 0.97 * u + 0.02 * across
    parts = [
        _mirrored(quads(top, top_coordinates, cells)),
        quads(bottom, bottom_coordinates, cells),
        *(_walls(top, bottom, wall_u, edges) for edges in _outline(cells)),
    ]
    return join(vertices, parts)


def _mirrored(part: Shape) -> Shape:
    return Shape(part.vertices, part.faces[:, ::-1], part.texture_coordinates[:, ::-1])


def _outline(cells: np.ndarray) -> list[np.ndarray]:
    """Grid edges (n, 2, 2), from and to (row, column), with material on their right; four sides apart."""
    padded = np.pad(cells, 1)
    inside = padded[1:-1, 1:-1]
    sides = []
    for row_step, column_step, start, end in (
        (-1, 0, (0, 0), (0, 1)),
        (1, 0, (1, 1), (1, 0)),
        (0, -1, (1, 0), (0, 0)),
        (0, 1, (0, 1), (1, 1)),
    ):
        neighbour = np.roll(padded, (-row_step, -column_step), axis=(0, 1))[1:-1, 1:-1]
        cell = np.argwhere(inside & ~neighbour)
        sides.append(np.stack([cell + np.array(start), cell + np.array(end)], axis=1))
    return sides


def _walls(top: np.ndarray, bottom: np.ndarray, u: np.ndarray, edges: np.ndarray) -> Shape:
    start, end = tuple(edges[:, 0].T), tuple(edges[:, 1].T)
    corners = np.stack([top[start], top[end], bottom[end], bottom[start]], axis=1)
    v = np.array([0.985, 0.985, 0.95, 0.95])
    coordinates = np.stack(
        [np.stack([u[start], u[end], u[end], u[start]], axis=1), np.broadcast_to(v, corners.shape)], axis=-1
    )
    order = np.array([[0, 1, 2], [0, 2, 3]])
    return Shape(np.zeros((0, 3)), corners[:, order].reshape(-1, 3), coordinates[:, order].reshape(-1, 3, 2))
