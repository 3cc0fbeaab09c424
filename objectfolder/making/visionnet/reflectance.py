"""The network: features of a point, and how it sends light on.

Radiance = P / (4 pi^2) * (irradiance * reflectance(features, angles) + albedo * bounced(coarse features,
normal, light, view)), where irradiance = visibility cos / d^2 is traced, not learned. The highlight in the
reflectance is a GGX lobe whose strength is learned.

A network with mirrors adds what a point shows of the surface itself along the mirror ray: Fresnel factor *
irradiance * reflectance of the point that this ray meets, its lobe wider by the width of the first. The
Fresnel factor (Schlick 1994) scales both highlights; its value when seen facing is learned place by place.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.extras import needs_extra
from objectfolder.vision.network.incidence import Incidence
from objectfolder.vision.network.network_layout import (
    ANGLES,
    COARSE_LEVELS,
    FEATURES,
    LAYER_WIDTH,
    LEAST_COSINE,
    SURROUNDINGS,
)

with needs_extra("factory"):
    import torch
    from torch import Tensor, nn
    from torch.nn import functional


class _Interpolate(torch.autograd.Function):
    """Weighted sums of rows of a table; its own backward, as torch's sorts the rows."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, rows: Tensor, weights: Tensor) -> Tensor:
        ctx.save_for_backward(rows, weights)
        ctx.shape = table.shape
        return functional.embedding_bag(rows, table, per_sample_weights=weights, mode="sum")

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        rows, weights = ctx.saved_tensors
        if rows.device.type != "cpu":
            shares = (weights[..., None] * gradients[0][:, None]).flatten(0, 1)
            return shares.new_zeros(ctx.shape).index_add_(0, rows.flatten(), shares), None, None
        flat, spread = rows.numpy().ravel(), weights.numpy()
        values = gradients[0].numpy()
        columns = [
            np.bincount(flat, (spread * values[:, column : column + 1]).ravel(), ctx.shape[0])
            for column in range(ctx.shape[1])
        ]
        return torch.from_numpy(np.stack(columns, axis=1).astype(np.float32)), None, None


def interpolate(table: Tensor, rows: np.ndarray, weights: np.ndarray) -> Tensor:
    """Return (n, features) sums of 8 rows of a (corners, features) table."""
    at = (torch.from_numpy(values).to(table.device) for values in (rows, weights))
    result: Tensor = _Interpolate.apply(table, *at)
    return result


def angle_inputs(points: Incidence) -> np.ndarray:
    """Return (n, 13) float32: the `ANGLES` that the network sees, and what its highlight needs beside them.

    These are the normal, and cosines of light, camera and half vector in useful powers. The last column is
    the squared sine between normal and half vector: of a cosine near 1 rounding leaves no sine.
    """
    half = points.to_light + points.to_camera
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
    light = np.einsum("ij,ij->i", points.normal, points.to_light)
    camera = np.einsum("ij,ij->i", points.normal, points.to_camera)
    middle = np.clip(np.einsum("ij,ij->i", points.normal, half), 0.0, 1.0)
    sine2 = np.where(middle > 0, (np.cross(points.normal, half) ** 2).sum(axis=1), 1.0)
    grazing = np.clip(np.einsum("ij,ij->i", points.to_light, half), 0.0, 1.0)
    powers = [light, light**2, camera, np.clip(1 - camera, 0, 1) ** 3, (1 - grazing) ** 5, grazing]
    lobes = [middle**4, middle**32, middle, sine2]
    return np.concatenate([points.normal, np.stack([*powers, *lobes], axis=1)], axis=1).astype(np.float32)


def fifth_power_of_rim(camera: np.ndarray) -> np.ndarray:
    """Return (1 - cosine of the camera)^5 float32: how nearly edge on a mirror is seen."""
    result: np.ndarray = (np.clip(1 - camera, 0.0, 1.0) ** 5).astype(np.float32)
    return result


def surrounding_inputs(points: Incidence, light_position: np.ndarray) -> np.ndarray:
    """Return (n, 31) float32: where the point is, how it lies, where the light and the camera are."""
    lamp = np.broadcast_to(light_position, points.position.shape)
    cosine = np.einsum("ij,ij->i", points.normal, points.to_light)[:, None]
    camera = np.einsum("ij,ij->i", points.normal, points.to_camera)[:, None]
    mirrored = 2 * camera * points.normal - points.to_camera
    glint = np.einsum("ij,ij->i", mirrored, points.to_light)[:, None]
    waves = [np.sin(math.pi * lamp), np.cos(math.pi * lamp), np.sin(2 * math.pi * lamp)]
    parts = [
        points.position, points.normal, points.to_camera, points.to_light, lamp, *waves,
        cosine, np.maximum(cosine, 0), camera, glint, points.distance[:, None],
        np.minimum(points.distance[:, None], 4.0) ** -2 / 4,
        np.log(np.maximum(points.irradiance[:, None], 1e-3)),
    ]  # fmt: skip
    return np.concatenate(parts, axis=1).astype(np.float32)


def highlight(angles: Tensor, log_alpha: Tensor) -> Tensor:
    """Return (n, 1) D V of a GGX surface over its diffuse counterpart, from `angle_inputs`.

    Trowbridge-Reitz distribution and height-correlated Smith visibility (Heitz 2014), pi left out; cosines
    below `LEAST_COSINE` are taken as that. The distribution is over alpha^2 cos^2 + sin^2 of the half vector:
    the equal cos^2 (alpha^2 - 1) + 1 cancels, by 2 % of a mirror's highlight in float32.
    """
    alpha2 = torch.exp(2 * log_alpha)
    light, camera, cosine, sine2 = (angles[:, column : column + 1] for column in (3, 5, 11, 12))
    light, camera = light.clamp(min=LEAST_COSINE), camera.clamp(min=LEAST_COSINE)
    masked = light * torch.sqrt(camera**2 * (1 - alpha2) + alpha2)
    shadowed = camera * torch.sqrt(light**2 * (1 - alpha2) + alpha2)
    return alpha2 / (2 * (alpha2 * cosine**2 + sine2) ** 2 * (masked + shadowed))


@dataclass(frozen=True)
class Mirrored:
    """What m of n points show of the surface itself: where their mirror rays meet it.

    Parameters
    ----------
    row
        (m,) int64 which points.
    rim
        (m, 1) of these, see `fifth_power_of_rim`.
    features
        (m, f) of all levels, of the points met.
    angles, irradiance
        Of the points met, as of `Reflectance.forward`.
    """

    row: Tensor
    rim: Tensor
    features: Tensor
    angles: Tensor
    irradiance: Tensor


class Reflectance(nn.Module):
    """Features on a sparse grid and two small perceptrons.

    Parameters
    ----------
    sizes
        Corners of each grid level, coarse to fine.
    mirrors
        Whether it shows the surface in itself.
    """

    def __init__(self, sizes: Sequence[int], mirrors: bool = False) -> None:
        super().__init__()
        self.mirrors = mirrors
        self.tables = nn.ParameterList(
            nn.Parameter(torch.zeros(size, FEATURES[level])) for level, size in enumerate(sizes)
        )
        features, coarse = sum(FEATURES), sum(FEATURES[:COARSE_LEVELS])
        self.direct = nn.Sequential(
            nn.Linear(features + ANGLES, LAYER_WIDTH),
            nn.ReLU(),
            nn.Linear(LAYER_WIDTH, LAYER_WIDTH),
            nn.ReLU(),
            nn.Linear(LAYER_WIDTH, 6),
        )
        self.bounced = nn.Sequential(
            nn.Linear(coarse + SURROUNDINGS, LAYER_WIDTH),
            nn.ReLU(),
            nn.Linear(LAYER_WIDTH, LAYER_WIDTH),
            nn.ReLU(),
            nn.Linear(LAYER_WIDTH, 3),
        )
        self.albedo = nn.Linear(features + 3, 3)
        # GGX width of the highlight that the network scales.
        self.log_alpha = nn.Parameter(torch.tensor(math.log(0.25)))
        if mirrors:
            self.facing = nn.Linear(features, 3)
            self.log_mirror_alpha = nn.Parameter(torch.tensor(math.log(0.25)))

    def initialise(self, generator: torch.Generator, alpha: float = 0.25, metallic: float = 0.0) -> None:
        """Draw the starting weights.

        Parameters
        ----------
        generator
            Of the random numbers.
        alpha
            GGX width of the highlight.
        metallic
            Where a network with mirrors starts from: 1 an even grey reflection, 0 that of a clear coat.
        """
        with torch.no_grad():
            self.log_alpha.fill_(math.log(alpha))
            for table in self.tables:
                table.uniform_(-0.001, 0.001, generator=generator)
            for module in self.modules():
                if isinstance(module, nn.Linear):
                    bound = math.sqrt(6.0 / module.in_features)
                    module.weight.uniform_(-bound, bound, generator=generator)
                    module.bias.zero_()
            for perceptron, bias in ((self.direct, (0.0,) * 3 + (-3.0,) * 3), (self.bounced, (-4.0,) * 3)):
                perceptron.get_parameter("4.weight").mul_(0.1)
                perceptron.get_parameter("4.bias").copy_(torch.tensor(bias))
            if self.mirrors:
                # Both lobes vary by half-vector: their variances add.
                self.log_mirror_alpha.fill_(math.log(alpha) + 0.5 * math.log(2.0))
                self.facing.weight.mul_(0.1)
                self.facing.bias.fill_(torch.logit(torch.tensor(0.04 + 0.46 * metallic)).item())
                self.direct.get_parameter("4.bias")[:3] = -3.0 * metallic
                self.direct.get_parameter("4.bias")[3:] = 0.0

    def fresnel(self, features: Tensor, grazing: Tensor) -> Tensor:
        """Return (n, 3) the share reflected; `grazing` (n, 1) is (1 - cosine)^5."""
        facing = torch.sigmoid(self.facing(features))
        return facing + (1 - facing) * grazing

    def _directly(self, features: Tensor, angles: Tensor) -> Tensor:
        answer: Tensor = self.direct(torch.cat([features, angles[:, :ANGLES]], dim=1))
        return answer

    def reflectance(self, features: Tensor, albedo: Tensor, angles: Tensor, log_alpha: Tensor) -> Tensor:
        """Return (n, 3) pi times the reflectance, its highlight of a given width."""
        out = self._directly(features, angles)
        lobe = highlight(angles, log_alpha)
        if self.mirrors:
            gloss = self.fresnel(features, angles[:, 7:8]) * 2 * torch.sigmoid(out[:, 3:])
        else:
            gloss = functional.softplus(out[:, 3:])
        return albedo * 2 * torch.sigmoid(out[:, :3]) + gloss * lobe

    def base(self, features: Tensor, angles: Tensor) -> Tensor:
        """Return the (n, 3) albedo."""
        return torch.sigmoid(self.albedo(torch.cat([features, angles[:, :3]], dim=1)))

    def forward(
        self,
        interpolation: list[tuple[np.ndarray, np.ndarray]],
        angles: Tensor,
        surroundings: Tensor,
        irradiance: Tensor,
        mirrored: Mirrored | None = None,
    ) -> Tensor:
        """Return (n, 3) radiance over P / (4 pi^2)."""
        levels = self.levels(interpolation)
        albedo = self.base(torch.cat(levels, dim=1), angles)
        return self.radiance(levels, albedo, angles, surroundings, irradiance, mirrored)

    def levels(self, interpolation: list[tuple[np.ndarray, np.ndarray]]) -> list[Tensor]:
        """Return the (n, features) of points at each level of the grid."""
        return [interpolate(table, *at) for table, at in zip(self.tables, interpolation, strict=True)]

    def radiance(
        self,
        levels: list[Tensor],
        albedo: Tensor,
        angles: Tensor,
        surroundings: Tensor,
        irradiance: Tensor,
        mirrored: Mirrored | None = None,
    ) -> Tensor:
        """Return (n, 3) radiance over P / (4 pi^2) of points with the features and the albedo given."""
        features = torch.cat(levels, dim=1)
        reflectance = self.reflectance(features, albedo, angles, self.log_alpha)
        light = functional.softplus(self.bounced(torch.cat([*levels[:COARSE_LEVELS], surroundings], dim=1)))
        radiance = irradiance[:, None] * reflectance + albedo * light
        if mirrored is None:
            return radiance
        met = mirrored.features
        seen = mirrored.irradiance[:, None] * self.reflectance(
            met, self.base(met, mirrored.angles), mirrored.angles, self.log_mirror_alpha
        )
        share = self.fresnel(features[mirrored.row], mirrored.rim)
        return radiance.index_add(0, mirrored.row, share * seen)

    def unevenness(self, features: Tensor, angles: Tensor) -> Tensor:
        """Return how far the reflectance over the albedo is from that of a point without features.

        Mean squared difference of what `direct` answers; a penalty on it makes places that no light has
        reached reflect as the others do. `angles` need not be those at which the points were seen.
        """
        alike = self._directly(torch.zeros_like(features), angles)
        difference = self._directly(features, angles) - alike
        return (difference**2).mean()
