"""Isotropic linear elasticity on tetrahedra: mass and stiffness of a free body, in dimensionless form.

With lengths in units of L, speeds in units of the shear speed c_s = sqrt(mu / rho) and density 1, the weak
form is

    lambda' (div u)(div v) + 2 eps(u) : eps(v)  =  eta^2 u . v,     lambda' = 2 nu / (1 - 2 nu),

so that eta = omega L / c_s: neither the size nor the unit of anything enters the eigenproblem.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from objectfolder.making.elements.hierarchic import differentiate, evaluate, quadrature, reference_integrals
from objectfolder.making.elements.sectors import SectorSpace
from objectfolder.making.elements.space import Space

Floats = NDArray[np.float64]
Values = NDArray[Any]  # float64 or complex128
Integers = NDArray[np.int64]
# Values at once in the dense part of an assembly, and kept for the next use of the same elements.
CHUNK_VALUES = 12_000_000
STORED_VALUES = 40_000_000
# Bent elements of order 2 are integrated as those of order 3: their integrand is rational.
LEAST_QUADRATURE_ORDER = 3


def element_integrals(space: Space, elements: Integers) -> tuple[Floats, Floats]:
    """int d_a N_i d_b N_j, (t, functions, functions, 3, 3), and int N_i N_j, (t, functions, functions).

    Straight elements: exact, by contraction of integrals over the reference element. Curved ones: by
    quadrature, of the degree that straight ones need for the stiffness (its integrand is rational), and two
    more for the mass.
    `elements` must be of one kind.

    Raises
    ------
    ValueError
        An element of no or mixed orientation.
    """
    count = space.numbers.shape[1]
    if not space.curved[elements].any():
        mass, stiffness = reference_integrals(space.order)
        corner = space.shapes(elements)[:, :4]
        edges = corner[:, 1:] - corner[:, :1]
        volume = np.abs(np.linalg.det(edges)) / 6
        rest = np.swapaxes(np.linalg.inv(edges), 1, 2)
        gradients = np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)
        outer = np.einsum("t,tka,tlb->tklab", volume, gradients, gradients).reshape(len(volume), 16, 9)
        cross = np.matmul(stiffness.reshape(count * count, 16), outer)
        return cross.reshape(len(volume), count, count, 3, 3), volume[:, None, None] * mass
    shape = space.shapes(elements)
    points, weight = quadrature(2 * max(space.order, LEAST_QUADRATURE_ORDER) - 1)
    determinant, jacobian, reference = _map(space.order, points, shape)
    gradient = np.matmul(reference, np.linalg.inv(jacobian))
    flat = gradient.reshape(len(elements), len(points), 3 * count)
    scaled = np.abs(determinant) * weight / 6
    cross = np.matmul(np.swapaxes(flat * scaled[:, :, None], 1, 2), flat)
    cross = cross.reshape(len(elements), count, 3, count, 3).transpose(0, 1, 3, 2, 4)

    points, weight = quadrature(2 * space.order + 1)
    determinant, _, _ = _map(space.order, points, shape)
    value = evaluate(points, space.order)
    products = (value[:, :, None] * value[:, None, :]).reshape(len(points), -1)
    mass = (np.abs(determinant) * weight / 6) @ products
    return np.ascontiguousarray(cross), mass.reshape(len(elements), count, count)


def _map(order: int, points: Floats, shape: Floats) -> tuple[Floats, Floats, Floats]:
    """Determinants (t, q), Jacobians (t, q, axis, reference axis), and slopes of the functions (q, n, 3).

    Raises
    ------
    ValueError
        When an element is folded.
    """
    derivative = differentiate(points, order)
    reference = derivative[:, :, 1:] - derivative[:, :, :1]
    rows = reference.transpose(0, 2, 1).reshape(-1, reference.shape[1])
    jacobian = np.swapaxes(np.matmul(rows, shape).reshape(len(shape), len(points), 3, 3), -1, -2)
    determinant = np.linalg.det(jacobian)
    if not np.all(determinant * np.sign(determinant[:, :1]) > 0):
        raise ValueError("a curved element is folded")
    return determinant, np.ascontiguousarray(jacobian), reference


def element_stiffness(cross: Floats, poisson_ratio: float) -> Floats:
    """Stiffness blocks (t, functions, functions, 3, 3) from int d_a N_i d_b N_j.

    Raises
    ------
    ValueError
        For a Poisson ratio outside (-1, 0.5), where the isotropic energy is not positive.
    """
    if not -1 < poisson_ratio < 0.5:
        raise ValueError(f"Poisson ratio {poisson_ratio} is outside (-1, 0.5)")
    lame = 2 * poisson_ratio / (1 - 2 * poisson_ratio)
    stiffness = lame * cross + np.swapaxes(cross, -1, -2)
    trace = np.trace(cross, axis1=-2, axis2=-1)
    for axis in range(3):
        stiffness[..., axis, axis] += trace
    return stiffness


@dataclass
class MatrixStore:
    """Blocks and masses of elements by the first of each group, and how many values more may be kept."""

    matrices: dict[int, tuple[Floats, Floats]] = field(default_factory=dict)
    room: int = STORED_VALUES


class ElementMatrices:
    """Stiffness blocks and masses of the elements of a space, made once for two uses as far as memory allows.

    Those of a `SectorSpace` are kept for other waves around the axis, too.

    Iteration gives elements (t,), their blocks (t, functions, functions, 3, 3) and masses (t, functions,
    functions), in groups of one kind.
    """

    def __init__(self, space: Space, poisson_ratio: float) -> None:
        self.space, self.poisson_ratio = space, poisson_ratio
        self._store = MatrixStore()
        if isinstance(space, SectorSpace):
            self._store = space.sectors.integrals.setdefault((space.order, poisson_ratio), self._store)

    def __iter__(self) -> Iterator[tuple[Integers, Floats, Floats]]:
        for elements in chunks(self.space):
            name = int(elements[0])
            if name in self._store.matrices:
                blocks, masses = self._store.matrices.pop(name)
                self._store.room += blocks.size
            else:
                cross, masses = element_integrals(self.space, elements)
                blocks = element_stiffness(cross, self.poisson_ratio)
            if blocks.size <= self._store.room:
                self._store.room -= blocks.size
                self._store.matrices[name] = blocks, masses
            yield elements, blocks, masses


def assemble(
    space: Space,
    poisson_ratio: float,
    chosen: NDArray[np.bool_] | None = None,
    matrices: ElementMatrices | None = None,
) -> tuple[sparse.bsr_matrix, sparse.csr_matrix]:
    """Stiffness (3 n, 3 n), unknown 3 function + axis, float64 BSR, and mass of one axis (n, n), CSR with
    an entry for each block; of a `SectorSpace` mass (3 n, 3 n), both Hermitian, of one sector.

    The spatial unit of `space.geometry` is L. The mass matrix is consistent, so that a body of density 1
    weighs its volume. With `chosen` (function,) only those functions, in their order. `matrices` are those of
    the space, where a caller has them.
    """
    if chosen is None:
        chosen = np.ones(space.size, dtype=bool)
    size = int(chosen.sum())
    renumbered = np.where(chosen, np.cumsum(chosen) - 1, -1)[space.numbers]
    count = renumbered.shape[1]
    row, column = np.repeat(renumbered, count, axis=1), np.tile(renumbered, (1, count))
    present = (row >= 0) & (column >= 0)
    key, position = np.unique((row * size + column)[present], return_inverse=True)
    indices, indptr = key % size, np.searchsorted(key, np.arange(size + 1) * size)
    totals = _Totals(space, present, position)
    for elements, every, weights in matrices or ElementMatrices(space, poisson_ratio):
        totals.add(elements, every, weights)
    stiffness = sparse.bsr_matrix((totals.blocks.reshape(-1, 3, 3), indices, indptr), shape=(3 * size,) * 2)
    if not isinstance(space, SectorSpace):
        return stiffness, sparse.csr_matrix((totals.mass[:, 0], indices, indptr), shape=(size, size))
    mass = sparse.bsr_matrix((totals.mass.reshape(-1, 3, 3), indices, indptr), shape=stiffness.shape)
    return _restricted(stiffness, mass, space.free[chosen])


class _Totals:
    """Sums over elements of their blocks (entry, 9) and masses (entry, 1), of a `SectorSpace` (entry, 9)."""

    def __init__(self, space: Space, present: NDArray[np.bool_], position: Integers) -> None:
        """`present` (t, functions^2) are the entries in use, `position` the number of each of them."""
        self._present, self._position = present, position
        self._first = np.concatenate([[0], np.cumsum(present.sum(axis=1))])
        self._sector = space if isinstance(space, SectorSpace) else None
        count = int(position.max(initial=-1)) + 1
        dtype, width = (np.dtype(np.float64), 1) if self._sector is None else (self._sector.frames.dtype, 9)
        self.blocks, self.mass = np.zeros((count, 9), dtype), np.zeros((count, width), dtype)

    def add(self, elements: Integers, blocks: Values, masses: Values) -> None:
        """Add blocks (t, functions, functions, 3, 3) and masses (t, functions, functions) of elements."""
        if self._sector is None:
            self._gather(elements, (self.blocks, blocks), (self.mass, masses))
            return
        turned = self._sector.framed[elements]
        for some in (turned, ~turned):
            if not some.any():
                continue
            those, of_blocks, of_mass = elements[some], blocks[some], masses[some]
            if some is turned:
                of_blocks, of_mass = self._sector.in_coefficients(those, of_blocks, of_mass)
                self._gather(those, (self.blocks, of_blocks), (self.mass, of_mass))
            else:
                self._gather(those, (self.blocks, of_blocks), (self.mass[:, ::4], of_mass))

    def _gather(self, elements: Integers, *terms: tuple[Values, Values]) -> None:
        """Add values of elements (t, functions, functions, ...) to totals (entry, ...)."""
        inside = self._present[elements].ravel()
        where = np.concatenate([self._position[self._first[e] : self._first[e + 1]] for e in elements])
        touched, target = np.unique(where, return_inverse=True)
        gather = sparse.csr_matrix(
            (np.ones(len(where)), (target.ravel(), np.arange(len(where)))), shape=(len(touched), len(where))
        )
        for total, values in terms:
            total[touched] += np.asarray(gather @ values.reshape(len(inside), -1)[inside])


def _restricted(
    stiffness: sparse.bsr_matrix, mass: sparse.bsr_matrix, free: NDArray[np.bool_]
) -> tuple[sparse.bsr_matrix, sparse.csr_matrix]:
    """Both without the components that are not free (n, 3): they have stiffness 1 and no mass."""
    rows = np.repeat(np.arange(len(free)), np.diff(stiffness.indptr))
    both = free[rows][:, :, None] & free[stiffness.indices][:, None, :]
    for matrix in (stiffness, mass):
        matrix.data[~both] = 0.0
    constraints = ~free[rows] & (rows == stiffness.indices)[:, None]
    entry, component = np.nonzero(constraints)
    stiffness.data[entry, component, component] = 1.0
    weights = mass.tocsr()
    weights.eliminate_zeros()
    return stiffness, weights


def chunks(space: Space) -> Iterator[Integers]:
    """Elements in groups of one kind, small enough to be integrated at once."""
    chunk = max(1, CHUNK_VALUES // (9 * space.numbers.shape[1] ** 2))
    for kind in (False, True):
        members = np.flatnonzero(space.curved == kind)
        for start in range(0, len(members), chunk):
            yield members[start : start + chunk]


def gains_of_more_functions(
    matrices: ElementMatrices, chosen: NDArray[np.bool_], vectors: Floats, eta_squared: Floats
) -> Floats:
    """How much each function left out would lower each eigenvalue, (function, modes), were it alone.

    With r the residual of a mode in the functions left out, and D the blocks of their stiffness on the
    diagonal, r^T D^-1 r: the hierarchic error indicator (R. E. Bank and A. Weiser, Math. Comp. 44, 1985;
    for eigenvalues R. E. Bank, L. Grubisic and J. S. Ovall, Appl. Numer. Math. 66, 2013). Zero for the
    functions chosen.

    Parameters
    ----------
    matrices
        Of a space that holds the functions used and those left out.
    chosen
        (function,) functions that `vectors` use.
    vectors
        (function, 3, modes), u^T M u = 1 and zero for functions not chosen.
    """
    space = matrices.space
    sector = space if isinstance(space, SectorSpace) else None
    modes = vectors.shape[2]
    residual = np.zeros((space.size, 3 * modes), vectors.dtype)
    diagonal = np.zeros((space.size, 9), vectors.dtype)
    # Functions of an element come by ascending order: those used by any are among the first, those left out
    # by any among the last.
    of_elements = chosen[space.numbers]
    present = slice(0, int(np.flatnonzero(of_elements.any(axis=0)).max(initial=-1)) + 1)
    absent = slice(int(of_elements.all(axis=0).argmin()), space.numbers.shape[1])
    own = np.arange(absent.start, absent.stop)
    for elements, blocks, weights in matrices:
        numbers = space.numbers[elements][:, absent]
        matrix = blocks[:, absent, present].transpose(0, 1, 3, 2, 4)
        matrix = matrix.reshape(len(elements), 3 * len(own), -1)
        local = vectors[space.numbers[elements][:, present]]
        own_blocks = blocks[:, own, own]
        if sector is not None:
            local = sector.frames[elements][:, present] @ local
        force = np.matmul(matrix, local.reshape(len(elements), -1, modes))
        inertia = np.matmul(weights[:, absent, present], local.reshape(*local.shape[:2], 3 * modes))
        inertia = inertia.reshape(len(elements), len(own), 3, modes) * eta_squared
        excess = force.reshape(inertia.shape) - inertia
        if sector is not None:
            back = sector.frames[elements][:, absent].conj().swapaxes(-1, -2)
            excess, own_blocks = back @ excess, back @ own_blocks @ back.conj().swapaxes(-1, -2)
        entries = numbers.size
        gather = sparse.csr_matrix(
            (np.ones(entries), (numbers.ravel(), np.arange(entries))), shape=(space.size, entries)
        )
        residual += np.asarray(gather @ excess.reshape(-1, 3 * modes))
        diagonal += np.asarray(gather @ own_blocks.reshape(-1, 9))
    candidates = np.flatnonzero(~chosen)
    result = np.zeros((space.size, modes))
    residuals = residual[candidates].reshape(-1, 3, modes)
    diagonals = diagonal[candidates].reshape(-1, 3, 3)
    if sector is not None:
        constraints = ~sector.free[candidates]
        residuals[constraints] = 0.0
        diagonals[constraints[:, :, None] | constraints[:, None, :]] = 0.0
        diagonals[:, range(3), range(3)] += constraints
    result[candidates] = np.sum(residuals.conj() * np.linalg.solve(diagonals, residuals), axis=1).real
    return result


def most_useful(
    space: Space, gains: Floats, chosen: NDArray[np.bool_], allowed: float, at_most: int
) -> Integers:
    """All functions of the fewest elements such that the others gain no mode more than `allowed`.

    Elements are taken whole: in a thin one, functions that gain next to nothing alone let others bend freely.

    Parameters
    ----------
    gains
        (function, modes) of a space of the next order.
    chosen
        (function,) those that are in use.
    at_most
        Number of functions that may be added.
    """
    if np.all(gains.sum(axis=0) <= allowed):
        return np.zeros(0, dtype=np.int64)
    sharing = np.bincount(space.numbers.ravel(), minlength=space.size)[:, None]
    of_element = (gains / sharing)[space.numbers].sum(axis=1)
    # Rounded: elements that are alike must not change places by the last bit.
    score = np.round(np.log(of_element.max(axis=1) + 1e-300), 3)
    order = np.argsort(-score, kind="stable")
    # First element, in this order, that brings each function in.
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    first = np.full(space.size, len(order))
    np.minimum.at(first, space.numbers.ravel(), np.repeat(rank, space.numbers.shape[1]))
    arriving = np.zeros((len(order), gains.shape[1]))
    np.add.at(arriving, first, gains)
    remainder = gains.sum(axis=0) - np.cumsum(arriving, axis=0)
    new = np.cumsum(np.bincount(first[~chosen], minlength=len(order))[: len(order)])
    enough = np.flatnonzero(np.all(remainder <= allowed, axis=1))
    elements = min(
        int(enough[0]) + 1 if len(enough) else len(order), int(np.searchsorted(new, at_most, "right"))
    )
    return np.flatnonzero(~chosen & (first < elements))
