"""What a camera sees of the objects of a simulation, each drawn from its own Object File."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.forks import hold_forks
from objectfolder.live.contacts import Posed, finite_pose
from objectfolder.live.lamp_ways import LitPoints
from objectfolder.live.matt_body import MattBody
from objectfolder.live.scene_layers import DRAFT, ONE_RAY, DrawnObject, Layer, Tabletop, composited
from objectfolder.live.scene_light import SceneLight, earlier_scene_lights
from objectfolder.live.scene_view import View, inverse_pose, moved_by
from objectfolder.live.surroundings import backdrop
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.query_values import real, real_array, require_room, whole
from objectfolder.renaming import renamed_keywords
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, image_size
from objectfolder.vision.compositing import on_backdrop, on_white
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import Lamps
from objectfolder.vision.studio import exposure
from objectfolder.vision.visionnet.visionnet import MOST_SUB_RAYS

Floats = NDArray[np.float64]
Hidden = NDArray[np.bool_]
Size = tuple[int, int]
SceneLights = ArrayLike | Lamps | Environment | Sequence[ArrayLike | Lamps | Environment]
# Shadow rays begin this share of their way off the surface.
OFF = 1e-3
STILL_PIXELS = 0.1  # that an object may move while a moving image shows it as it was
STILL_TURN = 0.05  # rad by which it may turn while a moving image keeps the environment round it
LAYER_BYTES = 40  # a pixel: colours, depth and which body, with copies


@dataclass(frozen=True)
class SceneImage:
    """One image of a scene.

    Attributes
    ----------
    rgb : (h, w, 3) uint8, sRGB, on white or the backdrop
    depth_m : (h, w) along the camera's -z axis at the pixels' centres, infinity where nothing is
    body : (h, w) which of the files is seen there, -1 for matt bodies, the table and nothing
    """

    rgb: NDArray[np.uint8]
    depth_m: Floats
    body: NDArray[np.int64]


class LiveSight:
    """Images of a simulation's objects together: the nearer one hides the other, and shadows fall.

    Each object is its Object File's own image: highlights, texture, and the light that its own parts throw
    on each other. Shadows that lamps throw of other objects have hard edges, taken at the pixels' centres.
    Objects throw no light on one another and mirror nothing of one another. They hide an environment from the
    table, not from one another.

    Parameters
    ----------
    simulation
        The engine, or anything that tells where bodies are, see `contacts.Posed`.
    files
        Object Files by the names of their bodies.
    matt
        Bodies without a file, by name.
    lights
        Positions (k, 3) of point lamps, metres, in the world; or `Lamps`, whose colours (k, 3) are factors of
        the light that a data set's lamp gives at one metre; or light from all round in the frame of the
        world, the name of an environment or an `Environment`; or a list of lamps and an environment, whose
        light adds up. None: three lamps.
    table_m
        Side and height in metres of a matt square table about the z axis; None: there is none.
    shadows
        Whether objects throw shadows on the table and on one another.
    warm
        Whether the table is of wood, and a soft backdrop is behind everything, in place of a plain table on
        white.
    exposure_factor
        Of linear values before they are shown; None: that which shows the first image best.

    Raises
    ------
    QueryError
        A body that the simulation lacks, lamps or colours of other shapes, another environment, values out
        of range.
    """

    @earlier_scene_lights
    def __init__(
        self,
        simulation: Posed,
        files: Mapping[str, ObjectFile],
        *,
        matt: Mapping[str, MattBody] | None = None,
        lights: SceneLights | None = None,
        table_m: tuple[float, float] | None = (1.0, 0.0),
        shadows: bool = True,
        warm: bool = False,
        exposure_factor: float | None = None,
    ) -> None:
        self._simulation, self._files, self._shadows = simulation, dict(files), shadows
        self._warm = warm
        self._drawable: dict[str, ObjectFile | MattBody] = {**files, **(matt or {})}
        self._light = SceneLight.of(lights)
        self._table = None
        if table_m is not None:
            self._table = real("table_m[0]", table_m[0], 1e-3, 1e3), real("table_m[1]", table_m[1], -1e3, 1e3)
        self._exposure = None if exposure_factor is None else real("exposure_factor", exposure_factor, 0, 1e9)
        self._balls = {name: _ball(file) for name, file in self._drawable.items()}
        self._views: dict[tuple[bytes, Size, float, bool], tuple[View, Tabletop | None]] = {}
        # Of each size of image: moving ones and those at rest take turns.
        self._before: dict[tuple[str, Size], DrawnObject] = {}
        # By what shadows fall on (None: the table) and who throws them.
        self._thrown: dict[tuple[str | None, str, Size], tuple[LitPoints, DrawnObject, Hidden]] = {}
        self._around: dict[tuple[str, Size], tuple[Tabletop, DrawnObject, Hidden]] = {}
        self._turned: dict[str, tuple[Floats, Environment | None]] = {}
        for name in self._drawable:
            finite_pose(simulation, name)

    @renamed_keywords(field_of_view="field_of_view_deg")
    @hold_forks
    def image(
        self, camera_to_world: Floats, resolution: int | tuple[int, int] = 256,
        field_of_view_deg: float = FIELD_OF_VIEW_DEG, sub_rays: int | None = 4, *, draft: bool = False,
    ) -> SceneImage:  # fmt: skip
        """Draw the scene as it is now.

        Parameters
        ----------
        camera_to_world
            (4, 4) pose; the camera looks along -z, +y is up.
        resolution, field_of_view_deg, sub_rays
            As for `ObjectFile.render`; but 1 is a ray through the centre of each pixel and no more, for
            images that move: edges are jagged.
        draft
            One ray a pixel whatever `sub_rays`, and in an environment light that is nearly right, in a tenth
            of the time: soft shadows of an object on itself come from some sites of it, and highlights do
            not show the object.

        Raises
        ------
        QueryError
            A pose that is not finite or not rigid, values out of range, an image larger than memory allows.
        """
        camera, size = real_array("camera_to_world", camera_to_world), image_size(resolution)
        layer_bytes = LAYER_BYTES * size[0] * size[1]
        remedy = "Ask for fewer pixels."
        require_room("resolution", layer_bytes * (len(self._drawable) + 2), remedy)
        rays = None if sub_rays is None else whole("sub_rays", sub_rays, 1, MOST_SUB_RAYS)
        rays = DRAFT if draft else rays
        poses = {name: finite_pose(self._simulation, name) for name in self._drawable}
        view, table = self._seen_from(camera, size, float(field_of_view_deg), rays in ONE_RAY)
        drawn = {name: self._drawn(name, pose, view, rays) for name, pose in poses.items()}
        layers = [self._shaded(name, drawn) for name in drawn]
        if table:
            hidden = self._hidden(table.lit, drawn), self._hidden_around(table, drawn)
            layers.append(table.layer(hidden[0], self._light, hidden[1]))
        rgba, depths = composited(layers, size, len(drawn))
        if self._exposure is None:
            self._exposure = exposure(rgba[None])
        nearest = depths.argmin(axis=0) if layers else np.zeros(size, np.int64)
        depth = np.take_along_axis(depths, nearest[None], 0)[0] if layers else np.full(size, np.inf)
        body = np.where(np.isfinite(depth) & (nearest < len(self._files)), nearest, -1)
        exposed = rgba * ([self._exposure] * 3 + [1.0])
        return SceneImage(
            on_backdrop(exposed, backdrop(view)) if self._warm else on_white(exposed), depth, body
        )

    def _seen_from(
        self, camera: Floats, size: Size, field_of_view_deg: float, moving: bool
    ) -> tuple[View, Tabletop | None]:
        """Return what only the camera decides: of the last four cameras it is known."""
        key = camera.tobytes(), size, field_of_view_deg, moving
        if key not in self._views:
            view = View(camera, size, field_of_view_deg)
            table = None
            if self._table is not None:
                lamps_m, look = self._light.lamps_m, {"wooden": self._warm, "moving": moving}
                table = Tabletop.of(*self._table, lamps_m, view, **look)
            self._views = dict([*self._views.items(), (key, (view, table))][-4:])
        return self._views[key]

    def _shaded(self, name: str, drawn: Mapping[str, DrawnObject]) -> Layer:
        item = drawn[name]
        rgba = item.layer.rgba
        # Light adds up: what a lamp gives is taken away where it is hidden.
        for lamp, dark in enumerate(self._hidden(item.lit, drawn, name)):
            if dark.any():
                rgba = rgba.copy() if rgba is item.layer.rgba else rgba
                rgba[(*item.part, np.s_[:3])] -= item.alone(lamp)[..., :3] * dark[item.part][..., None]
        return replace(item.layer, rgba=np.maximum(rgba, 0.0))

    def _drawn(self, name: str, pose: Floats, view: View, sub_rays: int | None) -> DrawnObject:
        """Return an object without shadows of others: as it was drawn last, where it has not moved since.

        In images that move that is by a tenth of a pixel: engines leave bodies at rest in motion.
        """
        file = self._drawable[name]
        if sub_rays == DRAFT and isinstance(file, ObjectFile) and not file.sight.net.drafts:
            sub_rays = 1
        centre, radius = moved_by(pose, self._balls[name][0]), self._balls[name][1]
        before = self._before.get((name, view.size))
        if before and before.view is view and before.sub_rays == sub_rays:
            moved_m = np.abs(pose[:3, 3] - before.pose[:3, 3]).max()
            moved_m += radius * np.abs(pose[:3, :3] - before.pose[:3, :3]).max()
            if moved_m <= (STILL_PIXELS * view.pixel_m(centre) if sub_rays in ONE_RAY else 0.0):
                return before
        unit_m = 1.0 if isinstance(file, MattBody) else file.frame.scale
        crop, around, turn = view.crop(centre, radius), self._light.around, pose[:3, :3]
        if crop is not None and sub_rays != DRAFT:
            around, turn = self._environment_of(name, pose, sub_rays == 1), np.eye(3)
        light = self._light.seen_by(pose, unit_m, around, turn)
        shaded = self._light.lamps_m if self._shadows else self._light.lamps_m[:0]
        drawn = DrawnObject.of(file, pose, view, sub_rays, crop, light, shaded)
        self._before[name, view.size] = drawn
        return drawn

    def _environment_of(self, name: str, pose: Floats, moving: bool) -> Environment | None:
        """Return the environment as a body sees it, in moving images as it saw it when it was turned last."""
        before = self._turned.get(name)
        most = STILL_TURN if moving else 0.0
        if before is None or np.abs(pose[:3, :3] - before[0]).max() > most:
            before = self._turned[name] = pose[:3, :3].copy(), self._light.turned(pose)
        return before[1]

    def _hidden(
        self, points: LitPoints, drawn: Mapping[str, DrawnObject], but: str | None = None
    ) -> NDArray[np.bool_]:
        """Return whether (k, h, w) points are hidden from lamps by other objects, as these were drawn."""
        hidden = np.zeros((len(self._light.lamps_m), *points.present.shape), dtype=bool)
        for name, item in drawn.items() if self._shadows and points.present.any() else ():
            if name == but:
                continue
            key = but, name, item.view.size
            before = self._thrown.get(key)
            if before is None or before[0] is not points or before[1] is not item:
                before = self._thrown[key] = points, item, self._thrown_by(name, item.pose, points)
            hidden[:, points.present] |= before[2]
        return hidden

    def _hidden_around(self, table: Tabletop, drawn: Mapping[str, DrawnObject]) -> NDArray[np.bool_]:
        """Return which (m, n) directions of the environment objects hide from sparse points of the table."""
        hidden = np.zeros((len(self._light.towards), len(table.sparse)), dtype=bool)
        for name, item in drawn.items() if self._shadows and hidden.size else ():
            key = name, item.view.size
            before = self._around.get(key)
            if before is None or before[0] is not table or before[1] is not item:
                before = self._around[key] = table, item, self._hidden_by(name, item.pose, table.sparse)
            hidden |= before[2]
        return hidden

    def _hidden_by(self, name: str, pose: Floats, points: Floats) -> NDArray[np.bool_]:
        """Return which (m, n) directions of the environment an object hides from points (n, 3)."""
        centre, radius = moved_by(pose, self._balls[name][0]), self._balls[name][1]
        back, towards = inverse_pose(pose), self._light.towards
        away = centre - points
        along = towards @ away.T
        direction, point = np.nonzero((along > -radius) & ((away**2).sum(axis=1) - along**2 < radius**2))
        reach = (along[direction, point] + radius)[:, None] * towards[direction]
        starts = points[point] + OFF * reach
        hidden = np.zeros(along.shape, dtype=bool)
        ends = moved_by(back, points[point] + reach)
        hidden[direction, point] = self._drawable[name].surface.occluded(moved_by(back, starts), ends)
        return hidden

    def _thrown_by(self, name: str, pose: Floats, points: LitPoints) -> NDArray[np.bool_]:
        """Return which (k, n) points an object hides from each lamp."""
        centre, radius = moved_by(pose, self._balls[name][0]), self._balls[name][1]
        back, lamps = inverse_pose(pose), self._light.lamps_m
        shadows = np.zeros((len(lamps), int(points.present.sum())), dtype=bool)
        for dark, lamp, ways in zip(shadows, lamps, points.ways, strict=True):
            near = np.flatnonzero(ways.within(centre, radius))
            starts = moved_by(back, ways.points[near] + OFF * ways.way[near])
            ends = np.broadcast_to(moved_by(back, lamp), (len(near), 3))
            dark[near] = self._drawable[name].surface.occluded(starts, ends)
        return shadows


def _ball(file: ObjectFile | MattBody) -> tuple[Floats, float]:
    """Return the centre (3,) and the radius of a ball round an object, metres, object frame."""
    centre = file.surface.bounds.mean(axis=0)
    return centre, float(np.linalg.norm(file.surface.vertices - centre, axis=1).max())
