"""What to shade: one point for each face in each pixel, amid the rays that see it there; then the pixels.

Only pixels that see the object are written; the others are the untouched gel's.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from typing import NamedTuple

import numpy as np

from objectfolder.jit import arrayless, inner, kernel, relaxed_kernel
from objectfolder.touch.rendering.rasterise import Raster, Rays


class SeenPoints(NamedTuple):
    """Points to shade; there is room for more than are seen.

    Parameters
    ----------
    positions, normals
        (3, >= n) float32 sensor frame; the normals, towards the camera, of any length.
    depth
        (>= n,) metres in the undeformed gel.
    """

    positions: np.ndarray
    normals: np.ndarray
    depth: np.ndarray


class Picture(NamedTuple):
    """Values (height, width, 3) uint8, depth (height, width) float32, metres, and mask bool."""

    rgb: np.ndarray
    depth: np.ndarray
    mask: np.ndarray


@arrayless(kernel)
def resolve(record, extent, values, sample_depth, gel_values, rays, steps, picture):
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
    picture
        A `Picture`; changed.
    """
    rgb, depth, mask = picture
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
            uncovered, background = np.float32(rays - covered), gel_values[i, j]
            red, green, blue = (
                red + uncovered * background[0],
                green + uncovered * background[1],
                blue + uncovered * background[2],
            )
            rgb[i, j, 0] = np.uint8(red * share * scale + half)
            rgb[i, j, 1] = np.uint8(green * share * scale + half)
            rgb[i, j, 2] = np.uint8(blue * share * scale + half)
            depth[i, j] = np.float32(np.floor(total * (1 / rays) * steps) / steps)
            mask[i, j] = 2 * covered >= rays


@inner(arrayless(kernel))
def _normal_map(edges, normals, pose, matrix):
    """Write what takes a ray (1, u, v) to the normal of a face (3, 3); return twice the face's area.

    Normals are linear in the ray: the sum of the corner normals, each times the distance of the ray from the
    opposite edge. Towards the camera, whichever side is seen: a shell turned inside out looks as the shell.
    """
    x = edges[0, 0] + edges[1, 0] + edges[2, 0]
    y = edges[0, 1] + edges[1, 1] + edges[2, 1]
    z = edges[0, 2] + edges[1, 2] + edges[2, 2]
    length = math.sqrt(x * x + y * y + z * z)
    for axis in range(3):
        matrix[axis] = 0.0
        for corner in range(3):
            n = normals[corner]
            along = n[0] * pose[0, axis] + n[1] * pose[1, axis] + n[2] * pose[2, axis]
            for k in range(3):
                matrix[axis, k] -= along * edges[corner, k] / length
    return length


@inner(arrayless(relaxed_kernel))
def _take(owner, nearness, shift, v, rows, column, face, mark):
    """Mark the rays of a pixel that see a face in a column of it.

    Returns how many there are, how far away the face is amid them, and means of their shift and v.
    """
    members, near, across, up = 0, 0.0, 0.0, 0.0
    for row in range(rows[0], rows[1]):
        if owner[row, column] == face:
            members += 1
            near += nearness[row, column]
            across += shift[row]
            up += v[row]
            owner[row, column] = mark
    share = 1 / members
    # One over the depth is linear over a face.
    return members, members / near, across * share, up * share


@inner(arrayless(relaxed_kernel))
def _normal(m, across, up):
    return (
        m[0, 0] + m[0, 1] * across + m[0, 2] * up,
        m[1, 0] + m[1, 1] * across + m[1, 2] * up,
        m[2, 0] + m[2, 1] * across + m[2, 2] * up,
    )


@inner(arrayless(relaxed_kernel))
def _indentation(deep, lateral, vertical, radius, stretch):
    """Metres that a point `deep` metres below the apex, and beside it, lies in the undeformed gel."""
    squared = radius * radius - (lateral * lateral + vertical * vertical)
    squared = squared if squared > 0 else 0.0
    deep -= stretch * (radius - np.sqrt(squared))
    return deep if deep > 0 else 0.0


@arrayless(relaxed_kernel)
def _gather(raster, corner_normals, faces, pose, gel, rays, working, shaded):
    """Write what `gather_samples` returns; working memory are (m, 3, 3), and (m,) of 0."""
    (owner, nearness, extent, edges, inverse), (maps, doubled_area) = raster, working
    camera, u, shift, v = rays.camera, rays.u, rays.shift, rays.v
    positions, normals, depth = shaded
    px, py, pz = positions[0], positions[1], positions[2]
    nx, ny, nz = normals[0], normals[1], normals[2]
    camera_x, apex_y, apex_z, radius, stretch = camera[0], gel[1], gel[2], gel[5], gel[6]
    gel_x, gel_y, gel_z = gel[0] - camera_x, camera[1] - apex_y, camera[2] - apex_z
    area, count, one, step = 0.0, np.uint64(0), np.uint64(1), np.uint64(rays.of_pixel)
    for top in range(np.uint64(0), np.uint64(len(v)), step):
        # Indices that cannot be negative are not tested for it.
        for column in range(np.uint64(extent[top, 0]), np.uint64(extent[top, 1] + 1)):
            for first in range(top, top + step):
                face = owner[first, column]
                if face < 0:
                    continue
                mark = np.int32(-2) - np.int32(count)
                members, distance, across, up = _take(
                    owner, nearness, shift, v, (first, top + step), column, face, mark
                )
                across += u[column]
                m = maps[face]
                if doubled_area[face] == 0:
                    doubled_area[face] = _normal_map(edges[face], corner_normals[faces[face]], pose, m)
                nx[count], ny[count], nz[count] = _normal(m, across, up)
                lateral, vertical = gel_y + distance * across, gel_z + distance * up
                px[count], py[count], pz[count] = camera_x + distance, lateral + apex_y, vertical + apex_z
                depth[count] = _indentation(gel_x - distance, lateral, vertical, radius, stretch)
                # A ray's surface is d^2 du dv over the cosine between ray and normal.
                size = doubled_area[face] * abs(inverse[face])
                area += distance * distance * distance * size * members
                count += one
    return np.int64(count), area


def gather_samples(
    raster: Raster, corner_normals: np.ndarray, faces: np.ndarray, pose: np.ndarray, gel: np.ndarray,
    rays: Rays,
) -> tuple[int, SeenPoints, float]:  # fmt: skip
    """Points and normals to shade: one for each face in each pixel, amid the rays that see it there.

    Parameters
    ----------
    raster
        As `rasterise.rasterise` returns it; `owner` is changed: to -2 less the column of the results of each
        ray, or -1 for the gel.
    corner_normals, faces
        (F, 3, 3) in the object frame, and which of the faces the triangles are (m,).
    pose, gel
        sensor_to_object (4, 4), and as of `gel.gel_constants`.
    rays
        Of the camera.

    Returns
    -------
    count, points
        How many there are, and the points.
    area
        Square metres of surface for each unit of du dv, summed over the rays.
    """
    most = int(np.maximum(raster.extent[:, 1] - raster.extent[:, 0] + 1, 0).sum())
    working = np.empty((len(faces), 3, 3)), np.zeros(len(faces))
    shaded = SeenPoints(
        np.empty((3, most), dtype=np.float32), np.empty((3, most), dtype=np.float32), np.empty(most)
    )
    count, area = _gather(raster, corner_normals, faces, pose, gel, rays, working, shaded)
    return count, shaded, area
