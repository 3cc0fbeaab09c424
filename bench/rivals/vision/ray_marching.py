"""Where a ray is sampled, and how much of its light each sample gives.

Samples lie in strata of the whole ray, then where the first ones found something. Intervals with optical
depths tau_i = sigma_i delta_i leave the transmittance T_i = exp(-sum_{j<i} tau_j) before interval i, which
gives the weight T_i (1 - exp(-tau_i)) (Max 1995). The common form (the code of NeRF, Mildenhall et al. 2020,
and that released with ObjectFolder) multiplies T_i = prod (1 - alpha_j + 1e-10): in single precision
opacities of thin intervals are multiples of 6e-8, and behind thick ones the gradient of the logarithm is NaN.
"""

import torch
from torch import Tensor

# Added to every weight, as published, so that empty rays have a density too.
LEAST_WEIGHT = 1e-5


def stratified(near: float, far: float, positions: Tensor) -> Tensor:
    """Return distances (n, samples), one in each of equal strata around evenly spaced points.

    Parameters
    ----------
    near, far
        Ends of the rays.
    positions
        (n, samples) of each distance in its stratum, 0 to 1. The strata part half-way between the
        `samples` points spaced evenly from `near` to `far`, so that the first and the last are half as wide.
    """
    count = positions.shape[-1]
    points = torch.linspace(near, far, count, dtype=positions.dtype, device=positions.device)
    middles = (points[1:] + points[:-1]) / 2
    lower, upper = torch.cat([points[:1], middles]), torch.cat([middles, points[-1:]])
    return lower + (upper - lower) * positions


def evenly_spaced(near: float, far: float, rays: int, samples: int, device: torch.device) -> Tensor:
    """Return distances (rays, samples) evenly spaced from `near` to `far`, both included."""
    return torch.linspace(near, far, samples, device=device).expand(rays, samples)


def inverse_cumulative(edges: Tensor, mass: Tensor, positions: Tensor) -> Tensor:
    """Draw from a density that is constant in each bin by inverting its cumulative distribution.

    Parameters
    ----------
    edges
        (n, bins + 1) ascending.
    mass
        (n, bins) of each bin, at least 0, of any sum; `LEAST_WEIGHT` is added to each.
    positions
        (n, samples) in [0, 1]: uniform draws, or even spacing for a fixed choice.

    Returns
    -------
    Tensor
        (n, samples), ascending where the positions are; no gradient flows through them.
    """
    mass = (mass + LEAST_WEIGHT).detach()
    cumulative = torch.cumsum(mass / mass.sum(dim=-1, keepdim=True), dim=-1)
    cumulative = torch.cat([torch.zeros_like(cumulative[..., :1]), cumulative], dim=-1)
    above = torch.searchsorted(cumulative, positions.contiguous(), right=True)
    above = above.clamp(1, cumulative.shape[-1] - 1)
    low, high = cumulative.gather(-1, above - 1), cumulative.gather(-1, above)
    share = ((positions - low) / (high - low)).clamp(0.0, 1.0)
    start, end = edges.gather(-1, above - 1), edges.gather(-1, above)
    return start + share * (end - start)


def refined(distances: Tensor, shares: Tensor, positions: Tensor) -> Tensor:
    """Return coarse and fine distances together (n, coarse + fine), ascending.

    As published, the bins of the fine ones part half-way between the coarse distances, and the first and
    last coarse share have no bin.

    Parameters
    ----------
    distances, shares
        (n, coarse) samples so far and the share of each in the ray's colour.
    positions
        (n, fine) as for `inverse_cumulative`.
    """
    middles = (distances[..., 1:] + distances[..., :-1]) / 2
    fine = inverse_cumulative(middles, shares[..., 1:-1], positions)
    return torch.sort(torch.cat([distances, fine], dim=-1), dim=-1).values


def log_transmittance(optical_depths: Tensor) -> Tensor:
    """Return the logarithm of the transmittance in front of each interval.

    Parameters
    ----------
    optical_depths
        (..., n) tau, at least 0, front to back.

    Returns
    -------
    Tensor
        (..., n + 1) starting with 0; the last is that of the whole ray.
    """
    return -torch.cat(
        [torch.zeros_like(optical_depths[..., :1]), torch.cumsum(optical_depths, dim=-1)], dim=-1
    )


def weights(optical_depths: Tensor) -> Tensor:
    """Return the share (..., n) of the light along a ray that comes from each interval.

    Shares and the transmittance of the whole ray add up to 1.

    Parameters
    ----------
    optical_depths
        (..., n) tau, at least 0, front to back.
    """
    in_front = torch.exp(log_transmittance(optical_depths)[..., :-1])
    return in_front * -torch.expm1(-optical_depths)
