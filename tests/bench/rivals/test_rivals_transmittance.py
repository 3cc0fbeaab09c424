import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.rivals.vision.ray_marching import log_transmittance, weights

PRODUCT_FLOOR = 1e-10
DEPTHS = arrays(np.float64, st.integers(1, 60), elements=st.floats(0, 40))


def transmittance_by_product(optical_depths: torch.Tensor) -> torch.Tensor:
    """Return the transmittance (..., n + 1) as a product of 1 - alpha + 1e-10, to show what that loses."""
    alpha = 1.0 - torch.exp(-optical_depths)
    return torch.cat(
        [torch.ones_like(alpha[..., :1]), torch.cumprod(1.0 - alpha + PRODUCT_FLOOR, dim=-1)], dim=-1
    )


def weights_by_product(optical_depths: torch.Tensor) -> torch.Tensor:
    """Return `weights` (..., n) in the common form, to show what it loses."""
    alpha = 1.0 - torch.exp(-optical_depths)
    return transmittance_by_product(optical_depths)[..., :-1] * alpha


def uniform(extinction: float, length: float, samples: int) -> torch.Tensor:
    """Optical depths of a uniform medium cut into equal slices."""
    return torch.full((samples,), extinction * length / samples, dtype=torch.float32)


def relative(value: torch.Tensor, truth: float) -> float:
    return abs(float(value.double()) / truth - 1)


@pytest.mark.parametrize(
    ("extinction", "samples"),
    [(1e-6, 100_000), (1e-3, 192), (0.7, 1), (0.7, 192), (20.0, 1), (20.0, 100_000)],
)
def test_a_uniform_medium_follows_the_law_of_beer_and_lambert(extinction, samples):
    depths = uniform(extinction, 1.5, samples)
    truth = -extinction * 1.5
    assert float(log_transmittance(depths)[-1]) == pytest.approx(truth, rel=1e-5)
    assert float(weights(depths).double().sum()) == pytest.approx(-np.expm1(truth), rel=1e-5)


def test_thin_slices_are_lost_or_doubled_by_the_product_alone():
    # One slice of optical depth 2e-8 is less than half a step of single precision below 1, 4e-8 more.
    for thickness, factor in ((2e-8, 0.0), (4e-8, 1.49)):
        depths = torch.full((100_000,), thickness, dtype=torch.float32)
        truth = -np.expm1(-thickness * 100_000)
        assert relative(weights(depths).double().sum(), truth) < 1e-5
        assert float(weights_by_product(depths).double().sum()) / truth == pytest.approx(factor, abs=0.01)


def test_behind_a_thick_medium_the_product_is_what_keeps_it_from_zero():
    depths = uniform(30.0, 1.0, 1)
    assert relative(torch.exp(log_transmittance(depths)[-1]), np.exp(-30.0)) < 1e-5
    assert relative(transmittance_by_product(depths)[-1], np.exp(-30.0)) > 100
    # Three walls let exp(-75) through; the product says 1e-30.
    walls = torch.full((3,), 25.0)
    assert float(log_transmittance(walls)[-1]) == -75.0
    assert float(transmittance_by_product(walls)[-1]) == pytest.approx(1e-30, rel=0.2)


def test_the_gradient_through_a_thick_medium_is_its_length_or_nan():
    """The derivative of log T by the extinction of a slice is minus the length of the slice."""
    lengths = torch.full((8,), 0.25)
    for form, expected in (
        (lambda depths: log_transmittance(depths)[-1], -0.25),
        (lambda depths: torch.log(transmittance_by_product(depths)[-1]), np.nan),
    ):
        extinction = torch.full((8,), 120.0, requires_grad=True)
        form(extinction * lengths).backward()
        assert extinction.grad is not None
        np.testing.assert_array_equal(extinction.grad.numpy(), np.float32(expected))


def test_a_density_that_is_too_thick_everywhere_still_learns_from_light_that_should_pass():
    """Matching log T by gradient steps: the stable form arrives, the product never moves or is lost."""
    results = {}
    for name, form in (
        ("stable", lambda depths: log_transmittance(depths)[-1]),
        ("product", lambda depths: torch.log(transmittance_by_product(depths)[-1])),
    ):
        extinction = torch.full((16,), 20.0, requires_grad=True)
        for _ in range(200):
            loss = (form(extinction) + 8.0).square()
            (gradient,) = torch.autograd.grad(loss, extinction)
            extinction = (extinction - 0.02 * gradient).detach().clamp(min=0).requires_grad_()
        results[name] = float(form(extinction).detach())
    assert results["stable"] == pytest.approx(-8.0, abs=1e-3)
    assert not abs(results["product"] + 8.0) < 1


@given(DEPTHS)
def test_weights_and_gradients_agree_with_double_precision(depths):
    exact = torch.tensor(depths, requires_grad=True)
    single = torch.tensor(depths, dtype=torch.float32, requires_grad=True)
    colours = torch.linspace(0.2, 1.0, len(depths), dtype=torch.float64)
    alpha = 1 - torch.exp(-exact)
    in_front = torch.cat([torch.ones(1, dtype=torch.float64), torch.cumprod(1 - alpha, 0)[:-1]])
    truth = in_front * alpha
    (truth * colours).sum().backward()
    (weights(single) * colours.float()).sum().backward()
    np.testing.assert_allclose(weights(single).detach().numpy(), truth.detach().numpy(), atol=3e-6)
    assert exact.grad is not None
    assert single.grad is not None
    np.testing.assert_allclose(single.grad.numpy(), exact.grad.numpy(), atol=1e-5)


@given(DEPTHS)
def test_every_ray_gives_its_light_to_its_samples_and_to_what_lies_behind(depths):
    values = torch.tensor(depths)
    total = weights(values).sum() + torch.exp(log_transmittance(values)[-1])
    assert float(total) == pytest.approx(1.0, abs=1e-12)
    assert (weights(values) >= 0).all()


def test_an_endless_last_interval_takes_all_that_is_left_and_none_where_it_is_empty():
    depths = torch.tensor([[0.5, 1e10 * 0.3], [0.5, 0.0]], requires_grad=True)
    shares = weights(depths)
    assert shares[0].detach().tolist() == pytest.approx([1 - np.exp(-0.5), np.exp(-0.5)])
    assert shares[1].detach().tolist() == pytest.approx([1 - np.exp(-0.5), 0.0])
    shares.sum().backward()
    assert depths.grad is not None
    assert torch.isfinite(depths.grad).all()
