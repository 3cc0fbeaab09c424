"""Thousands of views of several objects at once: what `render` answers, as tensors on a device.

First hits and shadows are found by the tree of a single view, points are shaded by the network in single
precision. A pixel has a ray through its centre, or `sub_rays` where it differs from a neighbour.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from objectfolder.batch import sight_bodies
from objectfolder.batch.resident import joined, numbers, object_indices, upload
from objectfolder.batch.sound import full_precision
from objectfolder.batch.targets import Tensor, checked_device, torch
from objectfolder.errors import QueryError
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, focal_length_px, image_size, sub_ray_offsets
from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.compiled.network import LIGHT_INPUTS
from objectfolder.vision.compositing import SRGB_KNEE
from objectfolder.vision.network.network_layout import ANGLES, MIRROR_WIDTH
from objectfolder.vision.visionnet.sight_queries import SightQueries

functional = torch.nn.functional
# Difference to a neighbour, in sRGB on white, from which on a pixel is looked at again.
CONTRAST = 0.15
# Rays traced at a time.
RAYS_AT_ONCE = 1 << 24
LEVELS = sight_bodies.LEVELS


@dataclass(frozen=True)
class _Points:
    """Points that rays meet; `view` (n,) says in which view."""

    view: Tensor
    face: Tensor
    barycentric: Tensor
    direction: Tensor
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
        A device that is not there, an object whose maps bend its normals.
    """

    def __init__(self, sights: Sequence[SightQueries], device: str | torch.device = "cuda") -> None:
        self.device = place = checked_device(device)
        nets = [sight.net for sight in sights]
        for index, net in enumerate(nets):
            if net._surface.bends:
                raise QueryError(
                    f"files[{index}]", "its maps bend normals", "Render it by `ObjectFile.render`."
                )
        lit = [LitSurface(net._surface) for net in nets]
        trees = [one.volumes for one in lit]
        sizes = np.array([(len(tree.boxes), len(tree.faces)) for tree in trees])
        self._tree = (
            _begins(sizes, place),
            joined([tree.boxes for tree in trees], place),
            joined([tree.children for tree in trees], place),
            joined([tree.counts for tree in trees], place),
            joined([tree.triangles for tree in trees], place),
        )
        self._faces = joined([tree.faces for tree in trees], place)
        self._facets = joined([one.facets for one in lit], place)
        self._corners = joined([one._triangles for one in lit], place)
        self._corner_normals = joined([one._corner_normals for one in lit], place)
        grids = [net._grid for net in nets]
        sizes = np.array([(*grid.sizes, *(len(lookup) for lookup in grid.lookups)) for grid in grids])
        sides = [[grid.resolution >> (LEVELS - 1 - level) for level in range(LEVELS)] for grid in grids]
        weights = [net._weights for net in nets]
        self._grid = (
            _begins(sizes, place),
            upload(np.array(sides), place),
            *(joined([own[f"tables.{level}"] for own in weights], place).float() for level in range(LEVELS)),
            *(joined([grid.lookups[level] for grid in grids], place) for level in range(LEVELS)),
        )
        self._alpha2 = _widths(weights, "log_alpha", place)
        self._mirror_alpha2 = _widths(weights, MIRROR_WIDTH, place)
        self._networks = [_Network(own, place) for own in weights]
        self._mirrors = any(network.mirrors for network in self._networks)
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
        rgba = self.render_linear(
            objects, camera_to_object, lights, resolution, field_of_view_deg, sub_rays=sub_rays
        )
        return (_on_white(rgba) * 255.0).round().to(torch.uint8)

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
        count = len(camera_to_object)  # type: ignore[arg-type]
        chosen = object_indices(objects, count, len(self._networks), self.device)
        cameras = numbers("camera_to_object", camera_to_object, (count, 4, 4), self.device).clone()
        lamps = numbers("lights", lights, (count, 3), self.device)
        cameras[:, :3, 3] = (cameras[:, :3, 3] - self._centres[chosen]) / self._scales[chosen, None]
        lamps = (lamps - self._centres[chosen]) / self._scales[chosen, None]
        size = image_size(resolution)
        lens = torch.tensor(
            [focal_length_px(size, field_of_view_deg), size[1], size[0]],
            dtype=torch.float64,
            device=self.device,
        )
        order = torch.argsort(chosen, stable=True)
        image = torch.zeros((count, *size, 4), dtype=torch.float32, device=self.device)
        step = max(1, RAYS_AT_ONCE // (size[0] * size[1]))
        for start in range(0, count, step):
            some = order[start : start + step]
            scene = _Scene(chosen[some], cameras[some], lamps[some], _lamp_terms(lamps[some]), lens)
            image[some] = self._views(scene, size, sub_rays)
        return image

    def _views(self, scene: "_Scene", size: tuple[int, int], sub_rays: int) -> Tensor:
        pixels, views = size[0] * size[1], len(scene.objects)
        every = torch.arange(views * pixels, device=self.device)
        middle = torch.tensor([[0.5, 0.5]], dtype=torch.float64, device=self.device)
        rgba = self._along(scene, every // pixels, every % pixels, middle.expand(len(every), 2).contiguous())
        image = rgba.reshape(views, *size, 4)
        again = torch.nonzero(_uneven(image).reshape(-1))[:, 0]
        if sub_rays > 1 and len(again):
            inside = upload(sub_ray_offsets(sub_rays), self.device)
            at_once = max(1, RAYS_AT_ONCE // sub_rays)
            for start in range(0, len(again), at_once):
                some = again[start : start + at_once]
                each = some.repeat_interleave(sub_rays)
                rays = self._along(scene, each // pixels, each % pixels, inside.repeat(len(some), 1))
                rgba[some] = rays.reshape(len(some), sub_rays, 4).mean(1)
        return image

    def _along(self, scene: "_Scene", view: Tensor, pixel: Tensor, inside: Tensor) -> Tensor:
        """Return premultiplied RGBA (n, 4) along rays through places (n, 2) in pixels (n,) of views (n,)."""
        rgba = torch.zeros((len(view), 4), dtype=torch.float32, device=self.device)
        direction, barycentric = (
            torch.empty((len(view), 3), dtype=torch.float64, device=self.device) for _ in range(2)
        )
        face = torch.empty(len(view), dtype=torch.int32, device=self.device)
        sight_bodies.cast(
            len(view), view, pixel, inside, scene.objects, scene.cameras, scene.lens, *self._tree,
            self._faces, direction, face, barycentric,
        )  # fmt: skip
        hit = torch.nonzero(face >= 0)[:, 0]
        if len(hit):
            points = self._lit(scene, view[hit], face[hit], barycentric[hit], direction[hit])
            rgba[hit, :3] = self._shaded(scene, points)
            rgba[hit, 3] = 1.0
        return rgba

    def _lit(
        self, scene: "_Scene", view: Tensor, face: Tensor, barycentric: Tensor, direction: Tensor
    ) -> _Points:
        position, normal = torch.empty_like(direction), torch.empty_like(direction)
        side, irradiance = torch.empty_like(direction[:, 0]), torch.empty_like(direction[:, 0])
        sight_bodies.light(
            len(view), view, scene.objects, scene.lights, *self._tree, self._corners, self._corner_normals,
            self._facets, face, barycentric, direction, position, normal, side, irradiance,
        )  # fmt: skip
        return _Points(view, face, barycentric, direction, position, normal, side, irradiance)

    def _inputs(self, scene: "_Scene", points: _Points, alpha2: Tensor) -> tuple[Tensor, Tensor]:
        """Return what the network is told of points, (terms, n) float32, and lobes (n,) of highlights."""
        count = len(points.view)
        inputs = torch.empty((sight_bodies.ROWS, count), dtype=torch.float32, device=self.device)
        lobe = torch.empty(count, dtype=torch.float32, device=self.device)
        sight_bodies.inputs(
            count, points.view, scene.objects, scene.lights, scene.lamp_terms, *self._grid, alpha2,
            points.position, points.normal, points.direction, points.irradiance, inputs, lobe,
        )  # fmt: skip
        return inputs, lobe

    def _shaded(self, scene: "_Scene", points: _Points) -> Tensor:
        """Return the colours (n, 3) float32 of points, which are in the order of the objects."""
        inputs, lobe = self._inputs(scene, points, self._alpha2)
        thing = scene.objects[points.view]
        irradiance = points.irradiance.float()
        colour = torch.empty((3, len(thing)), dtype=torch.float32, device=self.device)
        met_rows, met, met_inputs, met_lobe = None, points, inputs, lobe
        if self._mirrors:
            met_rows, met = self._met(scene, points)
            met_inputs, met_lobe = self._inputs(scene, met, self._mirror_alpha2)
        numbers_of = torch.arange(len(self._networks) + 1, device=self.device)
        starts = torch.searchsorted(thing, numbers_of)
        met_ends = (starts if met_rows is None else torch.searchsorted(met_rows, starts)).tolist()
        ends = starts.tolist()
        with full_precision():
            for index, network in enumerate(self._networks):
                some = slice(ends[index], ends[index + 1])
                if some.start == some.stop:
                    continue
                answer = network.answer(inputs[:, some])
                shown = irradiance[some] * answer.reflected(lobe[some]) + answer.albedo * answer.bounced
                seen = slice(met_ends[index], met_ends[index + 1])
                if network.mirrors and met_rows is not None and seen.start < seen.stop:
                    own = met_rows[seen]
                    again = network.answer(met_inputs[:, seen]).reflected(met_lobe[seen])
                    again *= met.irradiance[seen].float()
                    shown[:, own - some.start] += answer.fresnel(_rim(points, own), own - some.start) * again
                colour[:, some] = shown
        return colour.T * self._radiance[thing, None]

    def _met(self, scene: "_Scene", points: _Points) -> tuple[Tensor, _Points]:
        """Return which of the points (m,) see their object in mirror rays, and what they meet there."""
        direction, barycentric = torch.empty_like(points.direction), torch.empty_like(points.direction)
        face = torch.empty_like(points.face)
        sight_bodies.mirror(
            len(face), points.view, scene.objects, *self._tree, self._faces, self._facets, points.face,
            points.position, points.normal, points.side, points.direction, direction, face, barycentric,
        )  # fmt: skip
        row = torch.nonzero(face >= 0)[:, 0]
        return row, self._lit(scene, points.view[row], face[row], barycentric[row], direction[row])


@dataclass(frozen=True)
class _Scene:
    """Views in the unit frames of their objects, whose numbers ascend."""

    objects: Tensor
    cameras: Tensor
    lights: Tensor
    lamp_terms: Tensor
    lens: Tensor


@dataclass(frozen=True)
class _Answer:
    """What a network says of n points, (3, n) each; `rim` (n,) is that of the light."""

    albedo: Tensor
    even: Tensor
    strength: Tensor
    bounced: Tensor
    facing: Tensor | None
    rim: Tensor

    def fresnel(self, rim: Tensor, rows: Tensor | slice = slice(None)) -> Tensor:
        """Return the share (3, m) that points reflect; `rim` (m,) is (1 - cosine)^5."""
        assert self.facing is not None
        facing = self.facing[:, rows]
        return facing + (1 - facing) * rim

    def reflected(self, lobe: Tensor) -> Tensor:
        """Return (3, n) pi times the reflectance; `lobe` (n,) is that of the highlight."""
        if self.facing is None:
            gloss = functional.softplus(self.strength)
        else:
            gloss = self.fresnel(self.rim) * 2 * torch.sigmoid(self.strength)
        return self.albedo * self.even + gloss * lobe


class _Network:
    """`reflectance.Reflectance` of one object; what takes the inputs themselves is one matrix product."""

    def __init__(self, weights: Mapping[str, np.ndarray], device: torch.device) -> None:
        self.mirrors = MIRROR_WIDTH in weights
        features, coarse = sight_bodies.FEATURE_ROWS, sight_bodies.COARSE_ROWS
        terms = np.arange(coarse, coarse + sight_bodies.POINT_ROWS + sight_bodies.LAMP_ROWS)
        of_lamp = terms[LIGHT_INPUTS]
        order = [*np.setdiff1d(terms, of_lamp), *of_lamp]
        direct, bounced = weights["direct.0.weight"], weights["bounced.0.weight"]
        rows = {"direct.0": len(direct), "bounced.0": len(bounced), "albedo": 3}
        if self.mirrors:
            rows["facing"] = 3
        first = np.zeros((sum(rows.values()), sight_bodies.ROWS), dtype=np.float32)
        parts = np.split(first, np.cumsum(list(rows.values()))[:-1])
        parts[0][:, : direct.shape[1]] = direct
        parts[1][:, :coarse] = bounced[:, :coarse]
        parts[1][:, features + ANGLES :] = bounced[:, order]
        parts[2][:, : features + 3] = weights["albedo.weight"]
        if self.mirrors:
            parts[3][:, :features] = weights["facing.weight"]

        def single(name: str) -> Tensor:
            return upload(np.asarray(weights[name], dtype=np.float32), device)

        self._first = upload(first, device), torch.cat([single(f"{name}.bias") for name in rows])
        self._widths = list(rows.values())
        self._later = {
            name: [(single(f"{name}.{layer}.weight"), single(f"{name}.{layer}.bias")) for layer in (2, 4)]
            for name in ("direct", "bounced")
        }

    def answer(self, inputs: Tensor) -> _Answer:
        """Return what it says of points with inputs (terms, n)."""
        first = functional.linear(inputs.T, *self._first)
        direct, bounced, albedo, *facing = first.split(self._widths, dim=1)
        out = self._last("direct", direct.relu_()).T
        light = self._last("bounced", bounced.relu_()).T
        return _Answer(
            torch.sigmoid(albedo.T),
            2 * torch.sigmoid(out[:3]),
            out[3:],
            functional.softplus(light),
            torch.sigmoid(facing[0].T) if facing else None,
            inputs[sight_bodies.FEATURE_ROWS + 7],
        )

    def _last(self, name: str, hidden: Tensor) -> Tensor:
        second, third = self._later[name]
        return functional.linear(functional.linear(hidden, *second).relu_(), *third)


def _lamp_terms(places: Tensor) -> Tensor:
    """Return the inputs (n, 12) float32 that depend on lamps at (n, 3) alone."""
    waves = [torch.sin(torch.pi * places), torch.cos(torch.pi * places), torch.sin(2 * torch.pi * places)]
    return torch.cat([places, *waves], dim=1).float()


def _rim(points: _Points, row: Tensor) -> Tensor:
    beside = 1 + (points.normal[row] * points.direction[row]).sum(1)
    return beside.clamp(0.0, 1.0).pow(5).float()


def _widths(weights: list[dict[str, np.ndarray]], name: str, device: torch.device) -> Tensor:
    """Return squared GGX widths (objects,) float32; 1 where there is none."""
    logs = [np.float32(own[name]) if name in own else np.float32(0) for own in weights]
    return upload(np.exp(2 * np.array(logs, dtype=np.float32)), device)


def _begins(sizes: np.ndarray, device: torch.device) -> Tensor:
    return upload(np.concatenate([np.zeros_like(sizes[:1]), np.cumsum(sizes, axis=0)]), device)


def _on_white(rgba: Tensor) -> Tensor:
    """`compositing.composite_on_white` on a device, float32."""
    alpha = rgba[..., 3:].clamp(0.0, 1.0)
    straight = torch.where(alpha > 0, rgba[..., :3] / alpha.clamp(min=1e-30), 0.0).clamp(0.0, 1.0)
    curved = 1.055 * straight.clamp(min=SRGB_KNEE).pow(1 / 2.4) - 0.055
    return alpha * torch.where(straight <= SRGB_KNEE, 12.92 * straight, curved) + (1.0 - alpha)


def _uneven(image: Tensor) -> Tensor:
    """Mark pixels (n, h, w) that differ from a neighbour above, below or beside."""
    shown = _on_white(image)
    marked = torch.zeros(shown.shape[:3], dtype=torch.bool, device=image.device)
    for axis in (1, 2):
        length = shown.shape[axis]
        first, second = shown.narrow(axis, 0, length - 1), shown.narrow(axis, 1, length - 1)
        apart = ((first - second).abs() > CONTRAST).any(-1)
        marked.narrow(axis, 0, length - 1).logical_or_(apart)
        marked.narrow(axis, 1, length - 1).logical_or_(apart)
    return marked
