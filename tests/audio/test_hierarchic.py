"""Hierarchic functions: complete, continuous, and integrated exactly."""

from math import comb, factorial

import numpy as np
import pytest
from structured_solids import box

from objectfolder.making.elements.hierarchic import (
    HIGHEST_ORDER,
    differentiate,
    evaluate,
    functions,
    quadrature,
    reference_integrals,
)
from objectfolder.making.elements.space import Space

ORDERS = range(1, HIGHEST_ORDER + 1)


def points(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).dirichlet(np.ones(4), count)


@pytest.mark.parametrize("order", ORDERS)
def test_they_span_all_polynomials_of_their_order(order: int) -> None:
    barycentric = points(400)
    values = evaluate(barycentric, order)
    assert values.shape[1] == len(functions(order)) == comb(order + 3, 3)
    x, y, z = barycentric[:, 1:].T
    monomials = np.stack(
        [
            x**a * y**b * z**c
            for a in range(order + 1)
            for b in range(order + 1 - a)
            for c in range(order + 1 - a - b)
        ],
        axis=1,
    )
    fitted = values @ np.linalg.lstsq(values, monomials, rcond=None)[0]
    np.testing.assert_allclose(fitted, monomials, atol=1e-10)


@pytest.mark.parametrize("order", ORDERS[1:])
def test_those_of_a_lower_order_come_first(order: int) -> None:
    barycentric = points(20)
    lower = evaluate(barycentric, order - 1)
    np.testing.assert_allclose(evaluate(barycentric, order)[:, : lower.shape[1]], lower, atol=1e-12)


def test_derivatives_are_those_of_finite_differences() -> None:
    barycentric, step = points(30), 1e-6
    derivative = differentiate(barycentric, 5)
    for axis in range(4):
        offset = step * np.eye(4)[axis]
        change = evaluate(barycentric + offset, 5) - evaluate(barycentric - offset, 5)
        np.testing.assert_allclose(change / (2 * step), derivative[:, :, axis], atol=1e-7)


def test_quadrature_is_exact_to_its_degree() -> None:
    """Mean of l_1^a l_2^b l_3^c over a tetrahedron: 3! a! b! c! / (a + b + c + 3)!."""
    where, weight = quadrature(9)
    for a, b, c in ((9, 0, 0), (4, 3, 2), (1, 1, 1), (0, 5, 4)):
        mean = weight @ (where[:, 1] ** a * where[:, 2] ** b * where[:, 3] ** c)
        exact = 6 * factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 3)
        assert mean == pytest.approx(exact, rel=1e-12)


def test_reference_integrals_of_corners_are_the_textbooks() -> None:
    mass, stiffness = reference_integrals(1)
    np.testing.assert_allclose(mass, (1 + np.eye(4)) / 20, atol=1e-15)
    np.testing.assert_allclose(stiffness[2, 3, 2, 3], 1.0)


def test_fields_are_continuous_across_faces() -> None:
    """Any coefficients: the two elements at a face give the same values on it."""
    solid = box((2, 2, 1), (1.0, 1.1, 0.9))
    space = Space.on(solid.vertices, solid.tetrahedra, 5)
    coefficients = np.random.default_rng(2).standard_normal(space.size)
    weights = np.random.default_rng(3).dirichlet(np.ones(3), 6)
    shared: dict[tuple[int, ...], list[np.ndarray]] = {}
    for element, corners in enumerate(space.tetrahedra):
        for left_out in range(4):
            face = [k for k in range(4) if k != left_out]
            barycentric = np.zeros((len(weights), 4))
            barycentric[:, face] = weights
            values = space.values(coefficients, np.full(len(weights), element), barycentric)
            shared.setdefault(tuple(corners[face]), []).append(values)
    pairs = [values for values in shared.values() if len(values) == 2]
    assert len(pairs) > 20
    for first, second in pairs:
        np.testing.assert_allclose(first, second, atol=1e-12)


def test_a_space_of_lower_order_is_its_beginning() -> None:
    solid = box((1, 1, 1), (1, 1, 1))
    fourth, second = (Space.on(solid.vertices, solid.tetrahedra, order) for order in (4, 2))
    lower = fourth.up_to(2)
    assert lower.size == second.size
    np.testing.assert_array_equal(lower.numbers, second.numbers)
    assert np.all(np.diff(fourth.orders) >= 0)
