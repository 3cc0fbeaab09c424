"""VisionNet rendered by compiled kernels: the image of the route through torch, many times sooner."""

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np

from objectfolder.vision.compiled.drafts import Draft
from objectfolder.vision.compiled.effort import Effort
from objectfolder.vision.compiled.gloss_images import shade_gloss
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.lamp_images import mark_curved, shade_in_turn, shade_lit
from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.compiled.lobes import Cast
from objectfolder.vision.compiled.network import CompiledNetwork
from objectfolder.vision.compiled.shading import LIGHTS_IN_TURN, Shading, join_lights, labels_of
from objectfolder.vision.compiled.smoothing import SMOOTH_PX
from objectfolder.vision.compiled.surrounded_images import shade_surrounded
from objectfolder.vision.compiled.surroundings import Surroundings
from objectfolder.vision.compiled.visibility import MARGIN_PX, Crop, Projection, View, look
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.sparse_grid import SparseGrid

# Directions of a ray's gloss in which the surface is looked for.
RAY_SAMPLES = 8


class CompiledRenderer:
    """The surface, grid and weights of a VisionNet, ready to render.

    Every answer is computed alone by one thread, so that it depends on nothing but its own arguments.
    A quantity that no light changes is found once a view.

    Parameters
    ----------
    surface
        In the unit frame.
    grid
        Cells of the feature grid.
    weights
        Arrays of `reflectance.Reflectance` by name.
    radiance_scale
        What one unit of the network's output is in scene-linear radiance.

    Raises
    ------
    FormatError
        Weights of a network that is not the one compiled here.
    """

    def __init__(
        self,
        surface: UnitSurface,
        grid: SparseGrid,
        weights: Mapping[str, np.ndarray],
        radiance_scale: float,
    ) -> None:
        self._set(surface, LitSurface(surface), CompiledNetwork(grid, weights), radiance_scale)

    @classmethod
    def of_material(
        cls, surface: UnitSurface, material: Material, radiance_scale: float
    ) -> "CompiledRenderer":
        """Return a renderer of a surface of known material, with nothing learned.

        Raises
        ------
        FormatError
            A material that is not known in full.
        """
        renderer, lit = cls.__new__(cls), LitSurface(surface)
        renderer._set(surface, lit, KnownLight(lit, surface, material), radiance_scale)
        return renderer

    def _set(
        self, unit: UnitSurface, surface: LitSurface, network: CompiledNetwork | KnownLight,
        radiance_scale: float,
    ) -> None:  # fmt: skip
        self._unit, self._surface, self._network = unit, surface, network
        self._shading = Shading(surface, network)
        self._scale = np.array([radiance_scale] * 3 + [1.0], dtype=np.float32)

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
        size: tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int,
        crop: Crop | None = None,
    ) -> np.ndarray:
        """Render one view under point lights, whose contributions add up.

        Parameters
        ----------
        camera_to_world
            (4, 4) pose.
        light_position, light_colour
            (k, 3) positions, and factors of the data set's light in each channel.
        size
            (height, width), pixels.
        field_of_view_deg
            Angle over the longer side.
        sub_rays
            See `Effort`.
        crop
            (top, left, height, width) of the part that is wanted, pixels.

        Returns
        -------
        np.ndarray
            (h, w, 4) float32 scene-linear, premultiplied.

        Raises
        ------
        QueryError
            Fewer than one sub-ray, a field of view outside (0, 180) degrees.
        """
        is_known = isinstance(self._network, KnownLight)
        lights = list(_lights(light_position, light_colour))
        effort = Effort.of(sub_rays, is_known=is_known, one_lamp=len(lights) == 1)
        reach = SMOOTH_PX + 1 if is_known else 0
        view = self._view(camera_to_world, size, field_of_view_deg, effort, crop, reach)
        colour = np.zeros((len(view.rows), 3))
        if len(colour) and lights:
            many = len(lights) >= LIGHTS_IN_TURN
            labels = labels_of(view)
            if is_known or not many:
                probes = self._shading.chosen(view, labels, np.ones(len(colour), dtype=np.int64))
                chosen = probes
                if max(effort.shaded, effort.shaded_ends * is_known) > 1:
                    shaded = np.full(len(colour), effort.shaded)
                    if is_known and effort.shaded_ends:
                        shaded[view.samples[1].pixels] = effort.shaded_ends
                    chosen = self._shading.chosen(view, labels, shaded)
                visible = self._shading.visible(chosen.points)
            if is_known:
                colour += shade_gloss(
                    self._shading, view, probes, chosen, visible.appearance, join_lights(lights), effort
                )
            if many:
                colour += shade_in_turn(self._shading, view, lights, effort)
            else:
                turns = effort.shaded_curved > effort.shaded_uneven
                curved = mark_curved(self._shading, chosen, len(colour)) if turns else None
                for light, factor in lights:
                    colour += factor * shade_lit(
                        self._shading, view, probes, chosen, visible, light, effort, curved
                    )
        return _image(view, colour * self._scale[:3], crop or (0, 0, *size))

    def surrounded(
        self,
        camera_to_world: np.ndarray,
        environment: Environment,
        size: tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int,
        crop: Crop | None = None,
    ) -> np.ndarray:
        """Render one view in an environment, otherwise as `render`."""
        effort = Effort.of(sub_rays, is_known=isinstance(self._network, KnownLight))
        view = self._view(camera_to_world, size, field_of_view_deg, effort, crop, SMOOTH_PX)
        colour = np.zeros((len(view.rows), 3))
        if len(colour):
            around = Surroundings(self._surface, self._network, environment)
            colour = shade_surrounded(self._shading, view, around, effort) / np.pi
        return _image(view, colour, crop or (0, 0, *size))

    def draft(
        self, origins: np.ndarray, directions: np.ndarray, environment: Environment, turn: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return about the radiance (n, 4) float32 along rays in an environment, and how far (n,) they go.

        Parameters
        ----------
        origins, directions
            (n, 3), the latter of length 1, unit frame.
        turn
            (3, 3) from this frame to the environment's.
        """
        origins, directions = (np.array(rays, dtype=np.float64) for rays in (origins, directions))
        rgba, distance = np.zeros((len(origins), 4), dtype=np.float32), np.full(len(origins), np.inf)
        face, barycentric = self._surface.volumes.first_hits(origins, directions)
        hit = np.flatnonzero(face >= 0)
        points = self._surface.points(face[hit], barycentric[hit], directions[hit])
        rgba[hit, :3] = self._draft.radiance(points, environment, turn)
        rgba[hit, 3] = 1.0
        distance[hit] = np.einsum("ij,ij->i", points.position - origins[hit], directions[hit])
        return rgba, distance

    @cached_property
    def _draft(self) -> Draft:
        return Draft(self._surface, self._unit, self._network)

    def _view(
        self, camera_to_world: np.ndarray, size: tuple[int, int], field_of_view_deg: float, effort: Effort,
        crop: Crop | None, reach: int = 0,
    ) -> View:  # fmt: skip
        projection = Projection.of(
            self._surface.vertices,
            self._surface.faces,
            camera_to_world,
            size,
            field_of_view_deg,
            crop or (0, 0, *size),
            MARGIN_PX + reach,
        )
        samples = effort.samples, effort.samples_uneven, effort.samples_outline
        return look(projection, self._surface.facets, *samples)

    def radiance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
    ) -> np.ndarray:
        """Return (n, 4) float32 scene-linear premultiplied RGBA along rays, unit frame.

        Parameters
        ----------
        origins, directions
            (n, 3), the latter of length 1.
        light_position, light_colour
            (k, 3) as in `render`.
        """
        origins = np.ascontiguousarray(origins, dtype=np.float64)
        directions = np.ascontiguousarray(directions, dtype=np.float64)
        rgba = np.zeros((len(origins), 4), dtype=np.float32)
        face, barycentric = self._surface.volumes.first_hits(origins, directions)
        hit = np.flatnonzero(face >= 0)
        visible = self._shading.visible(self._surface.points(face[hit], barycentric[hit], directions[hit]))
        colour = np.zeros((len(hit), 3))
        lights = list(_lights(light_position, light_colour))
        for light, factor in lights:
            colour += factor * self._shading.colour(
                visible, self._shading.arriving(visible.points, light), light
            )
        if isinstance(self._network, KnownLight) and len(hit) and lights:
            # Each ray is answered as if it were alone.
            first, single = np.zeros(len(hit), dtype=np.int64), np.ones(len(hit), dtype=np.int64)
            cast = Cast(first, first, first, single)
            arguments = visible.points, visible.appearance, cast, RAY_SAMPLES * single, join_lights(lights)
            colour += self._network.in_gloss(*arguments)[0]
        rgba[hit, :3] = colour
        rgba[hit, 3] = 1.0
        return rgba * self._scale


def _image(view: View, colour: np.ndarray, crop: Crop) -> np.ndarray:
    """Return the pixels' colours (p, 3) and coverage in their places, (height, width, 4) float32."""
    top, left, height, width = crop
    rgba = np.zeros((height, width, 4), dtype=np.float32)
    row, column = view.rows.astype(np.int64) - top, view.columns.astype(np.int64) - left
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    rgba[row[inside], column[inside], :3] = (colour * (view.alpha / view.coverage)[:, None])[inside]
    rgba[row[inside], column[inside], 3] = view.alpha[inside]
    return rgba


def _lights(position: np.ndarray, colour: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield position and colour (3,) of each light that shines at all."""
    for light, factor in zip(
        # A copy: kernels would be compiled a second time for an array that may not be written.
        np.array(position, dtype=np.float64).reshape(-1, 3),
        np.asarray(colour, dtype=np.float64).reshape(-1, 3),
        strict=True,
    ):
        if factor.any():
            yield light, factor
