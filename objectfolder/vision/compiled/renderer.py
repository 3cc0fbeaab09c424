"""VisionNet rendered by compiled kernels: the same image as the route through torch, many times sooner."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.vision.cameras import focal_length_px, sub_ray_offsets
from objectfolder.vision.compiled.borders import contrasting, heaviest, mixed, sum_by_pixel, unevenly_seen
from objectfolder.vision.compiled.bounding_volumes import BoundingVolumes
from objectfolder.vision.compiled.grouping import GROUPS, choose_samples, group_samples
from objectfolder.vision.compiled.lighting import surface_points, unhindered
from objectfolder.vision.compiled.network import CompiledNetwork
from objectfolder.vision.compiled.rasteriser import edge_functions, meet_planes, rasterise
from objectfolder.vision.compositing import srgb_encode
from objectfolder.vision.incidence import SELF_OFFSET, TERMINATOR_COSINE, UnitSurface
from objectfolder.vision.sparse_grid import SparseGrid

# Radiance of one unit as it is commonly shown: contrast is judged as the eye would, without asking a scale.
SHOWN = 0.3
# What a pixel looks like depends on neighbours at most this far away, pixels.
MARGIN = 2
# Where in the box around a group the points that stand for it should lie.
MOST_SHADED = 16
TARGETS = np.zeros((MOST_SHADED, MOST_SHADED, 2), dtype=np.float32)
for _count in range(1, MOST_SHADED + 1):
    TARGETS[_count - 1, :_count] = sub_ray_offsets(_count)
Crop = tuple[int, int, int, int]


@dataclass(frozen=True)
class Effort:
    """What `sub_rays` buys.

    Parameters
    ----------
    samples
        Sub-samples of visibility a pixel.
    samples_uneven
        The same where a smooth piece of surface ends.
    shaded
        Colours a smooth piece of surface in a pixel.
    shaded_uneven
        The same where colour changes fast.
    contrast
        Difference to a neighbour, in sRGB, from which on it does.
    """

    samples: int
    samples_uneven: int
    shaded: int
    shaded_uneven: int
    contrast: float

    @classmethod
    def of(cls, sub_rays: int) -> "Effort":
        """Return the effort of a number of sub-rays.

        Raises
        ------
        QueryError
            Fewer than one.
        """
        if sub_rays < 1:
            raise QueryError("sub_rays", f"{sub_rays} rays a pixel", "Use 1, 4, 16 or 64.")
        if sub_rays >= 64:
            return cls(16, 4 * sub_rays, 4, 16, 0.03)
        if sub_rays >= 16:
            return cls(16, 256, 2, 4, 0.04)
        if sub_rays >= 4:
            return cls(16, 64, 1, 3, 0.05)
        return cls(16, 64, 1, 1, 2.0)


@dataclass(frozen=True)
class _Samples:
    """Sub-samples of some pixels, equally many of each.

    Parameters
    ----------
    start
        Number of the first of these pixels among all of the view.
    seen, label
        (p, s) face and group of each sub-sample.
    offsets_x, offsets_y
        (s,) sub-samples from the centre.
    """

    start: int
    seen: np.ndarray
    label: np.ndarray
    offsets_x: np.ndarray
    offsets_y: np.ndarray

    @property
    def pixels(self) -> slice:
        """Which pixels of the view these are."""
        return slice(self.start, self.start + len(self.seen))


@dataclass(frozen=True)
class _View:
    """What a camera sees: the pixels (p,) of a window that see anything, even ones first.

    Parameters
    ----------
    slots
        (h, w) int32 of the window: pixel, or -1.
    columns, rows
        (p,) centres of the pixels in the image.
    coverage
        (p,) share of the pixel.
    samples
        Of the even and of the uneven pixels.
    functions
        Edge functions of the faces.
    """

    slots: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    coverage: np.ndarray
    samples: tuple[_Samples, _Samples]
    functions: np.ndarray
    camera_to_world: np.ndarray
    focal: float
    centre: tuple[float, float]


@dataclass(frozen=True)
class _Points:
    """Points of the surface; as `lighting.surface_points`, and what they were made from."""

    face: np.ndarray
    barycentric: np.ndarray
    direction: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    side: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True)
class _Chosen:
    """Points that stand for a group of a pixel each: pixel, group and share of the pixel (n,)."""

    pixel: np.ndarray
    group: np.ndarray
    weight: np.ndarray
    points: _Points


class CompiledRenderer:
    """The surface, grid and weights of a VisionNet, ready to render.

    Every answer is computed alone by one thread, so that it depends on nothing but its own arguments.

    Parameters
    ----------
    surface
        In the unit frame.
    grid
        Cells of the feature grid.
    weights
        Arrays of `reflectance.Reflectance` by name.

    Raises
    ------
    FormatError
        Weights of a network that is not the one compiled here.
    """

    def __init__(
        self, surface: UnitSurface, grid: SparseGrid, weights: Mapping[str, np.ndarray]
    ) -> None:
        self._network = CompiledNetwork(grid, weights)
        self._triangles = np.ascontiguousarray(surface.triangles)
        self._vertices = surface.frame.to_unit(surface.surface.vertices)
        self._faces = surface.surface.faces
        self._corner_normals = np.ascontiguousarray(surface.surface.corner_normals)
        self._facets = np.ascontiguousarray(surface.surface.face_normals)
        self._volumes = BoundingVolumes.of_triangles(self._triangles)

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
        size: tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int,
        crop: Crop | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Render one view under point lights, whose contributions add up.

        Parameters
        ----------
        camera_to_world
            (4, 4) pose, unit frame.
        light_position, light_colour
            (k, 3) unit frame, and linear RGB factors.
        size
            (height, width) of the whole image, pixels.
        field_of_view_deg
            Angle over the longer side.
        sub_rays
            Quality: 1, 4, 16 or 64; see `Effort`.
        crop
            Top, left, height, width of the part wanted; equal to that part of the whole.

        Returns
        -------
        rgba
            (h, w, 4) float32 premultiplied, radiance over the radiance scale.
        depth
            (h, w) float32 along the camera's -z to what covers most of the pixel; infinity where nothing is.
        normal
            (h, w, 3) float32 shading normal there, on the camera's side; zero where nothing is.

        Raises
        ------
        QueryError
            Fewer than one sub-ray, a field of view outside (0, 180) degrees.
        """
        effort = Effort.of(sub_rays)
        top, left, height, width = (0, 0, *size) if crop is None else crop
        rgba = np.zeros((height, width, 4), dtype=np.float32)
        depth = np.full((height, width), np.inf, dtype=np.float32)
        normal = np.zeros((height, width, 3), dtype=np.float32)
        pose = np.ascontiguousarray(camera_to_world, dtype=np.float64)
        view = self._view(pose, size, field_of_view_deg, effort, (top, left, height, width))
        if view is None:
            return rgba, depth, normal
        once = np.ones(len(view.rows), dtype=np.int64)
        probes = self._chosen(view, [samples.label for samples in view.samples], once)
        first = heaviest(probes.pixel, probes.weight, len(once))
        colour = np.zeros((len(once), 3))
        for light, factor in zip(
            np.asarray(light_position, dtype=np.float64).reshape(-1, 3),
            np.asarray(light_colour, dtype=np.float64).reshape(-1, 3),
            strict=True,
        ):
            colour += factor * self._lit(view, probes, light, effort)
        row, column = view.rows.astype(np.int64) - top, view.columns.astype(np.int64) - left
        kept = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        at = row[kept], column[kept]
        rgba[(*at, slice(3))] = colour[kept]
        rgba[(*at, 3)] = view.coverage[kept]
        depth[at] = probes.points.depth[first][kept]
        normal[at] = probes.points.normal[first][kept]
        return rgba, depth, normal

    def radiance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
    ) -> np.ndarray:
        """Return (n, 4) float32 premultiplied RGBA over the radiance scale along rays, unit frame.

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
        face, barycentric = self._volumes.first_hits(origins, directions)
        hit = np.flatnonzero(face >= 0)
        points = self._surface_points(face[hit], barycentric[hit], directions[hit], np.zeros(len(hit)))
        colour = np.zeros((len(hit), 3))
        for light, factor in zip(
            np.asarray(light_position, dtype=np.float64).reshape(-1, 3),
            np.asarray(light_colour, dtype=np.float64).reshape(-1, 3),
            strict=True,
        ):
            irradiance, start = self._unhindered(points, light)
            irradiance[self._volumes.occluded(start, light, irradiance > 0)] = 0.0
            colour += factor * self._colour(points, irradiance, light)
        rgba[hit, :3] = colour
        rgba[hit, 3] = 1.0
        return rgba

    def _view(
        self, pose: np.ndarray, size: tuple[int, int], field_of_view_deg: float, effort: Effort, crop: Crop
    ) -> _View | None:
        """Find what each sub-sample sees; None where nothing is seen at all."""
        focal, centre = focal_length_px(size, field_of_view_deg), (size[1] / 2.0, size[0] / 2.0)
        local = np.ascontiguousarray((self._vertices - pose[:3, 3]) @ pose[:3, :3])
        functions, reach = edge_functions(local, self._faces, focal, *centre)
        left, right = (
            max(reach[:, 0].min(), crop[1] - MARGIN, 0.0),
            min(reach[:, 1].max(), crop[1] + crop[3] + MARGIN, size[1]),
        )
        top, bottom = (
            max(reach[:, 2].min(), crop[0] - MARGIN, 0.0),
            min(reach[:, 3].max(), crop[0] + crop[2] + MARGIN, size[0]),
        )
        if not (left <= right and top <= bottom):
            return None
        top, left = int(top), int(left)
        height, width = int(np.ceil(bottom)) - top, int(np.ceil(right)) - left
        if height < 1 or width < 1:
            return None
        def looked(slots: np.ndarray, count: int, wanted: int) -> tuple[np.ndarray, ...]:
            offsets = (sub_ray_offsets(wanted) - 0.5).astype(np.float32).T.copy()
            seen = np.full((count, wanted), -1, dtype=np.int32)
            nearness = np.zeros((count, wanted), dtype=np.float32)
            rasterise(functions, reach, slots, top, left, offsets[0], offsets[1], seen, nearness)
            rows, columns = np.nonzero(slots >= 0)
            label = group_samples(
                seen, nearness, left + columns + 0.5, top + rows + 0.5, functions, self._facets,
                offsets[0], offsets[1], 1.0 / focal,
            )  # fmt: skip
            return seen, label, offsets[0], offsets[1]

        everywhere = np.arange(height * width, dtype=np.int32).reshape(height, width)
        seen, label, *offsets = looked(everywhere, height * width, effort.samples)
        uneven = unevenly_seen(label, everywhere).ravel()
        even = np.flatnonzero((label[:, 0] >= 0) & ~uneven)
        again = np.flatnonzero(uneven)
        slots = np.full(height * width, -1, dtype=np.int32)
        slots[again] = np.arange(len(again), dtype=np.int32)
        finer = looked(slots.reshape(height, width), len(again), effort.samples_uneven)
        covered = (finer[1] >= 0).sum(axis=1)
        found = np.flatnonzero(covered)
        pixel = np.concatenate([even, again[found]])
        if len(pixel) == 0:
            return None
        slots[:] = -1
        slots[pixel] = np.arange(len(pixel), dtype=np.int32)
        rows, columns = np.divmod(pixel, width)
        return _View(
            slots.reshape(height, width),
            left + columns + 0.5,
            top + rows + 0.5,
            np.concatenate([np.ones(len(even)), covered[found] / effort.samples_uneven]),
            (
                _Samples(0, seen[even], label[even], *offsets),
                _Samples(len(even), finer[0][found], finer[1][found], *finer[2:]),
            ),
            functions,
            pose,
            focal,
            centre,
        )

    def _chosen(self, view: _View, labels: list[np.ndarray], wanted: np.ndarray) -> _Chosen:
        """Choose `wanted` (p,) points of each group of each pixel."""
        parts = []
        for samples, label in zip(view.samples, labels, strict=True):
            pixel, sample, group, weight = choose_samples(
                label, 2 * GROUPS, samples.offsets_x, samples.offsets_y, wanted[samples.pixels], TARGETS
            )
            parts.append((samples.start + pixel, group, weight, *_places(view, samples, pixel, sample)))
        pixel, group, weight, face, x, y = (np.concatenate(column) for column in zip(*parts, strict=True))
        return _Chosen(pixel, group, weight, self._points(view, face, x, y))

    def _points(self, view: _View, face: np.ndarray, x: np.ndarray, y: np.ndarray) -> _Points:
        barycentric, depth, direction = meet_planes(
            view.functions, face, x, y, view.camera_to_world, view.focal, *view.centre
        )
        return self._surface_points(face, barycentric, direction, depth)

    def _surface_points(
        self, face: np.ndarray, barycentric: np.ndarray, direction: np.ndarray, depth: np.ndarray
    ) -> _Points:
        position, normal, side = surface_points(
            face, barycentric, direction, self._triangles, self._corner_normals, self._facets
        )
        return _Points(face, barycentric, direction, position, normal, side, depth)

    def _unhindered(self, points: _Points, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return unhindered(  # type: ignore[no-any-return]
            points.face, points.barycentric, points.position, points.normal, points.side, light,
            self._triangles, self._corner_normals, self._facets, TERMINATOR_COSINE, SELF_OFFSET,
        )  # fmt: skip

    def _colour(self, points: _Points, irradiance: np.ndarray, light: np.ndarray) -> np.ndarray:
        return self._network.radiance(points.position, points.normal, -points.direction, irradiance, light)

    def _lit(self, view: _View, probes: _Chosen, light: np.ndarray, effort: Effort) -> np.ndarray:
        """Return the colour (p, 3) of the pixels under one light of colour 1."""
        labels, state = self._shadows(view, probes, light)
        colour = self._shaded(view, labels, state, np.full(len(view.rows), effort.shaded), light)
        if effort.shaded_uneven == effort.shaded:
            return colour
        shade = srgb_encode(SHOWN * colour / view.coverage[:, None])
        uneven = contrasting(view.slots, shade, effort.contrast)
        again = self._shaded(view, labels, state, np.where(uneven, effort.shaded_uneven, 0), light)
        colour[uneven] = again[uneven]
        return colour

    def _shadows(
        self, view: _View, probes: _Chosen, light: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Ask one point a group, and every sub-sample where a shadow ends.

        Returns
        -------
        labels
            Groups of `view.samples`, of which those in shadow are numbered from `GROUPS` where one ends.
        state
            (p, 2 * GROUPS) 1 lit, 2 in shadow, 0 not asked.
        """
        irradiance, start = self._unhindered(probes.points, light)
        asked = irradiance > 0
        blocked = self._volumes.occluded(start, light, asked)
        answer = np.where(asked, 1 + blocked, 0)
        state = np.zeros((len(view.rows), 2 * GROUPS), dtype=np.int64)
        state[probes.pixel, probes.group] = answer
        split = mixed(view.slots, probes.pixel, answer)
        state[split, :GROUPS], state[split, GROUPS:] = 1, 2
        labels = []
        for samples in view.samples:
            label = samples.label.copy()
            inside = np.flatnonzero(split[samples.pixels])
            row, sample = np.nonzero(label[inside] >= 0)
            pixel = inside[row]
            points = self._points(view, *_places(view, samples, pixel, sample))
            irradiance, start = self._unhindered(points, light)
            blocked = self._volumes.occluded(start, light, irradiance > 0)
            label[pixel[blocked], sample[blocked]] += GROUPS
            labels.append(label)
        return labels, state

    def _shaded(
        self, view: _View, labels: list[np.ndarray], state: np.ndarray, wanted: np.ndarray, light: np.ndarray
    ) -> np.ndarray:
        """Return the colour (p, 3) of the pixels from `wanted` (p,) points of each of their groups."""
        chosen = self._chosen(view, labels, wanted)
        irradiance, start = self._unhindered(chosen.points, light)
        known = state[chosen.pixel, chosen.group]
        unknown = (irradiance > 0) & (known == 0)
        blocked = self._volumes.occluded(start, light, unknown)
        irradiance[blocked | (known == 2)] = 0.0
        colour = self._colour(chosen.points, irradiance, light)
        return sum_by_pixel(chosen.pixel, chosen.weight, colour, len(wanted))  # type: ignore[no-any-return]


def _places(
    view: _View, samples: _Samples, pixel: np.ndarray, sample: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the face seen and the image point x, y of sub-samples (n,) of pixels (n,)."""
    x = view.columns[samples.pixels][pixel] + samples.offsets_x[sample]
    y = view.rows[samples.pixels][pixel] + samples.offsets_y[sample]
    return samples.seen[pixel, sample], x, y
