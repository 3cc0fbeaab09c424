"""Thousands of views of several objects at once: what `render` answers, as tensors on a device.

First hits and shadows are found by the tree of a single view. A pixel has a ray through its centre, or
`sub_rays` where it differs from a neighbour. Of a pixel that is covered in part, more rays without light
say how much of it is.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from objectfolder.batch import sight_bodies
from objectfolder.batch.known_sight import Bounced, KnownSight
from objectfolder.batch.learned_sight import LearnedSight
from objectfolder.batch.resident import numbers, object_indices, upload
from objectfolder.batch.sight_surfaces import Scene, Surfaces, points_of
from objectfolder.batch.targets import Tensor, checked_device, torch
from objectfolder.errors import QueryError
from objectfolder.vision.appearance import THIN
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, focal_length_px, image_size, sub_ray_offsets
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.lobes import Cast
from objectfolder.vision.visionnet.sight_queries import SightQueries

# The cheapest rays of an uneven pixel, and of coverage, with 42 dB of the starter set's foreground; the
# difference to a neighbour, in sRGB on white, from which on a pixel is looked at again.
UNEVEN_RAYS, OUTLINE_RAYS, CONTRAST = 11, 48, 0.15
# Times that pixels are compared with their neighbours: what is thinner than a pixel may miss the centres of a
# row of them. In views of the starter set the fourth time finds the last.
ROUNDS = 4
# Rays traced at a time.
RAYS_AT_ONCE = 1 << 24
# Views at a time: what their lamps send by way of the surface takes 150 kB each.
VIEWS_AT_ONCE = 2048
# Rows and columns of pixels whose rays follow each other: 32 threads take alike ways through the tree.
PIXEL_TILE = 4, 8


class SightBatch:
    """Surfaces and light of objects on a device.

    Parameters
    ----------
    sights
        ``ObjectFile.sight`` of each object.
    device
        ``"cuda"`` or ``"cpu"``.

    Raises
    ------
    QueryError
        A device that is not there, an object of thin glass.
    """

    def __init__(self, sights: Sequence[SightQueries], device: str | torch.device = "cuda") -> None:
        self.device = place = checked_device(device)
        for index, sight in enumerate(sights):
            if sight.net.glass == THIN:
                raise QueryError(f"files[{index}]", "thin glass", "Render it by `ObjectFile.render`.")
        # Learned objects come first.
        order = np.argsort([sight.net.computed for sight in sights], kind="stable")
        self._rank = upload(np.argsort(order), place)
        nets = [sights[index].net for index in order]
        self._learned = sum(not net.computed for net in nets)
        renderers = [net._rendering() for net in nets]
        self._surfaces = Surfaces(nets, [renderer._surface for renderer in renderers], place)
        learned, known = nets[: self._learned], nets[self._learned :]
        lights = [light for renderer in renderers if isinstance(light := renderer._network, KnownLight)]
        self._by_network = LearnedSight(self._surfaces, learned) if learned else None
        self._by_material = KnownSight(self._surfaces, known, lights) if known else None
        self._centres = upload([sights[index].frame.centre for index in order], place)
        self._scales = upload([sights[index].frame.scale for index in order], place)

    def render(
        self,
        objects: object,
        camera_to_object: object,
        lights: object,
        resolution: int | tuple[int, int] = 128,
        field_of_view_deg: float = FIELD_OF_VIEW_DEG,
        *,
        sub_rays: int = UNEVEN_RAYS,
        coverage_rays: int = OUTLINE_RAYS,
        contrast: float = CONTRAST,
    ) -> Tensor:
        """Render views under one lamp each: (n, h, w, 3) uint8, sRGB on white.

        Parameters
        ----------
        objects
            (n,) which of the objects each view shows, or one for all.
        camera_to_object, lights
            (n, 4, 4) rigid poses and (n, 3) or (3,) positions, as for `ObjectFile.render`.
        resolution, field_of_view_deg
            As for `ObjectFile.render`.
        sub_rays
            Rays of a pixel that differs from a neighbour; others have one.
        coverage_rays
            Rays without light that find the coverage of a pixel of which `sub_rays` find a part covered;
            none where they are not more than these.
        contrast
            Difference of sRGB on white from which on a pixel differs from a neighbour.
        """
        views = objects, camera_to_object, lights, resolution, field_of_view_deg
        return self._render(*views, (sub_rays, coverage_rays, contrast), linear=False)

    def render_linear(
        self,
        objects: object,
        camera_to_object: object,
        lights: object,
        resolution: int | tuple[int, int] = 128,
        field_of_view_deg: float = FIELD_OF_VIEW_DEG,
        *,
        sub_rays: int = UNEVEN_RAYS,
        coverage_rays: int = OUTLINE_RAYS,
        contrast: float = CONTRAST,
    ) -> Tensor:
        """Render as `render`: (n, h, w, 4) float32 scene-linear premultiplied RGBA."""
        views = objects, camera_to_object, lights, resolution, field_of_view_deg
        return self._render(*views, (sub_rays, coverage_rays, contrast), linear=True)

    def _render(
        self, objects: object, camera_to_object: object, lights: object, resolution: int | tuple[int, int],
        field_of_view_deg: float, effort: tuple[int, int, float], *, linear: bool,
    ) -> Tensor:  # fmt: skip
        # Arrays of any library are taken: their common type, `object`, has no length.
        count = len(camera_to_object)  # type: ignore[arg-type]
        chosen = self._rank[object_indices(objects, count, self._surfaces.count, self.device)]
        cameras = numbers("camera_to_object", camera_to_object, (count, 4, 4), self.device).clone()
        lamps = numbers("lights", lights, (count, 3), self.device)
        cameras[:, :3, 3] = (cameras[:, :3, 3] - self._centres[chosen]) / self._scales[chosen, None]
        lamps = (lamps - self._centres[chosen]) / self._scales[chosen, None]
        size = image_size(resolution)
        lens = upload([focal_length_px(size, field_of_view_deg), size[1], size[0]], self.device)
        order = torch.argsort(chosen, stable=True)
        channels, kind = (4, torch.float32) if linear else (3, torch.uint8)
        image = torch.empty((count, *size, channels), dtype=kind, device=self.device)
        step = min(max(1, RAYS_AT_ONCE // (size[0] * size[1])), VIEWS_AT_ONCE)
        for start in range(0, count, step):
            some = order[start : start + step]
            scene = Scene(chosen[some], cameras[some], lamps[some], lens)
            rgba, shown = self._views(scene, size, *effort)
            values = rgba if linear else (shown * 255.0).round_().to(torch.uint8)
            image[some] = values.reshape(len(some), *size, channels)
        return image

    def _views(
        self, scene: Scene, size: tuple[int, int], sub_rays: int, coverage_rays: int, contrast: float
    ) -> tuple[Tensor, Tensor]:
        """Return premultiplied RGBA (pixels, 4) and sRGB on white (pixels, 3) of all views, float32."""
        count = len(scene.objects) * size[0] * size[1]
        image = tuple(
            torch.empty((count, channels), dtype=torch.float32, device=self.device) for channels in (4, 3)
        )
        bounced, first = None, int(torch.searchsorted(scene.objects, self._learned))
        if self._by_material is not None and first < len(scene.objects):
            bounced = self._by_material.bounced(scene, first)
        middle = torch.full((1, 2), 0.5, dtype=torch.float64, device=self.device)
        self._along(scene, size, _tiled(count, size, self.device), middle, bounced, image)
        if sub_rays > 1:
            inside = upload(sub_ray_offsets(sub_rays), self.device)
            at_once = max(1, RAYS_AT_ONCE // sub_rays)
            uneven = torch.zeros(count, dtype=torch.bool, device=self.device)
            for _ in range(ROUNDS):
                marked = torch.empty(count, dtype=torch.bool, device=self.device)
                sight_bodies.uneven(count, scene.lens, np.float32(contrast), image[1], marked)
                again = torch.nonzero(marked & ~uneven)[:, 0]
                if not len(again):
                    break
                uneven |= marked
                for start in range(0, len(again), at_once):
                    self._along(scene, size, again[start : start + at_once], inside, bounced, image)
            again = torch.nonzero(uneven)[:, 0]
            if coverage_rays > sub_rays:
                alpha = image[0][again, 3]
                self._cover(scene, again[(alpha > 0) & (alpha < 1)], coverage_rays, image)
        return image[0], image[1]

    def _cover(self, scene: Scene, outline: Tensor, coverage_rays: int, image: tuple[Tensor, ...]) -> None:
        """Write pixels (n,) with the share of rays that meet something as their coverage."""
        inside = upload(sub_ray_offsets(coverage_rays), self.device)
        at_once = max(1, RAYS_AT_ONCE // coverage_rays)
        for start in range(0, len(outline), at_once):
            place = outline[start : start + at_once]
            rays = self._surfaces.cast(scene, place, inside)
            share = (rays.face >= 0).reshape(len(place), coverage_rays).float().mean(1)
            sight_bodies.cover(len(place), place, share, *image)

    def _along(
        self, scene: Scene, size: tuple[int, int], place: Tensor, inside: Tensor, bounced: Bounced | None,
        image: tuple[Tensor, ...],
    ) -> None:  # fmt: skip
        """Write the RGBA and sRGB of pixels (n,) by rays through places (m, 2) in each."""
        several = len(inside)
        colours = torch.zeros((len(place) * several, 4), dtype=torch.float32, device=self.device)
        points = self._surfaces.lit(scene, self._surfaces.cast(scene, place, inside))
        # Pixels are in the order of views, views in the order of objects.
        views = torch.searchsorted(scene.objects, torch.arange(self._learned + 1, device=self.device))
        starts = torch.searchsorted(place, views * (size[0] * size[1])) * several
        starts = torch.searchsorted(points.ray_of, starts)
        split = int(starts[-1])
        if self._by_network is not None and split > 0:
            self._by_network.shade(scene, points_of(points, slice(split)), starts, colours)
        if self._by_material is not None and bounced is not None and split < len(points.ray_of):
            rest = points_of(points, slice(split, None))
            pixel = place[rest.ray_of // several] % (size[0] * size[1])
            at: Any = pixel % size[1], pixel // size[1], rest.ray_of % several, several  # tensors for arrays
            self._by_material.shade(scene, rest, Cast(*at), bounced, colours)
        sight_bodies.blend(len(place), place, colours, *image)


def _tiled(count: int, size: tuple[int, int], device: torch.device) -> Tensor:
    """Return all pixels of views, tile by tile where the size of a view is a multiple of them."""
    places = torch.arange(count, device=device)
    if size[0] % PIXEL_TILE[0] or size[1] % PIXEL_TILE[1]:
        return places
    split = places.reshape(
        -1, size[0] // PIXEL_TILE[0], PIXEL_TILE[0], size[1] // PIXEL_TILE[1], PIXEL_TILE[1]
    )
    return split.transpose(2, 3).reshape(-1)
