"""Hierarchic polynomials of order 1 to 5 on a tetrahedron.

The functions of order p contain those of order p - 1: corners, then edges, faces and the interior (B. Szabo
and I. Babuska, Finite Element Analysis, 1991, ch. 6):

    corner    l_a
    edge      l_a l_b P'_{k-1}(l_b - l_a)                              k = 2 .. p
    face      l_a l_b l_c P_i(l_b - l_a) P_j(2 l_c - 1)                i + j + 3 = k
    interior  l_0 l_1 l_2 l_3 P_i(l_1 - l_0) P_j(2 l_2 - 1) P_m(2 l_3 - 1)   i + j + m + 4 = k

with Legendre polynomials P. Corners are taken in ascending order of their global numbers, so that neighbours
agree on the sign of odd functions without being asked. Any subset that holds the corners spans a continuous
space: this is what lets the order be chosen function by function.
"""

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.special import roots_jacobi

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
HIGHEST_ORDER = 5
EDGES = np.array(list(combinations(range(4), 2)))
FACES = np.array(list(combinations(range(4), 3)))

Exponents = tuple[int, int, int, int]
Polynomial = dict[Exponents, float]


@dataclass(frozen=True)
class Function:
    """One function of an element.

    Attributes
    ----------
    corners : corners of the element on whose entity it lives (1 corner, 2 edge, 3 face, 4 interior)
    order : polynomial order
    number : which of the functions of this order on this entity
    """

    corners: tuple[int, ...]
    order: int
    number: int


@cache
def functions(order: int) -> tuple[Function, ...]:
    """Functions of an element by ascending order."""
    if not 1 <= order <= HIGHEST_ORDER:
        raise ValueError(f"order {order}: elements of order 1 to {HIGHEST_ORDER} are implemented")
    return tuple(function for function, _ in _table(order))


@cache
def _table(order: int) -> tuple[tuple[Function, Polynomial], ...]:
    table: list[tuple[Function, Polynomial]] = [(Function((a,), 1, 0), _coordinate(a)) for a in range(4)]
    for k in range(2, order + 1):
        for pair in combinations(range(4), 2):
            a, b = pair
            kernel = _of_difference(legendre.legder(np.eye(k)[k - 1]), a, b)
            table.append((Function(pair, k, 0), _product(_bubble(pair), kernel)))
        for triple in combinations(range(4), 3):
            a, b, c = triple
            for number, i in enumerate(range(k - 3, -1, -1)):
                kernel = _product(_legendre(i, a, b), _legendre_of_one(k - 3 - i, c))
                table.append((Function(triple, k, number), _product(_bubble(triple), kernel)))
        number = 0
        for i in range(k - 4, -1, -1):
            for j in range(k - 4 - i, -1, -1):
                kernel = _product(
                    _product(_legendre(i, 0, 1), _legendre_of_one(j, 2)), _legendre_of_one(k - 4 - i - j, 3)
                )
                table.append((Function((0, 1, 2, 3), k, number), _product(_bubble((0, 1, 2, 3)), kernel)))
                number += 1
    return tuple(table)


def _coordinate(a: int, weight: float = 1.0) -> Polynomial:
    exponents = [0, 0, 0, 0]
    exponents[a] = 1
    return {(exponents[0], exponents[1], exponents[2], exponents[3]): weight}


def _product(first: Polynomial, second: Polynomial) -> Polynomial:
    result: Polynomial = {}
    for left, x in first.items():
        for right, y in second.items():
            key = (left[0] + right[0], left[1] + right[1], left[2] + right[2], left[3] + right[3])
            result[key] = result.get(key, 0.0) + x * y
    return result


def _bubble(corners: tuple[int, ...]) -> Polynomial:
    result: Polynomial = {(0, 0, 0, 0): 1.0}
    for a in corners:
        result = _product(result, _coordinate(a))
    return result


def _series(coefficients: Floats, argument: Polynomial) -> Polynomial:
    """Legendre series of a polynomial argument."""
    power: Polynomial = {(0, 0, 0, 0): 1.0}
    result: Polynomial = {}
    for coefficient in legendre.leg2poly(coefficients):
        for key, value in power.items():
            result[key] = result.get(key, 0.0) + coefficient * value
        power = _product(power, argument)
    return result


def _of_difference(coefficients: Floats, a: int, b: int) -> Polynomial:
    return _series(coefficients, {**_coordinate(b), **_coordinate(a, -1.0)})


def _legendre(degree: int, a: int, b: int) -> Polynomial:
    return _of_difference(np.eye(degree + 1)[degree], a, b)


def _legendre_of_one(degree: int, c: int) -> Polynomial:
    return _series(np.eye(degree + 1)[degree], {**_coordinate(c, 2.0), (0, 0, 0, 0): -1.0})


@cache
def _monomials(order: int) -> tuple[Integers, Floats]:
    """Exponents (m, 4) and coefficients (functions, m) of an element's functions."""
    table = _table(order)
    exponents = sorted({key for _, polynomial in table for key in polynomial})
    position = {key: index for index, key in enumerate(exponents)}
    coefficients = np.zeros((len(table), len(exponents)))
    for row, (_, polynomial) in enumerate(table):
        for key, value in polynomial.items():
            coefficients[row, position[key]] = value
    powers = np.array(exponents, dtype=np.int64)
    points, weight = quadrature(2 * order)
    mean_square = weight @ (_powers(points, powers) @ coefficients.T) ** 2
    # All as large as a corner's function: then no unknown is of another magnitude than its neighbours.
    return powers, coefficients * np.sqrt(mean_square[0] / mean_square)[:, None]


def evaluate(barycentric: Floats, order: int) -> Floats:
    """Values (n, functions) at barycentric coordinates (n, 4) by ascending global number of the corners."""
    exponents, coefficients = _monomials(order)
    return _powers(barycentric, exponents) @ coefficients.T


def differentiate(barycentric: Floats, order: int) -> Floats:
    """Derivatives (n, functions, 4) by each barycentric coordinate, all four taken as independent."""
    exponents, coefficients = _monomials(order)
    result = np.empty((len(barycentric), len(coefficients), 4))
    for axis in range(4):
        lowered = exponents.copy()
        lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
        result[:, :, axis] = _powers(barycentric, lowered) @ (coefficients * exponents[:, axis]).T
    return result


def _powers(barycentric: Floats, exponents: Integers) -> Floats:
    result = np.ones((len(barycentric), len(exponents)))
    table = np.ones((exponents.max() + 1, *barycentric.shape))
    for power in range(1, len(table)):
        table[power] = table[power - 1] * barycentric
    for axis in range(4):
        result *= table[exponents[:, axis], :, axis].T
    return result


@cache
def quadrature(degree: int) -> tuple[Floats, Floats]:
    """Barycentric points (n, 4) and weights (n,) of sum 1, exact to a degree: collapsed Gauss-Jacobi."""
    count = degree // 2 + 1
    (x, wx), (y, wy), (z, wz) = (roots_jacobi(count, power, 0) for power in (2, 1, 0))
    a, b, c = np.meshgrid((1 + x) / 2, (1 + y) / 2, (1 + z) / 2, indexing="ij")
    weight = np.einsum("i,j,k->ijk", wx, wy, wz).ravel()
    l1, l2, l3 = a.ravel(), (b * (1 - a)).ravel(), (c * (1 - b) * (1 - a)).ravel()
    return np.stack([1 - l1 - l2 - l3, l1, l2, l3], axis=-1), weight / weight.sum()


@cache
def reference_integrals(order: int) -> tuple[Floats, Floats]:
    """Means over a tetrahedron of N_i N_j, (n, n), and of dN_i/dl_k dN_j/dl_l, (n, n, 4, 4)."""
    points, weight = quadrature(2 * order)
    value, derivative = evaluate(points, order), differentiate(points, order)
    count = value.shape[1]
    flat = derivative.reshape(len(points), -1)
    products = (flat * weight[:, None]).T @ flat
    return (
        (value * weight[:, None]).T @ value,
        np.ascontiguousarray(products.reshape(count, 4, count, 4).transpose(0, 2, 1, 3)),
    )
