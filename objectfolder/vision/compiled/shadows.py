"""Where a shadow ends inside a pixel: some sub-samples are asked, the others follow the nearest."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import arrayless, kernel


def samples_to_ask(
    label: np.ndarray, rows: np.ndarray, rays: int, groups: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (n,) rows of `label` (p, s) and sub-samples: about `rays` of each of `rows`.

    These are evenly spaced samples of the lattice, and all of a group that has none of them.
    """
    chosen = label[rows]
    step = max(1, chosen.shape[1] // rays)
    regular = np.arange(chosen.shape[1]) % step == step // 2
    met = np.zeros((len(rows), groups + 1), dtype=bool)  # the last is that of no group
    np.put_along_axis(met, chosen[:, regular].astype(np.int64), True, axis=1)
    known = np.take_along_axis(met, chosen.astype(np.int64), axis=1)
    row, sample = np.nonzero((chosen >= 0) & (regular | ~known))
    return rows[row], np.ascontiguousarray(sample)


def split_groups(
    label: np.ndarray, pixel: np.ndarray, sample: np.ndarray, blocked: np.ndarray, offsets_x: np.ndarray,
    offsets_y: np.ndarray, groups: int,
) -> None:  # fmt: skip
    """Raise by `groups` the label (p, s) of sub-samples whose nearest asked one of their group is blocked.

    Parameters
    ----------
    pixel, sample, blocked
        (n,) those that were asked, in the order of `samples_to_ask`, and the answer.
    """
    raised = np.empty(label.shape[1], dtype=bool)
    _split_groups(label, pixel, sample, blocked, offsets_x, offsets_y, groups, raised)


@arrayless(kernel)
def _split_groups(label, pixel, sample, blocked, offsets_x, offsets_y, groups, raised):
    count, first = label.shape[1], 0
    while first < len(pixel):
        p, last = pixel[first], first
        some = False
        while last < len(pixel) and pixel[last] == p:
            some |= blocked[last]
            last += 1
        if some:
            for s in range(count):
                raised[s] = False
                gap = np.float32(np.inf)
                for asked in range(first, last):
                    t = sample[asked]
                    if label[p, t] == label[p, s]:
                        away = (offsets_x[s] - offsets_x[t]) ** 2 + (offsets_y[s] - offsets_y[t]) ** 2
                        if away < gap:
                            gap, raised[s] = away, blocked[asked]
            for s in range(count):
                if raised[s]:
                    label[p, s] += groups
        first = last
