"""The occupancy network: whether a point of the unit cube is inside, given features of a sample.

After Mescheder et al. (2019): layers whose batch normalisation the features set. Points enter with sines and
cosines (Mildenhall et al. 2020), without which walls of a few hundredths of the length are lost.
"""

from dataclasses import dataclass

import numpy as np
import torch
import trimesh
from scipy.ndimage import maximum_filter
from torch import nn
from torch.nn.functional import binary_cross_entropy_with_logits

from learning.networks import DEVICE
from learning.runs import Objects
from learning.settings import Reconstruction
from learning.shapes import grid_points, inside, near_surface, surface_of, unit_mesh, volume_points

BLOCKS = 4
CONDITION = 128
OCTAVES = 5
OBJECTS_A_STEP = 8
TRAINING_POINTS = 100_000  # an object; half of them near the surface
COARSER = 4  # cells of the first look
NEARLY_INSIDE, OUTSIDE = -6.0, -10.0  # logits


class _Conditioned(nn.Module):
    """Batch normalisation whose scale and shift a condition sets (de Vries et al. 2017)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.BatchNorm1d(width, affine=False)
        self.scale, self.shift = nn.Linear(CONDITION, width), nn.Linear(CONDITION, width)
        nn.init.zeros_(self.scale.weight)
        nn.init.ones_(self.scale.bias)

    def forward(self, x: torch.Tensor, condition: torch.Tensor) -> torch.Tensor:
        """Return (n, points, width)."""
        normed = self.norm(x.flatten(0, 1)).view_as(x)
        return self.scale(condition)[:, None] * normed + self.shift(condition)[:, None]


def _waves(points: torch.Tensor) -> torch.Tensor:
    """Return points (..., 3) with sines and cosines of them, octaves apart: (..., 3 + 6 `OCTAVES`)."""
    phases = (points[..., None] * (torch.pi * 2.0 ** torch.arange(OCTAVES, device=points.device))).flatten(-2)
    return torch.cat([points, phases.sin(), phases.cos()], dim=-1)


class OccupancyNetwork(nn.Module):
    """Logit of being inside for points (n, points, 3), given features (n, inputs)."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.condition = nn.Sequential(nn.BatchNorm1d(inputs), nn.Linear(inputs, CONDITION), nn.ReLU())
        self.place = nn.Linear(3 + 6 * OCTAVES, width)
        self.norms = nn.ModuleList(_Conditioned(width) for _ in range(2 * BLOCKS + 1))
        self.layers = nn.ModuleList(nn.Linear(width, width) for _ in range(2 * BLOCKS))
        self.inside = nn.Linear(width, 1)

    def forward(self, features: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
        """Return (n, points)."""
        condition = self.condition(features)
        x = self.place(_waves(points))
        for block in range(0, 2 * BLOCKS, 2):
            inner = self.layers[block](torch.relu(self.norms[block](x, condition)))
            x = x + self.layers[block + 1](torch.relu(self.norms[block + 1](inner, condition)))
        return self.inside(torch.relu(self.norms[-1](x, condition)))[..., 0]


@dataclass(frozen=True)
class Shape:
    """A closed object's mesh in the unit frame, its size, and points with what is inside.

    Attributes
    ----------
    points, occupied : (n, 3) and (n,), the first half uniform in the cube, the other near the surface
    """

    mesh: trimesh.Trimesh
    length_m: float
    points: torch.Tensor
    occupied: torch.Tensor


def shapes_of(objects: Objects) -> dict[int, Shape]:
    """Return shapes by the object's position; an open surface has no inside and is left out."""
    result = {}
    for label, file in enumerate(objects.files.values()):
        mesh = unit_mesh(file)
        if mesh.is_watertight:
            half = TRAINING_POINTS // 2
            points = np.concatenate([volume_points(label, half), near_surface(mesh, half, label)])
            occupied = torch.from_numpy(inside(mesh, points)).float()
            result[label] = Shape(mesh, file.frame.scale, torch.from_numpy(points).float(), occupied)
    return result


def fit(
    features: torch.Tensor, labels: torch.Tensor, shapes: dict[int, Shape], asked: Reconstruction, seed: int
) -> OccupancyNetwork:
    """Train on features (n, inputs) of objects (n,); those without a shape are passed over."""
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    network = OccupancyNetwork(features.shape[1], asked.width).to(DEVICE)
    optimiser = torch.optim.AdamW(network.parameters(), 2e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2e-3, total_steps=asked.steps)
    rows_with_shape = torch.tensor([row for row, label in enumerate(labels.tolist()) if label in shapes])
    for _ in range(asked.steps):
        rows = rows_with_shape[torch.randint(len(rows_with_shape), (OBJECTS_A_STEP,), generator=random)]
        chosen = torch.randint(TRAINING_POINTS, (OBJECTS_A_STEP, asked.points), generator=random)
        of_rows = [shapes[int(labels[row])] for row in rows]
        points = torch.stack([one.points[i] for one, i in zip(of_rows, chosen, strict=True)])
        wanted = torch.stack([one.occupied[i] for one, i in zip(of_rows, chosen, strict=True)])
        logits = network(features[rows].to(DEVICE), points.to(DEVICE))
        loss = binary_cross_entropy_with_logits(logits, wanted.to(DEVICE))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return network.eval()


@torch.no_grad()
def predicted(network: OccupancyNetwork, features: torch.Tensor, cells: int) -> trimesh.Trimesh | None:
    """Return the surface for the features (inputs,) of one sample.

    The network is asked at every point of the grid only where a grid `COARSER` times wider is nearly inside,
    as Mescheder et al. (2019) do.

    Parameters
    ----------
    cells
        A side of the grid; a multiple of `COARSER`.
    """

    def logits(points: np.ndarray) -> np.ndarray:
        parts = torch.from_numpy(points).float().to(DEVICE).split(1 << 15)
        condition = features[None].to(DEVICE)
        return torch.cat([network(condition, part[None])[0] for part in parts]).cpu().numpy()

    side = cells // COARSER + 1
    nearly = logits(grid_points(cells // COARSER)).reshape(side, side, side) > NEARLY_INSIDE
    nearest = (np.arange(cells + 1) + COARSER // 2) // COARSER
    asked = maximum_filter(nearly, size=3)[np.ix_(nearest, nearest, nearest)]
    values = np.full(asked.shape, OUTSIDE, dtype=np.float32)
    values[asked] = logits(grid_points(cells)[asked.ravel()])
    return surface_of(values, cells)
