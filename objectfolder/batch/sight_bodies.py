"""What rays of many views of several objects meet, what light arrives there, and what the network is told.

Each function computes one ray or one point by the kernels of a single view. `offsets` (objects + 1, 3) says
where nodes, faces and, at each level, lookups and features of each object begin.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from typing import Any

import numpy as np

from objectfolder.batch.targets import Body
from objectfolder.vision.compiled.bounding_volumes import STACK, _first_hits, _occluded
from objectfolder.vision.compiled.lighting import _surface_points, _unhindered
from objectfolder.vision.compiled.network import _incidence, _interpolate, _surroundings
from objectfolder.vision.network.incidence import LEAST_MIRROR_COSINE, SELF_OFFSET, TERMINATOR_COSINE
from objectfolder.vision.network.network_layout import ANGLES, COARSE_LEVELS, FEATURES, LEAST_COSINE
from objectfolder.vision.network.sparse_grid import HALF_WIDTH

LEVELS = len(FEATURES)
FEATURE_ROWS, COARSE_ROWS = sum(FEATURES), sum(FEATURES[:COARSE_LEVELS])
# Rows of a point's inputs: features of all levels, angles, the surroundings that depend on the point, and
# those that depend on the lamp alone.
POINT_ROWS, LAMP_ROWS = 19, 12
ROWS = FEATURE_ROWS + ANGLES + POINT_ROWS + LAMP_ROWS
_LEAST_COSINE = np.float32(LEAST_COSINE)


def _cast(
    ray, view_of, place_of, offset_of, objects, cameras, lens, offsets, boxes, children, counts, triangles,
    faces, direction, face, barycentric, origin, stack, entry, found, where,
):  # fmt: skip
    """Write the direction of a ray through a pixel, and the face (-1: none) and place that it meets.

    `place_of` is the pixel, row by row, `offset_of` the place in it, and `lens` the focal length, width and
    height in pixels.
    """
    view, width = view_of[ray], int(lens[1])
    row, column = place_of[ray] // width, place_of[ray] % width
    x = (column + offset_of[ray, 0] - lens[1] / 2) / lens[0]
    y = (lens[2] / 2 - row - offset_of[ray, 1]) / lens[0]
    pose, squared = cameras[view], 0.0
    for axis in range(3):
        origin[0, axis] = pose[axis, 3]
        value = x * pose[axis, 0] + y * pose[axis, 1] - pose[axis, 2]
        direction[ray, axis] = value
        squared += value * value
    for axis in range(3):
        direction[ray, axis] /= math.sqrt(squared)
    some, after = offsets[objects[view]], offsets[objects[view] + 1]
    found[0] = -1
    _first_hits(
        boxes[some[0] : after[0]], children[some[0] : after[0]], counts[some[0] : after[0]],
        triangles[some[1] : after[1]], faces[some[1] : after[1]], origin, direction[ray : ray + 1], stack,
        entry, found, where,
    )  # fmt: skip
    face[ray] = found[0]
    if found[0] >= 0:
        for corner in range(3):
            barycentric[ray, corner] = where[0, corner]


def _light(
    point, view_of, objects, lights, offsets, boxes, children, counts, triangles, corners, corner_normals,
    facets, face, barycentric, direction, position, normal, side, irradiance,
    start, wanted, blocked, v, n, stack,
):  # fmt: skip
    """Write where a point is, its normal, and what of the lamp reaches it past the object."""
    view, here = view_of[point], slice(point, point + 1)
    some, after = offsets[objects[view]], offsets[objects[view] + 1]
    own, normals, flat = (
        corners[some[1] : after[1]], corner_normals[some[1] : after[1]], facets[some[1] : after[1]]
    )  # fmt: skip
    lamp = lights[view : view + 1]
    _surface_points(
        face[here], barycentric[here], direction[here], own, normals, flat, position[here], normal[here],
        side[here],
    )  # fmt: skip
    irradiance[point] = 0.0
    _unhindered(
        face[here], barycentric[here], position[here], normal[here], side[here], lamp, own, normals, flat,
        TERMINATOR_COSINE, SELF_OFFSET, irradiance[here], start, v, n,
    )  # fmt: skip
    wanted[0], blocked[0] = irradiance[point] > 0, False
    _occluded(
        boxes[some[0] : after[0]], children[some[0] : after[0]], counts[some[0] : after[0]],
        triangles[some[1] : after[1]], start, lamp, wanted, stack, blocked,
    )  # fmt: skip
    if blocked[0]:
        irradiance[point] = 0.0


def _inputs(
    point, view_of, objects, lights, lamp_terms, grid_offsets, resolutions, first_table, second_table,
    third_table, fourth_table, first_lookup, second_lookup, third_lookup, fourth_lookup, alpha2, position,
    normal, direction, irradiance, inputs, lobe, to_light,
):  # fmt: skip
    """Write what the network is told of a point, a column of `inputs`, and the lobe of its highlight."""
    view = view_of[point]
    thing = objects[view]
    some, after, sides = grid_offsets[thing], grid_offsets[thing + 1], resolutions[thing]
    x, y, z = position[point, 0], position[point, 1], position[point, 2]
    row = np.int64(0)
    _interpolate(
        first_table[some[0] : after[0]], first_lookup[some[4] : after[4]], sides[0], HALF_WIDTH, x, y, z,
        inputs, row, point,
    )  # fmt: skip
    row += first_table.shape[1]
    _interpolate(
        second_table[some[1] : after[1]], second_lookup[some[5] : after[5]], sides[1], HALF_WIDTH, x, y, z,
        inputs, row, point,
    )  # fmt: skip
    row += second_table.shape[1]
    _interpolate(
        third_table[some[2] : after[2]], third_lookup[some[6] : after[6]], sides[2], HALF_WIDTH, x, y, z,
        inputs, row, point,
    )  # fmt: skip
    row += third_table.shape[1]
    _interpolate(
        fourth_table[some[3] : after[3]], fourth_lookup[some[7] : after[7]], sides[3], HALF_WIDTH, x, y, z,
        inputs, row, point,
    )  # fmt: skip
    row += fourth_table.shape[1]
    squared = 0.0
    for axis in range(3):
        to_light[axis] = lights[view, axis] - position[point, axis]
        squared += to_light[axis] * to_light[axis]
    for axis in range(3):
        to_light[axis] /= max(math.sqrt(squared), 1e-9)
    lobe[point] = _incidence(
        normal[point], direction[point], to_light, alpha2[thing], _LEAST_COSINE, inputs, row, point
    )
    _surroundings(
        position[point], normal[point], direction[point], lights[view], irradiance[point], inputs,
        row + ANGLES, point,
    )  # fmt: skip
    for term in range(LAMP_ROWS):
        inputs[row + ANGLES + POINT_ROWS + term, point] = lamp_terms[view, term]


def _mirror(
    point, view_of, objects, offsets, boxes, children, counts, triangles, faces, facets, face, position,
    normal, side, direction, met_direction, met_face, met_barycentric, origin, stack, entry, found, where,
):  # fmt: skip
    """Write what the mirror ray of a point meets, as `incidence.mirror_rays` and `first_hits` do."""
    thing = objects[view_of[point]]
    some, after = offsets[thing], offsets[thing + 1]
    flat = facets[some[1] + face[point]]
    camera, rise, squared = 0.0, 0.0, 0.0
    for axis in range(3):
        camera -= normal[point, axis] * direction[point, axis]
    for axis in range(3):
        value = 2 * camera * normal[point, axis] + direction[point, axis]
        met_direction[point, axis] = value
        rise += side[point] * flat[axis] * value
    for axis in range(3):
        met_direction[point, axis] += max(LEAST_MIRROR_COSINE - rise, 0.0) * side[point] * flat[axis]
        squared += met_direction[point, axis] * met_direction[point, axis]
        origin[0, axis] = position[point, axis] + SELF_OFFSET * side[point] * flat[axis]
    for axis in range(3):
        met_direction[point, axis] /= math.sqrt(squared)
    found[0] = -1
    _first_hits(
        boxes[some[0] : after[0]], children[some[0] : after[0]], counts[some[0] : after[0]],
        triangles[some[1] : after[1]], faces[some[1] : after[1]], origin, met_direction[point : point + 1],
        stack, entry, found, where,
    )  # fmt: skip
    met_face[point] = found[0]
    if found[0] >= 0:
        for corner in range(3):
            met_barycentric[point, corner] = where[0, corner]


_TRACE: dict[str, Any] = {
    "origin": ((1, 3), np.float64),
    "stack": ((STACK,), np.int32),
    "entry": ((STACK,), np.float32),
    "found": ((1,), np.int32),
    "where": ((1, 3), np.float64),
}
cast = Body(_cast, 1, **_TRACE)
mirror = Body(_mirror, 1, **_TRACE)
light = Body(
    _light, start=((1, 3), np.float64), wanted=((1,), np.bool_), blocked=((1,), np.bool_),
    v=((3, 3), np.float64), n=((3, 3), np.float64), stack=((STACK,), np.int32),
)  # fmt: skip
inputs = Body(_inputs, to_light=((3,), np.float64))
