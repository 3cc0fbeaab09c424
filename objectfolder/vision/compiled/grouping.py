"""Sub-samples of a pixel that see one smooth piece of surface, and the few of them that are shaded.

Visibility is found at every sub-sample, colour once or a few times a group, as in multisampling.

Where a shadow ends inside a pixel, some sub-samples are asked, and the others follow the nearest.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import arrayless, inner, kernel


def samples_to_ask(
    label: np.ndarray, rows: np.ndarray, rays: int, groups: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (n,) rows of `label` (p, s) and sub-samples: about `rays` of each of `rows`.

    These are evenly spaced samples of the lattice, and all of a group that has none of them.
    """
    labels = label[rows]
    step = max(1, labels.shape[1] // rays)
    regular = np.arange(labels.shape[1]) % step == step // 2
    met = np.zeros((len(rows), groups + 1), dtype=bool)  # the last is that of no group
    np.put_along_axis(met, labels[:, regular].astype(np.int64), True, axis=1)
    has_regular = np.take_along_axis(met, labels.astype(np.int64), axis=1)
    row, sample = np.nonzero((labels >= 0) & (regular | ~has_regular))
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
        any_blocked = False
        while last < len(pixel) and pixel[last] == p:
            any_blocked |= blocked[last]
            last += 1
        if any_blocked:
            for s in range(count):
                raised[s] = False
                gap = np.float32(np.inf)
                for ray in range(first, last):
                    t = sample[ray]
                    if label[p, t] == label[p, s]:
                        away = (offsets_x[s] - offsets_x[t]) ** 2 + (offsets_y[s] - offsets_y[t]) ** 2
                        if away < gap:
                            gap, raised[s] = away, blocked[ray]
            for s in range(count):
                if raised[s]:
                    label[p, s] += groups
        first = last


# Samples are of one group up to this turn of the facet (cosine) and within this many pixel widths of the
# plane of the group's first facet.
TURN_COSINE = 0.8
OFF_PLANE_PX = 1.0
# More groups than this in a pixel share the last one.
GROUPS = 8


def group_samples(
    front_faces: np.ndarray, nearness: np.ndarray, centres: tuple[np.ndarray, np.ndarray],
    functions: np.ndarray, facets: np.ndarray, offsets: np.ndarray, slant: float,
) -> np.ndarray:  # fmt: skip
    """Return the group (p, s) int8 of each sub-sample, -1 where nothing is seen.

    Parameters
    ----------
    front_faces, nearness
        (p, s) as of `rasteriser.rasterise`.
    centres
        Columns and rows (p,) of the centres of the pixels.
    functions
        As of `rasteriser.edge_functions`.
    facets
        (F, 3) unit normals, in any one frame.
    offsets
        (2, s) of the sub-samples from the centre.
    slant
        Width of a pixel at distance 1.
    """
    label, first = np.full(front_faces.shape, -1, dtype=np.int8), np.empty(GROUPS, dtype=np.int64)
    _group_samples(front_faces, nearness, centres, (functions, facets), offsets, slant, first, label)
    return label


@arrayless(kernel)
def _group_samples(front_faces, nearness, centres, faces, offsets, slant, first, label):
    (columns, rows), (functions, facets) = centres, faces
    offsets_x, offsets_y = offsets[0], offsets[1]
    pixels, count = front_faces.shape
    for p in range(pixels):
        groups = 0
        for s in range(count):
            face = front_faces[p, s]
            if face < 0:
                continue
            group = -1
            for g in range(groups):
                other = first[g]
                if other == face:
                    group = g
                    break
                cosine = (
                    facets[face, 0] * facets[other, 0]
                    + facets[face, 1] * facets[other, 1]
                    + facets[face, 2] * facets[other, 2]
                )
                if abs(cosine) < TURN_COSINE:
                    continue
                f = functions[other]
                x, y = columns[p] + offsets_x[s], rows[p] + offsets_y[s]
                plane = (
                    (f[0, 0] + f[1, 0] + f[2, 0]) * x
                    + (f[0, 1] + f[1, 1] + f[2, 1]) * y
                    + (f[0, 2] + f[1, 2] + f[2, 2])
                )
                # Depths z and z' differ by less than a few widths z * slant: |1/z - 1/z'| < ... / z.
                if abs(plane - nearness[p, s]) <= OFF_PLANE_PX * slant * nearness[p, s]:
                    group = g
                    break
            if group < 0:
                if groups < GROUPS:
                    first[groups] = face
                    groups += 1
                group = groups - 1
            label[p, s] = group


def choose_samples(
    label: np.ndarray, groups: int, offsets: np.ndarray, samples_per_group: np.ndarray, targets: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Choose up to `samples_per_group` spread sub-samples to stand for each group.

    Parameters
    ----------
    label
        (p, s) int8 groups from 0, -1: none.
    groups
        Most groups a pixel has.
    offsets
        (2, s).
    samples_per_group
        (p,) int64 how many a group.
    targets
        (most, most, 2) float32: in [k - 1] the k places in the unit square to be near to.

    Returns
    -------
    pixel, sample
        (n,) int32 row of `label` and column, ordered by pixel.
    group
        (n,) int8.
    weight
        (n,) float32 share of the pixel it stands for.
    """
    count, most = label.shape[1], len(targets)
    room = int(np.minimum(count, samples_per_group * groups).sum())
    pixel, sample = np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32)
    group, weight = np.empty(room, dtype=np.int8), np.empty(room, dtype=np.float32)
    whole = (
        np.empty((most, most), dtype=np.int64), np.empty((most, most), dtype=np.float32),
        np.zeros(most, dtype=bool),
    )  # fmt: skip
    working = (
        np.empty((groups, count), dtype=np.int64), np.empty(groups, dtype=np.int64),
        np.empty((4, count), dtype=np.float32),
    )  # fmt: skip
    choice = pixel, sample, group, weight
    total = _choose_samples(label, offsets, samples_per_group, targets, whole, working, choice)
    return pixel[:total], sample[:total], group[:total], weight[:total]


@arrayless(kernel)
def _choose_samples(label, offsets, samples_per_group, targets, whole_pixels, working, choice):
    """Write the answer of `choose_samples`, and return how many samples there are.

    A pixel of one group has the same samples every time: row k - 1 of the samples and weights of
    `whole_pixels`, once it is known. Working memory are members (groups, s) and sizes (groups,) of groups,
    and (4, s) numbers.
    """
    whole_sample, whole_weight, whole_known = whole_pixels
    (members, sizes, near), (pixel, sample, group, weight) = working, choice
    pixels, count = label.shape
    groups = len(sizes)
    total = np.int64(0)  # a literal would have `_stand_for` compiled twice
    for p in range(pixels):
        k = min(samples_per_group[p], count)
        if k == 0:
            continue
        only = label[p, 0]
        whole = only >= 0
        for s in range(1, count):
            whole &= label[p, s] == only
        if whole and whole_known[k - 1]:
            for j in range(k):
                pixel[total], group[total] = p, only
                sample[total], weight[total] = whole_sample[k - 1, j], whole_weight[k - 1, j]
                total += 1
            continue
        for g in range(groups):
            sizes[g] = 0
        for s in range(count):
            g = label[p, s]
            if g >= 0:
                members[g, sizes[g]] = s
                sizes[g] += 1
        for g in range(groups):
            if sizes[g] == 0:
                continue
            start = total
            total = _stand_for(
                members[g], sizes[g], offsets, targets[k - 1], k, near, (sample, weight), total
            )
            for j in range(start, total):
                pixel[j], group[j] = p, g
            if whole:
                for j in range(k):
                    whole_sample[k - 1, j], whole_weight[k - 1, j] = sample[start + j], weight[start + j]
                whole_known[k - 1] = True
    return total


@inner(arrayless(kernel))
def _stand_for(members, size, offsets, targets, most, near, choice, total):
    """Write up to `most` of `members` (>= size,) and the shares nearest to each from row `total` on.

    Return the row after them. Working memory are `near` (4, s): of members, and of samples.
    """
    offsets_x, offsets_y, (sample, weight) = offsets[0], offsets[1], choice
    low_x, high_x = np.float32(1.0), np.float32(-1.0)
    low_y, high_y = np.float32(1.0), np.float32(-1.0)
    x, y, chosen_x, chosen_y = near[0], near[1], near[2], near[3]
    for m in range(size):
        s = members[m]
        x[m], y[m] = offsets_x[s], offsets_y[s]
        low_x, high_x = min(low_x, x[m]), max(high_x, x[m])
        low_y, high_y = min(low_y, y[m]), max(high_y, y[m])
    stand_ins = min(most, size)
    for j in range(stand_ins):
        aim_x = low_x + (high_x - low_x) * targets[j, 0]
        aim_y = low_y + (high_y - low_y) * targets[j, 1]
        nearest, gap = -1, np.float32(np.inf)
        for m in range(size):
            away = (x[m] - aim_x) ** 2 + (y[m] - aim_y) ** 2
            if away < gap:
                repeated = False
                for t in range(total, total + j):
                    repeated |= sample[t] == members[m]
                if not repeated:
                    nearest, gap = m, away
        sample[total + j], weight[total + j] = members[nearest], 0.0
        chosen_x[j], chosen_y[j] = x[nearest], y[nearest]
    share = np.float32(1.0 / len(offsets_x))
    for m in range(size):
        nearest, gap = 0, np.float32(np.inf)
        for j in range(stand_ins):
            away = (x[m] - chosen_x[j]) ** 2 + (y[m] - chosen_y[j]) ** 2
            if away < gap:
                nearest, gap = j, away
        weight[total + nearest] += share
    return total + stand_ins
