"""Quantities on a surface without texture coordinates: values on lattices of its faces.

As mesh colours (Yuksel, Keyser and House 2010, "Mesh colors", ACM Transactions on Graphics 29:2), with a
parallelogram of places along the two shorter edges of a face. Places of one small cube whose faces look the
same way share a value, so that small faces cost no more than large ones, and what lies close in space, the
two sides of a thin wall, does not mix. Places and sharing follow from the triangles by elementwise
arithmetic, which every processor rounds alike.
"""

from functools import cached_property

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.integer_coding import pack_integers, unpack_integers

MOST_STEPS = 1024
"""Along an edge of a face."""

MOST_PLACES = 3 << 21
"""Of a lattice: six times those of a chair, 1/192 of its length apart."""

HALF_SIDE = 0.6
"""No coordinate of the unit frame is below this less than zero: cubes are counted from there."""


class FaceLattice:
    """Where on the faces of a surface values lie.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners, unit frame.
    pitch
        Neighbouring places lie at most this far apart; cubes have this side. Unit-frame lengths.
    shared
        Whether places of a cube share a value.
    most
        Places; `MOST_PLACES` at most where shared.

    Raises
    ------
    FormatError
        More places.

    Examples
    --------
    >>> triangle = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    >>> lattice = FaceLattice(triangle, 0.5, shared=False)
    >>> face, barycentric = lattice.places(np.zeros((1, 2)))
    >>> lattice.interpolate(barycentric[:, 1:], np.array([0]), np.array([[0.5, 0.4, 0.1]]))
    array([[0.4, 0.1]])
    """

    def __init__(
        self, triangles: np.ndarray, pitch: float, *, shared: bool = True, most: int = MOST_PLACES
    ) -> None:
        self._triangles, self._pitch, self._shared = triangles, pitch, shared
        x, y, z = np.moveaxis(np.roll(triangles, -1, axis=1) - triangles, 2, 0)
        edges = np.sqrt(x * x + y * y + z * z)
        # The corner opposite the longest edge comes first; rounding decides nothing between equal ones.
        first = (np.argmax(np.round(edges, 9), axis=1) + 2) % 3
        self._corners = (first[:, None] + np.arange(3)) % 3
        along = np.take_along_axis(edges, self._corners, axis=1)
        steps = np.clip(np.ceil(along[:, [0, 2]] / pitch - 1e-6), 1, MOST_STEPS)
        self._columns, self._rows = steps.astype(np.int64).T
        self._counts = (self._columns + 1) * (self._rows + 1)
        self._size = int(self._counts.sum())
        if self._size > most:
            raise FormatError("vision", f"{self._size} places on faces, more than {most}")
        self._start = np.cumsum(self._counts) - self._counts

    def places(self, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return face (p,) and barycentric coordinates (p, 3) of each place of the lattice, or near it.

        Parameters
        ----------
        offsets
            (1, 2) steps along the edges from the place. Where that leads off a face, the nearest of it.
        """
        face = np.repeat(np.arange(len(self._counts)), self._counts)
        j, i = np.divmod(np.arange(self._size) - self._start[face], self._columns[face] + 1)
        x = np.clip((i + offsets[:, 0]) / self._columns[face], 0.0, 1.0)
        y = np.clip((j + offsets[:, 1]) / self._rows[face], 0.0, 1.0)
        beyond = np.maximum(x + y, 1.0)
        x, y = x / beyond, y / beyond
        barycentric = np.empty((self._size, 3))
        np.put_along_axis(barycentric, self._corners[face], np.stack([1 - x - y, x, y], axis=1), axis=1)
        return face, np.clip(barycentric, 0.0, 1.0)

    @property
    def counts(self) -> np.ndarray:
        """Number of places (F,) on each face."""
        return self._counts

    @property
    def grids(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of each face its corners (F, 3) in the order of its grid, steps (F,) along two edges, first place.

        Places follow one another along the first edge, from the first corner to the second, and so on.
        """
        return self._corners, self._columns, self._rows, self._start

    @cached_property
    def owner(self) -> np.ndarray:
        """Which value (p,) is that of each place: in order of cubes along a Morton curve where shared."""
        if not self._shared:
            return np.arange(self._size)
        # Importing numba is slow, and only values on a lattice need it.
        from objectfolder.vision.network.place_values import shared_values

        ways = facing(self._triangles)
        return shared_values(self._triangles, ways, self.grids, self._size, self._pitch, HALF_SIDE)

    @cached_property
    def size(self) -> int:
        """Number of values."""
        return int(self.owner.max()) + 1

    def mean(self, of_places: np.ndarray) -> np.ndarray:
        """Return values (size, c) that are means over their places (p, c)."""
        count = np.bincount(self.owner)
        columns = [np.bincount(self.owner, column) / count for column in of_places.T]
        return np.stack(columns, axis=1)

    def interpolate(self, values: np.ndarray, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return (n, c) of values (size, c) at barycentric coordinates (n, 3) of faces (n,), bilinear."""
        local = np.take_along_axis(barycentric, self._corners[face], axis=1)
        columns, rows = self._columns[face], self._rows[face]
        x, y = np.clip(local[:, 1], 0.0, 1.0) * columns, np.clip(local[:, 2], 0.0, 1.0) * rows
        i, j = np.minimum(x.astype(np.int64), columns - 1), np.minimum(y.astype(np.int64), rows - 1)
        right, down = (x - i)[:, None], (y - j)[:, None]
        at = self._start[face] + j * (columns + 1) + i
        corner = [values[self.owner[place]] for place in (at, at + 1, at + columns + 1, at + columns + 2)]
        above = corner[0] * (1 - right) + corner[1] * right
        under = corner[2] * (1 - right) + corner[3] * right
        return np.asarray(above * (1 - down) + under * down)

    def nearest_values(self, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return which value (n,) lies nearest to barycentric coordinates (n, 3) of faces (n,)."""
        local = np.take_along_axis(barycentric, self._corners[face], axis=1)
        columns, rows = self._columns[face], self._rows[face]
        i, j = (
            np.rint(np.clip(local[:, k], 0.0, 1.0) * n).astype(np.int64) for k, n in ((1, columns), (2, rows))
        )
        return np.asarray(self.owner[self._start[face] + j * (columns + 1) + i])

    def least(self, values: np.ndarray) -> np.ndarray:
        """Return the least (F,) of values (size,) on each face."""
        return np.asarray(np.minimum.reduceat(values[self.owner], self._start))

    @property
    def steps(self) -> np.ndarray:
        """The more steps (F,) along one of the two edges that places follow."""
        return np.maximum(self._columns, self._rows)


def facing(triangles: np.ndarray) -> np.ndarray:
    """Return the way (F,) that triangles (F, 3, 3) look: twice the axis, plus 1 where they look along it."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    axis = np.argmax(np.abs(normal), axis=1)
    return 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] > 0)


def pack_levels(levels: np.ndarray) -> np.ndarray:
    """Return (size, c) uint8 of a lattice as a stream (n,) uint8: differences along it, compressed."""
    steps = np.diff(levels, axis=0, prepend=np.zeros((1, levels.shape[1]), dtype=np.uint8))
    return pack_integers(steps.T.astype(np.int64))


def unpack_levels(stream: np.ndarray, size: int, channels: int) -> np.ndarray:
    """Return the levels (size, channels) uint8 that `pack_levels` packed.

    Raises
    ------
    ValueError
        A stream that is damaged, of another size, or of numbers longer than a byte.
    """
    if len(stream) and stream[0] > 1:
        raise ValueError("levels of more than a byte")
    steps = unpack_integers(stream, size * channels).reshape(channels, size)
    return np.cumsum(steps.T, axis=0).astype(np.uint8)
