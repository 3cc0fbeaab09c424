import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.rivals.vision.ray_marching import (
    LEAST_WEIGHT,
    evenly_spaced,
    inverse_cumulative,
    refined,
    stratified,
)


@given(arrays(np.float64, 12, elements=st.floats(0, 1, width=32)))
def test_strata_tile_the_ray_and_hold_one_sample_each(positions):
    samples = stratified(0.01, 4.0, torch.tensor(positions)[None])[0].numpy()
    ends = stratified(0.01, 4.0, torch.tensor([[0.0] * 12, [1.0] * 12], dtype=torch.float64)).numpy()
    assert ends[0, 0] == 0.01
    assert ends[1, -1] == 4.0
    np.testing.assert_allclose(ends[0, 1:], ends[1, :-1])
    assert (samples >= ends[0] - 1e-12).all()
    assert (samples <= ends[1] + 1e-12).all()


def test_even_positions_in_bins_are_the_inverse_of_a_known_distribution():
    # Density 3 : 1 on two bins of different width: the median lies two thirds into the first.
    edges, mass = torch.tensor([[0.0, 0.4, 2.0]]).double(), torch.tensor([[0.75, 0.25]]).double() * 1e6
    quantiles = inverse_cumulative(edges, mass, torch.tensor([[0.0, 0.5, 0.75, 0.875, 1.0]]).double())
    np.testing.assert_allclose(quantiles.numpy(), [[0.0, 0.4 * 2 / 3, 0.4, 1.2, 2.0]], atol=1e-9)


def test_draws_have_the_density_they_are_drawn_from():
    generator = np.random.default_rng(0)
    edges = np.sort(generator.random(21)) * 3
    mass = generator.random(20) ** 4
    draws = inverse_cumulative(
        torch.tensor(edges)[None], torch.tensor(mass)[None], torch.tensor(generator.random((1, 200_000)))
    )[0].numpy()
    counts, _ = np.histogram(draws, edges)
    share = (mass + LEAST_WEIGHT) / (mass + LEAST_WEIGHT).sum()
    # Five standard deviations of a count.
    assert (np.abs(counts - 200_000 * share) < 5 * np.sqrt(200_000 * share) + 1).all()


@given(arrays(np.float32, (3, 8), elements=st.floats(0, 1, width=32)))
def test_fine_samples_join_the_coarse_ones_in_order_within_the_ray(shares):
    coarse = evenly_spaced(0.01, 4.0, 3, 8, torch.device("cpu"))
    fixed = torch.linspace(0, 1, 16).expand(3, -1)
    samples = refined(coarse, torch.tensor(shares), fixed)
    assert samples.shape == (3, 24)
    assert (samples[:, 1:] >= samples[:, :-1]).all()
    assert torch.isfinite(samples).all()
    for ray in range(3):
        assert set(coarse[ray].tolist()) <= set(samples[ray].tolist())


def test_fine_samples_gather_where_the_coarse_ones_found_the_surface():
    coarse = evenly_spaced(0.0, 1.0, 1, 64, torch.device("cpu"))
    shares = torch.zeros(1, 64)
    shares[0, 40] = 1.0
    samples = refined(coarse, shares, torch.linspace(0, 1, 128).expand(1, -1))[0]
    near = (samples - coarse[0, 40]).abs() < 1 / 63
    assert near.sum() > 120


def test_no_gradient_flows_through_where_samples_lie():
    shares = torch.rand(2, 8, requires_grad=True)
    samples = refined(
        evenly_spaced(0.0, 1.0, 2, 8, torch.device("cpu")), shares, torch.linspace(0, 1, 4).expand(2, -1)
    )
    assert not samples.requires_grad
