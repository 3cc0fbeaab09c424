"""Trilinear features on the corners of the grid cells that a surface crosses, at several resolutions.

Only the finest level's cells are stored (packed bits, deflated); coarser cells and all corners follow
from them by integer arithmetic, so every machine numbers the corners alike.
"""

import zlib
from functools import cached_property

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.unpacking import unpack_deflate
from objectfolder.surface.surface import Surface

# The grid reaches a little past the unit box: a compressed surface may.
HALF_WIDTH = 0.51
GRID_LEVELS = 4
LARGEST_RESOLUTION = 256  # cells a side: 78 MB of lookups, and up to 290 while they are made
CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)


class SparseGrid:
    """Cells of a cube of side 1.02 about the origin of the unit frame, and their corners.

    Parameters
    ----------
    occupancy
        (r, r, r) bool, cells of the finest level; r is a multiple of 8.
    """

    def __init__(self, occupancy: np.ndarray) -> None:
        self.occupancy = occupancy
        self.resolution = int(occupancy.shape[0])

    @classmethod
    def of_points(cls, points: np.ndarray, resolution: int) -> "SparseGrid":
        """Return the grid whose cells hold (n, 3) unit-frame points."""
        occupancy = np.zeros((resolution,) * 3, dtype=bool)
        x, y, z = np.floor(_to_cells(points, resolution)).astype(np.int64).T
        occupancy[x, y, z] = True
        return cls(occupancy)

    @classmethod
    def within_budget(cls, points: np.ndarray, corners: int, finest: int) -> "SparseGrid":
        """Return the finest grid, of at most `finest` cells a side and `corners` finest corners.

        Raises
        ------
        ValueError
            `finest` is above `LARGEST_RESOLUTION`.
        """
        if finest > LARGEST_RESOLUTION:
            raise ValueError(f"a grid of {finest} cells a side, of {LARGEST_RESOLUTION} at most")
        resolution = finest
        while True:
            grid = cls.of_points(points, resolution)
            count = grid.sizes[-1]
            if count <= corners or resolution <= 16:
                return grid
            # Corners on a surface grow with the square of the resolution.
            resolution = max(16, min(resolution - 8, int(resolution * (corners / count) ** 0.5) // 8 * 8))

    @classmethod
    def from_bytes(cls, data: np.ndarray, resolution: int) -> "SparseGrid":
        """Read what `to_bytes` wrote.

        Raises
        ------
        FormatError
            Bytes that do not hold a grid of this resolution.
        """
        try:
            if not 0 < resolution <= LARGEST_RESOLUTION or resolution % 8:
                raise ValueError("a resolution that no grid has")
            bits = np.frombuffer(unpack_deflate(data.tobytes(), resolution**3 // 8), dtype=np.uint8)
            return cls(np.unpackbits(bits, count=resolution**3).astype(bool).reshape((resolution,) * 3))
        except ValueError as error:
            raise FormatError("vision.grid", f"not a grid of {resolution} cells a side ({error})") from error

    def to_bytes(self) -> np.ndarray:
        """Return the finest level's cells as deflated bits, (n,) uint8."""
        return np.frombuffer(zlib.compress(np.packbits(self.occupancy).tobytes(), 9), dtype=np.uint8)

    @cached_property
    def lookups(self) -> tuple[np.ndarray, ...]:
        """For each level, coarse to fine, the row of each corner ((r+1)^3 int32), or -1."""
        cells = self.occupancy
        result = []
        for level in range(GRID_LEVELS):
            if level:
                half = cells.shape[0] // 2
                cells = cells.reshape(half, 2, half, 2, half, 2).any(axis=(1, 3, 5))
            side = cells.shape[0] + 1
            corners = np.zeros((side,) * 3, dtype=bool)
            for i, j, k in CORNERS:
                corners[i : i + side - 1, j : j + side - 1, k : k + side - 1] |= cells
            rows = np.full(corners.size, -1, dtype=np.int32)
            rows[np.flatnonzero(corners)] = np.arange(np.count_nonzero(corners), dtype=np.int32)
            result.append(rows)
        return tuple(reversed(result))

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of corners of each level, coarse to fine."""
        return tuple(int(lookup.max(initial=-1)) + 1 for lookup in self.lookups)

    def interpolation(self, points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return for each level the rows (n, 8) int32 and weights (n, 8) float32 that interpolate at points.

        Corners of cells that the surface was not seen to cross are left out and the others' weights
        rescaled; a point with none has zero weights.
        """
        result = []
        for level, lookup in enumerate(self.lookups):
            resolution = self.resolution >> (GRID_LEVELS - 1 - level)
            position = _to_cells(points, resolution)
            cell = position.astype(np.int32)
            fraction = (position - cell).astype(np.float32)
            low = 1 - fraction
            pair = [np.stack([low[:, axis], fraction[:, axis]], axis=1) for axis in range(3)]
            weights = (
                pair[0][:, :, None, None] * pair[1][:, None, :, None] * pair[2][:, None, None, :]
            ).reshape(-1, 8)
            side = resolution + 1
            steps = (CORNERS @ np.array([side * side, side, 1])).astype(np.int32)
            base = (cell[:, 0] * side + cell[:, 1]) * side + cell[:, 2]
            rows = lookup[base[:, None] + steps]
            missing = rows < 0
            if missing.any():
                rows[missing] = 0
                weights[missing] = 0
                weights /= np.maximum(weights.sum(axis=1, keepdims=True), np.float32(1e-6))
            result.append((rows, weights))
        return result


def _to_cells(points: np.ndarray, resolution: int) -> np.ndarray:
    scaled = (points + HALF_WIDTH) * (resolution / (2 * HALF_WIDTH))
    return np.clip(scaled, 0.0, resolution * (1 - 1e-7))


def covering_points(surface: Surface, unit_vertices: np.ndarray, resolution: int) -> np.ndarray:
    """Return unit-frame points that leave hardly a cell of the surface unseen: about 12 a cell face."""
    area = surface.area / np.ptp(surface.bounds, axis=0).max() ** 2
    samples = surface.sample(int(12 * area * resolution**2) + 1000, seed=0)
    inside = np.einsum("ij,ijk->ik", samples.barycentric, unit_vertices[surface.faces[samples.face]])
    return np.concatenate([inside, unit_vertices[np.unique(surface.faces)]])
