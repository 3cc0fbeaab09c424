"""Packed integers come back; damage is named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from objectfolder.products.integer_coding import pack_integers, unpack_integers, unzigzag, zigzag


@pytest.mark.slow
@given(
    arrays(
        np.int64,
        array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=12),
        elements=st.one_of(st.integers(-3, 3), st.integers(-(2**40), 2**40)),
    )
)
def test_any_integers_come_back(values: np.ndarray) -> None:
    stream = pack_integers(zigzag(values))
    np.testing.assert_array_equal(unzigzag(unpack_integers(stream, values.size)), values.ravel())


def test_bytes_are_near_the_entropy() -> None:
    """A two-sided geometric distribution, 3.9 bits a value."""
    ratio, random = 0.8, np.random.default_rng(5)
    values = random.geometric(1 - ratio, 50_000) - random.geometric(1 - ratio, 50_000)
    mean = np.abs(values).mean()
    bits = -np.log2((1 - ratio) / (1 + ratio)) - mean * np.log2(ratio)
    assert len(pack_integers(zigzag(values))) < 1.1 * bits / 8 * len(values)


def test_damage_is_named() -> None:
    stream = pack_integers(np.arange(1000))
    for wrong in (stream[:-2], stream[:0], np.append(stream, [0]).astype(np.uint8), np.append([9], stream)):
        with pytest.raises(ValueError, match="stream"):
            unpack_integers(wrong.astype(np.uint8), 1000)
