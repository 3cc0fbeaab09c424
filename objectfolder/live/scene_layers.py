"""What is seen of a scene, thing by thing: drawn objects and a table, put over one another by depth."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import minimum_filter

from objectfolder.live.lamp_ways import LitPoints
from objectfolder.live.matt_body import MattBody
from objectfolder.live.scene_light import BodyLight, SceneLight
from objectfolder.live.scene_view import CENTRE, Crop, View, inverse_pose
from objectfolder.live.surroundings import wood_albedo
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import LIGHT_POWER_W, Lamps

Floats = NDArray[np.float64]
TABLE_ALBEDO = (0.42, 0.36, 0.3)
# Rows and columns of points at which the table's share of an environment is known, at most; and in images
# that move.
SPARSE, SPARSE_MOVING = 48, 24
# In place of a number of sub-rays: one ray a pixel, and in an environment a draft of its light.
DRAFT = 0
ONE_RAY = (DRAFT, 1)


@dataclass(frozen=True)
class Layer:
    """Premultiplied linear colour (h, w, 4) of one thing, its depth (h, w), and that by which it is sorted.

    Where a pixel is covered but for its centre, it is as far away as its neighbours.
    """

    rgba: Floats
    depth_m: Floats
    order_m: Floats


@dataclass(frozen=True)
class DrawnObject:
    """An object as it was drawn without shadows of others.

    Parameters
    ----------
    view, pose, sub_rays : of what it was drawn
    layer : what is seen
    lit : points of it, in the world
    part : rows and columns in which it may show
    draw : returns colour and depth there under some of the lamps alone
    """

    view: View
    pose: Floats
    sub_rays: int | None
    layer: Layer
    lit: LitPoints
    part: tuple[slice, slice]
    draw: Callable[[list[int]], tuple[Floats, Floats]]
    _alone: dict[int, Floats] = field(default_factory=dict)

    @classmethod
    def of(
        cls, file: ObjectFile | MattBody, pose: Floats, view: View, sub_rays: int | None, crop: Crop | None,
        light: BodyLight, shaded: Floats,
    ) -> "DrawnObject":  # fmt: skip
        """Draw an object by the light of its own frame; shadows fall of `shaded` (k, 3), in the world."""
        rgba, depth = np.zeros((*view.size, 4)), np.full(view.size, np.inf)
        local = replace(view, camera=inverse_pose(pose) @ view.camera)
        top, left, height, width = crop or (0, 0, 0, 0)
        part = np.s_[top : top + height, left : left + width]

        def draw(which: list[int]) -> tuple[Floats, Floats]:
            some = light.lamps_m[which], light.colours[which]
            if isinstance(file, MattBody):
                by = BodyLight(*some, None)
                return file.seen(local, (top, left, height, width), by, smooth=sub_rays not in ONE_RAY)
            if sub_rays == DRAFT or (sub_rays == 1 and light.around is None):
                return _cast(file, local, (top, left, height, width), *some)
            return _rendered(file, local, (top, left, height, width), sub_rays, *some)

        if crop is not None and isinstance(file, MattBody):
            rgba[part], depth[part] = file.seen(local, crop, light, smooth=sub_rays not in ONE_RAY)
        elif crop is not None and len(light.lamps_m):
            rgba[part], depth[part] = draw(list(range(len(light.lamps_m))))
        if crop is not None and light.around is not None and not isinstance(file, MattBody):
            even, depth[part] = (
                _drafted(file, local, crop, light.around, light.turn)
                if sub_rays == DRAFT
                else _rendered(file, local, crop, sub_rays, around=light.around)
            )
            # Light adds up; what is covered is that of either image, to the bit.
            rgba[part] = np.concatenate([rgba[part][..., :3] + even[..., :3], even[..., 3:]], axis=-1)
        order = depth.copy()
        order[part] = sorting_depth(depth[part])
        lit = LitPoints.of(view.points(depth), shaded)
        return cls(view, pose, sub_rays, Layer(rgba, depth, order), lit, part, draw)

    def alone(self, lamp: int) -> Floats:
        """Return what one of the lamps gives (h, w, 4) in the part where it shows."""
        if lamp not in self._alone:
            self._alone[lamp] = self.draw([lamp])[0]
        return self._alone[lamp]


@dataclass(frozen=True)
class Tabletop:
    """A matt square table as a camera sees it.

    Parameters
    ----------
    lit : its points at the centres of pixels
    depth_m, order_m : as of `Layer`
    covered : (h, w) its share of each pixel
    light : (k, h, w) what it reflects of each lamp of colour 1, unhindered, over its albedo
    sparse : (n, 3) points of its plane that stand for the pixels `at`, on a grid of (rows, columns)
    at : (rows,) and (columns,)
    albedo : (h, w, 3) or (3,) linear
    """

    lit: LitPoints
    depth_m: Floats
    order_m: Floats
    covered: Floats
    light: Floats
    sparse: Floats
    at: tuple[NDArray[np.int64], NDArray[np.int64]]
    albedo: Floats

    @classmethod
    def of(
        cls, side_m: float, height_m: float, lamps_m: Floats, view: View, *, wooden: bool = False,
        moving: bool = False,
    ) -> "Tabletop":  # fmt: skip
        """Return a table of some side and height under lamps (k, 3), for images that are `moving` or not."""
        point, depth = view.on_plane(height_m)
        footprints = []
        # Sides of the table cut a pixel as far as they lie from its middle, in its footprint.
        inside, covered = side_m / 2 - abs(point[..., :2]), np.ones(view.size)
        for axis in range(2):
            footprint = sum(abs(slope) for slope in np.gradient(point[..., axis]))
            footprints.append(footprint)
            covered *= np.clip(0.5 + inside[..., axis] / np.maximum(footprint, 1e-12), 0.0, 1.0)
        covered = np.where(np.isfinite(depth), covered, 0.0)
        depth = np.where(covered > 0, depth, np.inf)
        places = np.where(np.isfinite(depth)[..., None], point, np.nan)
        away = lamps_m[:, None, None] - point
        squared = np.maximum((away**2).sum(axis=-1), 1e-12)
        falls = np.maximum(away[..., 2], 0.0) / squared**1.5 * LIGHT_POWER_W / (4 * np.pi**2)
        sparse = SPARSE_MOVING if moving else SPARSE
        rows, columns = (np.unique(np.linspace(0, n - 1, sparse).round().astype(int)) for n in view.size)
        albedo = np.array(TABLE_ALBEDO)
        if wooden:
            albedo = wood_albedo(places[..., :2], np.maximum(*footprints))
        return cls(
            LitPoints.of(places, lamps_m),
            depth,
            sorting_depth(depth),
            covered,
            np.nan_to_num(falls, posinf=0.0),
            point[np.ix_(rows, columns)].reshape(-1, 3),
            (rows, columns),
            albedo,
        )

    def layer(self, hidden: NDArray[np.bool_], light: SceneLight, around: NDArray[np.bool_]) -> Layer:
        """Return it under a light, whose lamps are each hidden (k, h, w) somewhere.

        So is what comes from each direction, at the `sparse` points, (m, n).
        """
        rgba = np.empty((*self.covered.shape, 4))
        lit = np.where(hidden, 0.0, self.light).transpose(1, 2, 0) @ light.colours
        even = np.asarray(light.above)
        if around.any():
            rows, columns = self.at
            dark = (around.T @ light.shares).reshape(len(rows), len(columns), 3)
            along = np.meshgrid(*(np.arange(n) for n in self.covered.shape), indexing="ij")
            even = light.above - RegularGridInterpolator(self.at, dark)(tuple(along))
        rgba[..., :3] = (lit + even) * self.albedo * self.covered[..., None]
        rgba[..., 3] = self.covered
        return Layer(rgba, self.depth_m, self.order_m)


def _rendered(
    file: ObjectFile, view: View, crop: Crop, sub_rays: int | None, lamps: Floats | None = None,
    colours: Floats | None = None, around: Environment | None = None,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return colour (h, w, 4) and depth (h, w) of a part of a view; all in the object's frame."""
    lights = around if around is not None or lamps is None else Lamps(lamps[None], colours)
    drawn = file.render_passes(
        view.camera,
        ("linear", "depth"),
        lights,
        view.size,
        field_of_view_deg=view.field_of_view_deg,
        sub_rays=sub_rays,
        crop=crop,
    )
    return drawn["linear"][0], drawn["depth"][0]


def _cast(file: ObjectFile, view: View, crop: Crop, lamps: Floats, colours: Floats) -> tuple[Floats, Floats]:
    """Return as `_rendered` does what lies at the centres of pixels."""
    starts, along = view.rays_in(crop, CENTRE)
    depth = file.surface.ray_hits(starts, along).distance * -(along @ view.camera[:3, 2])
    hit = np.isfinite(depth)
    rgba = np.zeros((len(along), 4))
    rgba[hit] = file.radiance(starts[hit], along[hit], Lamps(lamps, colours))
    depth[rgba[:, 3] == 0] = np.inf  # in holes
    return rgba.reshape(*crop[2:], 4), depth.reshape(crop[2:])


def _drafted(
    file: ObjectFile, view: View, crop: Crop, around: Environment, turn: Floats
) -> tuple[Floats, Floats]:
    """Return about what `_rendered` does of the centres of pixels; `turn` is from its frame to `around`."""
    starts, along = view.rays_in(crop, CENTRE)
    rgba, distance = file.sight.net.draft(file.frame.to_unit(starts), along, around, turn)
    depth = distance * file.frame.scale * -(along @ view.camera[:3, 2])
    return rgba.reshape(*crop[2:], 4), depth.reshape(crop[2:])


def sorting_depth(depth: Floats) -> Floats:
    """Return depths (h, w), where nothing is those of the nearest neighbour."""
    return np.where(np.isfinite(depth), depth, minimum_filter(depth, size=3, mode="nearest"))


def composited(layers: list[Layer], size: tuple[int, int], objects: int) -> tuple[Floats, Floats]:
    """Return colours (h, w, 4) of layers over one another, and the depths (layers, h, w).

    The first layers are of objects, one behind them of the table: most pixels show that alone.
    """
    if not layers:
        return np.zeros((*size, 4)), np.zeros((0, *size))
    rgba = layers[-1].rgba.copy()
    which = np.zeros(size, dtype=bool)
    for layer in layers[:objects]:
        which |= layer.rgba[..., 3] > 0
    order = np.stack([layer.order_m[which] for layer in layers]).argsort(axis=0, kind="stable")
    colours = np.take_along_axis(np.stack([layer.rgba[which] for layer in layers]), order[..., None], 0)
    total = np.zeros(colours.shape[1:])
    for layer in colours:
        total += (1 - total[:, 3:]) * layer
    rgba[which] = total
    return rgba, np.stack([layer.depth_m for layer in layers])
