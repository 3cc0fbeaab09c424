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
from objectfolder.vision.compiled.known_light import INFINITE_DISTANCE, OFFSET, KnownLight
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.lobes import Cast, lobe_directions, scattered, stepped
from objectfolder.vision.compiled.network import CompiledNetwork
from objectfolder.vision.environment import MAP_LIGHTS, Environment
from objectfolder.vision.network.incidence import SELF_OFFSET
from objectfolder.vision.network.network_layout import LEAST_COSINE

LIGHTS_A_PIXEL = 32
# Of known material: .7 and 1.3 dB more of a mug than by 32, for a tenth of the time.
KNOWN_LIGHTS_A_PIXEL = 128
# Every so many of these lights tells the bounced light: the network knows it of lamps at distance 1.
BOUNCED_STEP = 8
# Lookups are in a map finer than the sparseness of directions, by this many halvings.
SHARPER = 1.0
# Times that a highlight shows highlights.
REFLECTIONS = 1
# A highlight that reflects more than this is looked at along four times as many directions.
STRONG = 0.1


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
        arriving, unhindered, bounced, sampled = (np.zeros((len(features), 3)) for _ in range(4))
        lights = KNOWN_LIGHTS_A_PIXEL if isinstance(network, KnownLight) else LIGHTS_A_PIXEL
        turns = MAP_LIGHTS // lights
        turn = (4 * (cast.rows % 4) + cast.columns % 4) * 5 % turns
        if bounces and isinstance(network, KnownLight):
            bounced = network.bounced_round(points, features, around)
        for index in range(lights):
            light = index * turns + (turn + 3 * index) % turns
            direction, power = around.directions[light], around.powers[light]
            irradiance, hidden = self._surface.light_from(points, INFINITE_DISTANCE * direction)
            irradiance *= INFINITE_DISTANCE**2
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
                radiance = network.bounced(points, features, light, lamps, irradiance / square)
                bounced += power * square[:, None] * radiance
                sampled += power
        if sampled.any():
            total = around.powers.sum(axis=0)
            bounced *= np.divide(total, sampled, out=np.zeros_like(sampled), where=sampled > 0)
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
        self,
        lit: Highlit,
        cast: Cast,
        row: np.ndarray,
        samples: np.ndarray,
        alpha2: np.float32,
        reflections: int = REFLECTIONS,
    ) -> np.ndarray:
        """Return radiance (m, 3) of the highlights of points `row` (m,) along their directions `samples`.

        What they show of the object has highlights itself, `reflections` deep, where its material is known.
        """
        around, count, points = self._environment, len(samples), lit.points
        light = np.zeros((len(row), 3))
        facet = self._surface.facets[points.face[row]] * points.side[row, None]
        start = points.position[row] + SELF_OFFSET * facet
        starts = scattered(cast.of(row))
        is_known = isinstance(self._network, KnownLight)
        widths = lit.features[row, 0].astype(np.float64) if is_known else np.full(len(row), float(alpha2))
        # Directions that see the pixel, those of its other points among them.
        seeing = cast.count[row] * (samples[-1] + 1 if count else 1)
        texel = 2 * np.pi / around.heights[0] ** 2  # steradians, in the mean
        for sample in samples:
            direction, density = lobe_directions(
                points.normal[row],
                facet,
                -points.direction[row],
                widths,
                *stepped(starts, sample),
                LEAST_COSINE,
            )
            sent = density > 0
            _, gloss = self._network.reflected(
                points, lit.features, row[sent], np.ascontiguousarray(direction[sent]), alpha2
            )
            cosine = np.einsum("ij,ij->i", direction[sent], points.normal[row[sent]])
            weight = gloss * (cosine / (np.pi * density[sent]))[:, None]
            rays = start[sent], np.ascontiguousarray(direction[sent])
            clear, met = self._met(*rays, lit.matt[row[sent]], cast.of(row[sent]), reflections)
            sparse = 1.0 / (seeing[sent] * density[sent])
            level = 0.5 * np.log2(sparse / texel) - SHARPER
            sky = looked_up(around.texels, around.heights, direction[sent], level)
            light[sent] += weight * np.where(clear[:, None], sky, met) / count
        return light

    def _met(
        self, start: np.ndarray, direction: np.ndarray, matt: np.ndarray, cast: Cast, reflections: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return which (n,) rays meet nothing, and the radiance (n, 3) of the object where they meet it.

        Learned light of places that no ray of the camera meets is as bright as the rays' starts, `matt`.
        """
        network, volumes = self._network, self._surface.volumes
        if not isinstance(network, KnownLight):
            return ~volumes.occluded(
                start, start + INFINITE_DISTANCE * direction, np.ones(len(start), dtype=bool)
            ), matt
        face, barycentric = volumes.first_hits(start, direction)
        met, radiance = np.flatnonzero(face >= 0), np.zeros((len(face), 3))
        points = self._surface.points(face[met], barycentric[met], direction[met])
        appearance = network.features(points)
        radiance[met] = network.matt_round(points, appearance, self._environment) / np.pi
        if reflections and len(met):
            again = cast.of(met)
            again = Cast(again.columns, again.rows, (1 + again.order) * OFFSET, again.count)
            lit, all_met = Highlit(points, appearance[0], radiance[met]), np.arange(len(met))
            # One direction each: few rays meet the object, and each of these is one of many.
            radiance[met] += self._highlight(
                lit, again, all_met, np.arange(1), network.alpha2, reflections - 1
            )
        return face < 0, radiance

    def in_mirrors(self, points: Points, cast: Cast, samples: int) -> np.ndarray:
        """Return pi times the radiance (n, 3) of the surface as points show it."""
        answer = np.zeros((len(points.face), 3))
        if not isinstance(self._network, KnownLight) and self._network.mirrors:
            row, met = self._surface.mirrored(points)
            gathered = self.gathered(met, cast.of(row), bounces=False)
            matt, gloss, _ = self.shown(met, gathered, cast.of(row), samples, self._network.mirror_alpha2)
            answer[row] = self._network.fresnel(points.of(row)) * (matt + gloss)
        return answer


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
