"""Pixels in which a shadow ends or colour changes fast, found from one answer a pixel."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel

# Pixels above, and left of, an edge between two, and those on its other side.
PIXEL_NEIGHBOURS = (
    (np.s_[:-1, :], np.s_[1:, :]),
    (np.s_[:, :-1], np.s_[:, 1:]),
)


def unevenly_seen(label: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Mark (h, w) pixels of a window that more than one group shares, or beside one of other coverage.

    Parameters
    ----------
    label
        (h * w, s) groups of their sub-samples, -1: nothing.
    shape
        Height and width of the window.
    """
    first = label[:, 0]
    shared = np.zeros(len(label), dtype=bool)
    for sample in label.T[1:]:
        shared |= sample != first
    covered = np.where(first < 0, 0, label.shape[1])
    covered[shared] = np.count_nonzero(label[shared] >= 0, axis=1)
    marked, covered = shared.reshape(shape), covered.reshape(shape)
    for here, there in PIXEL_NEIGHBOURS:
        apart = covered[here] != covered[there]
        marked[here] |= apart
        marked[there] |= apart
    return marked


def neighbours(slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels (k,) on both sides of each edge between two, of slots (h, w) pixel or -1."""
    here = np.concatenate([slots[first].ravel() for first, _ in PIXEL_NEIGHBOURS])
    there = np.concatenate([slots[second].ravel() for _, second in PIXEL_NEIGHBOURS])
    both = (here >= 0) & (there >= 0)
    return here[both], there[both]


def mixed(
    edges: tuple[np.ndarray, np.ndarray], count: int, pixel: np.ndarray, state: np.ndarray
) -> np.ndarray:
    """Mark (p,) pixels that see, or have an edge neighbour that sees, what is lit beside what is in shadow.

    Parameters
    ----------
    edges, count
        As of `neighbours`, and how many pixels there are, p.
    pixel, state
        (n,) of points that were asked: their pixel, and 1 lit, 2 in shadow, 0 turned from the light.
    """
    lit, dark = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    lit[pixel[state == 1]] = dark[pixel[state == 2]] = True
    here, there = edges
    apart = (lit[here] | lit[there]) & (dark[here] | dark[there])
    marked: np.ndarray = lit & dark
    marked[here[apart]] = marked[there[apart]] = True
    return marked


def beside(edges: tuple[np.ndarray, np.ndarray], marked: np.ndarray) -> np.ndarray:
    """Mark (p,) pixels that are marked (p,), or an edge neighbour of one that is."""
    here, there = edges
    more = marked.copy()
    more[here[marked[there]]] = more[there[marked[here]]] = True
    return more


def contrasting(edges: tuple[np.ndarray, np.ndarray], shade: np.ndarray, limit: float) -> np.ndarray:
    """Mark (p,) pixels whose shade (p, 3) differs by more than `limit` from an edge neighbour's."""
    here, there = edges
    apart = np.zeros(len(here), dtype=bool)
    for channel in np.ascontiguousarray(shade.T):
        apart |= np.abs(channel[here] - channel[there]) > limit
    marked = np.zeros(len(shade), dtype=bool)
    marked[here[apart]] = marked[there[apart]] = True
    return marked


def sum_by_pixel(pixel: np.ndarray, weight: np.ndarray, colour: np.ndarray, count: int) -> np.ndarray:
    """Return (count, 3) float64 sums of weight * colour over the points of each pixel, in their order."""
    parts = [np.bincount(pixel, weight * channel, minlength=count) for channel in colour.T]
    return np.stack(parts, axis=1)


@kernel
def smoothed(slots, radius, position, normal, facing, apart, above, below):
    """Return (p, 3) ratios of sums of `above` over sums of `below` (p, 3) of pixels and of those round them.

    Parameters
    ----------
    slots
        (h, w) int32 pixel at each place of a window, or -1.
    radius
        Pixels to either side.
    position, normal
        (p, 3) of the surface in the pixel; a pixel whose normal is 0 is left as it is.
    facing, apart
        What turns count: 1 - cosine of two normals, and distance from the other's plane, of weight 1 / e.
    """
    height, width = slots.shape
    answer = np.zeros(above.shape)
    for row in range(height):
        for column in range(width):
            here = slots[row, column]
            if here < 0:
                continue
            top, bottom = np.zeros(3), np.zeros(3)
            for down in range(max(row - radius, 0), min(row + radius + 1, height)):
                for right in range(max(column - radius, 0), min(column + radius + 1, width)):
                    there = slots[down, right]
                    if there < 0:
                        continue
                    turn, off = 1.0, 0.0
                    for axis in range(3):
                        turn -= normal[here, axis] * normal[there, axis]
                        off += normal[here, axis] * (position[there, axis] - position[here, axis])
                    weight = 1.0 if here == there else np.exp(-max(turn, 0.0) / facing - abs(off) / apart)
                    for channel in range(3):
                        top[channel] += weight * above[there, channel]
                        bottom[channel] += weight * below[there, channel]
            for channel in range(3):
                if bottom[channel] > 0:
                    answer[here, channel] = top[channel] / bottom[channel]
    return answer
