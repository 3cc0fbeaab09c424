"""Free vibrations of a body of revolution: Fourier series around it, high-order elements in the meridian.

For circumferential order n the displacement is (U cos n theta, V sin n theta, W cos n theta) along r, theta
and z, and the strains are

    e_rr = U_r,  e_tt = (U + n V) / r,  e_zz = W_z,
    g_rz = U_z + W_r,  g_rt = V_r - (V + n U) / r,  g_tz = V_z - n W / r.

Each mode with n >= 1 comes twice, turned by pi / 2n; with n = 0 torsion (V) and the rest are separate and
come once. Elements are curved quadrilaterals with Lagrange functions at Gauss-Lobatto points (A. T. Patera,
J. Comput. Phys. 54, 1984). A displacement is single-valued on the axis: U = V = 0 for n = 0; U + V = W = 0
for n = 1; zero from n = 2 on.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh, splu

from objectfolder.errors import SimulationError
from tests.references.meridian import Meridian
from tests.references.spectrum import ReferenceSpectrum

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Orders = tuple[int, int]
# Orders along a wall and across it.
ORDERS = (7, 5)
FINER = (9, 6)
# A limit may fall on an eigenvalue; the count is then taken this much higher or lower.
NUDGES = (0.0, 1e-7, -1e-7, 3e-7)
# Circumferential orders without a mode after which no further one has one, and the order from which it holds.
EMPTY, LEAST_ORDER = 3, 5


def body_of_revolution(
    meridian: Meridian,
    poisson_ratio: float,
    limit: float,
    *,
    orders: Orders = ORDERS,
    finer: Orders | None = FINER,
) -> ReferenceSpectrum:
    """Every elastic mode of a free body of revolution with omega / c_s below `limit`.

    Parameters
    ----------
    meridian
        Blocks in the unit of length.
    poisson_ratio
        In (-1, 0.5).
    limit
        Radians per unit of length.
    orders
        Of the elements, along a wall and across it; of elements that are not of a wall, that across it both
        ways. Solid bodies want both high.
    finer
        Orders to solve with again; these modes are returned, and the largest relative change as
        `convergence`. None for a single solution, convergence nan.

    Returns
    -------
    ReferenceSpectrum
        Families are the circumferential orders, "n = 0 torsion" those of pure torsion.

    Raises
    ------
    ValueError
        For a Poisson ratio outside (-1, 0.5).
    SimulationError
        When the modes of a circumferential order are not as many as its factorisation counts.
    """
    if not -1 < poisson_ratio < 0.5:
        raise ValueError(f"Poisson ratio {poisson_ratio} is outside (-1, 0.5)")
    coarse = _all_orders(Discretisation.of(meridian, orders), poisson_ratio, limit, meridian.name)
    if finer is None:
        return ReferenceSpectrum.collect(_modes(coarse), limit, float("nan"))
    fine = _all_orders(Discretisation.of(meridian, finer), poisson_ratio, limit, meridian.name)
    convergence = 0.0
    for old, new in zip(coarse, fine, strict=True):
        count = int(np.count_nonzero(new < limit))
        if len(old) < count:
            return ReferenceSpectrum.collect(_modes(fine), limit, np.inf)
        convergence = max(convergence, float(np.max(np.abs(old[:count] / new[:count] - 1), initial=0.0)))
    return ReferenceSpectrum.collect(_modes(fine), limit, convergence)


@dataclass(frozen=True)
class Discretisation:
    """Nodes and elements of a meridian.

    Attributes
    ----------
    positions : (nodes, 2), r and z
    elements : (orders, node numbers (m,)) of each element
    on_axis : (nodes,) bool
    """

    positions: Floats
    elements: tuple[tuple[Orders, Integers], ...]
    on_axis: NDArray[np.bool_]

    @classmethod
    def of(cls, meridian: Meridian, orders: Orders) -> "Discretisation":
        """Place the nodes of every block, and merge those that coincide."""
        shapes, points = [], []
        for block in meridian.blocks:
            order = (orders[0] if block.along else orders[1], orders[1])
            s, t = np.meshgrid(*(lobatto_points(p) for p in order), indexing="ij")
            shapes.append(order)
            points.append(block.position((s.ravel() + 1) / 2, (t.ravel() + 1) / 2))
        every = np.concatenate(points)
        size = float(np.ptp(every, axis=0).max())
        _, first, number = np.unique(
            np.round(every / (1e-8 * size)).astype(np.int64), axis=0, return_index=True, return_inverse=True
        )
        starts = np.cumsum([0, *map(len, points)])
        elements = tuple(
            (shape, number.reshape(-1)[start:end])
            for shape, start, end in zip(shapes, starts[:-1], starts[1:], strict=True)
        )
        positions = every[first]
        return cls(positions, elements, np.abs(positions[:, 0]) < 1e-8 * size)

    def matrices(self, poisson_ratio: float) -> tuple[list[sparse.csc_matrix], sparse.csc_matrix]:
        """Stiffness as the polynomial K_0 + n K_1 + n^2 K_2, and mass; unknown 3 node + component.

        mu = 1, density 1, and the factor pi of the integral around the axis is left out of both.
        """
        lame = 2 * poisson_ratio / (1 - 2 * poisson_ratio)
        law = np.diag([2.0, 2, 2, 1, 1, 1])
        law[:3, :3] += lame
        rows, columns = [], []
        values: list[list[Floats]] = [[], [], [], []]
        for orders, nodes in self.elements:
            value, slope_r, slope_z, weight, radius = self._basis(orders, nodes)
            count = len(nodes)
            constant = np.zeros((len(weight), 6, count, 3))
            constant[:, 0, :, 0] = constant[:, 3, :, 2] = constant[:, 4, :, 1] = slope_r
            constant[:, 2, :, 2] = constant[:, 3, :, 0] = constant[:, 5, :, 1] = slope_z
            over_r = value / radius[:, None]
            constant[:, 1, :, 0] = over_r
            constant[:, 4, :, 1] -= over_r
            linear = np.zeros_like(constant)
            linear[:, 1, :, 1] = over_r
            linear[:, 4, :, 0] = linear[:, 5, :, 2] = -over_r
            b0, b1 = (b.reshape(len(weight) * 6, 3 * count) for b in (constant, linear))
            stress0, stress1 = (
                (np.einsum("q,ij,qjk->qik", weight, law, b.reshape(len(weight), 6, -1))).reshape(b.shape)
                for b in (b0, b1)
            )
            cross = b0.T @ stress1
            mass = np.kron((value * weight[:, None]).T @ value, np.eye(3))
            unknown = (3 * nodes[:, None] + np.arange(3)).ravel()
            rows.append(np.repeat(unknown, 3 * count))
            columns.append(np.tile(unknown, 3 * count))
            for entries, matrix in zip(
                values, (b0.T @ stress0, cross + cross.T, b1.T @ stress1, mass), strict=True
            ):
                entries.append(matrix.ravel())
        size = 3 * len(self.positions)
        place = (np.concatenate(rows), np.concatenate(columns))
        built = [sparse.coo_matrix((np.concatenate(v), place), shape=(size, size)).tocsc() for v in values]
        return built[:3], built[3]

    def volume(self) -> float:
        """Volume of the body of revolution."""
        return sum(float(2 * np.pi * self._basis(orders, nodes)[3].sum()) for orders, nodes in self.elements)

    def admissible(self, n: int) -> sparse.csc_matrix:
        """Columns that span the displacements of order n that are single-valued on the axis."""
        size = 3 * len(self.positions)
        free = np.repeat(~self.on_axis, 3)
        axis = np.flatnonzero(self.on_axis)
        if n == 0:
            free[3 * axis + 2] = True
        identity = sparse.identity(size, format="csc")
        columns = [identity[:, np.flatnonzero(free)]]
        if n == 1:
            columns.append(identity[:, 3 * axis] - identity[:, 3 * axis + 1])
        return sparse.hstack(columns, format="csc")

    def _basis(self, orders: Orders, nodes: Integers) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Values and slopes along r and z (points, nodes), weights with r, and r, (points,)."""
        value, by_s, by_t, weight = _reference_element(*orders)
        position = self.positions[nodes]
        jacobian = np.stack([by_s @ position, by_t @ position], axis=1)  # rows d/ds, d/dt of (r, z)
        slopes = np.linalg.solve(jacobian, np.stack([by_s, by_t], axis=1))
        radius = value @ position[:, 0]
        return (
            value,
            slopes[:, 0],
            slopes[:, 1],
            weight * np.abs(np.linalg.det(jacobian)) * radius,
            radius,
        )


def modes_of_order(
    stiffness: sparse.csc_matrix, mass: sparse.csc_matrix, rigid: int, limit: float, where: str
) -> Floats:
    """Elastic wavenumbers below `limit` of one pencil, after its `rigid` zero ones; their number is counted.

    Raises
    ------
    SimulationError
        When they are not as many as the inertia of K - limit^2 M says.
    """
    size = stiffness.shape[0]
    count = 10 + rigid
    if size < 400:
        values = eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True)
        return np.sqrt(np.maximum(values[rigid : np.searchsorted(values, limit**2)], 0.0))
    shift = (0.2 * limit) ** 2
    factors = _factorise(stiffness + shift * mass)
    inverse = LinearOperator((size, size), matvec=factors.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(size)
    while True:
        values = np.sort(
            eigsh(stiffness, count, mass, sigma=-shift, OPinv=inverse, v0=start, return_eigenvectors=False)
        )
        if values[-1] > 1.02 * limit**2:
            break
        count *= 2
    for nudge in NUDGES:
        bound = limit**2 * (1 + nudge)
        pivots = _factorise(stiffness - bound * mass)
        if np.array_equal(pivots.perm_r, pivots.perm_c):
            counted = int(np.count_nonzero(pivots.U.diagonal() < 0))
            solution_count = int(np.count_nonzero(values < bound))
            if counted != solution_count:
                raise SimulationError(
                    where, f"{solution_count} modes found, {counted} counted", "Change the limit."
                )
            break
    else:
        raise SimulationError(where, "the count of modes failed", "Change the limit.")
    if rigid and np.abs(values[:rigid]).max() > 1e-4 * values[rigid]:
        raise SimulationError(where, f"rigid motions at {values[:rigid]}", "Check the meridian.")
    return np.sqrt(values[rigid:][values[rigid:] < limit**2])


def lobatto_points(order: int) -> Floats:
    """Gauss-Lobatto points of an order on [-1, 1], (order + 1,)."""
    inner = legendre.legroots(legendre.legder(np.eye(order + 1)[order]))
    return np.concatenate([[-1.0], np.sort(inner.real), [1.0]])


def _factorise(matrix: sparse.csc_matrix) -> SuperLU:
    return splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


@cache
def _reference_element(order_s: int, order_t: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Lagrange functions and slopes (points, nodes) and weights (points,) of a Gauss rule on [-1, 1]^2."""
    (value_s, slope_s, weight_s), (value_t, slope_t, weight_t) = map(_lagrange, (order_s, order_t))
    return (
        np.kron(value_s, value_t),
        np.kron(slope_s, value_t),
        np.kron(value_s, slope_t),
        np.kron(weight_s, weight_t),
    )


def _lagrange(order: int) -> tuple[Floats, Floats, Floats]:
    nodes, weights = legendre.leggauss(order + 3)
    interpolation = np.linalg.inv(legendre.legvander(lobatto_points(order), order))
    slopes = np.stack([legendre.legval(nodes, legendre.legder(row)) for row in np.eye(order + 1)], axis=1)
    return legendre.legvander(nodes, order) @ interpolation, slopes @ interpolation, weights


def _all_orders(body: Discretisation, poisson_ratio: float, limit: float, name: str) -> list[Floats]:
    """Wavenumbers a little beyond the limit of torsion, then of n = 0, 1, ..., the last ones empty."""
    (constant, linear, square), mass = body.matrices(poisson_ratio)
    result: list[Floats] = []
    empty = n = 0
    beyond = 1.001 * limit
    while n < LEAST_ORDER or empty < EMPTY:
        columns = body.admissible(n)
        stiffness = columns.T @ (constant + n * linear + n**2 * square) @ columns
        inertia = columns.T @ mass @ columns
        if n == 0:
            twist = np.asarray(columns.argmax(axis=0)).ravel() % 3 == 1
            for part, label in ((twist, "torsion"), (~twist, "n = 0")):
                chosen = np.flatnonzero(part)
                k, m = (matrix.tocsc()[chosen][:, chosen] for matrix in (stiffness, inertia))
                result.append(modes_of_order(k, m, 1, beyond, f"{name}, {label}"))
        else:
            rigid = 2 if n == 1 else 0
            result.append(modes_of_order(stiffness, inertia, rigid, beyond, f"{name}, n = {n}"))
            empty = 0 if np.any(result[-1] < limit) else empty + 1
        n += 1
    return result


def _modes(classes: list[Floats]) -> list[tuple[float, int, str]]:
    labels = [("n = 0 torsion", 1), ("n = 0", 1), *((f"n = {n}", 2) for n in range(1, len(classes) - 1))]
    return [
        (float(value), multiplicity, label)
        for (label, multiplicity), values in zip(labels, classes, strict=True)
        for value in values
    ]
