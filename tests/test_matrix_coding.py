"""Packed matrices come back; bytes are near the entropy; damage is named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from objectfolder.products.integer_coding import pack_integers, zigzag
from objectfolder.products.matrix_coding import pack_matrix, unpack_matrix


@given(
    arrays(
        np.int64,
        array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=12),
        elements=st.one_of(st.integers(-3, 3), st.integers(1 - 2**40, 2**40 - 1)),
    )
)
def test_any_matrix_comes_back(values: np.ndarray) -> None:
    np.testing.assert_array_equal(unpack_matrix(pack_matrix(values), values.shape), values)


def rows_and_columns_of_different_size() -> tuple[np.ndarray, float]:
    """Two-sided geometric integers whose mean is a row's times a column's, and their entropy in bytes."""
    random = np.random.default_rng(3)
    size = np.outer(2.0 ** random.uniform(-4, 3, 800), 2.0 ** random.uniform(-2, 2, 90))
    ratio = size / (1 + size)
    values = random.geometric(1 - ratio) - random.geometric(1 - ratio)
    mean = 2 * ratio / (1 - ratio**2)  # of the magnitude
    bits = -np.log2((1 - ratio) / (1 + ratio)) - mean * np.log2(ratio)
    return values, float(bits.sum()) / 8


def test_bytes_are_near_the_entropy_and_below_those_of_one_model_for_all() -> None:
    values, entropy = rows_and_columns_of_different_size()
    stream = pack_matrix(values)
    np.testing.assert_array_equal(unpack_matrix(stream, values.shape), values)
    packed = len(stream)
    assert entropy < packed < 1.06 * entropy
    assert packed < 0.9 * len(pack_integers(zigzag(values)))


def test_damage_is_named() -> None:
    values, _ = rows_and_columns_of_different_size()
    stream = pack_matrix(values)
    random = np.random.default_rng(0)
    wrong = [stream[:0], stream[:7], stream[:-2], stream[:-40], np.append(stream, np.zeros(3, np.uint8))]
    flipped = stream.copy()
    # Of the plain bits of signs at the end any value can be meant.
    flipped[random.integers(0, len(stream) // 2)] ^= 1 << random.integers(8)
    for bad_stream in (*wrong, flipped):
        with pytest.raises(ValueError, match=r"stream|number"):
            unpack_matrix(bad_stream, values.shape)
    with pytest.raises(ValueError, match=r"stream|number"):
        unpack_matrix(stream, (values.shape[0] + 1, values.shape[1]))


def test_a_length_that_no_stream_has_is_refused() -> None:
    stream = pack_matrix(np.ones((3, 3), dtype=np.int64)).copy()
    stream[4:8] = 255
    with pytest.raises(ValueError, match="cut short"):
        unpack_matrix(stream, (3, 3))
