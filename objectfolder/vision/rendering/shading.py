"""What the network says of surface points under one light after another, on a CPU or a GPU.

The formula is that of `reflectance.Reflectance.forward`; features and albedo, which no light changes, are
apart from the two perceptrons, which each light asks anew.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from objectfolder.errors import FormatError, QueryError
from objectfolder.vision.network.incidence import Incidence
from objectfolder.vision.network.network_layout import COARSE_LEVELS, has_mirrors
from objectfolder.vision.network.reflectance import (
    Reflectance,
    angle_inputs,
    fifth_power_of_rim,
    surrounding_inputs,
)
from objectfolder.vision.network.sparse_grid import CORNERS, HALF_WIDTH, SparseGrid

# Rows that the network sees at a time, the last ones filled up: libraries round a matrix product by its
# number of rows. They may also round a row by its place among the others, so a point's radiance depends on
# the points asked with it by rounding; the compiled way's does not.
BLOCK = {"cpu": 1 << 10, "cuda": 1 << 14}
# The nearest that a light is told to be to a point, unit frame; as in its irradiance.
NEAREST = 1e-3


@dataclass(frozen=True)
class Described:
    """What the network knows of n points whatever light falls on them.

    Parameters
    ----------
    count
        n; the tensors have rows of zeros after these, up to a whole number of blocks.
    features, coarse
        (blocks * block, f) features of all levels, and of those that bounced light may depend on.
    albedo
        (blocks * block, 3).
    """

    count: int
    features: Tensor
    coarse: Tensor
    albedo: Tensor


class Shading:
    """The network and its feature grid on one device.

    Parameters
    ----------
    grid
        Cells of the feature grid.
    weights
        Arrays of `Reflectance` by name.
    device
        ``"cpu"`` or ``"cuda"``.

    Attributes
    ----------
    mirrors
        Whether the surface is shown in itself.

    Raises
    ------
    FormatError
        Weights that do not fit the network.
    """

    def __init__(self, grid: SparseGrid, weights: Mapping[str, np.ndarray], device: str = "cpu") -> None:
        network = Reflectance(grid.sizes, mirrors=has_mirrors(weights.keys()))
        state = {name: torch.from_numpy(value.astype(np.float32)) for name, value in weights.items()}
        try:
            network.load_state_dict(state)
        except RuntimeError as error:
            raise FormatError("vision", f"tensors do not fit the network: {error}") from error
        self.device = torch.device(device)
        self._network = network.eval().to(self.device)
        self.mirrors = network.mirrors
        self._block = BLOCK[device]
        self._resolution = grid.resolution
        self._lookups = [torch.from_numpy(lookup).to(self.device) for lookup in grid.lookups]

    def describe(self, position: np.ndarray, normal: np.ndarray) -> Described:
        """Look up the features at (n, 3) points with (n, 3) normals, unit frame."""
        with torch.inference_mode():
            levels = self._by_block(self._levels, self._padded(position))
            features = torch.cat(levels, dim=1)
            (albedo,) = self._by_block(
                lambda at, facing: [torch.sigmoid(self._network.albedo(torch.cat([at, facing], dim=1)))],
                features,
                self._padded(normal),
            )
            return Described(len(position), features, torch.cat(levels[:COARSE_LEVELS], dim=1), albedo)

    def radiance(self, described: Described, points: Incidence, light: np.ndarray) -> np.ndarray:
        """Return the (n, 3) float32 radiance over P / (4 pi^2) that one light at (3,) causes."""
        near = replace(points, distance=np.maximum(points.distance, NEAREST))
        with torch.inference_mode():
            (colour,) = self._by_block(
                self._lit,
                described.features,
                described.coarse,
                described.albedo,
                self._padded(angle_inputs(near)),
                self._padded(surrounding_inputs(near, light)),
                self._padded(near.irradiance[:, None]),
            )
            answer: np.ndarray = colour[: described.count].cpu().numpy()
        return answer

    def mirrored(
        self, seen: Described, points: Incidence, row: np.ndarray, met: Described, met_points: Incidence
    ) -> np.ndarray:
        """Return the (m, 3) float32 radiance over P / (4 pi^2) that points add by mirroring others.

        Parameters
        ----------
        seen, points
            The n points.
        row
            (m,) those whose mirror rays meet the surface.
        met, met_points
            The points met, under the same light.
        """
        near = replace(met_points, distance=np.maximum(met_points.distance, NEAREST))
        camera = np.einsum("ij,ij->i", points.normal[row], points.to_camera[row])
        rows = np.zeros(self._rows(len(row)), dtype=np.int64)
        rows[: len(row)] = row
        with torch.inference_mode():
            features = seen.features[torch.from_numpy(rows).to(self.device)]
            (colour,) = self._by_block(
                self._lit_in_mirror,
                features,
                self._padded(fifth_power_of_rim(camera)[:, None]),
                met.features,
                met.albedo,
                self._padded(angle_inputs(near)),
                self._padded(near.irradiance[:, None]),
            )
            answer: np.ndarray = colour[: len(row)].cpu().numpy()
        return answer

    def _lit(
        self,
        features: Tensor,
        coarse: Tensor,
        albedo: Tensor,
        angles: Tensor,
        around: Tensor,
        irradiance: Tensor,
    ) -> list[Tensor]:
        network = self._network
        reflectance = network.reflectance(features, albedo, angles, network.log_alpha)
        light = functional.softplus(network.bounced(torch.cat([coarse, around], dim=1)))
        return [irradiance * reflectance + albedo * light]

    def _lit_in_mirror(
        self,
        features: Tensor,
        rim: Tensor,
        met: Tensor,
        albedo: Tensor,
        angles: Tensor,
        irradiance: Tensor,
    ) -> list[Tensor]:
        network = self._network
        reflectance = network.reflectance(met, albedo, angles, network.log_mirror_alpha)
        return [network.fresnel(features, rim) * irradiance * reflectance]

    def _levels(self, points: Tensor) -> list[Tensor]:
        """Interpolate the features of each level at (n, 3) points; as `SparseGrid.interpolation`."""
        corners = torch.from_numpy(CORNERS).to(self.device)
        result = []
        for level, (lookup, table) in enumerate(zip(self._lookups, self._network.tables, strict=True)):
            resolution = self._resolution >> (len(self._lookups) - 1 - level)
            scaled = (points + HALF_WIDTH) * (resolution / (2 * HALF_WIDTH))
            scaled = scaled.clamp(0.0, resolution * (1 - 1e-7))
            cell = scaled.to(torch.int64)
            fraction = scaled - cell
            share = torch.where(corners[None] == 1, fraction[:, None], 1 - fraction[:, None])
            weights = share[..., 0] * share[..., 1] * share[..., 2]
            at = cell[:, None] + corners
            side = resolution + 1
            rows = lookup[(at[..., 0] * side + at[..., 1]) * side + at[..., 2]]
            absent = rows < 0
            weights = weights.masked_fill(absent, 0.0)
            known = weights / weights.sum(dim=1, keepdim=True).clamp_min(1e-6)
            weights = torch.where(absent.any(dim=1, keepdim=True), known, weights)
            rows = rows.clamp_min(0)
            result.append(functional.embedding_bag(rows, table, per_sample_weights=weights, mode="sum"))
        return result

    def _padded(self, values: np.ndarray) -> Tensor:
        """Return (n, c) values on the device, float32, with zeros up to a whole number of blocks."""
        full = np.zeros((self._rows(len(values)), values.shape[1]), dtype=np.float32)
        full[: len(values)] = values
        return torch.from_numpy(full).to(self.device)

    def _rows(self, count: int) -> int:
        return -(-count // self._block) * self._block

    def _by_block(self, function: Callable[..., Sequence[Tensor]], *tensors: Tensor) -> list[Tensor]:
        """Apply `function` to a block of rows of each tensor at a time."""
        parts = [
            function(*(tensor[start : start + self._block] for tensor in tensors))
            for start in range(0, len(tensors[0]), self._block)
        ]
        return [torch.cat(column) for column in zip(*parts, strict=True)]


def require_cuda() -> None:
    """Refuse CUDA where torch finds none.

    Raises
    ------
    QueryError
        No device.
    """
    if not torch.cuda.is_available():
        raise QueryError("device", "torch finds no CUDA device here", "Use 'cpu'.")
