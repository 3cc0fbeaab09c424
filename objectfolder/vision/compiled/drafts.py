"""Drafts: what an object in an environment looks like while it moves, in a tenth of an image's time.

What no turn of the object changes is found once (precomputed radiance transfer: Sloan, Kautz and Snyder
2002): which directions each of some sites sees, and which other sites hide the rest. However the object is
turned, light at the sites is then two products, and a ray's matt colour is interpolated between them.
Highlights show the environment as blurred as they are wide, by the share of it that the place sees.
"""

import numpy as np
from scipy.sparse import csr_array

from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.lattice_values import LatticeLookup, mix
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.network import CompiledNetwork
from objectfolder.vision.compiled.radiosity import PITCH, SITES, nearest_sites
from objectfolder.vision.compiled.surroundings import SHARPER, looked_up
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.face_lattice import FaceLattice
from objectfolder.vision.network.incidence import SELF_OFFSET, UnitSurface
from objectfolder.vision.network.network_layout import LEAST_COSINE

DIRECTIONS, DRAFT_BOUNCES = 128, 2


class Draft:
    """A surface and the light that its sites exchange.

    Parameters
    ----------
    lit, surface
        The surface, for kernels and in its unit frame.
    network
        What reflects its light.
    """

    def __init__(self, lit: LitSurface, surface: UnitSurface, network: CompiledNetwork | KnownLight) -> None:
        self._lit, self._network = lit, network
        sample = surface.surface.sample(SITES, seed=0)
        sites = lit.points(sample.face, sample.barycentric, -lit.facets[sample.face])
        features, albedo = network.features(sites)
        even, _ = network.reflected(sites, features, np.arange(SITES), sites.normal, network.alpha2)
        self._albedo = (albedo * even).astype(np.float64)
        lattice = FaceLattice(surface.triangles, PITCH)
        self._near, self._share = nearest_sites(lit, lattice, sites)
        self._lookup = LatticeLookup(lattice)
        self._directions = _spread(DIRECTIONS)
        self._exchange(sites, lattice)

    def _exchange(self, sites: Points, lattice: FaceLattice) -> None:
        """Find what share each site takes from each direction, and from the sites that hide some of these."""
        facet = self._lit.facets[sites.face]
        cosine = sites.upright @ self._directions.T
        site, way = np.nonzero((cosine > 0) & (facet @ self._directions.T > 0))
        weight = cosine[site, way]
        weight /= np.maximum(np.bincount(site, weight, SITES), 1e-300)[site]
        start = sites.position + SELF_OFFSET * facet
        face, barycentric = self._lit.volumes.first_hits(start[site], self._directions[way])
        met = face >= 0
        self._all, self._clear = np.zeros((2, SITES, DIRECTIONS))
        self._all[site, way] = weight
        self._clear[site[~met], way[~met]] = weight[~met]
        sender = self._near[lattice.nearest_values(face[met], barycentric[met]), 0]
        self._sent = csr_array((weight[met], (site[met], sender)), shape=(SITES, SITES))

    def light(self, around: Environment, turn: np.ndarray) -> np.ndarray:
        """Return the values (v, 6) of the lattice: light of the environment and of the object that arrives.

        The former is a share of what nothing hides, the latter irradiance over pi. `turn` (3, 3) is from the
        object's frame to the environment's.
        """
        texels_a_direction = 2.0 * around.heights[0] ** 2 / DIRECTIONS
        level = np.full(DIRECTIONS, max(0.0, 0.5 * np.log2(texels_a_direction) - SHARPER))
        sky = looked_up(around.texels, around.heights, self._directions @ turn.T, level)
        plane, direct = self._all @ sky, self._clear @ sky
        share = np.divide(direct, plane, out=np.ones_like(plane), where=plane > 0)
        bounced, sending = np.zeros_like(direct), direct
        for _ in range(DRAFT_BOUNCES):
            sending = self._sent @ (self._albedo * sending)
            bounced += sending
        return mix(np.concatenate([share, bounced], axis=1), self._near, self._share)

    def radiance(self, points: Points, around: Environment, turn: np.ndarray) -> np.ndarray:
        """Return the radiance (n, 3) of points as rays meet them; `turn` is as of `light`."""
        features, albedo = self._network.features(points)
        cosine = np.einsum("ij,ij->i", points.normal, points.direction)[:, None]
        mirrored = points.direction - 2 * cosine * points.normal
        every = np.arange(len(albedo))
        even, gloss = self._network.reflected(points, features, every, mirrored, self._network.alpha2)
        is_known_light = isinstance(self._network, KnownLight)
        alpha2 = (
            features[:, :1].astype(np.float64)
            if is_known_light
            else np.full((len(albedo), 1), self._network.alpha2)
        )
        strength = gloss * (4 * alpha2) * np.maximum(cosine**2, LEAST_COSINE)
        share, bounced = np.split(
            self._lookup.interpolate(self.light(around, turn), points.face, points.barycentric), 2, axis=1
        )
        rows = len(around.irradiance)
        plane = looked_up(
            around.irradiance.reshape(-1, 3), np.array([rows]), points.normal @ turn.T, np.zeros(len(albedo))
        )
        # A lobe is about 4 pi alpha^2 wide, steradians.
        level = 0.5 * np.log2(np.maximum(2.0 * alpha2[:, 0] * around.heights[0] ** 2, 1.0))
        sky = looked_up(around.texels, around.heights, mirrored @ turn.T, level)
        radiance: np.ndarray = albedo * even * (plane / np.pi * share + bounced) + strength * sky * share
        return radiance


def _spread(count: int) -> np.ndarray:
    """Return unit directions (count, 3) as even as a spiral makes them."""
    index = np.arange(count) + 0.5
    height, azimuth = 1 - 2 * index / count, np.pi * (1 + np.sqrt(5)) * index
    level = np.sqrt(1 - height**2)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=1)
