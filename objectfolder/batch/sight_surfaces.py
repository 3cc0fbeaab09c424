"""Surfaces that rays of many views meet, on a device: first hits, normals, and what of a lamp arrives."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from objectfolder.batch import sight_bodies
from objectfolder.batch.resident import joined_records, upload
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


@dataclass(frozen=True)
class Rays:
    """Rays (n,) and what they meet: `face` is -1 where that is nothing."""

    view: Tensor
    direction: Tensor
    face: Tensor
    barycentric: Tensor

    @classmethod
    def empty(cls, count: int, device: torch.device) -> "Rays":
        """Return room for rays."""
        view, face = (torch.empty(count, dtype=torch.int32, device=device) for _ in range(2))
        direction, place = (torch.empty((count, 3), dtype=torch.float64, device=device) for _ in range(2))
        return cls(view, direction, face, place)

    @property
    def arrays(self) -> tuple[Tensor, ...]:
        """The parameters, as kernels take them."""
        return self.view, self.direction, self.face, self.barycentric

    def hits(self) -> Tensor:
        """Return which rays (m,) meet something."""
        return torch.nonzero(self.face >= 0)[:, 0]


@dataclass(frozen=True)
class Points:
    """Points that rays meet; `ray` (n,) says which ray. `upright` is the normal without maps."""

    rays: Rays
    ray: Tensor
    position: Tensor
    normal: Tensor
    upright: Tensor
    side: Tensor
    irradiance: Tensor

    @property
    def arrays(self) -> tuple[Tensor, ...]:
        """The parameters, as kernels take them."""
        places = self.position, self.normal, self.upright, self.side, self.irradiance
        return self.ray, *self.rays.arrays, *places

    def of(self, some: slice) -> "Points":
        """Return some of the points."""
        own = {name.name: getattr(self, name.name)[some] for name in fields(self)[1:]}
        return replace(self, **own)


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
        trees = [surface.volumes for surface in lit]
        names = ("boxes", "children", "counts", "triangles", "faces")
        boxes = [[getattr(tree, name) for name in names] for tree in trees]
        self.volumes = joined_records(boxes, (0, 3), device)
        self.triangles = joined_records([surface._triangles for surface in lit], (), device)[1:]
        bends = np.array([net._surface.bends for net in nets])
        self._any_bends = bool(bends.any())
        self.stored = upload(bends, device), *joined_records([_stored(net) for net in nets], (0, 2), device)
        self.maps = joined_records([_maps(net) for net in nets], LATTICE_COUNTED, device)

    def cast(self, scene: Scene, place: Tensor, inside: Tensor) -> Rays:
        """Return rays through places `inside` (m, 2) each of pixels `place` (n,)."""
        count = len(place) * len(inside)
        rays = Rays.empty(count, self.device)
        sight_bodies.cast(
            count, place, inside, scene.objects, scene.cameras, scene.lens, *self.volumes, *rays.arrays
        )
        return rays

    def lit(self, scene: Scene, rays: Rays) -> Points:
        """Return the points that rays meet, and what of the lamps arrives there."""
        ray = rays.hits()
        lit = [torch.empty((len(ray), *shape), dtype=torch.float64, device=self.device) for shape in POINT]
        lamps = scene.objects, scene.lights
        sight_bodies.light(
            len(ray), ray, *rays.arrays, *lamps, *self.volumes, *self.triangles, *lit
        )  # fmt: skip
        position, upright, side, irradiance = lit
        normal = upright
        if self._any_bends:
            normal = torch.empty_like(upright)
            sight_bodies.bend(len(ray), ray, *rays.arrays, *lamps, *self.stored, *self.maps, *lit, normal)
        return Points(rays, ray, position, normal, upright, side, irradiance)


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
