"""The lowest surface along parallel rays, as `objectfolder.touch.contact.height_field`."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel


@kernel
def _covered(a, b, c, first, pitch, count):
    """First and last cell whose centre lies between the least and greatest of three coordinates."""
    a, b, c = (a - first) / pitch, (b - first) / pitch, (c - first) / pitch
    least, most = min(min(a, b), c) - 1e-9, max(max(a, b), c) + 1e-9
    return int(np.ceil(min(max(least, 0.0), count))), int(np.floor(max(min(most, count - 1.0), -1.0)))


@kernel
def lowest(triangles, y, z, least, tolerance):
    """Least x >= `least` (rows, columns) of triangles (m, 3, 3) over the grid; infinity where there is none.

    Parameters
    ----------
    triangles
        Sensor frame, metres.
    y, z
        (columns,) and (rows,) centres of the cells, descending.
    tolerance
        How far outside a face, in parts of its doubled area, a ray still meets it.
    """
    found = np.full((len(z), len(y)), np.inf)
    for face in range(len(triangles)):
        a, b, c = triangles[face, 0], triangles[face, 1], triangles[face, 2]
        low, high = min(min(a[0], b[0]), c[0]), max(max(a[0], b[0]), c[0])
        if high < least:
            continue
        first_row, last_row = _covered(a[2], b[2], c[2], z[0], z[1] - z[0], len(z))
        first_column, last_column = _covered(a[1], b[1], c[1], y[0], y[1] - y[0], len(y))
        for row in range(first_row, last_row + 1):
            az, bz, cz = a[2] - z[row], b[2] - z[row], c[2] - z[row]
            for column in range(first_column, last_column + 1):
                ay, by, cy = a[1] - y[column], b[1] - y[column], c[1] - y[column]
                first, second, third = by * cz - bz * cy, cy * az - cz * ay, ay * bz - az * by
                area = first + second + third
                if area == 0:
                    continue
                sign = 1.0 if area > 0 else -1.0
                slack = -tolerance * (abs(first) + abs(second) + abs(third))
                if first * sign < slack or second * sign < slack or third * sign < slack:
                    continue
                x = (first * a[0] + second * b[0] + third * c[0]) / area
                x = min(max(x, low), high)
                if x >= least and x < found[row, column]:
                    found[row, column] = x
    return found
