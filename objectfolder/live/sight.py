"""What a camera sees of the objects of a simulation, each drawn from its own Object File."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from objectfolder.errors import QueryError
from objectfolder.live.contacts import Posed, finite_pose
from objectfolder.object_file import ObjectFile
from objectfolder.query_values import real, real_array
from objectfolder.vision.cameras import (
    FIELD_OF_VIEW_DEG,
    focal_length_px,
    image_size,
    pixel_rays,
)
from objectfolder.vision.compositing import on_white
from objectfolder.vision.studio import exposure
from objectfolder.vision.truth.render_request import LIGHT_POWER_W

Floats = NDArray[np.float64]
Crop = tuple[int, int, int, int]  # (top, left, height, width), pixels
# In the world: a key lamp on the left, a weaker one on the right, one above, metres; and their colours.
LAMPS_M = ((-0.6, -0.8, 1.2), (0.9, -0.6, 0.7), (0.2, 0.4, 1.6))
LAMP_COLOURS = ((1.0, 0.97, 0.92), (0.3, 0.32, 0.36), (0.3, 0.3, 0.3))
TABLE_ALBEDO = (0.42, 0.36, 0.3)
# Shadow rays begin this share of their way off the surface.
OFF = 1e-3
STILL_PIXELS = 0.1  # that an object may move while a moving image shows it as it was
CENTRE = np.array([[0.5, 0.5]])  # of a pixel


@dataclass(frozen=True)
class SceneImage:
    """One image of a scene.

    Attributes
    ----------
    rgb : (h, w, 3) uint8, sRGB, on white
    depth_m : (h, w) along the camera's -z axis at the pixels' centres, infinity where nothing is
    body : (h, w) which of the files is seen there, -1 for the table and for nothing
    """

    rgb: NDArray[np.uint8]
    depth_m: Floats
    body: NDArray[np.int64]


@dataclass(frozen=True)
class _Layer:
    """Premultiplied linear colour (h, w, 4) of one thing, its depth (h, w), and that by which it is sorted.

    Where a pixel is covered but for its centre, it is as far away as its neighbours.
    """

    rgba: Floats
    depth_m: Floats
    order_m: Floats


class LiveSight:
    """Images of a simulation's objects together: the nearer one hides the other, and shadows fall.

    Each object is its Object File's own image: highlights, texture, and the light that its own parts throw
    on each other. Shadows of other objects have hard edges, taken at the pixels' centres; objects throw no
    light on one another and mirror nothing of one another.

    Parameters
    ----------
    simulation
        The engine, or anything that tells where bodies are, see `contacts.Posed`.
    files
        Object Files by the names of their bodies.
    lamps_m, lamp_colours
        (k, 3) point lamps in the world, and linear factors (k, 3) of the light that a data set's lamp gives
        at one metre.
    table_m
        Side and height in metres of a matt square table about the z axis; None: there is none.
    shadows
        Whether objects throw shadows on the table and on one another.
    exposure_factor
        Of linear values before they are shown; None: that which shows the first image best.

    Raises
    ------
    QueryError
        A body that the simulation lacks, lamps or colours of other shapes, values out of range.
    """

    def __init__(
        self,
        simulation: Posed,
        files: Mapping[str, ObjectFile],
        *,
        lamps_m: Floats | tuple[tuple[float, float, float], ...] = LAMPS_M,
        lamp_colours: Floats | tuple[tuple[float, float, float], ...] = LAMP_COLOURS,
        table_m: tuple[float, float] | None = (1.0, 0.0),
        shadows: bool = True,
        exposure_factor: float | None = None,
    ) -> None:
        self._simulation, self._files, self._shadows = simulation, dict(files), shadows
        self._lamps, self._colours = (
            real_array(name, values)
            for name, values in (("lamps_m", lamps_m), ("lamp_colours", lamp_colours))
        )
        if self._lamps.ndim != 2 or self._lamps.shape[1:] != (3,) or self._colours.shape != self._lamps.shape:
            finding = f"{self._lamps.shape} and {self._colours.shape}"
            raise QueryError("lamps_m, lamp_colours", finding, "Give a place and a colour (3,) of each.")
        self._table = None
        if table_m is not None:
            self._table = real("table_m[0]", table_m[0], 1e-3, 1e3), real("table_m[1]", table_m[1], -1e3, 1e3)
        self._exposure = None if exposure_factor is None else real("exposure_factor", exposure_factor, 0, 1e9)
        self._balls = {name: _ball(file) for name, file in self._files.items()}
        self._views: dict[tuple[bytes, tuple[int, int], float], tuple[_View, _Tabletop | None]] = {}
        self._before: dict[str, _Drawn] = {}
        # By what shadows fall on (None: the table) and who throws them.
        self._thrown: dict[tuple[str | None, str], tuple[_Lit, _Drawn, NDArray[np.bool_]]] = {}
        for name in self._files:
            finite_pose(simulation, name)

    def image(
        self, camera_to_world: Floats, resolution: int | tuple[int, int] = 256,
        field_of_view: float = FIELD_OF_VIEW_DEG, sub_rays: int | None = 4,
    ) -> SceneImage:  # fmt: skip
        """Draw the scene as it is now.

        Parameters
        ----------
        camera_to_world
            (4, 4) pose; the camera looks along -z, +y is up.
        resolution, field_of_view, sub_rays
            As for `ObjectFile.render`; but 1 is a ray through the centre of each pixel and no more, for
            images that move: edges are jagged.

        Raises
        ------
        QueryError
            A pose that is not finite or not rigid, values out of range.
        """
        camera, size = real_array("camera_to_world", camera_to_world), image_size(resolution)
        poses = {name: finite_pose(self._simulation, name) for name in self._files}
        view, table = self._seen_from(camera, size, float(field_of_view))
        drawn = {name: self._drawn(name, pose, view, sub_rays) for name, pose in poses.items()}
        layers = [self._shaded(name, drawn) for name in drawn]
        if table:
            layers.append(table.layer(self._hidden(table.lit, drawn), self._colours))
        rgba, depths = _over(layers, size, len(self._files))
        if self._exposure is None:
            self._exposure = exposure(rgba[None])
        nearest = depths.argmin(axis=0) if layers else np.zeros(size, np.int64)
        depth = np.take_along_axis(depths, nearest[None], 0)[0] if layers else np.full(size, np.inf)
        body = np.where(np.isfinite(depth) & (nearest < len(self._files)), nearest, -1)
        return SceneImage(on_white(rgba * ([self._exposure] * 3 + [1.0])), depth, body)

    def _seen_from(
        self, camera: Floats, size: tuple[int, int], field_of_view: float
    ) -> tuple["_View", "_Tabletop | None"]:
        """Return what only the camera decides: of the last four cameras it is known."""
        key = camera.tobytes(), size, field_of_view
        if key not in self._views:
            view = _View(camera, size, field_of_view)
            table = None if self._table is None else _Tabletop.of(*self._table, self._lamps, view)
            self._views = dict([*self._views.items(), (key, (view, table))][-4:])
        return self._views[key]

    def _shaded(self, name: str, drawn: Mapping[str, "_Drawn"]) -> _Layer:
        one = drawn[name]
        rgba = one.layer.rgba
        # Light adds up: what a lamp gives is taken away where it is hidden.
        for lamp, dark in enumerate(self._hidden(one.lit, drawn, name)):
            if dark.any():
                rgba = rgba.copy() if rgba is one.layer.rgba else rgba
                rgba[(*one.part, np.s_[:3])] -= one.alone(lamp)[..., :3] * dark[one.part][..., None]
        return replace(one.layer, rgba=np.maximum(rgba, 0.0))

    def _drawn(self, name: str, pose: Floats, view: "_View", sub_rays: int | None) -> "_Drawn":
        """Return an object without shadows of others: as it was drawn last, where it has not moved since.

        In images that move that is by a tenth of a pixel: engines leave bodies at rest in motion.
        """
        centre, radius = _apply(pose, self._balls[name][0]), self._balls[name][1]
        before = self._before.get(name)
        if before and before.view is view and before.sub_rays == sub_rays:
            moved_m = np.abs(pose[:3, 3] - before.pose[:3, 3]).max()
            moved_m += radius * np.abs(pose[:3, :3] - before.pose[:3, :3]).max()
            if moved_m <= (STILL_PIXELS * view.pixel_m(centre) if sub_rays == 1 else 0.0):
                return before
        # The file's lamps are as strong at one unit of its own frame as these are at a metre.
        colours = self._colours / self._files[name].frame.scale ** 2
        lamps = _apply(_inverse(pose), self._lamps)
        shaded = self._lamps if self._shadows else self._lamps[:0]
        crop = view.crop(centre, radius)
        drawn = _Drawn.of(self._files[name], pose, view, sub_rays, crop, lamps, colours, shaded)
        self._before[name] = drawn
        return drawn

    def _hidden(
        self, seen: "_Lit", drawn: Mapping[str, "_Drawn"], but: str | None = None
    ) -> NDArray[np.bool_]:
        """Return whether (k, h, w) points are hidden from lamps by other objects, as these were drawn."""
        hidden = np.zeros((len(self._lamps), *seen.known.shape), dtype=bool)
        for name, one in drawn.items() if self._shadows and seen.known.any() else ():
            if name == but:
                continue
            before = self._thrown.get((but, name))
            if before is None or before[0] is not seen or before[1] is not one:
                before = self._thrown[but, name] = seen, one, self._thrown_by(name, one.pose, seen)
            hidden[:, seen.known] |= before[2]
        return hidden

    def _thrown_by(self, name: str, pose: Floats, seen: "_Lit") -> NDArray[np.bool_]:
        """Return which (k, n) points an object hides from each lamp."""
        centre, radius = _apply(pose, self._balls[name][0]), self._balls[name][1]
        back, found = _inverse(pose), np.zeros((len(self._lamps), int(seen.known.sum())), dtype=bool)
        for dark, lamp, ways in zip(found, self._lamps, seen.ways, strict=True):
            near = np.flatnonzero(ways.within(centre, radius))
            starts = _apply(back, ways.points[near] + OFF * ways.way[near])
            ends = np.broadcast_to(_apply(back, lamp), (len(near), 3))
            dark[near] = self._files[name].surface.occluded(starts, ends)
        return found


@dataclass(frozen=True)
class _Ways:
    """Ways (n, 3) from points (n, 3) to a lamp, with what is asked for each object in turn.

    Parameters
    ----------
    squared, point_squared, along : (n,) of ways and of points, and the product of both
    """

    points: Floats
    way: Floats
    squared: Floats
    point_squared: Floats
    along: Floats

    @classmethod
    def of(cls, points: Floats, lamp: Floats) -> "_Ways":
        """Return the ways to a lamp (3,)."""
        way = lamp - points
        products = (np.einsum("ij,ij->i", a, b) for a, b in ((way, way), (points, points), (points, way)))
        return cls(points, way, *products)

    def within(self, centre: Floats, radius: float) -> NDArray[np.bool_]:
        """Return which (n,) pass a ball: how far its centre is from each way's nearest point."""
        across = self.way @ centre - self.along
        share = np.clip(across / np.maximum(self.squared, 1e-12), 0.0, 1.0)
        away = self.point_squared - 2 * (self.points @ centre) + centre @ centre
        return np.asarray(away + share * (share * self.squared - 2 * across) < radius**2)


@dataclass(frozen=True)
class _Lit:
    """Points of pixels that lamps may light: which pixels (h, w) have one, and the ways to each lamp."""

    known: NDArray[np.bool_]
    ways: tuple[_Ways, ...]

    @classmethod
    def of(cls, points: Floats, lamps: Floats) -> "_Lit":
        """Return points (h, w, 3), NaN for none, under lamps (k, 3)."""
        known = np.isfinite(points[..., 0])
        return cls(known, tuple(_Ways.of(points[known], lamp) for lamp in lamps))


@dataclass(frozen=True)
class _View:
    """A camera (4, 4), the (height, width) of its image and its field of view, degrees."""

    camera: Floats
    size: tuple[int, int]
    field_of_view: float

    @cached_property
    def rays(self) -> Floats:
        """Unit directions (h, w, 3) in the world through the centres of pixels."""
        pixels = np.arange(self.size[0] * self.size[1])
        _, along = pixel_rays(self.camera, pixels, CENTRE, self.size, self.field_of_view)
        return along.reshape(*self.size, 3)

    @cached_property
    def facing(self) -> Floats:
        """Depth (h, w) that is gained along a unit of each ray."""
        return np.asarray(-(self.rays @ self.camera[:3, 2]))

    def points(self, depth_m: Floats) -> Floats:
        """Return (h, w, 3) what is seen at the centres of pixels, NaN where nothing is."""
        points, known = np.full((*self.size, 3), np.nan), np.isfinite(depth_m)
        along = depth_m[known] / self.facing[known]
        points[known] = self.camera[:3, 3] + along[:, None] * self.rays[known]
        return points

    def on_plane(self, height_m: float) -> tuple[Floats, Floats]:
        """Return where (h, w, 3) rays meet a level plane, and the depth (h, w) there, infinite for none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (height_m - self.camera[2, 3]) / self.rays[..., 2]
        along = np.where(along > 0, along, np.inf)
        point = self.camera[:3, 3] + np.where(np.isfinite(along), along, 1e6)[..., None] * self.rays
        return point, along * self.facing

    def pixel_m(self, centre: Floats) -> float:
        """Return how wide a pixel is where a point (3,) of the world lies."""
        depth_m = abs(float(_apply(_inverse(self.camera), centre)[2]))
        return depth_m / focal_length_px(self.size, self.field_of_view)

    def crop(self, centre: Floats, radius: float) -> tuple[int, int, int, int] | None:
        """Return the part of the image (top, left, height, width) that a ball may cover; None: no part."""
        x, y, z = _apply(_inverse(self.camera), centre)
        if -z <= radius:
            return None if -z <= -radius else (0, 0, *self.size)
        # A ball's outline lies within that of the cube around it, whose nearest face is at -z - radius.
        focal = focal_length_px(self.size, self.field_of_view)
        sides = np.array([-1, 1])
        corners = np.array([-y, x])[:, None] + sides * radius
        ends = focal * (corners[:, None] / (-z + sides[:, None] * radius)).reshape(2, 4)
        middle, most = np.array(self.size) / 2, np.array(self.size)
        first = np.clip(np.floor(middle + ends.min(axis=1)) - 1, 0, most).astype(int)
        last = np.clip(np.ceil(middle + ends.max(axis=1)) + 1, 0, most).astype(int)
        if (last <= first).any():
            return None
        (top, left), (height, width) = first.tolist(), (last - first).tolist()
        return top, left, height, width


@dataclass(frozen=True)
class _Drawn:
    """An object as it was drawn without shadows of others.

    Parameters
    ----------
    view, pose, sub_rays : of what it was drawn
    layer : what is seen
    lit : points of it, in the world
    part : rows and columns in which it may show
    draw : returns colour and depth there under some of the lamps
    """

    view: _View
    pose: Floats
    sub_rays: int | None
    layer: _Layer
    lit: _Lit
    part: tuple[slice, slice]
    draw: Callable[[list[int]], tuple[Floats, Floats]]
    _alone: dict[int, Floats] = field(default_factory=dict)

    @classmethod
    def of(
        cls, file: ObjectFile, pose: Floats, view: _View, sub_rays: int | None, crop: Crop | None,
        lamps: Floats, colours: Floats, shaded: Floats,
    ) -> "_Drawn":  # fmt: skip
        """Draw an object by `lamps` (k, 3) of its own frame; shadows fall of `shaded`, in the world."""
        rgba, depth = np.zeros((*view.size, 4)), np.full(view.size, np.inf)
        local = replace(view, camera=_inverse(pose) @ view.camera)
        top, left, height, width = crop or (0, 0, 0, 0)
        part = np.s_[top : top + height, left : left + width]

        def draw(which: list[int]) -> tuple[Floats, Floats]:
            way = _cast if sub_rays == 1 else _rendered
            return way(file, local, (top, left, height, width), lamps[which], colours[which], sub_rays)

        if crop is not None:
            rgba[part], depth[part] = draw(list(range(len(lamps))))
        order = depth.copy()
        order[part] = _sorted_by(depth[part])
        lit = _Lit.of(view.points(depth), shaded)
        return cls(view, pose, sub_rays, _Layer(rgba, depth, order), lit, part, draw)

    def alone(self, lamp: int) -> Floats:
        """Return what one of the lamps gives (h, w, 4) in the part where it shows."""
        if lamp not in self._alone:
            self._alone[lamp] = self.draw([lamp])[0]
        return self._alone[lamp]


@dataclass(frozen=True)
class _Tabletop:
    """A matt square table as a camera sees it.

    Parameters
    ----------
    lit : its points at the centres of pixels
    depth_m, order_m : as of `_Layer`
    covered : (h, w) its share of each pixel
    light : (k, h, w) what it reflects of each lamp of colour 1, unhindered, over its albedo
    """

    lit: _Lit
    depth_m: Floats
    order_m: Floats
    covered: Floats
    light: Floats

    @classmethod
    def of(cls, side_m: float, height_m: float, lamps_m: Floats, view: _View) -> "_Tabletop":
        """Return a table of some side and height under lamps (k, 3)."""
        point, depth = view.on_plane(height_m)
        # Sides of the table cut a pixel as far as they lie from its middle, in its footprint.
        inside, covered = side_m / 2 - abs(point[..., :2]), np.ones(view.size)
        for axis in range(2):
            footprint = sum(abs(slope) for slope in np.gradient(point[..., axis]))
            covered *= np.clip(0.5 + inside[..., axis] / np.maximum(footprint, 1e-12), 0.0, 1.0)
        covered = np.where(np.isfinite(depth), covered, 0.0)
        depth = np.where(covered > 0, depth, np.inf)
        seen = np.where(np.isfinite(depth)[..., None], point, np.nan)
        away = lamps_m[:, None, None] - point
        squared = np.maximum((away**2).sum(axis=-1), 1e-12)
        falls = np.maximum(away[..., 2], 0.0) / squared**1.5 * LIGHT_POWER_W / (4 * np.pi**2)
        return cls(
            _Lit.of(seen, lamps_m), depth, _sorted_by(depth), covered, np.nan_to_num(falls, posinf=0.0)
        )

    def layer(self, hidden: NDArray[np.bool_], colours: Floats) -> _Layer:
        """Return it under lamps of `colours` (k, 3), each hidden (k, h, w) somewhere."""
        rgba = np.empty((*self.covered.shape, 4))
        lit = np.where(hidden, 0.0, self.light).transpose(1, 2, 0) @ (colours * TABLE_ALBEDO)
        rgba[..., :3], rgba[..., 3] = lit * self.covered[..., None], self.covered
        return _Layer(rgba, self.depth_m, self.order_m)


def _rendered(
    file: ObjectFile, view: _View, crop: Crop, lamps: Floats, colours: Floats, sub_rays: int | None
) -> tuple[Floats, Floats]:
    """Return colour (h, w, 4) and depth (h, w) of a part of a view; all in the object's frame."""
    drawn = file.render(
        view.camera, lamps[None], view.size, view.field_of_view, True, sub_rays,
        light_colour=colours, crop=crop, passes=("image", "depth"),
    )  # fmt: skip
    return drawn["image"][0], drawn["depth"][0]


def _cast(
    file: ObjectFile, view: _View, crop: Crop, lamps: Floats, colours: Floats, _: int | None
) -> tuple[Floats, Floats]:
    """Return as `_rendered` does what lies at the centres of pixels."""
    top, left, height, width = crop
    pixels = (np.arange(top, top + height)[:, None] * view.size[1] + np.arange(left, left + width)).ravel()
    starts, along = pixel_rays(view.camera, pixels, CENTRE, view.size, view.field_of_view)
    depth = file.surface.ray_hits(starts, along).distance * -(along @ view.camera[:3, 2])
    hit = np.isfinite(depth)
    rgba = np.zeros((len(pixels), 4))
    rgba[hit] = file.radiance(starts[hit], along[hit], lamps, light_colour=colours)
    depth[rgba[:, 3] == 0] = np.inf  # in holes
    return rgba.reshape(height, width, 4), depth.reshape(height, width)


def _sorted_by(depth: Floats) -> Floats:
    return np.where(np.isfinite(depth), depth, minimum_filter(depth, size=3, mode="nearest"))


def _over(layers: list[_Layer], size: tuple[int, int], objects: int) -> tuple[Floats, Floats]:
    """Return colours (h, w, 4) of layers over one another, and the depths (layers, h, w).

    The first layers are of objects, one behind them of the table: most pixels show that alone.
    """
    if not layers:
        return np.zeros((*size, 4)), np.zeros((0, *size))
    rgba = layers[-1].rgba.copy()
    which = np.any([layer.rgba[..., 3] > 0 for layer in layers[:objects]], axis=0)
    order = np.stack([layer.order_m[which] for layer in layers]).argsort(axis=0, kind="stable")
    found = np.take_along_axis(np.stack([layer.rgba[which] for layer in layers]), order[..., None], 0)
    total = np.zeros(found.shape[1:])
    for layer in found:
        total += (1 - total[:, 3:]) * layer
    rgba[which] = total
    return rgba, np.stack([layer.depth_m for layer in layers])


def _ball(file: ObjectFile) -> tuple[Floats, float]:
    """Return the centre (3,) and the radius of a ball round an object, metres, object frame."""
    centre = file.surface.bounds.mean(axis=0)
    return centre, float(np.linalg.norm(file.surface.vertices - centre, axis=1).max())


def _inverse(pose: Floats) -> Floats:
    inverse = np.eye(4)
    inverse[:3, :3], inverse[:3, 3] = pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def _apply(pose: Floats, points: Floats) -> Floats:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])
