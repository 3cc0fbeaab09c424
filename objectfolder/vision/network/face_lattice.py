"""Quantities on a surface without texture coordinates: a lattice of values on each face.

As mesh colours (Yuksel, Keyser and House 2010, "Mesh colors", ACM Transactions on Graphics 29:2), with a
parallelogram of values along the two shorter edges of a face. Faces share nothing: what lies close in space,
the two sides of a thin wall, does not mix.
"""

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.integer_coding import pack_integers, unpack_integers

MOST_STEPS = 1024
"""Along an edge of a face."""

MOST_VALUES = 1 << 22
"""Of a lattice: ten times those of a chair."""

TAPS = 4
"""Places along each axis of a value's cell over which it is a mean."""


class FaceLattice:
    """Where on the faces of a surface values lie.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners.
    pitch
        Neighbouring values lie at most this far apart, in the unit of the triangles.

    Raises
    ------
    FormatError
        More than `MOST_VALUES` values.

    Examples
    --------
    >>> lattice = FaceLattice(np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]), 0.5)
    >>> face, barycentric = lattice.places(np.zeros((1, 2)))
    >>> lattice.interpolate(barycentric[:, 1:], np.array([0]), np.array([[0.5, 0.4, 0.1]]))
    array([[0.4, 0.1]])
    """

    def __init__(self, triangles: np.ndarray, pitch: float) -> None:
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        # The corner opposite the longest edge comes first; rounding decides nothing between equal ones.
        first = (np.argmax(np.round(edges, 9), axis=1) + 2) % 3
        self._corners = (first[:, None] + np.arange(3)) % 3
        along = np.take_along_axis(edges, self._corners, axis=1)
        steps = np.clip(np.ceil(along[:, [0, 2]] / pitch - 1e-6), 1, MOST_STEPS)
        self._columns, self._rows = steps.astype(np.int64).T
        counts = (self._columns + 1) * (self._rows + 1)
        self.size = int(counts.sum())
        if self.size > MOST_VALUES:
            raise FormatError("vision", f"{self.size} values on faces, more than {MOST_VALUES}")
        self._start = np.cumsum(counts) - counts
        self._counts = counts

    def places(self, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return face (n,) and barycentric coordinates (n, 3) near each value, one of them a value.

        Parameters
        ----------
        offsets
            (1, 2) or (size, 2) steps from the value. Places outside a face are moved onto it.
        """
        face = np.repeat(np.arange(len(self._counts)), self._counts)
        j, i = np.divmod(np.arange(self.size) - self._start[face], self._columns[face] + 1)
        x = np.clip((i + offsets[:, 0]) / self._columns[face], 0.0, 1.0)
        y = np.clip((j + offsets[:, 1]) / self._rows[face], 0.0, 1.0)
        beyond = np.maximum(x + y, 1.0)
        x, y = x / beyond, y / beyond
        barycentric = np.empty((self.size, 3))
        np.put_along_axis(barycentric, self._corners[face], np.stack([1 - x - y, x, y], axis=1), axis=1)
        return face, np.clip(barycentric, 0.0, 1.0)

    def interpolate(self, values: np.ndarray, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return (n, c) of values (size, c) at barycentric coordinates (n, 3) of faces (n,), bilinear."""
        local = np.take_along_axis(barycentric, self._corners[face], axis=1)
        columns, rows = self._columns[face], self._rows[face]
        x, y = np.clip(local[:, 1], 0.0, 1.0) * columns, np.clip(local[:, 2], 0.0, 1.0) * rows
        i, j = np.minimum(x.astype(np.int64), columns - 1), np.minimum(y.astype(np.int64), rows - 1)
        right, down = (x - i)[:, None], (y - j)[:, None]
        at = self._start[face] + j * (columns + 1) + i
        below = at + columns + 1
        above = values[at] * (1 - right) + values[at + 1] * right
        return np.asarray(
            above * (1 - down) + (values[below] * (1 - right) + values[below + 1] * right) * down
        )

    def least(self, values: np.ndarray) -> np.ndarray:
        """Return the least (F,) of values (size,) on each face."""
        return np.asarray(np.minimum.reduceat(values, self._start))

    @property
    def steps(self) -> np.ndarray:
        """The more steps (F,) along one of the two edges that values follow."""
        return np.maximum(self._columns, self._rows)


def pack_levels(levels: np.ndarray) -> np.ndarray:
    """Return (size, c) uint8 of a lattice as a stream (n,) uint8: differences along it, compressed."""
    steps = np.diff(levels, axis=0, prepend=np.zeros((1, levels.shape[1]), dtype=np.uint8))
    return pack_integers(steps.T.astype(np.int64))


def unpack_levels(stream: np.ndarray, size: int, channels: int) -> np.ndarray:
    """Return the levels (size, channels) uint8 that `pack_levels` packed.

    Raises
    ------
    ValueError
        A stream that is damaged or of another size.
    """
    steps = unpack_integers(stream, size * channels).reshape(channels, size)
    return np.cumsum(steps.T, axis=0).astype(np.uint8)
