"""What rays of many views of several objects meet, what light arrives there, and the pixels that they make.

Each function computes one ray, point or pixel by the kernels of a single view. `offsets` (objects + 1, ...)
say where what belongs to each object begins. `ray_of` is the ray that meets a point; views, directions, faces
and barycentric coordinates are those of rays.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple
from typing import Any

import numpy as np

from objectfolder.batch.targets import Body, scalar
from objectfolder.vision.compiled.bounding_volumes import STACK, BoundingVolumes, _first_hits, _occluded
from objectfolder.vision.compiled.lattice_values import _interpolate
from objectfolder.vision.compiled.lighting import Triangles, _surface_points, _unhindered
from objectfolder.vision.compositing import SRGB_KNEE
from objectfolder.vision.network.incidence import SELF_OFFSET, TERMINATOR_COSINE
from objectfolder.vision.network.surface_maps import UPRIGHT

# Views: objects, poses of cameras; focal length, width and height in pixels.
Views = namedtuple("Views", "objects cameras lens")
# Bounding volumes of all objects, one behind the other.
Volumes = namedtuple("Volumes", "offsets boxes children counts triangles faces")
# View and direction of rays, and what they meet.
Rays = namedtuple("Rays", "view_of direction face barycentric")
# The ray that meets each point, and all rays.
PointRays = namedtuple("PointRays", "ray_of view_of direction face barycentric")
# Objects of views, and their lamps.
Lamps = namedtuple("Lamps", "objects places")
# Triangles of all objects, as of `lighting.Triangles`.
Meshes = namedtuple("Meshes", "corners corner_normals facets")
# Where points are, their normals without maps and sides, and what of the lamp reaches them.
Lit = namedtuple("Lit", "position upright side irradiance")
# Points with all about them: the ray that meets each, and all rays; normals as maps bend them, and without.
SurfacePoints = namedtuple(
    "SurfacePoints", "ray_of view_of direction face barycentric position normal upright side irradiance"
)
# Lattices on the faces of all objects: `LatticeLookup`'s arrays, and values at their places.
Lattices = namedtuple("Lattices", "offsets corners columns rows start owner values")
# Whether maps bend the normals of objects. Of the faces that rays meet: that of the stored surface which each
# is a piece of, and its corners there. Of stored faces the way that they look.
Stored = namedtuple("Stored", "bends offsets parent corners facing")
# Working memory of a ray, of what shades a point, and of a place on a stored surface.
Trace = namedtuple("Trace", "origin stack entry hit where")
Shade = namedtuple("Shade", "start lit blocked v n stack")
Place = namedtuple("Place", "parent inside levels")
# Column of the first part of a bent normal in maps beside albedo.
BENT_COLUMN = 2


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


@scalar
def lattice_of(lattices, number):
    """Return the places of an object's lattice, and the values there."""
    some, after = lattices.offsets[number], lattices.offsets[number + 1]
    places = (
        lattices.corners[some[0] : after[0]], lattices.columns[some[0] : after[0]],
        lattices.rows[some[0] : after[0]], lattices.start[some[0] : after[0]],
        lattices.owner[some[1] : after[1]],
    )  # fmt: skip
    return places, lattices.values[some[2] : after[2]]


@scalar
def place_on(stored, number, face, barycentric, place):
    """Write where on the stored surface of an object a point is."""
    piece = stored.offsets[number, 0] + face
    place.parent[0] = stored.parent[piece]
    for k in range(3):
        place.inside[0, k] = (
            barycentric[0] * stored.corners[piece, 0, k]
            + barycentric[1] * stored.corners[piece, 1, k]
            + barycentric[2] * stored.corners[piece, 2, k]
        )


@scalar
def meet(ray, own, rays, trace):
    """Write the face (-1: none) and place that a ray from `trace.origin` meets."""
    trace.hit[0] = -1
    _first_hits(
        own, trace.origin, rays.direction[ray : ray + 1], trace.stack, trace.entry, trace.hit, trace.where
    )
    rays.face[ray] = trace.hit[0]
    for corner in range(3):
        rays.barycentric[ray, corner] = trace.where[0, corner] if trace.hit[0] >= 0 else 0.0


@scalar
def shine(own, surface, met, lamp, irradiance, shade):
    """Write what of a lamp (1, 3) reaches a point past the object to `irradiance` (1,)."""
    start, lit, blocked, v, n, stack = shade
    irradiance[0] = 0.0
    _unhindered(met, lamp, surface, TERMINATOR_COSINE, SELF_OFFSET, irradiance, start, (v, n))
    lit[0], blocked[0] = irradiance[0] > 0, False
    _occluded(own, start, lamp, lit, stack, blocked)
    if blocked[0]:
        irradiance[0] = 0.0


@scalar
def bent_share(upright, bent, position, lamp):
    """Return what `incidence.bent_share` does of a point and a lamp (3,)."""
    cosine, after, turned, squared = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        way = lamp[axis] - position[axis]
        squared += way * way
        cosine += upright[axis] * way
        after += bent[axis] * way
        turned += upright[axis] * bent[axis]
    scale = 1.0 / max(math.sqrt(squared), 1e-9)
    cosine, after, turned = max(cosine * scale, 1e-9), max(after * scale, 0.0), max(turned, 1e-9)
    width2 = min(max((1 / (turned * turned) - 1) / 8, 0.0), 1.0)
    left = 2 / (1 + math.sqrt(1 + width2 * max(1 / (cosine * cosine) - 1, 0.0)))
    return left * after / cosine


def _cast(ray, place_of, inside, views: Views, volumes: Volumes, rays: Rays, trace: Trace):
    """Write the view and the direction of a ray, and the face (-1: none) and place that it meets.

    `place_of` are pixels, view by view and row by row, and `inside` the places in each that have a ray.
    """
    objects, cameras, lens = views
    count, width, height = inside.shape[0], int(lens[1]), int(lens[2])
    place, inner = place_of[ray // count], ray % count
    view, pixel = place // (width * height), place % (width * height)
    row, column = pixel // width, pixel % width
    rays.view_of[ray] = view
    x = (column + inside[inner, 0] - lens[1] / 2) / lens[0]
    y = (lens[2] / 2 - row - inside[inner, 1]) / lens[0]
    pose, squared = cameras[view], 0.0
    for axis in range(3):
        trace.origin[0, axis] = pose[axis, 3]
        value = x * pose[axis, 0] + y * pose[axis, 1] - pose[axis, 2]
        rays.direction[ray, axis] = value
        squared += value * value
    for axis in range(3):
        rays.direction[ray, axis] /= math.sqrt(squared)
    own, _, _ = volumes_of(volumes, objects[view])
    meet(ray, own, rays, trace)


def _light(
    point, rays: PointRays, lamps: Lamps, volumes: Volumes, meshes: Meshes, points: Lit, shade: Shade
):  # fmt: skip
    """Write where a point is, its normal, and what of the lamp reaches it past the object."""
    position, upright, side, irradiance = points
    ray, row = rays.ray_of[point], slice(point, point + 1)
    view, beam = rays.view_of[ray], slice(ray, ray + 1)
    own, first, end = volumes_of(volumes, lamps.objects[view])
    surface = Triangles(
        meshes.corners[first:end], meshes.corner_normals[first:end], meshes.facets[first:end]
    )  # fmt: skip
    face, barycentric = rays.face[beam], rays.barycentric[beam]
    _surface_points(
        face, barycentric, rays.direction[beam], surface, position[row], upright[row], side[row]
    )  # fmt: skip
    met = face, barycentric, position[row], upright[row], side[row]
    shine(own, surface, met, lamps.places[view : view + 1], irradiance[row], shade)


def _bend(
    point, rays: PointRays, lamps: Lamps, stored: Stored, maps: Lattices, points: Lit, normal, place: Place
):  # fmt: skip
    """Write the normal as a map bends it, and what that leaves of the light: `SurfaceMaps.bent`."""
    ray = rays.ray_of[point]
    view = rays.view_of[ray]
    number, side, upright = lamps.objects[view], points.side[point], points.upright[point]
    for axis in range(3):
        normal[point, axis] = upright[axis]
    if not stored.bends[number]:
        return
    place_on(stored, number, rays.face[ray], rays.barycentric[ray], place)
    places, values = lattice_of(maps, number)
    _interpolate(places, values, place.parent, place.inside, place.levels)
    u, v = (
        (place.levels[0, BENT_COLUMN] - UPRIGHT) / UPRIGHT,
        (place.levels[0, BENT_COLUMN + 1] - UPRIGHT) / UPRIGHT,
    )
    rise = math.sqrt(max(1.0 - u * u - v * v, 0.0))
    x, y, z = side * upright[0], side * upright[1], side * upright[2]
    axis = (stored.facing[stored.offsets[number, 1] + place.parent[0]] // 2 + 1) % 3
    along = side * upright[axis]
    ax = (1.0 if axis == 0 else 0.0) - along * x
    ay = (1.0 if axis == 1 else 0.0) - along * y
    az = (1.0 if axis == 2 else 0.0) - along * z
    length = math.sqrt(ax * ax + ay * ay + az * az)
    scale = 1.0 / length if length > 1e-3 else 0.0
    ax, ay, az = ax * scale, ay * scale, az * scale
    bx = u * ax + v * (y * az - z * ay) + rise * x
    by = u * ay + v * (z * ax - x * az) + rise * y
    bz = u * az + v * (x * ay - y * ax) + rise * z
    scale = side / max(math.sqrt(bx * bx + by * by + bz * bz), 1e-12)
    normal[point, 0], normal[point, 1], normal[point, 2] = bx * scale, by * scale, bz * scale
    points.irradiance[point] *= bent_share(
        upright, normal[point], points.position[point], lamps.places[view]
    )  # fmt: skip


@scalar
def _show(rgba, shown, place):
    """Write a pixel's `compositing.composite_on_white`."""
    one, zero, knee = np.float32(1.0), np.float32(0.0), np.float32(SRGB_KNEE)
    alpha = rgba[place, 3]
    for c in range(3):
        straight = min(max(rgba[place, c] / max(alpha, np.float32(1e-30)), zero), one)
        if straight <= knee:
            curved = np.float32(12.92) * straight
        else:
            curved = np.float32(1.055) * straight ** np.float32(1 / 2.4) - np.float32(0.055)
        shown[place, c] = alpha * curved + (one - alpha)


def _blend(number, place_of, colours, rgba, shown):
    """Write the mean RGBA of the rays of a pixel, and its `compositing.composite_on_white`."""
    place, rays = place_of[number], colours.shape[0] // place_of.shape[0]
    for c in range(4):
        total = np.float32(0.0)
        for ray in range(number * rays, (number + 1) * rays):
            total += colours[ray, c]
        rgba[place, c] = total / np.float32(rays)
    _show(rgba, shown, place)


def _cover(number, place_of, share_of, rgba, shown):
    """Give a pixel another coverage, with the colour that it has."""
    place, zero = place_of[number], np.float32(0.0)
    scale = share_of[number] / max(rgba[place, 3], np.float32(1e-30))
    for c in range(4):
        rgba[place, c] *= scale
    if share_of[number] == zero:
        for c in range(4):
            rgba[place, c] = zero
    _show(rgba, shown, place)


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


TRACE: dict[str, Any] = {
    "origin": ((1, 3), np.float64),
    "stack": ((STACK,), np.int32),
    "entry": ((STACK,), np.float32),
    "hit": ((1,), np.int32),
    "where": ((1, 3), np.float64),
}
SHADE: dict[str, Any] = {
    "start": ((1, 3), np.float64),
    "lit": ((1,), np.bool_),
    "blocked": ((1,), np.bool_),
    "v": ((3, 3), np.float64),
    "n": ((3, 3), np.float64),
    "stack": ((STACK,), np.int32),
}
PLACE: dict[str, Any] = {
    "parent": ((1,), np.int64),
    "inside": ((1, 3), np.float64),
    "levels": ((1, 4), np.float64),
}
cast = Body(_cast, 1, **TRACE)
light = Body(_light, 1, **SHADE)
bend = Body(_bend, 1, **PLACE)
blend = Body(_blend)
cover = Body(_cover)
uneven = Body(_uneven)
