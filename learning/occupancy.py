"""The occupancy network: whether a point of the unit cube is inside, given a condition that a sample sets.

Conditional batch normalisation after Mescheder et al. (2019), but of the last layer alone. There a condition
sets every layer, so each point passes through all of them for each object. Here grids (Peng et al. 2020) and
two layers turn a point into functions of place that all objects share, normalised over the batch. A sample's
condition says how much of each function its object has. One pass of a point trains all known objects.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import trimesh
from scipy.ndimage import maximum_filter
from torch import nn
from torch.nn.functional import binary_cross_entropy_with_logits, grid_sample

from learning.enclosure import Columns
from learning.isosurface import grid_points, surface_of
from learning.networks import DEVICE
from learning.runs import Objects, kept
from learning.settings import Reconstruction
from learning.shapes import HALF_SIDE, near_surface, unit_mesh, volume_points

SIDES, CHANNELS = (16, 32, 64), (8, 16, 32)  # of the feature grids: corners a side, numbers at each
CONDITION = 128
GRID_RATE, RATE = 3e-2, 5e-3  # of learning
OVERLAP_WEIGHT = 0.3  # of the loss by overlap, beside that by points
FAR_POINTS, NEAR_POINTS = 100_000, 3_000_000  # in the cube, and about surfaces, of all objects together
NEAR_SHARE = 0.75  # of the points of a step
FEWEST_SAMPLES = 32  # of a step, several of an object where few are known
COARSEST = 4  # cells that a cell of the first grid is wide, a power of 2
OUTSIDE, INSIDE = -6.0, 6.0  # logits below and above which a point is surely so


class OccupancyNetwork(nn.Module):
    """Logit of being inside for points (p, 3), given conditions (n, inputs).

    Parameters
    ----------
    width
        Functions of place.
    """

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.grids = nn.ParameterList(
            1e-2 * torch.randn(1, channels, side, side, side)
            for side, channels in zip(SIDES, CHANNELS, strict=True)
        )
        self.layers = nn.Sequential(
            nn.Linear(sum(CHANNELS) + 3, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()
        )
        self.norm = nn.BatchNorm1d(width, affine=False)
        self.condition = nn.Sequential(nn.BatchNorm1d(inputs), nn.Linear(inputs, CONDITION), nn.ReLU())
        self.scales, self.shift = nn.Linear(CONDITION, width), nn.Linear(CONDITION, 1)

    def functions(self, points: torch.Tensor) -> torch.Tensor:
        """Return the values (p, width) of the functions at points (p, 3)."""
        places = (points / HALF_SIDE)[None, :, None, None]
        read = [grid_sample(grid, places, align_corners=True)[0, :, :, 0, 0].T for grid in self.grids]
        return self.norm(self.layers(torch.cat([*read, points], dim=1)))

    def forward(self, conditions: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
        """Return (n, p)."""
        condition = self.condition(conditions)
        values = self.functions(points)
        return self.scales(condition) @ values.T / values.shape[1] ** 0.5 + self.shift(condition)


@dataclass(frozen=True)
class Shapes:
    """Meshes of closed objects in the unit frame, and points with who has them inside.

    Attributes
    ----------
    meshes
        By the object's position.
    points
        (p, 3) float32: first `FAR_POINTS` uniform in the cube, then an equal share about each surface.
    occupied
        (p, bytes) uint8: a bit a mesh, as `numpy.packbits` has them.
    """

    meshes: dict[int, trimesh.Trimesh]
    points: torch.Tensor
    occupied: np.ndarray


def shapes_of(objects: Objects) -> Shapes:
    """Return the shapes of objects; an open surface has no inside and is left out."""
    meshes = {label: unit_mesh(file) for label, file in enumerate(objects.files.values())}
    meshes = {label: mesh for label, mesh in meshes.items() if mesh.is_watertight}
    key = {"unit": "points", "files": objects.digests}
    arrays = kept(__name__, key, lambda: _labelled(meshes))
    return Shapes(meshes, torch.from_numpy(arrays["points"]), arrays["occupied"])


def _labelled(meshes: dict[int, trimesh.Trimesh]) -> dict[str, np.ndarray]:
    near = NEAR_POINTS // max(1, len(meshes))
    about = [near_surface(mesh, near, label) for label, mesh in meshes.items()]
    points = np.concatenate([volume_points(0, FAR_POINTS), *about]).astype(np.float32)
    return {"points": points, "occupied": occupied_bits(list(meshes.values()), points)}


def occupied_bits(meshes: Sequence[trimesh.Trimesh], points: np.ndarray) -> np.ndarray:
    """Return which of points (p, 3) each mesh has inside, as `Shapes.occupied`."""
    columns = Columns(points)
    groups = [meshes[first : first + 8] for first in range(0, len(meshes), 8)]
    rows = [np.packbits([columns.inside(mesh) for mesh in group], axis=0)[0] for group in groups]
    return np.stack(rows, axis=1)


def fit(
    conditions: torch.Tensor,
    labels: torch.Tensor,
    shapes: Shapes,
    known: tuple[int, ...],
    parameters: Reconstruction,
    seed: int,
) -> OccupancyNetwork:
    """Train on the samples of objects that are known.

    Parameters
    ----------
    conditions
        (n, inputs) float32 of samples.
    labels
        (n,) int64, whose they are: positions of objects.
    known
        Positions of objects with a mesh in `shapes`; samples and near points of others are not read.
    """
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    network = OccupancyNetwork(conditions.shape[1], parameters.width).to(DEVICE)
    weights = [weight for name, weight in network.named_parameters() if not name.startswith("grids")]
    grids: dict[str, Any] = {"params": network.grids.parameters(), "lr": GRID_RATE}
    optimiser = torch.optim.Adam([grids, {"params": weights}], RATE, fused=True)
    schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.01, total_iters=parameters.steps)
    places = {label: row for row, label in enumerate(shapes.meshes)}
    near = _near_rows([places[label] for label in known], len(shapes.meshes))
    batch_labels = known * -(-FEWEST_SAMPLES // len(known))
    rows_of = [torch.nonzero(labels == label)[:, 0] for label in batch_labels]
    batch_places = [places[label] for label in batch_labels]
    for _ in range(parameters.steps):
        samples = torch.stack([rows[torch.randint(len(rows), (), generator=random)] for rows in rows_of])
        count = round(NEAR_SHARE * parameters.points)
        chosen = torch.cat(
            [
                near[torch.randint(len(near), (count,), generator=random)],
                torch.randint(FAR_POINTS, (parameters.points - count,), generator=random),
            ]
        )
        logits = network(conditions[samples].to(DEVICE), shapes.points[chosen].to(DEVICE))
        bits = np.unpackbits(shapes.occupied[chosen.numpy()], axis=1)[:, batch_places]
        loss = occupancy_loss(logits, torch.from_numpy(bits).T.float().to(DEVICE))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return network.eval()


def occupancy_loss(logits: torch.Tensor, occupied: torch.Tensor) -> torch.Tensor:
    """Return the loss of points of several objects: how wrong each is, and how little volumes overlap.

    Of a thin object few points are inside. By points alone it is best left out; overlap (the coefficient of
    Dice, as Milletari et al. 2016) counts it as much as any other.

    Parameters
    ----------
    logits, occupied
        (objects, points).
    """
    probabilities = logits.sigmoid()
    both = (probabilities * occupied).sum(dim=1)
    sizes = (probabilities + occupied).sum(dim=1)
    dice = ((2 * both + 1) / (sizes + 1)).mean()
    return binary_cross_entropy_with_logits(logits, occupied) + OVERLAP_WEIGHT * (1 - dice)


def _near_rows(places: Sequence[int], count: int) -> torch.Tensor:
    """Return the rows (n,) of points about the surfaces of some of `count` meshes, by their order."""
    share = NEAR_POINTS // count
    return torch.cat([FAR_POINTS + share * place + torch.arange(share) for place in places])


@torch.no_grad()
def predicted(
    network: OccupancyNetwork, conditions: torch.Tensor, cells: int
) -> list[trimesh.Trimesh | None]:
    """Return the surface for each of the conditions (n, inputs) of an object's samples.

    Grids are halved from `COARSEST` times the cells on (as Mescheder et al. 2019 do), and the network is
    asked only where a wider grid is neither surely outside nor surely inside nearby. Samples of one object
    are asked at the same points, whose functions are computed once.

    Parameters
    ----------
    cells
        A side of the grid; a multiple of `COARSEST`.
    """

    def logits(points: np.ndarray) -> np.ndarray:
        parts = torch.from_numpy(points).float().to(DEVICE).split(1 << 15)
        values = [network(conditions.to(DEVICE), part) for part in parts]
        return torch.cat(values, dim=1).cpu().numpy()

    side = cells // COARSEST
    values = logits(grid_points(side)).reshape(-1, *3 * [side + 1])
    while side < cells:
        unsure = maximum_filter((values > OUTSIDE).any(axis=0), size=3)
        unsure &= maximum_filter((values < INSIDE).any(axis=0), size=3)
        side *= 2
        nearest = np.ix_(*3 * [(np.arange(side + 1) + 1) // 2])
        mask = unsure[nearest]
        values = np.stack([own[nearest] for own in values])
        values[:, mask] = logits(grid_points(side, mask))
    return [surface_of(own, cells) for own in values]
