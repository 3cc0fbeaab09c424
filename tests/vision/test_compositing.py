import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.vision.compositing import composite_on_white, on_white, srgb_decode, srgb_encode


def test_the_encoding_is_that_of_the_standard():
    np.testing.assert_allclose(
        srgb_encode(np.array([0.0, 0.002, 0.214041, 1.0, 7.0])), [0, 0.02584, 0.5, 1, 1], atol=1e-5
    )
    assert abs(float(srgb_encode(0.0031308)) - float(srgb_encode(0.0031309))) < 2e-6


@given(st.floats(0, 1))
def test_decoding_inverts_encoding(value):
    assert float(srgb_decode(srgb_encode(np.float64(value)))) == pytest.approx(value, abs=1e-7)


def test_straight_colour_is_encoded_before_it_is_blended():
    straight, alpha = np.array([0.01, 0.3, 0.9]), 0.5
    rgba = np.append(straight * alpha, alpha)
    np.testing.assert_allclose(composite_on_white(rgba), alpha * srgb_encode(straight) + 0.5)
    linear_blend = srgb_encode(straight * alpha + 0.5)
    assert np.abs(composite_on_white(rgba) - linear_blend).max() > 0.1


def test_extremes_are_exact():
    rgba = np.array([[0, 0, 0, 0], [0, 0, 0, 1], [1, 1, 1, 1], [5, 5, 5, 1], [3, 0, 0, 0]], dtype=np.float16)
    assert on_white(rgba)[:, 0].tolist() == [255, 0, 255, 255, 255]
    assert on_white(np.zeros((2, 3, 4, 4))).shape == (2, 3, 4, 3)


def test_images_are_the_blend_rounded():
    rgba = np.random.default_rng(0).uniform(-0.2, 1.2, (5, 6, 4))
    assert (rgba[..., 3] < 0).any()
    assert np.array_equal(on_white(rgba), np.round(255 * composite_on_white(rgba)).astype(np.uint8))
