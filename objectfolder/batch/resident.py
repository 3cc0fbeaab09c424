"""Surfaces of several objects on one device, one behind the other."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from objectfolder.batch.contact_bodies import Trees, locate
from objectfolder.batch.targets import Tensor, resident, torch
from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface


def upload(values: object, device: torch.device, kind: Any = None) -> Tensor:
    """Copy an array, or numbers that make one, to a device; of their own type if `kind` is None."""
    return torch.from_numpy(np.array(values, dtype=kind, order="C")).to(device)


def joined(parts: Sequence[np.ndarray], device: torch.device) -> Tensor:
    """Copy arrays to a device, one behind the other."""
    return upload(np.concatenate(parts), device)


def joined_records(
    records: Sequence[Sequence[np.ndarray]], counted: Sequence[int], device: torch.device
) -> tuple[Any, ...]:
    """Copy arrays of several objects to a device, each kind one behind the other, as kernels take them.

    Returns
    -------
    offsets, *arrays
        (objects + 1, counted) int64 where those of each object begin, in the arrays `counted`; the arrays.
    """
    sizes = np.array([[len(record[index]) for index in counted] for record in records], dtype=np.int64)
    offsets = np.concatenate([np.zeros_like(sizes[:1]), np.cumsum(sizes, axis=0)])
    arrays = (joined(parts, device) for parts in zip(*records, strict=True))
    return resident(upload(offsets, device)), *map(resident, arrays)


def resident_trees(surfaces: Sequence[Surface], device: torch.device) -> Trees:
    """Copy trees of boxes over the triangles of objects to a device; faces count from each object's first."""
    trees = [surface._tree for surface in surfaces]
    records = [(tree.boxes, tree.order, tree.triangles) for tree in trees]
    return Trees(*joined_records(records, range(3), device))


def closest(trees: Trees, objects: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
    """Return the nearest face (n,) of its object to each point (n, 3), and barycentric coordinates (n, 3)."""
    face, barycentric = torch.empty_like(objects), torch.zeros_like(points)
    locate(len(objects), objects, points, *trees, face, barycentric)
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
