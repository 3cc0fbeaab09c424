"""Finite-element spaces of hierarchic functions on straight or curved tetrahedra."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from objectfolder.making.elements.hierarchic import EDGES, FACES, differentiate, evaluate, functions

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Space:
    """Continuous functions on a mesh of tetrahedra, numbered by ascending order.

    Attributes
    ----------
    tetrahedra : (t, 4) int64, corners of each element in an order that neighbours agree on (so either
        orientation): ascending, unless `of_corners` was given another
    vertex_count : number of vertices; function v is the hat function of vertex v
    order : highest order, 1 to 5
    numbers : (t, functions of an element) int64, global number of each local function
    orders : (function,) int64, order of each function, ascending
    geometry : (function, 3) float64, the map from the reference to space in these same functions, so that
        rigid motions are in the space whatever the shape of the elements
    curved : (t,) bool, whether an element's map is more than linear
    """

    tetrahedra: Integers
    vertex_count: int
    order: int
    numbers: Integers
    orders: Integers
    geometry: Floats
    curved: NDArray[np.bool_]

    @classmethod
    def on(cls, vertices: Floats, tetrahedra: Integers, order: int) -> "Space":
        """Space of an order on straight elements; `tetrahedra` in any orientation."""
        corners = np.sort(np.asarray(tetrahedra, dtype=np.int64), axis=1)
        space = cls.of_corners(len(vertices), corners, order)
        space.geometry[: len(vertices)] = vertices
        return space

    @classmethod
    def of_corners(cls, count: int, corners: Integers, order: int) -> "Space":
        """Space of an order without a shape, on corners (t, 4) of `count` vertices.

        Their order in an element is that of its functions; elements have to agree on it at common edges and
        faces. Functions are numbered alike whatever it is.
        """
        if count >= 2**21:
            raise ValueError(f"{count} vertices: numbering holds fewer than 2097152")
        edges, edge_of = _unique_rows(np.sort(corners[:, EDGES], axis=-1), count)
        faces, face_of = _unique_rows(np.sort(corners[:, FACES], axis=-1), count)
        of_kind = {2: edge_of, 3: face_of, 4: np.arange(len(corners))[:, None]}
        local = {2: [tuple(e) for e in EDGES], 3: [tuple(f) for f in FACES], 4: [(0, 1, 2, 3)]}

        table = functions(order)
        numbers = np.empty((len(corners), len(table)), dtype=np.int64)
        numbers[:, :4] = corners
        orders = [np.ones(count, dtype=np.int64)]
        total = count
        for k in range(2, order + 1):
            for kind, sizes in ((2, edges), (3, faces), (4, len(corners))):
                many = max(
                    (f.number + 1 for f in table if len(f.corners) == kind and f.order == k), default=0
                )
                if not many:
                    continue
                for index, function in enumerate(table):
                    if len(function.corners) == kind and function.order == k:
                        place = local[kind].index(function.corners)
                        numbers[:, index] = total + of_kind[kind][:, place] * many + function.number
                orders.append(np.full(sizes * many, k, dtype=np.int64))
                total += sizes * many
        straight = np.zeros(len(corners), dtype=bool)
        return cls(corners, count, order, numbers, np.concatenate(orders), np.zeros((total, 3)), straight)

    @property
    def size(self) -> int:
        """Number of functions; three times as many unknowns."""
        return len(self.orders)

    def up_to(self, order: int) -> "Space":
        """Leading functions of a lower order.

        Raises
        ------
        ValueError
            When the elements are curved by functions of a higher order than that.
        """
        size = int(np.searchsorted(self.orders, order, side="right"))
        if np.any(self.geometry[size:]):
            raise ValueError(f"elements are curved by functions above order {order}")
        return Space(
            self.tetrahedra,
            self.vertex_count,
            order,
            self.numbers[:, : len(functions(order))],
            self.orders[:size],
            self.geometry[:size],
            self.curved,
        )

    def shapes(self, elements: Integers) -> Floats:
        """Geometry of elements, (t, functions of an element, 3)."""
        return self.geometry[self.numbers[elements]]

    def shaped(self, geometry: Floats) -> "Space":
        """The same functions on elements of another shape, `geometry` (function, 3)."""
        curved = np.any(geometry[self.numbers[:, 4:]] != 0, axis=(1, 2))
        return replace(self, geometry=geometry, curved=curved)

    def values(
        self, coefficients: Floats, element: Integers, barycentric: Floats, offset: Floats | None = None
    ) -> Floats:
        """Field (n, ...) of coefficients (function, ...) in elements (n,) at barycentric coordinates (n, 4).

        Coordinates belong to the corners in the order that `tetrahedra` has. With `offset` (n, 3),
        continued linearly so far beyond those points.
        """
        weights = evaluate(barycentric, self.order)
        if offset is not None:
            weights = weights + np.einsum("nid,nd->ni", self._slopes(element, barycentric), offset)
        count = weights.shape[1]
        matrix = sparse.csr_matrix(
            (weights.ravel(), self.numbers[element].ravel(), np.arange(len(element) + 1) * count),
            shape=(len(element), self.size),
        )
        # On a face most functions of its element vanish.
        matrix.eliminate_zeros()
        flat = np.ascontiguousarray(coefficients).reshape(self.size, -1)
        return np.asarray(matrix @ flat).reshape(len(element), *coefficients.shape[1:])

    def _slopes(self, element: Integers, barycentric: Floats) -> Floats:
        """Gradients in space (n, functions of an element, 3)."""
        derivative = differentiate(barycentric, self.order)
        reference = derivative[:, :, 1:] - derivative[:, :, :1]
        jacobian = np.einsum("nik,nid->ndk", reference, self.geometry[self.numbers[element]], optimize=True)
        return np.matmul(reference, np.linalg.inv(jacobian))


def _unique_rows(groups: Integers, base: int) -> tuple[int, Integers]:
    """Number of distinct sorted rows of (t, g, 2 or 3), and which one each is, (t, g)."""
    key = groups[..., 0]
    for column in range(1, groups.shape[-1]):
        key = key * base + groups[..., column]
    unique, index = np.unique(key, return_inverse=True)
    return len(unique), index.reshape(key.shape).astype(np.int64)
