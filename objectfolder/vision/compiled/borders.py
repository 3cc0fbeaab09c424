"""Pixels in which a shadow ends or colour changes fast, found from one answer a pixel."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel


@kernel
def unevenly_seen(label, slots):
    """Mark (h, w) pixels of a window that more than one group shares, or beside one of other coverage.

    Parameters
    ----------
    label
        (h * w, s) groups of their sub-samples, -1: nothing.
    slots
        (h, w) int32 row of `label`, or -1: nothing is seen in the pixel.
    """
    height, width = slots.shape
    marked = np.zeros((height, width), np.bool_)
    covered = np.zeros((height, width), np.int64)
    count = label.shape[1]
    for row in range(height):
        for column in range(width):
            here = slots[row, column]
            if here < 0:
                continue
            first = label[here, 0]
            for s in range(count):
                covered[row, column] += label[here, s] >= 0
                marked[row, column] |= label[here, s] != first
    for row in range(height):
        for column in range(width):
            for down, right in ((1, 0), (0, 1)):
                below, beside = row + down, column + right
                if below < height and beside < width and covered[row, column] != covered[below, beside]:
                    marked[row, column] = marked[below, beside] = True
    return marked


@kernel
def mixed(slots, pixel, state):
    """Mark (p,) pixels that see, or have an edge neighbour that sees, what is lit beside what is in shadow.

    Parameters
    ----------
    slots
        (h, w) int32 pixel at each place of a window, or -1.
    pixel, state
        (n,) of points that were asked: their pixel, and 1 lit, 2 in shadow, 0 turned from the light.
    """
    height, width = slots.shape
    last = -1
    for row in range(height):
        for column in range(width):
            last = max(last, slots[row, column])
    kinds = np.zeros(last + 1, np.int64)
    for i in range(len(pixel)):
        kinds[pixel[i]] |= state[i]
    marked = np.zeros(len(kinds), np.bool_)
    for row in range(height):
        for column in range(width):
            here = slots[row, column]
            if here < 0:
                continue
            marked[here] |= kinds[here] == 3
            for down, right in ((1, 0), (0, 1)):
                if row + down < height and column + right < width:
                    there = slots[row + down, column + right]
                    if there >= 0 and kinds[here] | kinds[there] == 3:
                        marked[here] = marked[there] = True
    return marked


@kernel
def contrasting(slots, shade, limit):
    """Mark (p,) pixels whose shade (p, 3) differs by more than `limit` from an edge neighbour's."""
    height, width = slots.shape
    marked = np.zeros(len(shade), np.bool_)
    for row in range(height):
        for column in range(width):
            here = slots[row, column]
            if here < 0:
                continue
            for down, right in ((1, 0), (0, 1)):
                if row + down < height and column + right < width:
                    there = slots[row + down, column + right]
                    if there < 0:
                        continue
                    for channel in range(3):
                        if abs(shade[here, channel] - shade[there, channel]) > limit:
                            marked[here] = marked[there] = True
    return marked


@kernel
def sum_by_pixel(pixel, weight, colour, count):
    """Return (count, 3) float64 sums of weight * colour over the points of each pixel, in their order."""
    total = np.zeros((count, 3))
    for i in range(len(pixel)):
        for channel in range(3):
            total[pixel[i], channel] += weight[i] * colour[i, channel]
    return total


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
