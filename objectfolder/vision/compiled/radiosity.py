"""Light that a matt surface sends onto itself, by radiosity between sites spread over it (Goral et al. 1984).

Nothing of it is stored: sites follow from a seed, and what they send one another from the surface. As in the
truth, a surface that light reaches from another is matt, and a metal black.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from objectfolder.jit import arrayless, relaxed_kernel
from objectfolder.vision.compiled.lattice_values import LatticeLookup, mix
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.network.face_lattice import FaceLattice
from objectfolder.vision.network.incidence import SELF_OFFSET, UnitSurface
from objectfolder.vision.network.material import Material

SITES, BOUNCES = 1500, 3
# Points a site: light that arrives at a site is the mean of what arrives at those nearest to it.
POINTS = 16
# The same of a coarse image, and its bounces: .1 dB of 47, and a third of the time of a new lamp.
COARSE_POINTS, COARSE_BOUNCES = 4, 2
# Steps of Lloyd's algorithm that spread the sites.
LLOYD_STEPS = 3
# Sites are as dense as the surface is near itself: by the mean of 1 / (distance + `DENSITY_DISTANCE`) along
# rays, and this share of its mean all over.
DENSITY_DISTANCE, EVERYWHERE, BOX = 0.05, 0.5, 16
# Sites whose exchange is found at a time.
SITES_AT_ONCE = 128
# Light is interpolated from so many sites to places this far apart, of which faces take it.
SITE_NEIGHBOURS, PITCH = 4, 1 / 64
# A turn of the normal by one radian is as far as this distance: walls have two sides. And a distance within
# which sites count alike.
TURN, ALIKE_DISTANCE = 0.25, 0.01
# Lights that a site is asked for at most.
ASKED = 128
# Sets of lights whose bounced light is remembered.
REMEMBERED = 64
# Places and colours (l, 3) of lights.
Lights = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Receivers:
    """Points (n,) that receive light for sites.

    Parameters
    ----------
    points, site, albedo
        The points, and their sites (n,) and base colours (n, 3).
    """

    points: Points
    site: np.ndarray
    albedo: np.ndarray

    def of(self, row: np.ndarray) -> "Receivers":
        """Return some of the points."""
        return Receivers(self.points.of(row), self.site[row], self.albedo[row])

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (s, c) at sites of values (n, c) at points."""
        count = np.maximum(np.bincount(self.site, minlength=SITES), 1)
        total = [np.bincount(self.site, column, minlength=SITES) for column in values.T]
        return np.stack(total, axis=1) / count[:, None]


class Radiosity:
    """Exchange of light between the sites of a surface.

    Parameters
    ----------
    lit, surface
        The surface, for kernels and in its unit frame.
    material
        What it is made of.
    """

    def __init__(self, lit: LitSurface, surface: UnitSurface, material: Material) -> None:
        self._lit = lit
        sample = surface.surface.sample(POINTS * SITES, seed=0)
        face, barycentric = sample.face, sample.barycentric
        self._points = lit.points(face, barycentric, -lit.facets[face])
        places = surface.in_stored(face, barycentric)
        matt = 1 - material.value("metallic", *places)
        albedo = material.value("albedo", *places) * matt[:, None]
        site, sites = self._spread()
        order = np.argsort(site, kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order)) - np.searchsorted(site[order], site[order])
        self._receivers = Receivers(self._points, site, albedo)
        self._few = self._receivers.of(np.flatnonzero(rank < COARSE_POINTS))
        self._sites = self._points.of(sites)
        self._albedo = self._receivers.mean(albedo)
        a, b, c = np.moveaxis(surface.triangles, 1, 0)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / len(face)
        self._exchange = self._exchanged(area * np.maximum(np.bincount(site, minlength=SITES), 1))
        lattice = FaceLattice(surface.triangles, PITCH)
        self._near, self._share = nearest_sites(lit, lattice, self._sites)
        self._lookup = LatticeLookup(lattice)
        self._fields: dict[bytes, np.ndarray] = {}

    def _spread(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the site (n,) of each point, and the point (s,) at which each site is."""
        random, places = np.random.default_rng(0), _places(self._points)
        facet = self._lit.facets[self._points.face]
        direction = random.normal(size=facet.shape)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        # From the plane's point on a unit sphere that it touches: as often as the cosine says.
        direction += 1.000001 * facet
        start = self._points.position + SELF_OFFSET * facet
        face, barycentric = self._lit.volumes.first_hits(start, direction)
        met = np.flatnonzero(face >= 0)
        end = self._lit.points(face[met], barycentric[met], direction[met]).position
        density = np.zeros(len(face))
        density[met] = 1 / (np.linalg.norm(end - start[met], axis=1) + DENSITY_DISTANCE)
        order = cKDTree(places[:, :3]).indices  # along its leaves: what follows is near
        smooth = np.convolve(np.pad(density[order], BOX, mode="edge"), np.ones(2 * BOX + 1), "valid")
        density[order] = smooth + EVERYWHERE * smooth.mean() + 1e-9
        total = np.cumsum(density[order])
        centre = places[order[np.searchsorted(total, (np.arange(SITES) + 0.5) / SITES * total[-1])]]
        for _ in range(LLOYD_STEPS):
            site = np.asarray(cKDTree(centre).query(places)[1])
            weight = np.bincount(site, density, minlength=SITES)
            total = [np.bincount(site, density * column, minlength=SITES) for column in places.T]
            some = weight > 0
            centre[some] = (np.stack(total, axis=1) / np.maximum(weight, 1e-12)[:, None])[some]
        return np.asarray(cKDTree(centre).query(places)[1]), np.asarray(cKDTree(places).query(centre)[1])

    def _exchanged(self, area: np.ndarray) -> np.ndarray:
        """Return the share (s, s) float32 of what site j, of areas (s,), sends that reaches site i."""
        position, normal = self._sites.position, self._sites.upright
        start = position + SELF_OFFSET * self._lit.facets[self._sites.face]
        exchange = np.zeros((SITES, SITES), dtype=np.float32)
        for first in range(0, SITES, SITES_AT_ONCE):
            rows = np.arange(first, min(first + SITES_AT_ONCE, SITES))
            # Each pair once: what i sees of j, j sees of i.
            columns = np.arange(first, SITES)
            way = position[columns] - position[rows][:, None]
            from_here = np.einsum("ijk,ik->ij", way, normal[rows])
            from_there = -np.einsum("ijk,jk->ij", way, normal[columns])
            i, j = np.nonzero((from_here > 0) & (from_there > 0) & (columns > rows[:, None]))
            square, both = (way[i, j] ** 2).sum(axis=1), from_here[i, j] * from_there[i, j]
            i, j = rows[i], columns[j]
            # Near sites are discs, not points.
            share = both / (np.pi * square * (square + np.sqrt(area[i] * area[j]) / np.pi))
            share[self._lit.volumes.occluded(start[i], start[j], np.ones(len(i), dtype=bool))] = 0.0
            exchange[i, j], exchange[j, i] = share * area[j], share * area[i]
        exchange /= np.maximum(exchange.sum(axis=1, keepdims=True), 1.0)
        return exchange

    def irradiance(
        self, lights: Lights, face: np.ndarray, barycentric: np.ndarray, direct: bool = False,
        coarse: bool = False,
    ) -> np.ndarray:  # fmt: skip
        """Return the irradiance (n, 3) that lights cause at points by way of the surface itself.

        The unit is that of `LitSurface.light_from`.

        Parameters
        ----------
        lights
            Places and colours (l, 3).
        direct
            Whether what arrives at sites on no way round is part of the answer.
        coarse
            Whether light is received at few points, and followed for one bounce less.
        """
        key = b"".join((lights[0].tobytes(), lights[1].tobytes(), bytes([direct, coarse])))
        field = self._fields.get(key)
        if field is None:
            # Views of a query are rendered by several threads: another may have made room.
            for oldest in list(self._fields)[: max(0, len(self._fields) + 1 - REMEMBERED)]:
                self._fields.pop(oldest, None)
            field = self._fields[key] = self._field(lights, direct, coarse)
        return self._lookup.interpolate(field, face, barycentric)

    def _field(self, lights: Lights, direct: bool, coarse: bool) -> np.ndarray:
        """Return the values (v, 3) of the lattice that `irradiance` is between."""
        receivers = self._few if coarse else self._receivers
        arriving = self._arriving(lights, receivers)
        sending = receivers.mean(arriving * receivers.albedo)
        total = receivers.mean(arriving) if direct else np.zeros((SITES, 3))
        for _ in range(COARSE_BOUNCES if coarse else BOUNCES):
            reached = np.empty((3, SITES), dtype=np.float32)
            _gather(self._exchange, np.ascontiguousarray(sending.T, dtype=np.float32), reached)
            total += reached.T
            sending = self._albedo * reached.T
        return mix(total, self._near, self._share)

    def _arriving(self, lights: Lights, receivers: Receivers) -> np.ndarray:
        """Return the irradiance (n, 3) of the points by lights."""
        arriving = np.zeros((len(receivers.site), 3))
        # Of many lights each is asked at some of the points, the next one at others.
        turns, parts = max(1, len(lights[0]) * POINTS // ASKED), [receivers]
        if turns > 1:
            parts = [receivers.of(np.arange(turn, len(arriving), turns)) for turn in range(turns)]
        for index, (light, colour) in enumerate(zip(*lights, strict=True)):
            irradiance, hidden = self._lit.light_from(parts[index % turns].points, light)
            irradiance[hidden] = 0.0
            arriving[index % turns :: turns] += turns * irradiance[:, None] * colour
        return arriving


def nearest_sites(lit: LitSurface, lattice: FaceLattice, sites: Points) -> tuple[np.ndarray, np.ndarray]:
    """Return the sites (v, k) nearest to each value of the lattice, in order, and their shares (v, k)."""
    face, barycentric = lattice.places(np.zeros((1, 2)))
    points = lit.points(face, barycentric, -lit.facets[face])
    place = lattice.mean(_places(points))
    distance, near = map(np.asarray, cKDTree(_places(sites)).query(place, SITE_NEIGHBOURS))
    share = 1 / (distance + ALIKE_DISTANCE) ** 2
    return near, share / share.sum(axis=1, keepdims=True)


@arrayless(relaxed_kernel)
def _gather(exchange, sending, reached):
    """Write the products (k, s) of a matrix (s, s) and columns (k, s), on every processor the same."""
    for i in range(len(exchange)):
        for k in range(len(sending)):
            total = np.float32(0.0)
            for j in range(exchange.shape[1]):
                total += exchange[i, j] * sending[k, j]
            reached[k, i] = total


def _places(points: Points) -> np.ndarray:
    """Return (n, 6) places that are as near as light makes points alike."""
    return np.concatenate([points.position, TURN * points.upright], axis=1)
