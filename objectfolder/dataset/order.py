"""The order of samples in which products are opened once and batches are of few objects."""

from collections.abc import Iterator, Sequence

import numpy as np


def batches_of_few_objects(
    ranges: Sequence[tuple[int, int]], size: int, together: int, random: np.random.Generator
) -> Iterator[list[int]]:
    """Yield all samples once, in random order, in batches that are of few objects each.

    Parameters
    ----------
    ranges
        First index of each object's samples, and the index behind the last.
    size
        Samples a batch; the last has the rest.
    together
        Objects at a time, whose samples are shuffled together.
    random
        Of the order.
    """
    objects = random.permutation(len(ranges))
    order: list[int] = []
    for start in range(0, len(objects), together):
        of_some = [np.arange(*ranges[place]) for place in objects[start : start + together]]
        order.extend(random.permutation(np.concatenate(of_some)).tolist())
    for start in range(0, len(order), size):
        yield order[start : start + size]
