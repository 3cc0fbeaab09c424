"""How much light is left along a ray through an absorbing medium, in a stable and in the common form.

A ray of intervals with optical depths tau_i = sigma_i delta_i has the transmittance
T_i = exp(-sum_{j<i} tau_j) before interval i, and interval i contributes the weight
T_i (1 - exp(-tau_i)) (Max 1995). The common form (the code of NeRF, Mildenhall et al. 2020, and that released
with ObjectFolder) first makes opacities alpha_i = 1 - exp(-tau_i) and multiplies
T_i = prod (1 - alpha_j + 1e-10). In single precision it has two faults: opacities of thin intervals are
multiples of 6e-8, so that a medium cut into fine enough slices is lost or doubled; and behind thick ones the
product is that of the 1e-10 that keep it from zero, or zero, its logarithm minus infinity and the gradient of
that NaN.
"""

import torch
from torch import Tensor

PRODUCT_FLOOR = 1e-10


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


def transmittance_by_product(optical_depths: Tensor) -> Tensor:
    """Return the transmittance (..., n + 1) as a product of 1 - alpha + 1e-10, to show what that loses."""
    alpha = 1.0 - torch.exp(-optical_depths)
    return torch.cat(
        [torch.ones_like(alpha[..., :1]), torch.cumprod(1.0 - alpha + PRODUCT_FLOOR, dim=-1)], dim=-1
    )


def weights_by_product(optical_depths: Tensor) -> Tensor:
    """Return `weights` (..., n) in the common form, to show what it loses."""
    alpha = 1.0 - torch.exp(-optical_depths)
    return transmittance_by_product(optical_depths)[..., :-1] * alpha
