"""Light from all round: few lights a pixel in turn for what is matt, sampled directions for highlights.

Light adds up, so that each part of what is reflected is summed in the way that suits it. What is matt is the
irradiance of a plane that nothing hides, times the share that `LIGHTS_A_PIXEL` lights of the environment find
arriving and reflected; neighbouring pixels ask other lights (interleaved sampling, Keller and Heidrich 2001).
The highlight is seen along directions drawn from it (visible normals, Heitz 2018) in a map as blurred as
these are sparse (filtered importance sampling, Krivanek and Colbert 2008).
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from dataclasses import dataclass

import numpy as np

from objectfolder.jit import kernel
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.network import CompiledNetwork
from objectfolder.vision.environment import LIGHTS, Environment
from objectfolder.vision.network.incidence import SELF_OFFSET
from objectfolder.vision.network.network_layout import LEAST_COSINE

# Unit-frame lengths to a light that is taken as infinitely far.
FAR = 1e4
LIGHTS_A_PIXEL = 32
# Every so many of these lights tells the bounced light: the network knows it of lamps at distance 1.
BOUNCED_STEP = 8
# Lookups are in a map finer than the sparseness of directions, by this many halvings.
SHARPER = 1.0
# Irrational steps of a sequence that fills the unit square evenly (Roberts 2018).
STEPS = (0.7548776662466927, 0.5698402909980532)
# A highlight that reflects more than this is looked at along four times as many directions.
STRONG = 0.1


@dataclass(frozen=True)
class Cast:
    """Where points (n,) are in an image, int64: whatever is drawn for them follows from this.

    Parameters
    ----------
    columns, rows
        Pixels of the image.
    order, count
        Number of the point in its pixel, and how many there are.
    """

    columns: np.ndarray
    rows: np.ndarray
    order: np.ndarray
    count: np.ndarray

    def of(self, row: np.ndarray) -> "Cast":
        """Return some of the points."""
        return Cast(self.columns[row], self.rows[row], self.order[row], self.count[row])


@dataclass(frozen=True)
class Gathered:
    """Light of an environment that reaches points, (n, 3) each over the albedo.

    Parameters
    ----------
    arriving, unhindered
        Of the lights that the pixel asks: what is reflected, and the irradiance but for shadow.
    bounced
        Light that comes off the object.
    """

    arriving: np.ndarray
    unhindered: np.ndarray
    bounced: np.ndarray

    def of(self, row: np.ndarray) -> "Gathered":
        """Return some of the points."""
        return Gathered(self.arriving[row], self.unhindered[row], self.bounced[row])

    @property
    def share(self) -> np.ndarray:
        """Share of a plane's irradiance that is reflected; 1 where no light asked faces the point."""
        everything = np.ones_like(self.arriving)
        return np.divide(self.arriving, self.unhindered, out=everything, where=self.unhindered > 0)


@dataclass(frozen=True)
class Highlit:
    """Points (n,) whose highlights are asked for; the network's features and matt radiance (n, 3) there."""

    points: Points
    features: np.ndarray
    matt: np.ndarray


class Surroundings:
    """An environment round a surface.

    Parameters
    ----------
    surface, network
        Of the object.
    environment
        Its light.
    """

    def __init__(
        self, surface: LitSurface, network: CompiledNetwork | KnownLight, environment: Environment
    ) -> None:
        self._surface, self._network, self._environment = surface, network, environment

    def gathered(self, points: Points, cast: Cast, bounces: bool = True) -> Gathered:
        """Return what reaches points; without `bounces` no light comes off the object."""
        network, around = self._network, self._environment
        features, _ = network.features(points)
        arriving, unhindered, bounced, told = (np.zeros((len(features), 3)) for _ in range(4))
        turns = LIGHTS // LIGHTS_A_PIXEL
        turn = (4 * (cast.rows % 4) + cast.columns % 4) * 5 % turns
        if bounces and isinstance(network, KnownLight):
            bounced = network.bounced_round(points, features, around)
        for index in range(LIGHTS_A_PIXEL):
            light = index * turns + (turn + 3 * index) % turns
            direction, power = around.directions[light], around.powers[light]
            irradiance, hidden = self._surface.light_from(points, FAR * direction)
            irradiance *= FAR**2
            unhindered += irradiance[:, None] * power
            irradiance[hidden] = 0.0
            lit = np.flatnonzero(irradiance)
            even, _ = network.reflected(points, features, lit, direction[lit], network.alpha2)
            arriving[lit] += irradiance[lit, None] * power[lit] * even
            due = bounces and index % BOUNCED_STEP == BOUNCED_STEP // 2
            if due and not isinstance(network, KnownLight):
                # As strong as the far light is at the point.
                square = ((direction - points.position) ** 2).sum(axis=1)
                lamps = network.lamps(around.directions)
                there = network.bounced(points, features, light, lamps, irradiance / square)
                bounced += power * square[:, None] * there
                told += power
        if told.any():
            total = around.powers.sum(axis=0)
            bounced *= np.divide(total, told, out=np.zeros_like(told), where=told > 0)
        return Gathered(arriving, unhindered, bounced)

    def outlined(self, points: Points, gathered: Gathered) -> tuple[np.ndarray, np.ndarray]:
        """Return about what `shown` does, as if highlights saw even light that nothing hides."""
        features, albedo = self._network.features(points)
        plane = self._plane(points)
        return plane * albedo * gathered.share, plane * self._strength(points, features, self._network.alpha2)

    def _strength(self, points: Points, features: np.ndarray, alpha2: np.float32) -> np.ndarray:
        """Return about the share (n, 3) that the highlight reflects: what it does to the mirror's side."""
        cosine = np.einsum("ij,ij->i", points.normal, points.direction)[:, None]
        mirrored = points.direction - 2 * cosine * points.normal
        _, gloss = self._network.reflected(points, features, np.arange(len(features)), mirrored, alpha2)
        answer: np.ndarray = gloss * (4 * alpha2) * np.maximum(cosine**2, LEAST_COSINE)
        return answer

    def _plane(self, points: Points) -> np.ndarray:
        """Return the irradiance (n, 3) of planes that nothing hides."""
        table = self._environment.irradiance
        level = np.zeros(len(points.normal))
        answer: np.ndarray = looked_up(table.reshape(-1, 3), np.array([len(table)]), points.normal, level)
        return answer

    def shown(
        self, points: Points, gathered: Gathered, cast: Cast, samples: int, alpha2: np.float32
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return pi times the radiance of points, (n, 3) matt and (n, 3) highlight, and about the latter.

        The last is the highlight as of `outlined`.

        Parameters
        ----------
        gathered
            What reaches them.
        samples
            Directions of a point's highlight; four times as many where it is strong.
        alpha2
            Square of the highlight's GGX width.
        """
        features, albedo = self._network.features(points)
        plane = self._plane(points)
        colour = albedo * (plane * gathered.share + gathered.bounced)
        lit = Highlit(points, features, colour / np.pi)
        everywhere = np.arange(len(albedo))
        gloss = self._highlight(lit, cast, everywhere, np.arange(samples), alpha2)
        # Not by what the first directions show: to go on where these are bright would darken the mean.
        strength = self._strength(points, features, alpha2)
        strong = np.flatnonzero(strength.max(axis=1) > STRONG)
        more = self._highlight(lit, cast, strong, np.arange(samples, 4 * samples), alpha2)
        gloss[strong] = (gloss[strong] + 3 * more) / 4
        return colour, np.pi * gloss, plane * strength

    def _highlight(
        self, lit: Highlit, cast: Cast, row: np.ndarray, samples: np.ndarray, alpha2: np.float32
    ) -> np.ndarray:
        """Return radiance (m, 3) of the highlights of points `row` (m,) along their directions `samples`."""
        around, count, points = self._environment, len(samples), lit.points
        light = np.zeros((len(row), 3))
        facet = self._surface.facets[points.face[row]] * points.side[row, None]
        start = points.position[row] + SELF_OFFSET * facet
        starts = scattered(cast.of(row))
        # Directions that see the pixel, those of its other points among them.
        seeing = cast.count[row] * (samples[-1] + 1 if count else 1)
        texel = 2 * np.pi / around.heights[0] ** 2  # steradians, in the mean
        for sample in samples:
            drawn = [(part + sample * step) % 1.0 for part, step in zip(starts, STEPS, strict=True)]
            direction, density = lobe_directions(
                points.normal[row], facet, -points.direction[row], float(alpha2), *drawn, LEAST_COSINE
            )
            sent = density > 0
            _, gloss = self._network.reflected(
                points, lit.features, row[sent], np.ascontiguousarray(direction[sent]), alpha2
            )
            cosine = np.einsum("ij,ij->i", direction[sent], points.normal[row[sent]])
            weight = gloss * (cosine / (np.pi * density[sent]))[:, None]
            clear = ~self._surface.volumes.occluded(start, start + FAR * direction, sent)[sent]
            sparse = 1.0 / (seeing[sent] * density[sent])
            level = 0.5 * np.log2(sparse / texel) - SHARPER
            seen = looked_up(around.texels, around.heights, direction[sent], level)
            # What hides the map is the object itself, as bright as the point in the mean.
            light[sent] += weight * np.where(clear[:, None], seen, lit.matt[row[sent]]) / count
        return light

    def in_mirrors(self, points: Points, cast: Cast, samples: int) -> np.ndarray:
        """Return pi times the radiance (n, 3) of the surface as points show it."""
        answer = np.zeros((len(points.face), 3))
        if not isinstance(self._network, KnownLight) and self._network.mirrors:
            row, met = self._surface.mirrored(points)
            gathered = self.gathered(met, cast.of(row), bounces=False)
            matt, gloss, _ = self.shown(met, gathered, cast.of(row), samples, self._network.mirror_alpha2)
            answer[row] = self._network.fresnel(points.of(row)) * (matt + gloss)
        return answer


def scattered(cast: Cast) -> tuple[np.ndarray, np.ndarray]:
    """Return two numbers (n,) of [0, 1) for points, evenly spread for those of one pixel."""
    bits = (cast.columns * 0x9E3779B1) ^ (cast.rows * 0x85EBCA77)
    for shift, factor in ((16, 0x21F0AAAD), (15, 0x735A2D97)):
        bits = ((bits ^ (bits >> shift)) & 0xFFFFFFFF) * factor & 0xFFFFFFFF
    bits ^= bits >> 15
    starts = (bits & 0xFFFF) / 65536, (bits >> 16) / 65536
    first, second = (
        (start + 64 * cast.order * step) % 1.0 for start, step in zip(starts, STEPS, strict=True)
    )
    return first, second


@kernel
def lobe_directions(normal, facet, to_camera, alpha2, first, second, least_cosine):
    """Draw directions (n, 3) from GGX lobes, and their densities (n,) over solid angle, 0 below the surface.

    Half vectors are drawn as the camera sees them (Heitz 2018).
    """
    count = len(normal)
    direction, density = np.zeros((count, 3)), np.zeros(count)
    alpha = math.sqrt(alpha2)
    for i in range(count):
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        # Two axes across the normal (Duff et al. 2017).
        sign = 1.0 if nz >= 0 else -1.0
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        x0, x1, x2 = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
        y0, y1, y2 = b, sign + ny * ny * a, -ny
        cx, cy, cz = to_camera[i, 0], to_camera[i, 1], to_camera[i, 2]
        vx, vy = x0 * cx + x1 * cy + x2 * cz, y0 * cx + y1 * cy + y2 * cz
        vz = max(nx * cx + ny * cy + nz * cz, least_cosine)
        scale = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
        # The lobe stretched to a hemisphere, seen from the camera as a disc.
        sx, sy, sz = alpha * vx, alpha * vy, vz
        scale = 1.0 / math.sqrt(sx * sx + sy * sy + sz * sz)
        sx, sy, sz = sx * scale, sy * scale, sz * scale
        flat = math.sqrt(sx * sx + sy * sy)
        tx, ty = (-sy / flat, sx / flat) if flat > 1e-7 else (1.0, 0.0)
        radius, angle = math.sqrt(first[i]), 2 * math.pi * second[i]
        p, q = radius * math.cos(angle), radius * math.sin(angle)
        half = 0.5 * (1.0 + sz)
        q = (1.0 - half) * math.sqrt(max(1.0 - p * p, 0.0)) + half * q
        r = math.sqrt(max(1.0 - p * p - q * q, 0.0))
        hx, hy = alpha * (p * tx - q * sz * ty + r * sx), alpha * (p * ty + q * sz * tx + r * sy)
        hz = max(q * (sx * ty - sy * tx) + r * sz, 1e-6)
        scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx * scale, hy * scale, hz * scale
        along = 2.0 * (vx * hx + vy * hy + vz * hz)
        lx, ly, lz = along * hx - vx, along * hy - vy, along * hz - vz
        dx, dy, dz = x0 * lx + y0 * ly + nx * lz, x1 * lx + y1 * ly + ny * lz, x2 * lx + y2 * ly + nz * lz
        if lz <= 1e-4 or dx * facet[i, 0] + dy * facet[i, 1] + dz * facet[i, 2] <= 0:
            continue
        direction[i, 0], direction[i, 1], direction[i, 2] = dx, dy, dz
        width = alpha2 * hz * hz + hx * hx + hy * hy
        masked = vz + math.sqrt(alpha2 + (1.0 - alpha2) * vz * vz)
        density[i] = alpha2 / (math.pi * width * width) / (2.0 * masked)
    return direction, density


@kernel
def looked_up(texels, heights, directions, level):
    """Return (n, 3) radiance along directions, linear in a pyramid of maps and between its levels (n,).

    `texels` and `heights` are as of `environment.Environment`.
    """
    count, last = len(directions), len(heights) - 1
    answer = np.zeros((count, 3))
    for i in range(count):
        at = min(max(level[i], 0.0), float(last))
        fine = min(int(at), last)
        first = 0
        for k in range(fine):
            first += 2 * heights[k] * heights[k]
        polar = math.acos(min(max(directions[i, 2], -1.0), 1.0)) / math.pi
        turn = 0.5 - math.atan2(directions[i, 1], directions[i, 0]) / (2 * math.pi)
        for k in range(fine, min(fine + 2, last + 1)):
            share = 1.0 - abs(at - k)
            height, width = heights[k], 2 * heights[k]
            y, x = polar * height - 0.5, turn * width - 0.5
            row, column = math.floor(y), math.floor(x)
            for down in range(2):
                for right in range(2):
                    weight = share * (1.0 - abs(y - row - down)) * (1.0 - abs(x - column - right))
                    above = min(max(int(row) + down, 0), height - 1)
                    texel = first + above * width + (int(column) + right) % width
                    for channel in range(3):
                        answer[i, channel] += weight * texels[texel, channel]
            first += 2 * height * height
    return answer
