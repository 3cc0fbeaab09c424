"""Answers of sums that a library may add in another order: by the batch, by the processor."""

import numpy as np

# Shares of the largest value.
DOUBLE, SINGLE = 1e-12, 1e-6


def assert_equal_but_for_rounding(answer: np.ndarray, expected: np.ndarray) -> None:
    """Libraries of linear algebra may round a row of a product by its place among the others."""
    assert (answer.shape, answer.dtype) == (expected.shape, expected.dtype)
    share = DOUBLE if expected.dtype == np.float64 else SINGLE
    limit = share * np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(answer, expected, rtol=0, atol=limit)
