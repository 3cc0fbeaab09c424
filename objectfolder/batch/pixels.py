"""What one pixel sees of the faces near a gel, through one of many sensors.

The arithmetic is in the type of the arrays: single precision is for graphics processors, double for
comparison with a single press. Of faces equally near the last is seen. A pixel is shaded once for each face
that is seen in it, amid the rays that see it.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from objectfolder.batch.targets import Body, scalar

MOST_PIXEL_RAYS = 16

# As of `point_lights.PointLights`; the material's last number is the exponent.
Lamps = namedtuple("Lamps", "camera positions colours material")
# The camera, and nodes and place as of `table_lighting.TableLighting`.
Table = namedtuple("Table", "camera nodes place")
# Where the faces of each touch begin, and `contact_bodies.Projections` of them.
Faces = namedtuple("Faces", "starts windows reach planes maps")
# Rays of a pixel, slopes u + shift and v of all, the gel along each, and numbers of the gel.
PixelRays = namedtuple("PixelRays", "of_pixel u shift v gel_nearness gel_values constants")
# Of all touches, as of `Touches`.
Images = namedtuple("Images", "rgb depth mask")
# Working memory of the rays of a pixel: the face that each sees, and one over its depth.
RaysOfPixel = namedtuple("RaysOfPixel", "owner best")


@scalar
def point_lights(point, normal, lamps):
    """Pixel value of a point with a normal of any length: `point_lights.PointLights`, point by point."""
    (x, y, z), (nx, ny, nz) = point, normal
    camera, lights, colours, material = lamps
    real = camera.dtype.type
    zero, one, least, four, half_turn = real(0), real(1), real(0.001), real(4), real(math.pi)
    alpha2, k, base, diffuse, exponent = material[0], material[1], material[2], material[3], material[4]
    inverse = one / math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx * inverse, ny * inverse, nz * inverse
    vx, vy, vz = camera[0] - x, camera[1] - y, camera[2] - z
    inverse = one / math.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * inverse, vy * inverse, vz * inverse
    nv = min(max(abs(nx * vx + ny * vy + nz * vz), least), one)
    visible = nv / (nv * (one - k) + k) * (alpha2 / half_turn)
    red, green, blue = zero, zero, zero
    for light in range(lights.shape[0]):
        lx, ly, lz = lights[light, 0] - x, lights[light, 1] - y, lights[light, 2] - z
        inverse = one / math.sqrt(lx * lx + ly * ly + lz * lz)
        falloff = inverse * inverse
        lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
        hx, hy, hz = lx + vx, ly + vy, lz + vz
        inverse = one / math.sqrt(hx * hx + hy * hy + hz * hz)
        nl = min(max(nx * lx + ny * ly + nz * lz, least), one)
        nh = min(max((nx * hx + ny * hy + nz * hz) * inverse, zero), one)
        miss = one - min(max((vx * hx + vy * hy + vz * hz) * inverse, zero), one)
        fresnel = base + (one - base) * (miss * miss) * (miss * miss) * miss
        lobe = nh * nh * (alpha2 - one) + one
        specular = fresnel * visible * nl
        specular /= (nl * (one - k) + k) * lobe * lobe * (four * nl * nv + least)
        reflected = nl * falloff * ((one - fresnel) * diffuse + specular)
        red += colours[light, 0] * reflected
        green += colours[light, 1] * reflected
        blue += colours[light, 2] * reflected
    return min(red, one) ** exponent, min(green, one) ** exponent, min(blue, one) ** exponent


@scalar
def photometric_table(point, normal, table):
    """Pixel value of a membrane with a normal of any length: as `table_lighting.TableLighting`."""
    (_, y, z), (nx, ny, nz) = point, normal
    camera, nodes, place = table
    real = camera.dtype.type
    zero, one, quarter_turn = real(0), real(1), real(math.pi / 2)
    slopes, directions = nodes.shape[0], nodes.shape[1]
    last, turns = real(slopes - 1), real(directions)
    row = min(math.atan2(math.sqrt(ny * ny + nz * nz), -nx) * (last / quarter_turn), last)
    column = math.atan2(nz, -ny) * (turns / (real(4) * quarter_turn))
    column = column + turns if column < zero else column
    lower, left = min(int(row), slopes - 2), int(column)
    down, along = row - real(lower), column - real(left)
    left = left % directions
    right = (left + 1) % directions
    first, second = (one - down) * (one - along), (one - down) * along
    third, fourth = down * (one - along), down * along
    across, up = (place[0] - y) / place[2], (z - place[1]) / place[3]
    red, green, blue = zero, zero, zero
    for term in range(6):
        weight = one  # of 1, a, b, a a, a b, b b
        if term == 1 or term == 3:
            weight = across
        elif term == 2 or term == 5:
            weight = up
        if term == 3 or term == 4:
            weight = weight * across if term == 3 else across * up
        elif term == 5:
            weight = weight * up
        a, b = nodes[lower, left], nodes[lower, right]
        c, d = nodes[lower + 1, left], nodes[lower + 1, right]
        red += weight * (first * a[term] + second * b[term] + third * c[term] + fourth * d[term])
        k = 6 + term
        green += weight * (first * a[k] + second * b[k] + third * c[k] + fourth * d[k])
        k = 12 + term
        blue += weight * (first * a[k] + second * b[k] + third * c[k] + fourth * d[k])
    return min(max(red, zero), one), min(max(green, zero), one), min(max(blue, zero), one)


def _pixel(shade: Callable[..., Any], lighting: Any) -> Callable[..., None]:
    def pixel(
        touch, place, faces: Faces, pixel_rays: PixelRays, light: lighting, no_contact, images: Images,
        memory: RaysOfPixel,
    ):  # fmt: skip
        starts, windows, reach, planes, maps = faces
        rays, u, shift, v, gel_nearness, gel_values, constants = pixel_rays
        (rgb, depth, mask), (owner, best), camera = images, memory, light.camera
        real = camera.dtype.type
        zero, one = real(0), real(1)
        width = u.shape[0]
        i, j = place // width, place % width
        covered = 0
        total, red, green, blue = zero, zero, zero, zero
        inside = reach[touch, 0] <= i <= reach[touch, 1] and reach[touch, 2] <= j <= reach[touch, 3]
        if inside:
            for ray in range(rays):
                owner[ray], best[ray] = -1, gel_nearness[i * rays + ray, j]
            limit = constants[0]
            for k in range(starts[touch], starts[touch + 1]):
                window = windows[k]
                if i < window[0] or i > window[1] or j < window[2] or j > window[3]:
                    continue
                plane = planes[k]
                for ray in range(rays):
                    across, up = u[j] + shift[i * rays + ray], v[i * rays + ray]
                    near = plane[9] + plane[10] * across + plane[11] * up
                    if near >= best[ray] and near < limit:
                        a = plane[0] + plane[1] * across + plane[2] * up
                        b = plane[3] + plane[4] * across + plane[5] * up
                        c = plane[6] + plane[7] * across + plane[8] * up
                        if a >= zero and b >= zero and c >= zero:
                            best[ray], owner[ray] = near, k
            for first in range(rays):
                face = owner[first]
                if face < 0:
                    continue
                count, near, across, up = zero, zero, zero, zero
                for ray in range(first, rays):
                    if owner[ray] == face:
                        count += one
                        near += best[ray]
                        across += u[j] + shift[i * rays + ray]
                        up += v[i * rays + ray]
                        owner[ray] = -1
                        covered += 1
                # Amid the rays that see the face: one over the depth is linear over it.
                distance, across, up = count / near, across / count, up / count
                m = maps[face]
                nx = m[0] + m[1] * across + m[2] * up
                ny = m[3] + m[4] * across + m[5] * up
                nz = m[6] + m[7] * across + m[8] * up
                x = camera[0] + distance
                y, z = camera[1] + distance * across, camera[2] + distance * up
                r, g, b = shade((x, y, z), (nx, ny, nz), light)
                red, green, blue = red + count * r, green + count * g, blue + count * b
                # The gel's sag without the cancellation of R - sqrt(R^2 - q).
                y, z = y - constants[2], z - constants[3]
                q, radius = y * y + z * z, constants[4]
                sag = constants[5] * q / (radius + math.sqrt(max(radius * radius - q, zero)))
                total += count * max(constants[1] - x - sag, zero)
        if covered == 0:
            rgb[touch, i, j, 0] = no_contact[i, j, 0]
            rgb[touch, i, j, 1] = no_contact[i, j, 1]
            rgb[touch, i, j, 2] = no_contact[i, j, 2]
            depth[touch, i, j], mask[touch, i, j] = np.float32(0), False
            return
        left, share, scale, half = real(rays - covered), one / real(rays), real(255), real(0.5)
        value = gel_values[i, j]
        rgb[touch, i, j, 0] = np.uint8((red + left * value[0]) * share * scale + half)
        rgb[touch, i, j, 1] = np.uint8((green + left * value[1]) * share * scale + half)
        rgb[touch, i, j, 2] = np.uint8((blue + left * value[2]) * share * scale + half)
        steps = constants[6]
        depth[touch, i, j] = np.float32(real(np.int32(total * share * steps)) / steps)
        mask[touch, i, j] = 2 * covered >= rays

    return pixel


@lru_cache(maxsize=4)
def pixel_body(table: bool, kind: type[np.floating[Any]]) -> Body:
    """Return the body for a photometric table or point lights, in a precision."""
    function = _pixel(photometric_table, Table) if table else _pixel(point_lights, Lamps)
    return Body(function, 2, owner=((MOST_PIXEL_RAYS,), np.int64), best=((MOST_PIXEL_RAYS,), kind))
