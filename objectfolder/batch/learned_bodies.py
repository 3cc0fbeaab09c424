"""Colours of points by a learned network: its inputs, what mirrors meet, and what its answers make.

Each function computes one point by the kernels of a single view; see `sight_bodies`.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple

import numpy as np

from objectfolder.batch.sight_bodies import TRACE, Rays, SurfacePoints, Trace, Volumes, meet, volumes_of
from objectfolder.batch.targets import Body, scalar
from objectfolder.vision.compiled.network_kernels import (
    _incidence,
    _interpolate,
    _schlick,
    _sigmoid,
    _softplus,
    _surroundings,
)
from objectfolder.vision.network.incidence import LEAST_MIRROR_COSINE, SELF_OFFSET
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

# Objects of views, their lamps, and the inputs that follow from these.
LampTerms = namedtuple("LampTerms", "objects places terms")
# Feature grids of all objects, and widths of their highlights.
Grids = namedtuple(
    "Grids", "offsets resolutions table_0 table_1 table_2 table_3 lookup_0 lookup_1 lookup_2 lookup_3 alpha2"
)
# The network's inputs and answers, and the lobes of highlights.
NetworkInputs = namedtuple("NetworkInputs", "inputs lobe")
NetworkAnswers = namedtuple("NetworkAnswers", "answers inputs lobe")
# Of objects of views: whether they have mirrors, and the scale of their radiance.
ViewedObjects = namedtuple("ViewedObjects", "objects mirrors radiance")


def _inputs(point, points: SurfacePoints, lamps: LampTerms, grids: Grids, network: NetworkInputs, to_light):
    """Write the network's inputs of a point, a column of `inputs`, and the lobe of its highlight."""
    (objects, lights, lamp_terms), (inputs, lobe) = lamps, network
    ray = points.ray_of[point]
    view = points.view_of[ray]
    position, normal, direction = points.position[point], points.normal[point], points.direction[ray]
    thing = objects[view]
    some, after, sides = grids.offsets[thing], grids.offsets[thing + 1], grids.resolutions[thing]
    place = position[0], position[1], position[2]
    row = np.int64(0)
    level = grids.table_0[some[0] : after[0]], grids.lookup_0[some[4] : after[4]], sides[0]
    _interpolate(level, HALF_WIDTH, place, inputs, row, point)
    row += grids.table_0.shape[1]
    level = grids.table_1[some[1] : after[1]], grids.lookup_1[some[5] : after[5]], sides[1]
    _interpolate(level, HALF_WIDTH, place, inputs, row, point)
    row += grids.table_1.shape[1]
    level = grids.table_2[some[2] : after[2]], grids.lookup_2[some[6] : after[6]], sides[2]
    _interpolate(level, HALF_WIDTH, place, inputs, row, point)
    row += grids.table_2.shape[1]
    level = grids.table_3[some[3] : after[3]], grids.lookup_3[some[7] : after[7]], sides[3]
    _interpolate(level, HALF_WIDTH, place, inputs, row, point)
    row += grids.table_3.shape[1]
    squared = 0.0
    for axis in range(3):
        to_light[axis] = lights[view, axis] - position[axis]
        squared += to_light[axis] * to_light[axis]
    for axis in range(3):
        to_light[axis] /= max(math.sqrt(squared), 1e-9)
    lobe[point] = _incidence(
        normal, direction, to_light, grids.alpha2[thing], _LEAST_COSINE, inputs, row, point
    )
    _surroundings(
        position, normal, direction, lights[view], points.irradiance[point], inputs, row + ANGLES, point
    )  # fmt: skip
    row += ANGLES
    for term in range(LAMP_ROWS):
        inputs[row + POINT_ROWS + term, point] = lamp_terms[view, term]
    for term in range(INPUT_ROWS, PADDED_ROWS):
        inputs[term, point] = np.float32(0.0)


def _mirror(point, points: SurfacePoints, objects, volumes: Volumes, facets, met: Rays, trace: Trace):
    """Write what the mirror ray of a point meets, as `incidence.mirror_rays` and `first_hits` do."""
    ray = points.ray_of[point]
    met.view_of[point] = points.view_of[ray]
    own, first, _ = volumes_of(volumes, objects[points.view_of[ray]])
    flat, side = facets[first + points.face[ray]], points.side[point]
    normal, direction, mirrored = points.normal[point], points.direction[ray], met.direction[point]
    camera, rise, squared = 0.0, 0.0, 0.0
    for axis in range(3):
        camera -= normal[axis] * direction[axis]
    for axis in range(3):
        value = 2 * camera * normal[axis] + direction[axis]
        mirrored[axis] = value
        rise += side * flat[axis] * value
    for axis in range(3):
        mirrored[axis] += max(LEAST_MIRROR_COSINE - rise, 0.0) * side * flat[axis]
        squared += mirrored[axis] * mirrored[axis]
        trace.origin[0, axis] = points.position[point, axis] + SELF_OFFSET * side * flat[axis]
    for axis in range(3):
        mirrored[axis] /= math.sqrt(squared)
    meet(point, own, met, trace)


@scalar
def reflectance(point, c, answers, facing, fifth, lobe):
    """Return pi times the reflectance of a point in channel c; `fifth` is (1 - cosine)^5 at the light."""
    even, strength = 2 * _sigmoid(answers[point, EVEN + c]), answers[point, STRENGTH + c]
    if facing:
        gloss = _schlick(answers[point, FACING + c], fifth) * 2 * _sigmoid(strength)
    else:
        gloss = _softplus(strength)
    return _sigmoid(answers[point, ALBEDO + c]) * even + gloss * lobe


def _reflect(point, points: SurfacePoints, objects, mirrors, network: NetworkAnswers, reflected):
    """Write what a point reflects of the lamp to the mirror that its ray left, (points, 3)."""
    answers, inputs, lobe = network
    ray = points.ray_of[point]
    if mirrors[objects[points.view_of[ray]]]:
        fifth, light = inputs[FEATURE_ROWS + 7, point], np.float32(points.irradiance[point])
        for c in range(3):
            reflected[ray, c] = light * reflectance(point, c, answers, True, fifth, lobe[point])


def _colour(point, points: SurfacePoints, viewed: ViewedObjects, network: NetworkAnswers, reflected, colours):
    """Write the RGBA of the ray that meets a point; `reflected` (points, 3) matters to mirrors."""
    (objects, mirrors, radiance), (answers, inputs, lobe) = viewed, network
    ray = points.ray_of[point]
    number = objects[points.view_of[ray]]
    facing, light = mirrors[number], np.float32(points.irradiance[point])
    fifth, rim = inputs[FEATURE_ROWS + 7, point], np.float32(0.0)
    if facing:
        beside = 1.0
        for axis in range(3):
            beside += points.normal[point, axis] * points.direction[ray, axis]
        beside = min(max(beside, 0.0), 1.0)
        rim = np.float32(beside * beside * beside * beside * beside)
    for c in range(3):
        value = light * reflectance(point, c, answers, facing, fifth, lobe[point])
        value += _sigmoid(answers[point, ALBEDO + c]) * _softplus(answers[point, BOUNCED + c])
        if facing:
            value += _schlick(answers[point, FACING + c], rim) * reflected[point, c]
        colours[ray, c] = value * radiance[number]
    colours[ray, 3] = np.float32(1.0)


inputs = Body(_inputs, to_light=((3,), np.float64))
mirror = Body(_mirror, 1, **TRACE)
reflect, colour = Body(_reflect), Body(_colour)
