"""Coded integers come back, in about as many bytes as their entropy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from objectfolder.audio.audionet.entropy_coding import decode_integers, encode_integers
from objectfolder.errors import FormatError


@settings(deadline=None, max_examples=60)
@given(
    arrays(
        np.int64,
        array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=12),
        elements=st.one_of(st.integers(-3, 3), st.integers(-(2**27) + 1, 2**27 - 1)),
    )
)
def test_any_integers_come_back(values: np.ndarray) -> None:
    stream = encode_integers(values)
    assert stream.dtype == np.uint8
    np.testing.assert_array_equal(decode_integers(stream, *values.shape), values)


def falling_laplacian(rows: int, columns: int) -> tuple[np.ndarray, float]:
    """Values whose size falls from row to row and differs between columns; their entropy in bytes."""
    random = np.random.default_rng(5)
    width = 60.0 * np.exp(-4 * np.arange(rows) / rows)[:, None] * (0.2 + np.arange(columns) / columns)
    ratio = (np.sqrt(1 + width**2) - 1) / width
    sign = random.geometric(1 - ratio) - random.geometric(1 - ratio)  # two-sided geometric
    # P(k) = (1 - r) / (1 + r) r^|k| with mean magnitude `width`.
    bits = -np.log2((1 - ratio) / (1 + ratio)) - width * np.log2(ratio)
    return sign, float(bits.sum()) / 8


def test_bytes_are_near_the_entropy() -> None:
    values, least = falling_laplacian(400, 120)
    used = len(encode_integers(values))
    assert least < used < 1.06 * least + 4 * values.shape[1]


def test_zeros_cost_next_to_nothing() -> None:
    assert len(encode_integers(np.zeros((1000, 100), dtype=np.int64))) < 100_000 / 8 * 0.1


def test_equal_values_give_equal_bytes() -> None:
    values, _ = falling_laplacian(30, 20)
    np.testing.assert_array_equal(encode_integers(values), encode_integers(values.copy()))


def test_damage_is_named() -> None:
    values, _ = falling_laplacian(50, 20)
    stream = encode_integers(values)
    for wrong in (stream[:-2], stream[:30], np.append(stream, [0, 0]).astype(np.uint8), stream[:-1]):
        with pytest.raises(FormatError):
            decode_integers(wrong, *values.shape)
    spoiled = stream.copy()
    spoiled[len(spoiled) // 2] ^= 0x55
    with pytest.raises(FormatError):
        decode_integers(spoiled, *values.shape)


def test_too_large_integers_are_refused() -> None:
    with pytest.raises(ValueError, match=r"2\^27"):
        encode_integers(np.array([[2**27]]))
