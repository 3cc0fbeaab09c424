"""Light that a matt surface sends onto itself, by radiosity between sites spread over it (Goral et al. 1984).

Nothing of it is stored: sites follow from a seed, and what they send one another from the surface. As in the
truth, a surface that light reaches from another is matt, and a metal black.
"""

import numpy as np
from scipy.spatial import cKDTree

from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.face_lattice import FaceLattice
from objectfolder.vision.network.incidence import SELF_OFFSET, UnitSurface
from objectfolder.vision.network.material import Material

SITES, BOUNCES = 2000, 3
# Sites whose exchange is found at a time.
ROWS = 128
# Light is interpolated from so many sites to places this far apart, of which faces take it.
NEIGHBOURS, PITCH = 6, 1 / 64
# A turn of the normal by one radian is as far as this distance: walls have two sides. And a distance within
# which sites count alike.
TURN, NEAR = 0.25, 0.01
# Unit-frame lengths to a light that is taken as infinitely far.
FAR = 1e4
# Lamps whose light is remembered.
REMEMBERED = 64


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
        sample = surface.surface.sample(SITES, seed=0)
        face, barycentric = sample.face, sample.barycentric
        facet = lit.facets[face]
        self._sites = lit.points(face, barycentric, -facet)
        places = surface.in_stored(face, barycentric)
        matt = 1 - material.value("metallic", *places)
        self._albedo = material.value("albedo", *places) * matt[:, None]
        a, b, c = np.moveaxis(surface.triangles, 1, 0)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / SITES
        self._exchange = self._exchanged(facet, float(area))
        self._lattice = FaceLattice(surface.triangles, PITCH)
        self._near, self._share = self._interpolation(surface)
        self._fields: dict[bytes, np.ndarray] = {}

    def _exchanged(self, facet: np.ndarray, area: float) -> np.ndarray:
        """Return the share (s, s) float32 of what site j sends that reaches site i."""
        position, normal = self._sites.position, self._sites.upright
        start = position + SELF_OFFSET * facet
        exchange = np.zeros((SITES, SITES), dtype=np.float32)
        for first in range(0, SITES, ROWS):
            rows = np.arange(first, min(first + ROWS, SITES))
            # Each pair once: what i sees of j, j sees of i.
            columns = np.arange(first, SITES)
            way = position[columns] - position[rows][:, None]
            from_here = np.einsum("ijk,ik->ij", way, normal[rows])
            from_there = -np.einsum("ijk,jk->ij", way, normal[columns])
            i, j = np.nonzero((from_here > 0) & (from_there > 0) & (columns > rows[:, None]))
            square = (way[i, j] ** 2).sum(axis=1)
            # Near sites are discs, not points.
            share = from_here[i, j] * from_there[i, j] * area / (np.pi * square * (square + area / np.pi))
            i, j = rows[i], columns[j]
            hidden = self._lit.volumes.occluded(start[i], start[j], np.ones(len(i), dtype=bool))
            exchange[i, j] = exchange[j, i] = np.where(hidden, 0.0, share)
        exchange /= np.maximum(exchange.sum(axis=1, keepdims=True), 1.0)
        return exchange

    def _interpolation(self, surface: UnitSurface) -> tuple[np.ndarray, np.ndarray]:
        """Return the sites (v, k) nearest to each value of the lattice, and their shares (v, k)."""
        face, barycentric = self._lattice.places(np.zeros((1, 2)))
        points = self._lit.points(face, barycentric, -self._lit.facets[face])
        place = self._lattice.mean(np.concatenate([points.position, TURN * points.upright], axis=1))
        sites = np.concatenate([self._sites.position, TURN * self._sites.upright], axis=1)
        distance, near = map(np.asarray, cKDTree(sites).query(place, NEIGHBOURS))
        share = 1 / (distance + NEAR) ** 2
        return near, share / share.sum(axis=1, keepdims=True)

    def from_lamp(self, light: np.ndarray, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return the irradiance (n, 3) that a lamp at (3,) causes at points by way of the surface itself.

        The unit is that of `LitSurface.light_from`.
        """
        key = light.tobytes()
        if key not in self._fields:
            irradiance, hidden = self._lit.light_from(self._sites, light)
            self._remember(key, np.where(hidden, 0.0, irradiance)[:, None])
        return self._lattice.interpolate(self._fields[key], face, barycentric)

    def from_environment(self, around: Environment, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return the irradiance (n, 3) that an environment causes at points by way of the surface itself."""
        key = around.directions.tobytes() + around.powers.tobytes()
        if key not in self._fields:
            arriving = np.zeros((SITES, 3))
            for direction, power in zip(around.directions, around.powers, strict=True):
                irradiance, hidden = self._lit.light_from(self._sites, FAR * direction)
                arriving += np.where(hidden, 0.0, irradiance * FAR**2)[:, None] * power
            self._remember(key, arriving)
        return self._lattice.interpolate(self._fields[key], face, barycentric)

    def _remember(self, key: bytes, arriving: np.ndarray) -> None:
        """Find what light that arrives at sites (s, 1 or 3) causes elsewhere."""
        while len(self._fields) >= REMEMBERED:
            del self._fields[next(iter(self._fields))]
        bounced = np.zeros((SITES, 3))
        for _ in range(BOUNCES):
            arriving = self._exchange @ (self._albedo * arriving).astype(np.float32)
            bounced += arriving
        self._fields[key] = np.einsum("vk,vkc->vc", self._share, bounced[self._near])
