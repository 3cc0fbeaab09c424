"""The order of samples in which products are opened once and batches are of few objects."""

from collections.abc import Iterator

import numpy as np
from torch.utils.data import Sampler

from objectfolder.dataset.samples import ObjectFolderDataset
from objectfolder.errors import InputError


class ObjectBatches(Sampler[list[int]]):
    """Batches of samples in random order that are of few objects each; a `batch_sampler` of `DataLoader`.

    Every epoch has every sample once. Its objects are shuffled and taken a few at a time, and the samples of
    these are shuffled. So products and Object Files are opened once an epoch, however many objects there are,
    and a batch asks each of its objects for several samples at once.

    Parameters
    ----------
    samples
        A data set.
    batch_size
        Samples a batch; the last has the rest.
    together
        Objects at a time, at most the `open_objects` of the data set.
    seed
        Of the order. Each epoch has another one.

    Examples
    --------
    >>> from objectfolder.dataset import ObjectFolderDataset
    >>> samples = ObjectFolderDataset("bar.safetensors", "touch", source="object_file", queries=5)
    >>> [len(batch) for batch in ObjectBatches(samples, 2)]
    [2, 2, 1]
    """

    def __init__(
        self, samples: ObjectFolderDataset, batch_size: int, *, together: int = 4, seed: int = 0
    ) -> None:
        for name, value in (("batch_size", batch_size), ("together", together)):
            if value < 1:
                raise InputError(name, f"{value}", "Give 1 or more.")
        self._samples, self._size, self._together, self._seed = samples, batch_size, together, seed
        self._epoch = 0

    def __len__(self) -> int:
        return -(-len(self._samples) // self._size)

    def __iter__(self) -> Iterator[list[int]]:
        random = np.random.default_rng([self._seed, self._epoch])
        self._epoch += 1
        ranges = self._samples.ranges()
        objects = random.permutation(len(ranges))
        order: list[int] = []
        for start in range(0, len(objects), self._together):
            of_some = [np.arange(*ranges[place]) for place in objects[start : start + self._together]]
            order.extend(random.permutation(np.concatenate(of_some)).tolist())
        for start in range(0, len(order), self._size):
            yield order[start : start + self._size]
