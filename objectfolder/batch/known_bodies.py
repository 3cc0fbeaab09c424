"""Colours of points of known material: light in closed form, light by way of the surface, and its gloss.

Each function computes one point, direction or site by the kernels of a single view; see `sight_bodies`.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple
from typing import Any

import numpy as np

from objectfolder.batch.sight_bodies import (
    PLACE,
    SHADE,
    TRACE,
    Lamps,
    Lattices,
    Meshes,
    Shade,
    Stored,
    SurfacePoints,
    Trace,
    Volumes,
    bent_share,
    lattice_of,
    meet,
    place_on,
    shine,
    volumes_of,
)
from objectfolder.batch.targets import Body, scalar
from objectfolder.vision.compiled.lattice_values import _interpolate, _mix
from objectfolder.vision.compiled.lighting import Triangles
from objectfolder.vision.compiled.lobes import SEQUENCE_STEPS, _lobe_directions
from objectfolder.vision.compiled.principled import LEAST_ROUGHNESS, _reflected, _terms
from objectfolder.vision.compositing import SRGB_KNEE
from objectfolder.vision.network.incidence import SELF_OFFSET
from objectfolder.vision.network.network_layout import LEAST_COSINE
from objectfolder.vision.network.surface_maps import MAP_WHOLE

# Levels of a map from 0 to 1, alike for albedo, roughness and metallic.
WHOLE = MAP_WHOLE["albedo"]
FIRST_STEP, SECOND_STEP = SEQUENCE_STEPS

# Objects of views. Of objects: roughness and metallic where no map has them, and whether one does;
# `Principled`'s tables, and its upright reflection, the mean of it and index.
Looks = namedtuple("Looks", "objects constants mapped white mean rise levels")
# Whether maps bend objects' normals, and their sites: the first of each object, the points at which light is
# asked for a site, which follow one another, and these.
Sites = namedtuple("Sites", "bends rows starts face barycentric position normal upright side albedo")
# Lamps of views, their numbers, and what they send by way of the surface.
Shown = namedtuple("Shown", "places lamp fields")
# Of points: terms of `Principled`, and the base colour.
Substance = namedtuple("Substance", "terms base")
# Of points: their terms, directions of the gloss of each, and two numbers from which they are drawn.
Drawn = namedtuple("Drawn", "terms samples first second")
# Directions of gloss as `Rays`, with the shares of what they meet.
Glossy = namedtuple("Glossy", "view_of direction face barycentric share")
# Working memory.
Base = namedtuple("Base", "parent inside levels colour three rough metal")
Lobe = namedtuple("Lobe", "facet towards width u v density row even gloss origin stack entry hit where")
Light = namedtuple("Light", "row to_light even gloss three")
Arriving = namedtuple("Arriving", "irradiance start lit blocked v n stack")


@scalar
def decoded(value):
    """As `compositing.srgb_decode`."""
    value = min(max(value, 0.0), 1.0)
    return value / 12.92 if value <= 12.92 * SRGB_KNEE else ((value + 0.055) / 1.055) ** 2.4


def _substance(
    point, points: SurfacePoints, looks: Looks, stored: Stored, albedo: Lattices, others: Lattices,
    substance: Substance, base: Base,
):  # fmt: skip
    """Write terms and base colour of a point: `KnownLight.features`."""
    ray = points.ray_of[point]
    number = looks.objects[points.view_of[ray]]
    place_on(stored, number, points.face[ray], points.barycentric[ray], base)
    places, values = lattice_of(albedo, number)
    _interpolate(places, values, base.parent, base.inside, base.three)
    for c in range(3):
        base.colour[0, c] = decoded(base.three[0, c] / WHOLE)
        substance.base[point, c] = base.colour[0, c]
    base.rough[0], base.metal[0] = looks.constants[number, 0], looks.constants[number, 1]
    if looks.mapped[number, 0] or looks.mapped[number, 1]:
        places, values = lattice_of(others, number)
        _interpolate(places, values, base.parent, base.inside, base.levels)
        if looks.mapped[number, 0]:
            base.rough[0] = base.levels[0, 0] / WHOLE
        if looks.mapped[number, 1]:
            base.metal[0] = base.levels[0, 1] / WHOLE
    row, levels = slice(point, point + 1), looks.levels[number]
    _terms(
        points.normal[row], points.direction[ray : ray + 1], (base.colour, base.rough, base.metal),
        (looks.white[number], looks.mean[number], looks.rise[number]), levels[0], levels[1], LEAST_ROUGHNESS,
        substance.terms[row],
    )  # fmt: skip


def _radiate(
    point, points: SurfacePoints, looks: Looks, shown: Shown, substance: Substance, bounced: Lattices,
    radiance, light: Light,
):  # fmt: skip
    """Write what (points, 3) a point sends of the lamp, reflected once or by way of the surface."""
    ray, row = points.ray_of[point], slice(point, point + 1)
    view, beam = points.view_of[ray], slice(ray, ray + 1)
    number, squared = looks.objects[view], 0.0
    for axis in range(3):
        light.to_light[0, axis] = shown.places[view, axis] - points.position[point, axis]
        squared += light.to_light[0, axis] * light.to_light[0, axis]
        light.even[0, axis], light.gloss[0, axis], light.three[0, axis] = 0.0, 0.0, 0.0
    for axis in range(3):
        light.to_light[0, axis] /= max(math.sqrt(squared), 1e-9)
    light.row[0] = 0
    if points.irradiance[point] != 0.0:
        _reflected(
            (light.row, light.to_light), points.normal[row], points.upright[row], points.direction[beam],
            substance.terms[row], looks.levels[number, 2], light.even, light.gloss,
        )  # fmt: skip
    places, some = lattice_of(bounced, number)
    if len(some):
        _interpolate(
            places, shown.fields[shown.lamp[view]], points.face[beam], points.barycentric[beam], light.three
        )
    for c in range(3):
        once = substance.base[point, c] * light.even[0, c] + light.gloss[0, c]
        again = substance.base[point, c] * substance.terms[point, 2] * light.three[0, c]
        radiance[point, c] = points.irradiance[point] * once + again


def _scatter(
    number, points: SurfacePoints, looks: Looks, lobes: Drawn, volumes: Volumes, facets, met: Glossy,
    lobe: Lobe,
):  # fmt: skip
    """Write a direction of a point's gloss, what it meets, and what share of that is sent on."""
    point, sample = number // lobes.samples, number % lobes.samples
    ray, row = points.ray_of[point], slice(point, point + 1)
    view, here = points.view_of[ray], slice(number, number + 1)
    own, first, _ = volumes_of(volumes, looks.objects[view])
    for axis in range(3):
        lobe.facet[0, axis] = points.side[point] * facets[first + points.face[ray], axis]
        lobe.towards[0, axis] = -points.direction[ray, axis]
        lobe.origin[0, axis] = points.position[point, axis] + SELF_OFFSET * lobe.facet[0, axis]
        met.direction[number, axis], met.share[number, axis] = 0.0, 0.0
    lobe.u[0] = (lobes.first[point] + sample * FIRST_STEP) % 1.0
    lobe.v[0] = (lobes.second[point] + sample * SECOND_STEP) % 1.0
    lobe.width[0], lobe.density[0], lobe.row[0] = lobes.terms[point, 0], 0.0, 0
    met.view_of[number], met.face[number] = view, -1
    _lobe_directions(
        (points.normal[row], lobe.facet, lobe.towards), lobe.width, (lobe.u, lobe.v), LEAST_COSINE,
        (met.direction[here], lobe.density),
    )  # fmt: skip
    if not lobe.density[0] > 0:
        return
    _reflected(
        (lobe.row, met.direction[here]), points.normal[row], points.upright[row],
        points.direction[ray : ray + 1], lobes.terms[row], looks.levels[looks.objects[view], 2],
        lobe.even, lobe.gloss,
    )  # fmt: skip
    cosine = 0.0
    for axis in range(3):
        cosine += met.direction[number, axis] * points.normal[point, axis]
    for c in range(3):
        met.share[number, c] = lobe.gloss[0, c] * cosine / (lobes.samples * math.pi * lobe.density[0])
    meet(number, own, met, Trace(lobe.origin, lobe.stack, lobe.entry, lobe.hit, lobe.where))


def _gather(point, samples, row_of, share, sent, radiance):
    """Add what the gloss of a point shows; `row_of` directions are rows of `sent` (n, 3), or -1."""
    for number in range(point * samples, (point + 1) * samples):
        if row_of[number] >= 0:
            for c in range(3):
                radiance[point, c] += share[number, c] * sent[row_of[number], c]


def _send(
    lamp, site, lamps: Lamps, volumes: Volumes, meshes: Meshes, sites: Sites, sending, arriving: Arriving
):  # fmt: skip
    """Write what (sites, lamps, 3) a site sends of the light that reaches it straight from a lamp."""
    number, place = lamps.objects[lamp], lamps.places[lamp : lamp + 1]
    row = sites.rows[number] + site
    for c in range(3):
        sending[site, lamp, c] = np.float32(0.0)
    if row >= sites.rows[number + 1]:
        return
    own, first, end = volumes_of(volumes, number)
    surface = Triangles(
        meshes.corners[first:end], meshes.corner_normals[first:end], meshes.facets[first:end]
    )  # fmt: skip
    irradiance, start, lit, blocked, v, n, stack = arriving
    shade = Shade(start, lit, blocked, v, n, stack)
    red, green, blue, first_point, after = 0.0, 0.0, 0.0, sites.starts[row], sites.starts[row + 1]
    for k in range(first_point, after):
        here = slice(k, k + 1)
        met = (
            sites.face[here],
            sites.barycentric[here],
            sites.position[here],
            sites.upright[here],
            sites.side[here],
        )
        shine(own, surface, met, place, irradiance, shade)
        if irradiance[0] > 0:
            if sites.bends[number]:
                irradiance[0] *= bent_share(sites.upright[k], sites.normal[k], sites.position[k], place[0])
            red += irradiance[0] * sites.albedo[k, 0]
            green += irradiance[0] * sites.albedo[k, 1]
            blue += irradiance[0] * sites.albedo[k, 2]
    count = max(after - first_point, 1)
    sending[site, lamp, 0] = red / count
    sending[site, lamp, 1] = green / count
    sending[site, lamp, 2] = blue / count


def _spread(lamp, value, objects, total, bounced: Lattices, shares, fields):
    """Write what (lamps, values, 3) arrives at a place of the lattice from the sites nearest to it."""
    some = bounced.offsets[objects[lamp]], bounced.offsets[objects[lamp] + 1]
    row = some[0][2] + value
    if row < some[1][2]:
        here = slice(row, row + 1)
        _mix(total[lamp], bounced.values[here], shares[here], fields[lamp, value : value + 1])


LIGHT: dict[str, Any] = {
    "row": ((1,), np.int64),
    "to_light": ((1, 3), np.float64),
    "even": ((1, 3), np.float32),
    "gloss": ((1, 3), np.float32),
    "three": ((1, 3), np.float64),
}
substance = Body(
    _substance, 1, **PLACE, colour=((1, 3), np.float64), three=((1, 3), np.float64),
    rough=((1,), np.float64), metal=((1,), np.float64),
)  # fmt: skip
radiate = Body(_radiate, 1, **LIGHT)
scatter = Body(
    _scatter, 1, **TRACE, facet=((1, 3), np.float64), towards=((1, 3), np.float64),
    width=((1,), np.float64), u=((1,), np.float64), v=((1,), np.float64), density=((1,), np.float64),
    row=((1,), np.int64), even=((1, 3), np.float32), gloss=((1, 3), np.float32),
)  # fmt: skip
gather = Body(_gather)
send = Body(_send, 2, **SHADE, irradiance=((1,), np.float64))
spread = Body(_spread, 2)
