"""What one pixel sees of the faces near a gel, through one of many sensors.

The arithmetic is in the type of the arrays: single precision is for graphics processors, double for
comparison with a single press. Of faces equally near the last is seen. A pixel is shaded once for each face
that is seen in it, amid the rays that see it.

`Shadows` follow the lines of all fans of all pictures at once, as `objectfolder.touch.rendering.shadows` does
those of one. How dark each is where it crosses a row, or a column, is kept for the pixels between two.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from objectfolder.batch.resident import upload
from objectfolder.batch.targets import Body, Tensor, scalar, torch
from objectfolder.touch.rendering.shadows import ShadowCaster

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

# Pictures at a time: their lines take half a megabyte each.
SHADED_AT_ONCE = 1024
# As of `ShadowCaster`.
Casting = namedtuple("Casting", "fans lamps shares softness")
# Of touches: one over the depth, how far pixels are pressed in, the first and last row and column of those
# that are, -1 where there are none, and of each fan (touches, fans, 2) its first tangent and lines.
Pressings = namedtuple("Pressings", "nearness depth ends aims")


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


def _aim(touch, number, casting: Casting, ends, aims):
    """Write a fan's first tangent and how many lines it has: `shadows._lines`."""
    fan = casting.fans[number]
    lamp, axis, direction, tangent, step = casting.lamps[int(fan[0])], int(fan[1]), fan[2], fan[3], fan[4]
    along, beside, last = lamp[axis], lamp[1 - axis], int(fan[5]) - 1
    near, far = ends[touch, 2 * axis], ends[touch, 2 * axis + 1]
    first, count = 0, last + 1
    if min((near - along) * direction, (far - along) * direction) >= 1:
        low, high = math.inf, -math.inf
        for row in (near, far):
            for side in range(2):
                place = ends[touch, 2 - 2 * axis + side] - beside
                met = (place / abs(row - along) - tangent) / step
                low, high = min(low, met), max(high, met)
        first = min(max(math.floor(low) - 1, 0), last)
        count = max(min(math.ceil(high) + 1, last) - first + 1, 0)
    aims[touch, number, 0] = tangent + first * step
    aims[touch, number, 1] = count if ends[touch, 0] >= 0 else 0


@scalar
def fan_of(casting, pressings, touch, number):
    """Return a fan's axis and direction, its lamp along and across, and tangent, step and count of lines."""
    fan, aim = casting.fans[number], pressings.aims[touch, number]
    lamp, axis = casting.lamps[int(fan[0])], int(fan[1])
    return axis, int(fan[2]), (lamp[axis], lamp[1 - axis], lamp[2]), (aim[0], fan[4], int(aim[1]))


def _follow(touch, place, casting: Casting, pressings: Pressings, dark):
    """Write how dark (touches, fans, rows, lines) a line is in each row that it crosses; dark was 0."""
    (nearness, depth, ends, _), softness = pressings, casting.softness
    most = dark.shape[3]
    number, line = place // most, place % most
    axis, way, lamp, (tangent, step, count) = fan_of(casting, pressings, touch, number)
    if line >= count:
        return
    height, width = depth.shape[1 + axis], depth.shape[2 - axis]
    unity, half, lamp_nearness = np.float32(1), np.float32(0.5), np.float32(lamp[2])
    horizon, before, top = np.float32(-np.inf), np.float32(-np.inf), np.float32(0)
    row, past = ends[touch, 2 * axis], ends[touch, 2 * axis + 1]
    if way < 0:
        row, past = past, row
    row = row - way if 0 <= row - way < height else row
    while 0 <= row < height:
        at, distance, over = row, (row - lamp[0]) * way, (row - past) * way > 0
        row += way
        if distance <= 0:
            continue
        begin, spacing = lamp[1] + tangent * distance, step * distance
        if line < -begin / spacing or line > (width - 1 - begin) / spacing:
            continue
        far = np.float32(distance)
        inverse = unity / far
        column = np.float32(begin) + np.float32(spacing) * np.float32(line)
        j, pressed = min(int(column), width - 2), int(column + half)
        r = column - np.float32(j)
        if axis == 0:
            n = (unity - r) * nearness[touch, at, j] + r * nearness[touch, at, j + 1]
            away = depth[touch, at, pressed] > 0
        else:
            n = (unity - r) * nearness[touch, j, at] + r * nearness[touch, j + 1, at]
            away = depth[touch, pressed, at] > 0
        slope = (n - lamp_nearness) * inverse
        away = away and slope < before
        before = slope
        if slope < horizon:
            penumbra = softness[0] * (unity - top * inverse) + softness[1]
            hidden = (horizon - slope) * top / (n * n * penumbra)
            if not away:
                dark[touch, number, at, line] = min(hidden, unity)
        elif over:  # nothing hides the lamp from here on
            return
        else:
            horizon, top = slope, far


def _darken(touch, place, casting: Casting, pressings: Pressings, dark, rgb):
    """Take from a pixel what the lines beside it are dark."""
    width = rgb.shape[2]
    i, j = place // width, place % width
    unity, zero = np.float32(1), np.float32(0)
    red, green, blue = unity, unity, unity
    for number in range(casting.fans.shape[0]):
        axis, way, lamp, (tangent, step, count) = fan_of(casting, pressings, touch, number)
        at, column = (i, j) if axis == 0 else (j, i)
        distance = (at - lamp[0]) * way
        if count == 0 or distance <= 0 or abs(column - lamp[1]) > distance:
            continue
        begin, spacing = lamp[1] + tangent * distance, step * distance
        if column < begin or column > begin + count * spacing:
            continue
        line = np.float32(-begin / spacing) + np.float32(1 / spacing) * np.float32(column)
        line = max(line, zero)
        k = int(line)
        r = line - np.float32(k)
        shade = (unity - r) * dark[touch, number, at, k] + r * dark[touch, number, at, k + 1]
        share = casting.shares[int(casting.fans[number, 0])]
        red, green = red * (unity - share[0] * shade), green * (unity - share[1] * shade)
        blue *= unity - share[2] * shade
    half = np.float32(0.5)
    rgb[touch, i, j, 0] = np.uint8(np.float32(rgb[touch, i, j, 0]) * red + half)
    rgb[touch, i, j, 1] = np.uint8(np.float32(rgb[touch, i, j, 1]) * green + half)
    rgb[touch, i, j, 2] = np.uint8(np.float32(rgb[touch, i, j, 2]) * blue + half)


aim, follow, darken = Body(_aim, 2), Body(_follow, 2), Body(_darken, 2)


class Shadows:
    """What casts a sensor's shadows, on a device."""

    def __init__(self, caster: ShadowCaster, device: torch.device) -> None:
        self._gel_depth = upload(caster.gel_depth, device)
        self._casting = [
            upload(part, device) for part in (caster.fans, caster.lamps, caster.shares, caster.softness)
        ]
        # Room for two lines more than a fan has, which are never dark.
        self._shape = len(caster.fans), max(caster.gel_depth.shape), int(caster.fans[:, 5].max()) + 2

    def cast(self, rgb: Tensor, depth: Tensor) -> None:
        """Darken pictures (n, height, width, 3) by what is pressed in by depths (n, height, width)."""
        for first in range(0, len(rgb), SHADED_AT_ONCE):
            pictures, depths = rgb[first : first + SHADED_AT_ONCE], depth[first : first + SHADED_AT_ONCE]
            count, pressed = len(pictures), depths > 0
            sides = []
            for axis in (1, 2):
                lines = pressed.any(3 - axis)
                last = lines.shape[1] - 1 - lines.flip(1).byte().argmax(1)
                sides += [torch.where(lines.any(1), side, -1) for side in (lines.byte().argmax(1), last)]
            ends, nearness = torch.stack(sides, 1), 1 / (self._gel_depth - depths)
            aims = torch.empty((count, self._shape[0], 2), dtype=torch.float64, device=rgb.device)
            aim((count, self._shape[0]), *self._casting, ends, aims)
            parts = *self._casting, nearness, depths, ends, aims
            dark = depths.new_zeros((count, *self._shape))
            follow((count, self._shape[0] * self._shape[2]), *parts, dark)
            darken((count, depths[0].numel()), *parts, dark, pictures)
