"""Colours of points of known material: `KnownLight` on a device.

Light is reflected once in closed form. What the surface sends onto itself follows from radiosity between
sites, whose exchange is found on the host when the objects are uploaded; each lamp of a query is solved on
the device. In its gloss a point shows the surface along directions drawn from its highlight.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from objectfolder.batch import known_bodies
from objectfolder.batch.resident import joined_records, upload
from objectfolder.batch.sight_bodies import SurfacePoints
from objectfolder.batch.sight_surfaces import (
    LATTICE_COUNTED,
    MAPS,
    Scene,
    Surfaces,
    on_lattice,
    room_for_rays,
)
from objectfolder.batch.targets import Tensor, full_precision, torch
from objectfolder.vision.compiled.known_light import GLOSS_BOUNCES, OFFSET, KnownLight
from objectfolder.vision.compiled.lobes import Cast, scattered
from objectfolder.vision.compiled.principled import PRINCIPLED_TERMS
from objectfolder.vision.compiled.radiosity import BOUNCES, SITE_NEIGHBOURS, SITES, Radiosity
from objectfolder.vision.visionnet.visionnet import VisionNet

Arrays = tuple[np.ndarray, ...]
# Numbers of views' lamps, and what these send by way of the surface.
Bounced = tuple[Tensor, Tensor]


class KnownSight:
    """Materials and radiosity of the last objects of some surfaces.

    Parameters
    ----------
    surfaces
        Of all objects.
    nets, lights
        VisionNets of these, and their light.
    """

    def __init__(self, surfaces: Surfaces, nets: Sequence[VisionNet], lights: Sequence[KnownLight]) -> None:
        self._surfaces, self._device = surfaces, (place := surfaces.device)
        # Directions of a ray's gloss, as where a single view is even.
        self._samples = max(light.samples[0] for light in lights)
        # The objects before these have rows that no kernel looks at.
        before = surfaces.count - len(nets)
        solved = [None] * before + [light._radiosity for light in lights]
        looks = [_look(*pair) for pair in zip(nets, lights, strict=True)]
        self._looks = joined_records(looks[:1] * before + looks, (), place)[1:]
        albedo = [on_lattice(None, NO_COLOUR)] * before + [_albedo(net) for net in nets]
        self._albedo = joined_records(albedo, LATTICE_COUNTED, place)
        *bounced, shares = zip(*map(_bounced, solved), strict=True)
        self._bounced = joined_records(list(zip(*bounced, strict=True)), LATTICE_COUNTED, place)
        self._shares = upload(np.concatenate(shares), place)
        self._values = max(len(part) for part in shares)
        sites = [_sites(each) for each in solved]
        counts, *points = (np.concatenate(column) for column in zip(*sites, strict=True))
        rows, ends = np.cumsum([0, *(len(each[0]) for each in sites)]), np.cumsum([0, *counts])
        self._sites = tuple(upload(column, place) for column in (rows, ends, *points))
        self._exchange = [
            None if each is None else (upload(each._exchange, place), upload(each._albedo, place).float())
            for each in solved
        ]

    def bounced(self, scene: Scene, first: int) -> Bounced:
        """Return the number (views,) of each view's lamp, and what it sends by way of the surface.

        The latter is (lamps, values, 3) float32 irradiance at places of the lattices of radiosity. Views
        before `first` show learned objects, and their numbers mean nothing.
        """
        keys = torch.cat([scene.objects[first:, None].double(), scene.lights[first:]], dim=1)
        lamps, inverse = torch.unique(keys, dim=0, return_inverse=True)
        number = torch.nn.functional.pad(inverse, (first, 0))
        objects, places = lamps[:, 0].long(), lamps[:, 1:].contiguous()
        sending = torch.empty((SITES, len(lamps), 3), dtype=torch.float32, device=self._device)
        known_bodies.send(
            (len(lamps), SITES), objects, places, *self._surfaces.volumes, *self._surfaces.triangles,
            self._surfaces.stored[0], *self._sites, sending,
        )  # fmt: skip
        total = torch.zeros_like(sending)
        ends = torch.searchsorted(
            objects, torch.arange(self._surfaces.count + 1, device=self._device)
        ).tolist()
        for exchange, start, end in zip(self._exchange, ends, ends[1:], strict=False):
            if exchange is not None and start < end:
                share, albedo = exchange
                part = sending[:, start:end]
                for _ in range(BOUNCES):
                    with full_precision():
                        reached = (share @ part.reshape(SITES, -1)).reshape(part.shape)
                    total[:, start:end] += reached
                    part = albedo[:, None] * reached
        fields = torch.zeros((len(lamps), self._values, 3), dtype=torch.float32, device=self._device)
        total = total.transpose(0, 1).contiguous()
        known_bodies.spread(
            (len(lamps), self._values), objects, total, *self._bounced, self._shares, fields
        )  # fmt: skip
        return number, fields

    def shade(
        self, scene: Scene, points: SurfacePoints, cast: Cast, bounced: Bounced, colours: Tensor
    ) -> None:
        """Write the colours of rays that meet points; `cast` says where each is in its image."""
        radiance = self._radiated(scene, points, cast, bounced, self._samples, GLOSS_BOUNCES)
        scale = self._surfaces.radiance[scene.objects[points.view_of[points.ray_of]]]
        colours[points.ray_of, :3] = radiance * scale[:, None]
        colours[points.ray_of, 3] = 1.0

    def _radiated(
        self, scene: Scene, points: SurfacePoints, cast: Cast, bounced: Bounced, samples: int, times: int
    ) -> Tensor:
        """Return what (n, 3) float32 points send, showing others in their gloss `times`."""
        count = len(points.ray_of)
        terms = torch.empty((count, PRINCIPLED_TERMS), dtype=torch.float32, device=self._device)
        base, radiance = (torch.empty((count, 3), dtype=torch.float32, device=self._device) for _ in range(2))
        known_bodies.substance(
            count, *points, scene.objects, *self._looks, *self._surfaces.stored, *self._albedo,
            *self._surfaces.maps, terms, base,
        )  # fmt: skip
        known_bodies.radiate(
            count, *points, scene.objects, *self._looks, scene.lights, *bounced, terms, base,
            *self._bounced, radiance,
        )  # fmt: skip
        if times == 0 or samples == 0:
            return radiance
        starts: Any = scattered(cast)
        offsets = [part.double() for part in starts]
        rays = room_for_rays(count * samples, self._device)
        share = torch.empty((count * samples, 3), dtype=torch.float32, device=self._device)
        known_bodies.scatter(
            count * samples, *points, scene.objects, *self._looks, terms, samples, *offsets,
            *self._surfaces.volumes, self._surfaces.triangles[2], *rays, share,
        )  # fmt: skip
        met = self._surfaces.lit(scene, rays)
        row = torch.full((count * samples,), -1, dtype=torch.int64, device=self._device)
        row[met.ray_of] = torch.arange(len(met.ray_of), device=self._device)
        shown_by = met.ray_of // samples
        order = (1 + cast.order[shown_by]) * OFFSET + met.ray_of % samples
        again = Cast(cast.columns[shown_by], cast.rows[shown_by], order, cast.count)
        sent = self._radiated(scene, met, again, bounced, 1, times - 1)
        known_bodies.gather(count, samples, row, share, sent, radiance)
        return radiance


NO_COLOUR = np.zeros((0, 3), dtype=np.uint8)
# Points of each site, and of these: faces, barycentric coordinates, positions, normals as maps bend them and
# without, sides, albedo.
NO_SITES = (*[np.zeros(0, np.int64)] * 2, *[np.zeros((0, 3))] * 4, np.zeros(0), np.zeros((0, 3)))


def _albedo(net: VisionNet) -> Arrays:
    assert net._maps is not None
    return on_lattice(net._maps.lattice("albedo"), net._maps.levels["albedo"])


def _look(net: VisionNet, light: KnownLight) -> Arrays:
    """Return a row of each array of `known_bodies.Looks`."""
    own, level = net._appearance, light._principled
    assert own is not None
    mapped = [net._material.mapped(name) for name in list(MAPS)[:2]]
    numbers = level._upright, level._upright_mean, level._index
    return (
        np.array([[own.roughness, own.metallic]]), np.array([mapped]), level._white[None], level._mean[None],
        level._rise[None], np.array([numbers]),
    )  # fmt: skip


def _bounced(radiosity: Radiosity | None) -> Arrays:
    """Return the lattice of radiosity, the sites near to its values, and their shares."""
    if radiosity is None:
        return *on_lattice(None, np.zeros((0, SITE_NEIGHBOURS), np.int64)), np.zeros((0, SITE_NEIGHBOURS))
    return *radiosity._lookup._places, radiosity._near, radiosity._share


def _sites(radiosity: Radiosity | None) -> Arrays:
    """Return how many points receive light for each site, as in a coarse image, and these in order."""
    if radiosity is None:
        return NO_SITES
    receivers = radiosity._few
    order, points = np.argsort(receivers.site, kind="stable"), receivers.points
    columns = (
        points.face, points.barycentric, points.position, points.normal, points.upright, points.side,
        receivers.albedo,
    )  # fmt: skip
    return np.bincount(receivers.site, minlength=SITES), *(column[order] for column in columns)
