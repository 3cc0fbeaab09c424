"""What rays of many views of several objects meet, what light arrives there, and the colours that it makes.

Each function computes one ray, point or pixel by the kernels of a single view. `offsets` (objects + 1, 3)
says where nodes, faces and, at each level, lookups and features of each object begin. `ray_of` is the ray
that meets a point; views, directions, faces and barycentric coordinates are those of rays.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple
from typing import Any

import numpy as np

from objectfolder.batch.targets import Body, scalar
from objectfolder.vision.compiled.bounding_volumes import STACK, BoundingVolumes, _first_hits, _occluded
from objectfolder.vision.compiled.lighting import Triangles, _surface_points, _unhindered
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


# Views: objects, poses of cameras; focal length, width and height in pixels.
Views = namedtuple("Views", "objects cameras lens")
# Bounding volumes of all objects, one behind the other.
Volumes = namedtuple("Volumes", "offsets boxes children counts triangles faces")
# View and direction of rays, and what they meet.
Rays = namedtuple("Rays", "view_of direction face barycentric")
# The ray that meets each point; views and directions of rays.
PointRays = namedtuple("PointRays", "ray_of view_of direction")
# Objects of views, and their lamps.
Lamps = namedtuple("Lamps", "objects places")
LampTerms = namedtuple("LampTerms", "objects places terms")
# Triangles of all objects, as of `lighting.Triangles`, and what rays meet of them.
Meshes = namedtuple("Meshes", "corners corner_normals facets")
Hits = namedtuple("Hits", "face barycentric")
# Where points are, their normals and sides, and what of the lamp reaches them.
Lit = namedtuple("Lit", "position normal side irradiance")
# Feature grids of all objects, and widths of their highlights.
Grids = namedtuple(
    "Grids", "offsets resolutions table_0 table_1 table_2 table_3 lookup_0 lookup_1 lookup_2 lookup_3 alpha2"
)
# What the network takes of a point.
Shaded = namedtuple("Shaded", "position normal direction irradiance")
# The network's inputs and answers, and the lobes of highlights.
NetworkInputs = namedtuple("NetworkInputs", "inputs lobe")
NetworkAnswers = namedtuple("NetworkAnswers", "answers inputs lobe")
# Points that may be mirrors.
Mirrors = namedtuple("Mirrors", "facets face position normal side direction")
# Of objects of views: whether they have mirrors, and the scale of their radiance.
ViewedObjects = namedtuple("ViewedObjects", "objects mirrors radiance")
# Working memory of a ray, and of what shades a point.
Trace = namedtuple("Trace", "origin stack entry hit where")
Shade = namedtuple("Shade", "start lit blocked v n stack")


@scalar
def volumes_of(volumes, number):
    """Return the bounding volumes of an object, and the numbers of its first face and of the next one's."""
    some, after = volumes.offsets[number], volumes.offsets[number + 1]
    own = BoundingVolumes(
        volumes.boxes[some[0] : after[0]], volumes.children[some[0] : after[0]],
        volumes.counts[some[0] : after[0]], volumes.triangles[some[1] : after[1]],
        volumes.faces[some[1] : after[1]],
    )  # fmt: skip
    return own, some[1], after[1]


def _cast(ray, place_of, inside, views: Views, volumes: Volumes, rays: Rays, trace: Trace):
    """Write the view and the direction of a ray, and the face (-1: none) and place that it meets.

    `place_of` are pixels, view by view and row by row, and `inside` the places in each that have a ray.
    """
    (objects, cameras, lens), (origin, stack, entry, hit, where) = views, trace
    view_of, direction, face, barycentric = rays
    count, width, height = inside.shape[0], int(lens[1]), int(lens[2])
    place, inner = place_of[ray // count], ray % count
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
    own, _, _ = volumes_of(volumes, objects[view])
    hit[0] = -1
    _first_hits(own, origin, direction[ray : ray + 1], stack, entry, hit, where)
    face[ray] = hit[0]
    if hit[0] >= 0:
        for corner in range(3):
            barycentric[ray, corner] = where[0, corner]


def _light(
    point, rays: PointRays, lamps: Lamps, volumes: Volumes, meshes: Meshes, hits: Hits, points: Lit,
    shade: Shade,
):  # fmt: skip
    """Write where a point is, its normal, and what of the lamp reaches it past the object."""
    (position, normal, side, irradiance), (start, lit, blocked, v, n, stack) = points, shade
    ray, row = rays.ray_of[point], slice(point, point + 1)
    view, beam = rays.view_of[ray], slice(ray, ray + 1)
    own, first, end = volumes_of(volumes, lamps.objects[view])
    surface = Triangles(
        meshes.corners[first:end], meshes.corner_normals[first:end], meshes.facets[first:end]
    )  # fmt: skip
    lamp, face, barycentric = lamps.places[view : view + 1], hits.face[beam], hits.barycentric[beam]
    _surface_points(
        face, barycentric, rays.direction[beam], surface, position[row], normal[row], side[row]
    )  # fmt: skip
    irradiance[point] = 0.0
    met = face, barycentric, position[row], normal[row], side[row]
    _unhindered(met, lamp, surface, TERMINATOR_COSINE, SELF_OFFSET, irradiance[row], start, (v, n))
    lit[0], blocked[0] = irradiance[point] > 0, False
    _occluded(own, start, lamp, lit, stack, blocked)
    if blocked[0]:
        irradiance[point] = 0.0


def _inputs(
    point, ray_of, view_of, lamps: LampTerms, grids: Grids, shaded: Shaded, network: NetworkInputs, to_light
):  # fmt: skip
    """Write the network's inputs of a point, a column of `inputs`, and the lobe of its highlight."""
    (objects, lights, lamp_terms), (inputs, lobe) = lamps, network
    position, normal, direction, irradiance = shaded
    ray = ray_of[point]
    view = view_of[ray]
    thing = objects[view]
    some, after, sides = grids.offsets[thing], grids.offsets[thing + 1], grids.resolutions[thing]
    place = position[point, 0], position[point, 1], position[point, 2]
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
        to_light[axis] = lights[view, axis] - position[point, axis]
        squared += to_light[axis] * to_light[axis]
    for axis in range(3):
        to_light[axis] /= max(math.sqrt(squared), 1e-9)
    lobe[point] = _incidence(
        normal[point], direction[ray], to_light, grids.alpha2[thing], _LEAST_COSINE, inputs, row, point
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
    point, ray_of, view_of, objects, volumes: Volumes, mirrors: Mirrors, met: Rays, trace: Trace
):  # fmt: skip
    """Write what the mirror ray of a point meets, as `incidence.mirror_rays` and `first_hits` do."""
    facets, face, position, normal, side, direction = mirrors
    met_view, met_direction, met_face, met_barycentric = met
    origin, stack, entry, hit, where = trace
    ray = ray_of[point]
    met_view[point] = view_of[ray]
    own, first, _ = volumes_of(volumes, objects[view_of[ray]])
    flat = facets[first + face[ray]]
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
    _first_hits(own, origin, met_direction[point : point + 1], stack, entry, hit, where)
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


def _reflect(point, ray_of, view_of, objects, mirrors, network: NetworkAnswers, irradiance, reflected):
    """Write what a point reflects of the lamp to the mirror that its ray left, (points, 3)."""
    answers, inputs, lobe = network
    ray = ray_of[point]
    if mirrors[objects[view_of[ray]]]:
        fifth, light = inputs[FEATURE_ROWS + 7, point], np.float32(irradiance[point])
        for c in range(3):
            reflected[ray, c] = light * _scalar_reflected(point, c, answers, True, fifth, lobe[point])


def _colour(
    point, rays: PointRays, viewed: ViewedObjects, network: NetworkAnswers, irradiance, normal, reflected,
    colours,
):  # fmt: skip
    """Write the RGBA of the ray that meets a point; `reflected` (points, 3) matters to mirrors."""
    (objects, mirrors, radiance), (answers, inputs, lobe) = viewed, network
    ray, direction = rays.ray_of[point], rays.direction
    number = objects[rays.view_of[ray]]
    facing, light = mirrors[number], np.float32(irradiance[point])
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
        colours[ray, c] = value * radiance[number]
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
