"""Surfaces that rays of many views meet, on a device: first hits, normals, and what of a lamp arrives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from objectfolder.batch import sight_bodies
from objectfolder.batch.resident import joined_records, upload
from objectfolder.batch.sight_bodies import Rays, SurfacePoints
from objectfolder.batch.targets import Tensor, torch
from objectfolder.vision.compiled.lattice_values import LatticeLookup
from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.network.face_lattice import FaceLattice
from objectfolder.vision.visionnet.visionnet import VisionNet

# Columns of the maps beside albedo.
MAPS = {"roughness": slice(0, 1), "metallic": slice(1, 2), "normal": slice(2, 4)}
NO_LATTICE: tuple[np.ndarray, ...] = (
    np.zeros((0, 3), np.int64),
    *[np.zeros(0, np.int64)] * 3,
    np.zeros(0, np.int32),
)


@dataclass(frozen=True)
class Scene:
    """Views in the unit frames of their objects, whose numbers ascend."""

    objects: Tensor
    cameras: Tensor
    lights: Tensor
    lens: Tensor


def room_for_rays(count: int, device: torch.device) -> Rays:
    """Return room for rays and what they meet."""
    view, face = (torch.empty(count, dtype=torch.int32, device=device) for _ in range(2))
    direction, place = (torch.empty((count, 3), dtype=torch.float64, device=device) for _ in range(2))
    return Rays(view, direction, face, place)


def hits(rays: Rays) -> Tensor:
    """Return which rays (m,) meet something."""
    return torch.nonzero(rays.face >= 0)[:, 0]


def points_of(points: SurfacePoints, some: slice) -> SurfacePoints:
    """Return some of the points, and all rays."""
    return SurfacePoints(points.ray_of[some], *points[1:5], *(part[some] for part in points[5:]))


class Surfaces:
    """Surfaces of objects, with the maps that bend their normals.

    Parameters
    ----------
    nets
        VisionNets of the objects.
    lit
        Their surfaces as kernels take them.
    device
        Where.
    """

    def __init__(self, nets: Sequence[VisionNet], lit: Sequence[LitSurface], device: torch.device) -> None:
        self.device, self.count = device, len(nets)
        self.radiance = upload([net.radiance_scale for net in nets], device, np.float32)
        self.volumes = joined_records([surface.volumes for surface in lit], (0, 3), device)
        self.triangles = joined_records([surface._triangles for surface in lit], (), device)[1:]
        bends = [net._surface.bends for net in nets]
        self._any_bends = any(bends)
        self.stored = upload(bends, device), *joined_records([_stored(net) for net in nets], (0, 2), device)
        self.maps = joined_records([_maps(net) for net in nets], LATTICE_COUNTED, device)

    def cast(self, scene: Scene, place: Tensor, inside: Tensor) -> Rays:
        """Return rays through places `inside` (m, 2) each of pixels `place` (n,)."""
        count = len(place) * len(inside)
        rays = room_for_rays(count, self.device)
        sight_bodies.cast(
            count, place, inside, scene.objects, scene.cameras, scene.lens, *self.volumes, *rays
        )
        return rays

    def lit(self, scene: Scene, rays: Rays) -> SurfacePoints:
        """Return the points that rays meet, and what of the lamps arrives there."""
        ray = hits(rays)
        lit = [torch.empty((len(ray), *shape), dtype=torch.float64, device=self.device) for shape in POINT]
        lamps = scene.objects, scene.lights
        sight_bodies.light(len(ray), ray, *rays, *lamps, *self.volumes, *self.triangles, *lit)
        position, upright, side, irradiance = lit
        normal = upright
        if self._any_bends:
            normal = torch.empty_like(upright)
            sight_bodies.bend(len(ray), ray, *rays, *lamps, *self.stored, *self.maps, *lit, normal)
        return SurfacePoints(ray, *rays, position, normal, upright, side, irradiance)


# Shapes of position, normal, side and irradiance of a point.
POINT = (3,), (3,), (), ()
# Of the arrays of a lattice those that are counted apart: faces, owners, values.
LATTICE_COUNTED = 0, 4, 5


def on_lattice(lattice: FaceLattice | None, values: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return a lattice as kernels take it, and its values; None has no places."""
    places: tuple[np.ndarray, ...] = NO_LATTICE if lattice is None else LatticeLookup(lattice)._places
    return *places, values


def _maps(net: VisionNet) -> tuple[np.ndarray, ...]:
    """Return the maps beside albedo, on their lattice, (size, 4) uint8."""
    maps, lattice, values = net._maps, None, np.zeros((0, 4), dtype=np.uint8)
    for name, columns in MAPS.items():
        if maps is not None and name in maps:
            if lattice is None:
                lattice, values = maps.lattice(name), np.zeros((len(maps.levels[name]), 4), dtype=np.uint8)
            values[:, columns] = maps.levels[name]
    return on_lattice(lattice, values)


def _stored(net: VisionNet) -> tuple[np.ndarray, ...]:
    """Return what `sight_bodies.Stored` holds of faces; nothing of what has no maps."""
    surface, maps = net._surface, net._maps
    count = 0 if maps is None else len(surface.triangles)
    parent, corners = np.arange(count), np.broadcast_to(np.eye(3), (count, 3, 3))
    if surface._cut is not None:
        parent, corners = surface._cut.parent, surface._cut.corners
    return parent, corners, np.zeros(0, dtype=np.int64) if maps is None else maps._facing
