"""Thousands of views of several objects at once: what `render` answers, as tensors on a device.

First hits and shadows are found by the tree of a single view, points are shaded by the network in bfloat16,
whose sums are single. A pixel has a ray through its centre, or `sub_rays` where it differs from a neighbour.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.batch import sight_bodies
from objectfolder.batch.resident import joined, numbers, object_indices, upload
from objectfolder.batch.targets import Tensor, checked_device, resident, torch
from objectfolder.errors import QueryError
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, focal_length_px, image_size, sub_ray_offsets
from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.compiled.network import LIGHT_INPUTS
from objectfolder.vision.network.network_layout import ANGLES, LAYER_WIDTH, MIRROR_WIDTH
from objectfolder.vision.visionnet.sight_queries import SightQueries

# Difference to a neighbour, in sRGB on white, from which on a pixel is looked at again.
CONTRAST = 0.15
# Rays traced at a time.
RAYS_AT_ONCE = 1 << 24
# Rows and columns of pixels whose rays follow each other: 32 threads take alike ways through the tree.
PIXEL_TILE = 4, 8
# Of the matrices of networks, whose products are summed in single precision. Lamps far away and close to a
# surface are beyond the range of float16.
HALF = torch.bfloat16
LEVELS = sight_bodies.LEVELS


@dataclass(frozen=True)
class _Rays:
    """Rays (n,) and what they meet: `face` is -1 where that is nothing."""

    view: Tensor
    face: Tensor
    barycentric: Tensor
    direction: Tensor

    @classmethod
    def empty(cls, count: int, device: torch.device) -> "_Rays":
        """Return room for rays."""
        view, face = (torch.empty(count, dtype=torch.int32, device=device) for _ in range(2))
        places = (torch.empty((count, 3), dtype=torch.float64, device=device) for _ in range(2))
        return cls(view, face, *places)

    @property
    def arrays(self) -> tuple[Tensor, ...]:
        """The parameters, as kernels that write them take them."""
        return self.view, self.direction, self.face, self.barycentric

    def hits(self) -> Tensor:
        """Return which rays (m,) meet something."""
        return torch.nonzero(self.face >= 0)[:, 0]


@dataclass(frozen=True)
class _Points:
    """Points that rays meet; `ray` (n,) says which ray."""

    rays: _Rays
    ray: Tensor
    position: Tensor
    normal: Tensor
    side: Tensor
    irradiance: Tensor


class SightBatch:
    """Surfaces and networks of objects on a device.

    Parameters
    ----------
    sights
        ``ObjectFile.sight`` of each object.
    device
        ``"cuda"`` or ``"cpu"``.

    Raises
    ------
    QueryError
        A device that is not there, an object whose maps bend its normals, or of known material.
    """

    def __init__(self, sights: Sequence[SightQueries], device: str | torch.device = "cuda") -> None:
        self.device = place = checked_device(device)
        nets = [sight.net for sight in sights]
        for index, net in enumerate(nets):
            if net._surface.bends or net.computed:
                finding = "its maps bend normals" if net._surface.bends else "its light is computed"
                remedy = "Render it by `ObjectFile.render`"
                remedy += ", or build it with `material: learned`." if net.computed else "."
                raise QueryError(f"files[{index}]", finding, remedy)
        lit = [LitSurface(net._surface) for net in nets]
        trees = [surface.volumes for surface in lit]
        sizes = np.array([(len(tree.boxes), len(tree.faces)) for tree in trees])
        self._tree = _resident(
            _begins(sizes, place),
            joined([tree.boxes for tree in trees], place),
            joined([tree.children for tree in trees], place),
            joined([tree.counts for tree in trees], place),
            joined([tree.triangles for tree in trees], place),
            joined([tree.faces for tree in trees], place),
        )
        self._triangles = _resident(
            *(joined(parts, place) for parts in zip(*(surface._triangles for surface in lit), strict=True))
        )
        grids = [grid for net in nets if (grid := net._grid) is not None]
        sizes = np.array([(*grid.sizes, *(len(lookup) for lookup in grid.lookups)) for grid in grids])
        sides = [[grid.resolution >> (LEVELS - 1 - level) for level in range(LEVELS)] for grid in grids]
        weights = [net._weights for net in nets]
        self._grid = _resident(
            _begins(sizes, place),
            upload(np.array(sides), place),
            *(joined([own[f"tables.{level}"] for own in weights], place).float() for level in range(LEVELS)),
            *(joined([grid.lookups[level] for grid in grids], place) for level in range(LEVELS)),
        )
        self._alpha2 = _widths(weights, "log_alpha", place)
        self._mirror_alpha2 = _widths(weights, MIRROR_WIDTH, place)
        self._networks = [_Network(own, place) for own in weights]
        self._mirrors = upload(np.array([MIRROR_WIDTH in own for own in weights]), place)
        self._any_mirrors = any(MIRROR_WIDTH in own for own in weights)
        self._centres = upload(np.array([sight.frame.centre for sight in sights]), place)
        self._scales = upload(np.array([sight.frame.scale for sight in sights]), place)
        self._radiance = upload(np.array([net.radiance_scale for net in nets], dtype=np.float32), place)

    def render(
        self,
        objects: object,
        camera_to_object: object,
        lights: object,
        resolution: int | tuple[int, int] = 128,
        field_of_view_deg: float = FIELD_OF_VIEW_DEG,
        *,
        sub_rays: int = 10,
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
        """
        views = objects, camera_to_object, lights, resolution, field_of_view_deg
        return self._render(*views, sub_rays, linear=False)

    def render_linear(
        self,
        objects: object,
        camera_to_object: object,
        lights: object,
        resolution: int | tuple[int, int] = 128,
        field_of_view_deg: float = FIELD_OF_VIEW_DEG,
        *,
        sub_rays: int = 10,
    ) -> Tensor:
        """Render as `render`: (n, h, w, 4) float32 scene-linear premultiplied RGBA."""
        views = objects, camera_to_object, lights, resolution, field_of_view_deg
        return self._render(*views, sub_rays, linear=True)

    def _render(
        self, objects: object, camera_to_object: object, lights: object, resolution: int | tuple[int, int],
        field_of_view_deg: float, sub_rays: int, *, linear: bool,
    ) -> Tensor:  # fmt: skip
        count = len(camera_to_object)  # type: ignore[arg-type]
        chosen = object_indices(objects, count, len(self._networks), self.device)
        cameras = numbers("camera_to_object", camera_to_object, (count, 4, 4), self.device).clone()
        lamps = numbers("lights", lights, (count, 3), self.device)
        cameras[:, :3, 3] = (cameras[:, :3, 3] - self._centres[chosen]) / self._scales[chosen, None]
        lamps = (lamps - self._centres[chosen]) / self._scales[chosen, None]
        size = image_size(resolution)
        lens = upload(np.array([focal_length_px(size, field_of_view_deg), size[1], size[0]]), self.device)
        order = torch.argsort(chosen, stable=True)
        channels, kind = (4, torch.float32) if linear else (3, torch.uint8)
        image = torch.empty((count, *size, channels), dtype=kind, device=self.device)
        step = max(1, RAYS_AT_ONCE // (size[0] * size[1]))
        for start in range(0, count, step):
            some = order[start : start + step]
            scene = _Scene(chosen[some], cameras[some], lamps[some], _lamp_terms(lamps[some]), lens)
            rgba, shown = self._views(scene, size, sub_rays)
            values = rgba if linear else (shown * 255.0).round_().to(torch.uint8)
            image[some] = values.reshape(len(some), *size, channels)
        return image

    def _views(self, scene: "_Scene", size: tuple[int, int], sub_rays: int) -> tuple[Tensor, Tensor]:
        """Return premultiplied RGBA (pixels, 4) and sRGB on white (pixels, 3) of all views, float32."""
        count = len(scene.objects) * size[0] * size[1]
        image = tuple(
            torch.empty((count, channels), dtype=torch.float32, device=self.device) for channels in (4, 3)
        )
        middle = torch.full((1, 2), 0.5, dtype=torch.float64, device=self.device)
        self._along(scene, size, _tiled(count, size, self.device), middle, image)
        if sub_rays > 1:
            marked = torch.empty(count, dtype=torch.bool, device=self.device)
            sight_bodies.uneven(count, scene.lens, np.float32(CONTRAST), image[1], marked)
            again = torch.nonzero(marked)[:, 0]
            inside = upload(sub_ray_offsets(sub_rays), self.device)
            at_once = max(1, RAYS_AT_ONCE // sub_rays)
            for start in range(0, len(again), at_once):
                self._along(scene, size, again[start : start + at_once], inside, image)
        return image[0], image[1]

    def _along(
        self, scene: "_Scene", size: tuple[int, int], place: Tensor, inside: Tensor, image: tuple[Tensor, ...]
    ) -> None:
        """Write the RGBA and sRGB of pixels (n,) by rays through places (m, 2) in each."""
        count = len(place) * len(inside)
        colours = torch.zeros((count, 4), dtype=torch.float32, device=self.device)
        rays = _Rays.empty(count, self.device)
        sight_bodies.cast(
            count, place, inside, scene.objects, scene.cameras, scene.lens, *self._tree, *rays.arrays
        )
        hit = rays.hits()
        # Pixels are in the order of views, views in the order of objects.
        views = torch.searchsorted(scene.objects, torch.arange(len(self._networks) + 1, device=self.device))
        starts = torch.searchsorted(place, views * (size[0] * size[1])) * len(inside)
        self._shade(scene, self._lit(scene, rays, hit), torch.searchsorted(hit, starts), colours)
        sight_bodies.blend(len(place), place, colours, *image)

    def _lit(self, scene: "_Scene", rays: _Rays, ray: Tensor) -> _Points:
        position, normal = (
            torch.empty((len(ray), 3), dtype=torch.float64, device=self.device) for _ in range(2)
        )
        side, irradiance = (torch.empty(len(ray), dtype=torch.float64, device=self.device) for _ in range(2))
        sight_bodies.light(
            len(ray), ray, rays.view, rays.direction, scene.objects, scene.lights, *self._tree,
            *self._triangles, rays.face, rays.barycentric, position, normal, side, irradiance,
        )  # fmt: skip
        return _Points(rays, ray, position, normal, side, irradiance)

    def _answered(
        self, scene: "_Scene", points: _Points, starts: Tensor, alpha2: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return answers (n, ANSWERS) of the networks, their inputs and the lobes (n,) of highlights.

        The points of each object lie between two of `starts` (objects + 1,).
        """
        count = len(points.ray)
        # Each row begins where products in half precision want it, and so does each object.
        inputs, lobe, answers = (
            torch.empty(shape, dtype=torch.float32, device=self.device)
            for shape in ((sight_bodies.PADDED_ROWS, _eights(count)), (count,), (count, sight_bodies.ANSWERS))
        )
        sight_bodies.inputs(
            count, points.ray, points.rays.view, scene.objects, scene.lights, scene.lamp_terms, *self._grid,
            alpha2, points.position, points.normal, points.rays.direction, points.irradiance, inputs, lobe,
        )  # fmt: skip
        ends = starts.tolist()
        for network, start, end in zip(self._networks, ends, ends[1:], strict=False):
            if start < end:
                first = start - start % 8
                answer = network.answer(inputs[:, first : _eights(end)].to(HALF).T)
                answers[start:end] = answer[start - first : end - first]
        return answers, inputs, lobe

    def _shade(self, scene: "_Scene", points: _Points, starts: Tensor, colours: Tensor) -> None:
        """Write the colours of rays that meet points, which are in the order of the objects."""
        answers, inputs, lobe = self._answered(scene, points, starts, self._alpha2)
        reflected = torch.zeros(
            (len(points.ray) if self._any_mirrors else 1, 3), dtype=torch.float32, device=self.device
        )
        if self._any_mirrors:
            met = self._met(scene, points)
            mirrored = self._answered(scene, met, torch.searchsorted(met.ray, starts), self._mirror_alpha2)
            sight_bodies.reflect(
                len(met.ray), met.ray, met.rays.view, scene.objects, self._mirrors, *mirrored, met.irradiance,
                reflected,
            )  # fmt: skip
        sight_bodies.colour(
            len(points.ray), points.ray, points.rays.view, points.rays.direction, scene.objects,
            self._mirrors, self._radiance, answers, inputs, lobe, points.irradiance, points.normal, reflected,
            colours,
        )  # fmt: skip

    def _met(self, scene: "_Scene", points: _Points) -> _Points:
        """Return what mirror rays meet, of which each point has one."""
        rays = _Rays.empty(len(points.ray), self.device)
        sight_bodies.mirror(
            len(points.ray), points.ray, points.rays.view, scene.objects, *self._tree, self._triangles[2],
            points.rays.face, points.position, points.normal, points.side, points.rays.direction,
            *rays.arrays,
        )  # fmt: skip
        return self._lit(scene, rays, rays.hits())


@dataclass(frozen=True)
class _Scene:
    """Views in the unit frames of their objects, whose numbers ascend."""

    objects: Tensor
    cameras: Tensor
    lights: Tensor
    lamp_terms: Tensor
    lens: Tensor


class _Network:
    """`reflectance.Reflectance` of one object in three products of matrices.

    Both perceptrons lie side by side in each. Albedo and mirrors, which have no hidden layers, go through
    those by their positive and their negative part.
    """

    def __init__(self, weights: Mapping[str, np.ndarray], device: torch.device) -> None:
        features, coarse = sight_bodies.FEATURE_ROWS, sight_bodies.COARSE_ROWS
        terms = np.arange(coarse, coarse + sight_bodies.POINT_ROWS + sight_bodies.LAMP_ROWS)
        of_lamp = terms[LIGHT_INPUTS]
        order = [*np.setdiff1d(terms, of_lamp), *of_lamp]
        direct, bounced = weights["direct.0.weight"], weights["bounced.0.weight"]
        pair, straight = 2 * LAYER_WIDTH, 6
        hidden = pair + 2 * straight + 4  # a multiple of 8
        # (inputs, outputs) of each product, then what it adds.
        first, second, third = (
            np.zeros((rows + 1, columns), dtype=np.float32)
            for rows, columns in (
                (sight_bodies.PADDED_ROWS, hidden), (hidden, hidden), (hidden, sight_bodies.ANSWERS)
            )
        )  # fmt: skip
        first[: direct.shape[1], :LAYER_WIDTH] = direct.T
        first[:coarse, LAYER_WIDTH:pair] = bounced[:, :coarse].T
        first[features + ANGLES : sight_bodies.INPUT_ROWS, LAYER_WIDTH:pair] = bounced[:, order].T
        first[-1, :pair] = np.concatenate([weights[f"{name}.0.bias"] for name in ("direct", "bounced")])
        positive, negative = pair + np.arange(straight), pair + straight + np.arange(straight)
        for index, name in enumerate(("albedo", "facing")):
            if f"{name}.weight" in weights:
                own, columns = weights[f"{name}.weight"].T, positive[3 * index : 3 * index + 3]
                first[: len(own), columns], first[-1, columns] = own, weights[f"{name}.bias"]
        first[:, negative] = -first[:, positive]
        rows = slice(0, LAYER_WIDTH), slice(LAYER_WIDTH, pair)
        answers = slice(0, sight_bodies.BOUNCED), slice(sight_bodies.BOUNCED, sight_bodies.ALBEDO)
        for name, some, shown in zip(("direct", "bounced"), rows, answers, strict=True):
            second[some, some], second[-1, some] = weights[f"{name}.2.weight"].T, weights[f"{name}.2.bias"]
            third[some, shown], third[-1, shown] = weights[f"{name}.4.weight"].T, weights[f"{name}.4.bias"]
        both_parts = np.concatenate([positive, negative])
        second[both_parts, both_parts] = 1
        columns = sight_bodies.ALBEDO + np.arange(straight)
        third[positive, columns], third[negative, columns] = 1, -1
        self._layers = [
            (upload(layer[-1], device).to(HALF), upload(layer[:-1], device).to(HALF))
            for layer in (first, second, third)
        ]

    def answer(self, inputs: Tensor) -> Tensor:
        """Return what it says (n, ANSWERS) of points with inputs (n, ROWS)."""
        first, second, third = self._layers
        hidden = torch._addmm_activation(first[0], inputs, first[1])
        return torch.addmm(third[0], torch._addmm_activation(second[0], hidden, second[1]), third[1])


def _resident(*tensors: Tensor) -> tuple[Any, ...]:
    return tuple(resident(tensor) for tensor in tensors)


def _eights(count: int) -> int:
    """Return the least multiple of 8 from a count on."""
    return -(-count // 8) * 8


def _tiled(count: int, size: tuple[int, int], device: torch.device) -> Tensor:
    """Return all pixels of views, tile by tile where the size of a view is a multiple of them."""
    places = torch.arange(count, device=device)
    if size[0] % PIXEL_TILE[0] or size[1] % PIXEL_TILE[1]:
        return places
    split = places.reshape(
        -1, size[0] // PIXEL_TILE[0], PIXEL_TILE[0], size[1] // PIXEL_TILE[1], PIXEL_TILE[1]
    )
    return split.transpose(2, 3).reshape(-1)


def _lamp_terms(places: Tensor) -> Tensor:
    """Return the inputs (n, 12) float32 that depend on lamps at (n, 3) alone."""
    waves = [torch.sin(torch.pi * places), torch.cos(torch.pi * places), torch.sin(2 * torch.pi * places)]
    return torch.cat([places, *waves], dim=1).float()


def _widths(weights: list[dict[str, np.ndarray]], name: str, device: torch.device) -> Tensor:
    """Return squared GGX widths (objects,) float32; 1 where there is none."""
    logs = [np.float32(own[name]) if name in own else np.float32(0) for own in weights]
    return upload(np.exp(2 * np.array(logs, dtype=np.float32)), device)


def _begins(sizes: np.ndarray, device: torch.device) -> Tensor:
    return upload(np.concatenate([np.zeros_like(sizes[:1]), np.cumsum(sizes, axis=0)]), device)
