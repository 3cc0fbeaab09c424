"""An atlas for a surface without texture coordinates: a block of texels of its own for each triangle.

Corners lie on texel centres, and a block has every texel that bilinear lookup inside its triangle reads:
the half texel around the triangle is its guard band, so that no colour bleeds from block to block. (Mip
maps would mix blocks; the exported sampler has none.)
"""

from dataclasses import dataclass

import numpy as np

from objectfolder.errors import InputError


@dataclass(frozen=True)
class Atlas:
    """Blocks of a square texture, row 0 on top.

    Parameters
    ----------
    side
        Texels a side.
    pitch_m
        Largest distance of neighbouring texels on the surface along the edges of a block, metres.
    column, row
        (F,) the top left texel of each block.
    columns, rows
        (F,) texel steps along the two edges of the triangle; a block is one texel larger.
    corners
        (F, 3) corner of the triangle at the block's top left, its top right, and its bottom left.
    """

    side: int
    pitch_m: float
    column: np.ndarray
    row: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    corners: np.ndarray

    def texture_coordinates(self) -> np.ndarray:
        """Return (F, 3, 2) coordinates of each face's corners in the mesh's order, v up."""
        left, top = self.column + 0.5, self.row + 0.5
        x = np.stack([left, left + self.columns, left], axis=1)
        y = np.stack([top, top, top + self.rows], axis=1)
        in_block = np.stack([x, self.side - y], axis=-1) / self.side
        result = np.empty_like(in_block)
        np.put_along_axis(result, self.corners[..., None], in_block, axis=1)
        return result

    def texels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the texels that lookups read: row (n,), column (n,), face (n,), barycentric (n, 3).

        A guard texel outside its triangle has the nearest point along the block's edges inside it.
        """
        count = (self.columns + 1) * (self.rows + 1)
        face = np.repeat(np.arange(len(count)), count)
        within = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
        j, i = np.divmod(within, self.columns[face] + 1)
        x, y = i / self.columns[face], j / self.rows[face]
        # The farthest texel read is the far corner of a cell that the slanted edge crosses.
        read = x + y < 1 + 1 / self.columns[face] + 1 / self.rows[face] - 1e-9
        face, i, j, x, y = face[read], i[read], j[read], x[read], y[read]
        beyond = np.maximum(x + y, 1.0)
        x, y = x / beyond, y / beyond
        in_block = np.stack([1 - x - y, x, y], axis=1)
        barycentric = np.empty_like(in_block)
        np.put_along_axis(barycentric, self.corners[face], in_block, axis=1)
        return self.row[face] + j, self.column[face] + i, face, np.clip(barycentric, 0.0, 1.0)


def pack(triangles: np.ndarray, side: int, finest_m: float = 0.0) -> Atlas:
    """Return the atlas of (F, 3, 3) triangles, metres, as fine as fits a square of `side` texels.

    Parameters
    ----------
    finest_m
        Texels need lie no closer than this.

    Raises
    ------
    InputError
        More triangles than fit at one texel a corner.
    """
    edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    # The corner opposite the longest edge comes first: the block follows the two shorter ones.
    first = (np.argmax(edges, axis=1) + 2) % 3
    corners = (first[:, None] + np.arange(3)) % 3
    along = np.take_along_axis(edges, corners, axis=1)
    across, down = along[:, 0], along[:, 2]
    low = max(finest_m, 1e-9 * max(float(edges.max()), 1e-12))
    high = max(float(edges.max()), low)
    if not _fits(across, down, high, side):
        raise InputError(
            "texture side",
            f"{side} texels do not hold {len(triangles)} triangles",
            "Ask for a larger texture.",
        )
    if not _fits(across, down, low, side):
        for _ in range(24):
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if _fits(across, down, middle, side) else (middle, high)
    else:
        high = low
    columns, rows = _steps(across, high), _steps(down, high)
    placed = _shelves(columns + 1, rows + 1, side)
    assert placed is not None
    return Atlas(side, high, *placed, columns, rows, corners)


def _steps(length: np.ndarray, pitch: float) -> np.ndarray:
    return np.maximum(np.ceil(length / pitch - 1e-9), 1).astype(np.int64)


def _fits(across: np.ndarray, down: np.ndarray, pitch: float, side: int) -> bool:
    columns, rows = _steps(across, pitch) + 1, _steps(down, pitch) + 1
    if columns.max() > side or rows.max() > side or (columns * rows).sum() > side * side:
        return False
    return _shelves(columns, rows, side) is not None


def _shelves(width: np.ndarray, height: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Place rectangles on shelves, tallest first; return their columns and rows, None if they do not fit."""
    column, row = np.zeros_like(width), np.zeros_like(height)
    x = top = shelf = 0
    for index in np.lexsort((-width, -height)).tolist():
        wide, tall = int(width[index]), int(height[index])
        if x + wide > side:
            x, top, shelf = 0, top + shelf, 0
        if top + tall > side:
            return None
        shelf = max(shelf, tall)
        column[index], row[index] = x, top
        x += wide
    return column, row
