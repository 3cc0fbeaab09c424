"""From samples to pixels: only those that see the object; the others are the untouched gel's."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel


@kernel
def resolve(record, extent, values, sample_depth, gel_values, rays, steps, rgb, depth, mask):
    """Write the pixels that see the object: the mean over their rays.

    Parameters
    ----------
    record
        (rows, columns) int32: -2 less the column of the values that a ray has, -1: the gel's; set only in
        the extent.
    extent
        (rows, 2) first and last column of each row of rays outside which there is none, that of all rows of
        its pixels.
    values
        (3, n) float32 pixel values, 0..1.
    sample_depth
        (>= n,) metres.
    gel_values
        (height, width, 3) float32 of the untouched gel.
    rays
        Of a pixel, each in a row of its own.
    steps
        Steps of depth a metre.
    rgb, depth, mask
        (height, width, 3) uint8, (height, width) float32 and bool; changed.
    """
    step, share = np.uint64(rays), np.float32(1 / rays)
    scale, half = np.float32(255), np.float32(0.5)
    reds, greens, blues = values[0], values[1], values[2]
    for i in range(np.uint64(mask.shape[0])):
        top = i * step
        for j in range(np.uint64(extent[top, 0]), np.uint64(extent[top, 1] + 1)):
            red, green, blue = np.float32(0), np.float32(0), np.float32(0)
            total, covered = 0.0, 0
            for row in range(top, top + step):
                mark = record[row, j]
                if mark < -1:
                    at = np.uint64(-2 - mark)
                    red, green, blue = red + reds[at], green + greens[at], blue + blues[at]
                    total += sample_depth[at]
                    covered += 1
            if covered == 0:
                continue
            left, background = np.float32(rays - covered), gel_values[i, j]
            red, green, blue = (
                red + left * background[0],
                green + left * background[1],
                blue + left * background[2],
            )
            rgb[i, j, 0] = np.uint8(red * share * scale + half)
            rgb[i, j, 1] = np.uint8(green * share * scale + half)
            rgb[i, j, 2] = np.uint8(blue * share * scale + half)
            depth[i, j] = np.float32(np.floor(total * (1 / rays) * steps) / steps)
            mask[i, j] = 2 * covered >= rays
