"""Surfaces of several objects on one device, one behind the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from objectfolder.batch import contact_bodies
from objectfolder.batch.targets import Tensor, torch
from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface


def upload(values: np.ndarray, device: torch.device) -> Tensor:
    """Copy an array to a device."""
    return torch.from_numpy(np.array(values, order="C")).to(device)


def joined(parts: Sequence[np.ndarray], device: torch.device) -> Tensor:
    """Copy arrays to a device, one behind the other."""
    return upload(np.concatenate(parts), device)


@dataclass(frozen=True)
class ResidentTrees:
    """Triangles of several objects and trees of boxes over them, concatenated.

    Parameters
    ----------
    offsets
        (objects + 1, 3) int64: where boxes, leaves and faces of each begin.
    boxes, order, triangles
        As of `BoundingBoxTree`; faces are counted from the first of their object.
    """

    offsets: Tensor
    boxes: Tensor
    order: Tensor
    triangles: Tensor

    @classmethod
    def of(cls, surfaces: Sequence[Surface], device: torch.device) -> "ResidentTrees":
        """Upload surfaces."""
        trees = [surface._tree for surface in surfaces]
        sizes = [(len(tree.boxes), len(tree.order), len(tree.triangles)) for tree in trees]
        offsets = np.concatenate([np.zeros((1, 3), dtype=np.int64), np.cumsum(sizes, axis=0)])
        return cls(
            upload(offsets, device),
            joined([tree.boxes for tree in trees], device),
            joined([tree.order for tree in trees], device),
            joined([tree.triangles for tree in trees], device),
        )

    @property
    def arrays(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The parameters, as kernels take them."""
        return self.offsets, self.boxes, self.order, self.triangles

    def closest(self, objects: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Return the nearest face (n,) to each point (n, 3), and barycentric coordinates (n, 3) there."""
        face, barycentric = torch.empty_like(objects), torch.zeros_like(points)
        contact_bodies.locate(len(objects), objects, points, *self.arrays, face, barycentric)
        return face, barycentric


def numbers(name: str, value: object, shape: tuple[int, ...], device: torch.device) -> Tensor:
    """Return a tensor, an array or a number as float64 of a shape, on a device.

    Raises
    ------
    QueryError
        Values that cannot be repeated to this shape.
    """
    values = value if isinstance(value, Tensor) else torch.as_tensor(np.asarray(value, dtype=np.float64))
    try:
        return values.to(device, torch.float64).expand(shape).contiguous()
    except RuntimeError as error:
        finding = f"shape {tuple(values.shape)}"
        raise QueryError(name, finding, f"Give {shape}, or what repeats to it.") from error


def object_indices(objects: object, count: int, most: int, device: torch.device) -> Tensor:
    """Return which object each of `count` queries asks, (count,) int64 on a device.

    Raises
    ------
    QueryError
        Another shape, or no object of a batch of `most`. Those on a GPU are checked there, at the cost of
        waiting for it.
    """
    index = objects if isinstance(objects, Tensor) else torch.as_tensor(np.asarray(objects))
    if index.is_floating_point() or index.ndim > 1 or (index.ndim == 1 and len(index) not in (1, count)):
        raise QueryError("objects", f"{index.dtype} {tuple(index.shape)}", f"Give ({count},) whole numbers.")
    chosen = index.to(device, torch.int64).expand(count).contiguous()
    if count and (int(chosen.min()) < 0 or int(chosen.max()) >= most):
        raise QueryError("objects", "an index out of range", f"Give 0 to {most - 1}.")
    return chosen
