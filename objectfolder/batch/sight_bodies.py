"""What rays of many views of several objects meet, what light arrives there, and the colours that it makes.

Each function computes one ray, point or pixel by the kernels of a single view. `offsets` (objects + 1, 3)
says where nodes, faces and, at each level, lookups and features of each object begin. `ray_of` is the ray
that meets a point; `view_of`, `face`, `barycentric` and `direction` are those of rays.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from typing import Any

import numpy as np

from objectfolder.batch.targets import Body, scalar
from objectfolder.vision.compiled.bounding_volumes import STACK, _first_hits, _occluded
from objectfolder.vision.compiled.lighting import _surface_points, _unhindered
from objectfolder.vision.compiled.network_kernels import (
    _incidence,
    _interpolate,
    _schlick,
    _sigmoid,
    _softplus,
    _surroundings,
)
from objectfolder.vision.compositing import SRGB_KNEE
from objectfolder.vision.network.incidence import LEAST_MIRROR_COSINE, SELF_OFFSET, TERMINATOR_COSINE
from objectfolder.vision.network.network_layout import ANGLES, COARSE_LEVELS, FEATURES, LEAST_COSINE
from objectfolder.vision.network.sparse_grid import HALF_WIDTH

LEVELS = len(FEATURES)
FEATURE_ROWS, COARSE_ROWS = sum(FEATURES), sum(FEATURES[:COARSE_LEVELS])
# Rows of a point's inputs: features of all levels, angles, the surroundings that depend on the point, and
# those that depend on the lamp alone.
POINT_ROWS, LAMP_ROWS = 19, 12
INPUT_ROWS = FEATURE_ROWS + ANGLES + POINT_ROWS + LAMP_ROWS
# Products of 16-bit numbers are fast where there are 8 n of them; the last rows are 0.
PADDED_ROWS = -(-INPUT_ROWS // 8) * 8
# What the network answers: light that is reflected evenly, strength of the highlight, bounced light, albedo,
# and what a mirror reflects of light from the front, before they are bounded; three each.
EVEN, STRENGTH, BOUNCED, ALBEDO, FACING, ANSWERS = 0, 3, 6, 9, 12, 16
_LEAST_COSINE = np.float32(LEAST_COSINE)


def _cast(
    ray, place_of, inside, objects, cameras, lens, offsets, boxes, children, counts, triangles, faces,
    view_of, direction, face, barycentric, origin, stack, entry, hit, where,
):  # fmt: skip
    """Write the view and the direction of a ray, and the face (-1: none) and place that it meets.

    `place_of` are pixels, view by view and row by row, `inside` the places in each that have a ray, and
    `lens` the focal length, width and height in pixels.
    """
    rays, width, height = inside.shape[0], int(lens[1]), int(lens[2])
    place, inner = place_of[ray // rays], ray % rays
    view, pixel = place // (width * height), place % (width * height)
    row, column = pixel // width, pixel % width
    view_of[ray] = view
    x = (column + inside[inner, 0] - lens[1] / 2) / lens[0]
    y = (lens[2] / 2 - row - inside[inner, 1]) / lens[0]
    pose, squared = cameras[view], 0.0
    for axis in range(3):
        origin[0, axis] = pose[axis, 3]
        value = x * pose[axis, 0] + y * pose[axis, 1] - pose[axis, 2]
        direction[ray, axis] = value
        squared += value * value
    for axis in range(3):
        direction[ray, axis] /= math.sqrt(squared)
    some, after = offsets[objects[view]], offsets[objects[view] + 1]
    hit[0] = -1
    _first_hits(
        boxes[some[0] : after[0]], children[some[0] : after[0]], counts[some[0] : after[0]],
        triangles[some[1] : after[1]], faces[some[1] : after[1]], origin, direction[ray : ray + 1], stack,
        entry, hit, where,
    )  # fmt: skip
    face[ray] = hit[0]
    if hit[0] >= 0:
        for corner in range(3):
            barycentric[ray, corner] = where[0, corner]


def _light(
    point, ray_of, view_of, objects, lights, offsets, boxes, children, counts, triangles, corners,
    corner_normals, facets, face, barycentric, direction, position, normal, side, irradiance, start, lit,
    blocked, v, n, stack,
):  # fmt: skip
    """Write where a point is, its normal, and what of the lamp reaches it past the object."""
    ray, row = ray_of[point], slice(point, point + 1)
    view, beam = view_of[ray], slice(ray, ray + 1)
    some, after = offsets[objects[view]], offsets[objects[view] + 1]
    own, normals, flat = (
        corners[some[1] : after[1]], corner_normals[some[1] : after[1]], facets[some[1] : after[1]]
    )  # fmt: skip
    lamp = lights[view : view + 1]
    _surface_points(
        face[beam], barycentric[beam], direction[beam], own, normals, flat, position[row], normal[row],
        side[row],
    )  # fmt: skip
    irradiance[point] = 0.0
    _unhindered(
        face[beam], barycentric[beam], position[row], normal[row], side[row], lamp, own, normals, flat,
        TERMINATOR_COSINE, SELF_OFFSET, irradiance[row], start, v, n,
    )  # fmt: skip
    lit[0], blocked[0] = irradiance[point] > 0, False
    _occluded(
        boxes[some[0] : after[0]], children[some[0] : after[0]], counts[some[0] : after[0]],
        triangles[some[1] : after[1]], start, lamp, lit, stack, blocked,
    )  # fmt: skip
    if blocked[0]:
        irradiance[point] = 0.0


def _inputs(
    point, ray_of, view_of, objects, lights, lamp_terms, grid_offsets, resolutions, first_table, second_table,
    third_table, fourth_table, first_lookup, second_lookup, third_lookup, fourth_lookup, alpha2, position,
    normal, direction, irradiance, inputs, lobe, to_light,
):  # fmt: skip
    """Write the network's inputs of a point, a column of `inputs`, and the lobe of its highlight."""
    ray = ray_of[point]
    view = view_of[ray]
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
        normal[point], direction[ray], to_light, alpha2[thing], _LEAST_COSINE, inputs, row, point
    )
    _surroundings(
        position[point], normal[point], direction[ray], lights[view], irradiance[point], inputs,
        row + ANGLES, point,
    )  # fmt: skip
    row += ANGLES
    for term in range(LAMP_ROWS):
        inputs[row + POINT_ROWS + term, point] = lamp_terms[view, term]
    for term in range(INPUT_ROWS, PADDED_ROWS):
        inputs[term, point] = np.float32(0.0)


def _mirror(
    point, ray_of, view_of, objects, offsets, boxes, children, counts, triangles, faces, facets, face,
    position, normal, side, direction, met_view, met_direction, met_face, met_barycentric, origin, stack,
    entry, hit, where,
):  # fmt: skip
    """Write what the mirror ray of a point meets, as `incidence.mirror_rays` and `first_hits` do."""
    ray = ray_of[point]
    thing = objects[view_of[ray]]
    met_view[point] = view_of[ray]
    some, after = offsets[thing], offsets[thing + 1]
    flat = facets[some[1] + face[ray]]
    camera, rise, squared = 0.0, 0.0, 0.0
    for axis in range(3):
        camera -= normal[point, axis] * direction[ray, axis]
    for axis in range(3):
        value = 2 * camera * normal[point, axis] + direction[ray, axis]
        met_direction[point, axis] = value
        rise += side[point] * flat[axis] * value
    for axis in range(3):
        met_direction[point, axis] += max(LEAST_MIRROR_COSINE - rise, 0.0) * side[point] * flat[axis]
        squared += met_direction[point, axis] * met_direction[point, axis]
        origin[0, axis] = position[point, axis] + SELF_OFFSET * side[point] * flat[axis]
    for axis in range(3):
        met_direction[point, axis] /= math.sqrt(squared)
    hit[0] = -1
    _first_hits(
        boxes[some[0] : after[0]], children[some[0] : after[0]], counts[some[0] : after[0]],
        triangles[some[1] : after[1]], faces[some[1] : after[1]], origin, met_direction[point : point + 1],
        stack, entry, hit, where,
    )  # fmt: skip
    met_face[point] = hit[0]
    if hit[0] >= 0:
        for corner in range(3):
            met_barycentric[point, corner] = where[0, corner]


def _reflected(point, c, answers, facing, fifth, lobe):
    """Return pi times the reflectance of a point in channel c; `fifth` is (1 - cosine)^5 at the light."""
    even, strength = 2 * _sigmoid(answers[point, EVEN + c]), answers[point, STRENGTH + c]
    if facing:
        gloss = _schlick(answers[point, FACING + c], fifth) * 2 * _sigmoid(strength)
    else:
        gloss = _softplus(strength)
    return _sigmoid(answers[point, ALBEDO + c]) * even + gloss * lobe


def _reflect(
    point, ray_of, view_of, objects, mirrors, answers, inputs, lobe, irradiance, reflected
):  # fmt: skip
    """Write what a point reflects of the lamp to the mirror that its ray left, (points, 3)."""
    ray = ray_of[point]
    if mirrors[objects[view_of[ray]]]:
        fifth, light = inputs[FEATURE_ROWS + 7, point], np.float32(irradiance[point])
        for c in range(3):
            reflected[ray, c] = light * _scalar_reflected(point, c, answers, True, fifth, lobe[point])


def _colour(
    point, ray_of, view_of, objects, mirrors, radiance, answers, inputs, lobe, irradiance, normal, direction,
    reflected, colours,
):  # fmt: skip
    """Write the RGBA of the ray that meets a point; `reflected` (points, 3) matters to mirrors."""
    ray = ray_of[point]
    thing = objects[view_of[ray]]
    facing, light = mirrors[thing], np.float32(irradiance[point])
    fifth, rim = inputs[FEATURE_ROWS + 7, point], np.float32(0.0)
    if facing:
        beside = 1.0
        for axis in range(3):
            beside += normal[point, axis] * direction[ray, axis]
        beside = min(max(beside, 0.0), 1.0)
        rim = np.float32(beside * beside * beside * beside * beside)
    for c in range(3):
        value = light * _scalar_reflected(point, c, answers, facing, fifth, lobe[point])
        value += _sigmoid(answers[point, ALBEDO + c]) * _softplus(answers[point, BOUNCED + c])
        if facing:
            value += _schlick(answers[point, FACING + c], rim) * reflected[point, c]
        colours[ray, c] = value * radiance[thing]
    colours[ray, 3] = np.float32(1.0)


def _blend(number, place_of, colours, rgba, shown):
    """Write the mean RGBA of the rays of a pixel, and its `compositing.composite_on_white`."""
    place, rays = place_of[number], colours.shape[0] // place_of.shape[0]
    one, zero, knee = np.float32(1.0), np.float32(0.0), np.float32(SRGB_KNEE)
    for c in range(4):
        total = zero
        for ray in range(number * rays, (number + 1) * rays):
            total += colours[ray, c]
        rgba[place, c] = total / np.float32(rays)
    alpha = rgba[place, 3]
    for c in range(3):
        straight = min(max(rgba[place, c] / max(alpha, np.float32(1e-30)), zero), one)
        if straight <= knee:
            curved = np.float32(12.92) * straight
        else:
            curved = np.float32(1.055) * straight ** np.float32(1 / 2.4) - np.float32(0.055)
        shown[place, c] = alpha * curved + (one - alpha)


def _uneven(place, lens, contrast, shown, marked):
    """Mark a pixel that differs from a neighbour above, below or beside."""
    width, height = int(lens[1]), int(lens[2])
    row, column = place // width % height, place % width
    differs = False
    for c in range(3):
        value = shown[place, c]
        if column > 0 and abs(value - shown[place - 1, c]) > contrast:
            differs = True
        if column < width - 1 and abs(value - shown[place + 1, c]) > contrast:
            differs = True
        if row > 0 and abs(value - shown[place - width, c]) > contrast:
            differs = True
        if row < height - 1 and abs(value - shown[place + width, c]) > contrast:
            differs = True
    marked[place] = differs


_TRACE: dict[str, Any] = {
    "origin": ((1, 3), np.float64),
    "stack": ((STACK,), np.int32),
    "entry": ((STACK,), np.float32),
    "hit": ((1,), np.int32),
    "where": ((1, 3), np.float64),
}
cast = Body(_cast, 1, **_TRACE)
mirror = Body(_mirror, 1, **_TRACE)
light = Body(
    _light, start=((1, 3), np.float64), lit=((1,), np.bool_), blocked=((1,), np.bool_),
    v=((3, 3), np.float64), n=((3, 3), np.float64), stack=((STACK,), np.int32),
)  # fmt: skip
inputs = Body(_inputs, to_light=((3,), np.float64))
_scalar_reflected = scalar(_reflected)
reflect = Body(_reflect)
colour = Body(_colour)
blend = Body(_blend)
uneven = Body(_uneven)
