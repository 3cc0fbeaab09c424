"""VisionNet rendered by compiled kernels: the image of the route through torch, many times sooner."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.vision.cameras import sub_ray_offsets
from objectfolder.vision.compiled.borders import beside, contrasting, mixed, smoothed, sum_by_pixel
from objectfolder.vision.compiled.grouping import GROUPS, choose_samples
from objectfolder.vision.compiled.known_light import Gloss, KnownLight
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.lobes import Cast
from objectfolder.vision.compiled.network import CompiledNetwork, Known
from objectfolder.vision.compiled.radiosity import Lights
from objectfolder.vision.compiled.rasteriser import meet_planes
from objectfolder.vision.compiled.shadows import samples_to_ask, split_groups
from objectfolder.vision.compiled.surroundings import Gathered, Surroundings
from objectfolder.vision.compiled.visibility import MARGIN_PX, Crop, Projection, View, look
from objectfolder.vision.compositing import srgb_encode
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.sparse_grid import SparseGrid

# Averages, where normals turn by less than so much, a quantity (p, 3) of pixels as a multiple of another.
Smoother = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
# Radiance of one unit as it is commonly shown: contrast is judged as the eye would, without asking a scale.
SHOWN = 0.3
# Where in the box around a group the points that stand for it should lie: [k - 1] for k of them.
MOST_SHADED = 64
TARGETS = np.zeros((MOST_SHADED, MOST_SHADED, 2), dtype=np.float32)
for _count in range(1, MOST_SHADED + 1):
    TARGETS[_count - 1, :_count] = sub_ray_offsets(_count)
# From so many lights on, each is asked at one point of a group only, the next light at another.
LIGHTS_IN_TURN = 32
# At `MORE` points where normals turn in a pixel: 1 - length of their mean, in squared widths of the lobe.
CURVED, MORE = 0.03, 4
# The same, and the difference to a neighbour in sRGB, from which on `Effort.shaded_uneven` points meet a
# highlight by chance.
TURNED, SHARP = 0.7, 0.2
# Directions of a highlight in an environment for a point of an even pixel (else 1), and of one mirrored.
HIGHLIGHT_SAMPLES, MIRROR_SAMPLES = 2, 4
# Times more points of known material where a smooth piece of surface ends, at first and where light or colour
# changes in it; each point asks for its own shadow.
UNEVEN, UNEVEN_AGAIN = 3, 6
# Points of a smooth piece of surface in a pixel whose gloss is asked whether it shows any surface, and how it
# looks.
GLOSS_PROBES, GLOSS_POINTS = 2, 4
# Directions of a ray's gloss in which the surface is looked for.
RAY_SAMPLES = 8
# What arrives from all round is averaged over pixels this far to either side. Of weight 1 / e are those whose
# normals turn by so much (1 - cosine; the highlight's: times its squared width), or so far off the plane.
SMOOTH_PX, SMOOTH_TURN, SMOOTH_LOBE, SMOOTH_OFF = 1, 0.05, 0.1, 0.01


@dataclass(frozen=True)
class Effort:
    """What `sub_rays` buys.

    Parameters
    ----------
    samples
        Sub-samples of visibility a pixel.
    samples_uneven
        The same where a smooth piece of surface ends.
    samples_outline
        The same where the pixel is covered in part, for its coverage alone.
    shaded
        Colours a smooth piece of surface in a pixel.
    shaded_uneven
        The same where colour changes fast.
    shaded_curved
        The same where normals turn within the pixel by much of the highlight's width, too (`TURNED`).
    shadow_rays
        Sub-samples that are asked for a pixel in which a shadow ends.
    contrast
        Difference to a neighbour, in sRGB, from which on it does.
    """

    samples: int
    samples_uneven: int
    samples_outline: int
    shaded: int
    shaded_uneven: int
    shaded_curved: int
    shadow_rays: int
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
            return cls(16, 4 * sub_rays, max(1024, 4 * sub_rays), 4, 16, 64, 64, 0.03)
        if sub_rays >= 16:
            return cls(16, 256, 256, 1, 4, 4, 16, 0.02)
        if sub_rays >= 4:
            return cls(16, 64, 64, 1, 3, 3, 16, 0.05)
        return cls(16, 64, 64, 1, 1, 1, 8, 2.0)


@dataclass(frozen=True)
class _Chosen:
    """Points that stand for a group of a pixel each: pixel, group and share of the pixel (n,)."""

    pixel: np.ndarray
    group: np.ndarray
    weight: np.ndarray
    points: Points

    def thinned(self, most: int, pixels: np.ndarray) -> tuple[np.ndarray, "_Chosen"]:
        """Return which rows are up to `most` points of each group of pixels marked (p,), and these points.

        Those of a group have equal shares.
        """
        first = np.flatnonzero(np.diff(self.pixel * GROUPS + self.group, prepend=-1))
        several = np.diff(first, append=len(self.pixel))
        kept = np.where(pixels[self.pixel[first]], np.minimum(several, most), 0)
        of = np.repeat(np.arange(len(first)), kept)
        order = np.arange(len(of)) - (np.cumsum(kept) - kept)[of]
        row = first[of] + (2 * order + 1) * several[of] // (2 * kept[of])
        weight = (np.add.reduceat(self.weight, first) / np.maximum(kept, 1))[of]
        return row, _Chosen(self.pixel[row], self.group[row], weight, self.points.of(row))


@dataclass(frozen=True)
class _Seen:
    """Points (n,) with all about them that no light changes.

    Parameters
    ----------
    points, known
        The points, and their features and albedo.
    place
        (n,) row of `met` that is seen mirrored in each, or -1.
    met, met_known, share
        Points (m,) seen in mirrors, what is known of them, and the share (m, 3) that the mirror reflects.
    """

    points: Points
    known: Known
    place: np.ndarray
    met: Points
    met_known: Known
    share: np.ndarray

    def of(self, row: np.ndarray) -> "_Seen":
        """Return some of the points, all that they may show in mirrors with them."""
        features, albedo = self.known
        return replace(
            self, points=self.points.of(row), known=(features[row], albedo[row]), place=self.place[row]
        )


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
        self._set(LitSurface(surface), CompiledNetwork(grid, weights), radiance_scale)

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
        renderer._set(lit, KnownLight(lit, surface, material), radiance_scale)
        return renderer

    def _set(self, surface: LitSurface, network: CompiledNetwork | KnownLight, radiance_scale: float) -> None:
        self._surface, self._network = surface, network
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
        effort = Effort.of(sub_rays)
        known = isinstance(self._network, KnownLight)
        reach = SMOOTH_PX + 1 if known else 0
        view = self._view(camera_to_world, size, field_of_view_deg, effort, crop, reach)
        colour = np.zeros((len(view.rows), 3))
        lights = list(_lights(light_position, light_colour))
        if len(colour) and lights:
            many = len(lights) >= LIGHTS_IN_TURN
            labels = _labels(view)
            if known or not many:
                probes = self._chosen(view, labels, np.ones(len(colour), dtype=np.int64))
                chosen = probes
                if effort.shaded > 1:
                    shaded = np.full(len(colour), effort.shaded)
                    shaded[view.samples[1].pixels] *= UNEVEN if known else 1
                    chosen = self._chosen(view, labels, shaded)
                seen = self._seen(chosen.points)
            if known:
                colour += self._in_gloss(view, probes, chosen, seen.known, _joined(lights))
            if many:
                colour += self._lit_in_turn(view, lights, effort)
            else:
                curved = self._curved(chosen, len(colour))
                for light, factor in lights:
                    colour += factor * self._lit(view, probes, chosen, seen, light, effort, curved)
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
        effort = Effort.of(sub_rays)
        view = self._view(camera_to_world, size, field_of_view_deg, effort, crop, SMOOTH_PX)
        colour = np.zeros((len(view.rows), 3))
        if len(colour):
            around = Surroundings(self._surface, self._network, environment)
            colour = self._surrounded(view, around, effort) / np.pi
        return _image(view, colour, crop or (0, 0, *size))

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

    def _surrounded(self, view: View, around: Surroundings, effort: Effort) -> np.ndarray:
        """Return pi times the colour (p, 3) of the pixels in an environment."""
        labels, alpha2 = _labels(view), self._network.alpha2
        probes = self._chosen(view, labels, np.ones(len(view.rows), dtype=np.int64))
        gathered = around.gathered(probes.points, _cast(view, probes))
        smooth = _smoother(view, probes)
        gathered = _smoothed(probes, gathered, smooth)
        mirrored = around.in_mirrors(probes.points, _cast(view, probes), MIRROR_SAMPLES)
        probe = np.zeros((len(view.rows), GROUPS), dtype=np.int64)
        probe[probes.pixel, probes.group] = np.arange(len(probes.pixel))

        def summed(chosen: _Chosen, colour: np.ndarray) -> np.ndarray:
            total: np.ndarray = sum_by_pixel(chosen.pixel, chosen.weight, colour, len(view.rows))
            return total

        def shaded(wanted: np.ndarray, samples: int) -> np.ndarray:
            chosen = self._chosen(view, labels, wanted)
            of = probe[chosen.pixel, chosen.group]
            matt, *gloss = around.shown(chosen.points, gathered.of(of), _cast(view, chosen), samples, alpha2)
            return np.stack([summed(chosen, part) for part in (matt + mirrored[of], *gloss)])

        chosen = self._chosen(view, labels, np.full(len(view.rows), effort.shaded))
        outline = around.outlined(chosen.points, gathered.of(probe[chosen.pixel, chosen.group]))
        matt, even = (summed(chosen, part) for part in outline)
        shade = srgb_encode(SHOWN * (matt + even) / view.coverage[:, None])
        uneven = contrasting(view.edges, shade, effort.contrast)
        coarse = shaded(np.where(uneven, 0, effort.shaded), HIGHLIGHT_SAMPLES)
        fine = shaded(np.where(uneven, effort.shaded_uneven, 0), 1)
        matt, gloss, even = coarse + fine
        return matt + smooth(SMOOTH_LOBE * float(alpha2), gloss, even)

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
        seen = self._seen(self._surface.points(face[hit], barycentric[hit], directions[hit]))
        colour = np.zeros((len(hit), 3))
        lights = list(_lights(light_position, light_colour))
        for light, factor in lights:
            colour += factor * self._colour(seen, self._arriving(seen.points, light), light)
        if isinstance(self._network, KnownLight) and len(hit) and lights:
            # Each ray is answered as if it were alone.
            first, single = np.zeros(len(hit), dtype=np.int64), np.ones(len(hit), dtype=np.int64)
            cast = Cast(first, first, first, single)
            asked = seen.points, seen.known, cast, RAY_SAMPLES * single, _joined(lights)
            colour += self._network.in_gloss(*asked)[0]
        rgba[hit, :3] = colour
        rgba[hit, 3] = 1.0
        return rgba * self._scale

    def _chosen(self, view: View, labels: list[np.ndarray], wanted: np.ndarray) -> _Chosen:
        """Choose `wanted` (p,) points of each group of each pixel."""
        parts = []
        for samples, label in zip(view.samples, labels, strict=True):
            pixel, sample, group, weight = choose_samples(
                label, 2 * GROUPS, samples.offsets_x, samples.offsets_y, wanted[samples.pixels], TARGETS
            )
            parts.append((samples.start + pixel, group, weight, *view.places(samples, pixel, sample)))
        pixel, group, weight, face, x, y = (np.concatenate(column) for column in zip(*parts, strict=True))
        return _Chosen(pixel, group, weight, self._points(view, face, x, y))

    def _points(self, view: View, face: np.ndarray, x: np.ndarray, y: np.ndarray) -> Points:
        at = view.projection
        barycentric, _, direction = meet_planes(
            at.functions, face, x, y, at.camera_to_world, at.focal, *at.centre
        )
        return self._surface.points(face, barycentric, direction)

    def _seen(self, points: Points) -> _Seen:
        place = np.full(len(points.face), -1)
        met, share = points.of(np.empty(0, dtype=np.int64)), np.empty((0, 3), dtype=np.float32)
        if not isinstance(self._network, KnownLight) and self._network.mirrors:
            row, met = self._surface.mirrored(points)
            place[row] = np.arange(len(row))
            share = self._network.fresnel(points.of(row))
        of_met = self._network.features(met)
        return _Seen(points, self._network.features(points), place, met, of_met, share)

    def _arriving(self, points: Points, light: np.ndarray) -> np.ndarray:
        """Return the irradiance (n,) of points."""
        irradiance, hidden = self._surface.light_from(points, light)
        irradiance[hidden] = 0.0
        return irradiance

    def _colour(self, seen: _Seen, irradiance: np.ndarray, light: np.ndarray) -> np.ndarray:
        colour = self._network.bounced_by(seen.points, seen.known, irradiance, light)
        return colour + self._directly(seen, irradiance, light)

    def _directly(self, seen: _Seen, irradiance: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return the colour (n, 3) but for bounced light."""
        colour = self._network.directly(seen.points, seen.known, irradiance, light)
        if not isinstance(self._network, KnownLight) and self._network.mirrors:
            row = np.flatnonzero(seen.place >= 0)
            met, (features, albedo) = seen.place[row], seen.met_known
            points = seen.met.of(met)
            known, arriving = (features[met], albedo[met]), self._arriving(points, light)
            colour[row] += seen.share[met] * self._network.mirrored(points, known, arriving, light)
        return colour

    def _in_gloss(
        self, view: View, probes: _Chosen, chosen: _Chosen, known: Known, lights: Lights
    ) -> np.ndarray:
        """Return the colour (p, 3) of the surface that pixels show in their gloss, as `chosen`.

        Few rays tell in which pixels there is any; more are sent there and beside.
        """
        network, count = self._network, len(view.rows)
        assert isinstance(network, KnownLight)

        def asked(pixels: np.ndarray, points: int, samples: tuple[int, int]) -> tuple[_Chosen, Gloss]:
            row, some = chosen.thinned(points, pixels)
            of_row = known[0][row], known[1][row]
            directions = np.where(some.pixel < view.samples[1].start, *samples)
            return some, (some.points, of_row, _cast(view, some), directions)

        def summed(some: _Chosen, part: np.ndarray) -> np.ndarray:
            total: np.ndarray = sum_by_pixel(some.pixel, some.weight, part, count)
            return total

        few, gloss = asked(np.ones(count, dtype=bool), GLOSS_PROBES, (1, 1))
        shown = network.shown(*gloss, 1)
        shows = np.zeros(count, dtype=bool)
        shows[few.pixel[shown.row]] = True
        shows = beside(view.edges, beside(view.edges, shows))
        some, gloss = asked(shows, GLOSS_POINTS, network.samples)
        turns = network.samples[0] if len(lights[0]) >= LIGHTS_IN_TURN else 1
        above, below = (summed(some, part) for part in network.in_gloss(*gloss, lights, turns))
        below[~shows] = summed(few, shown.everything)[~shows]
        return _smoother(view, probes)(SMOOTH_LOBE * float(network.alpha2), above, below)

    def _lit_in_turn(
        self, view: View, lights: list[tuple[np.ndarray, np.ndarray]], effort: Effort
    ) -> np.ndarray:
        """Return the colour (p, 3) of the pixels under many lights, each asked at one point of a group.

        The next light is asked at the next point: a group's points are found once, and are all asked
        (interleaved sampling, Keller and Heidrich 2001).
        """
        count, turns = len(view.rows), effort.shaded_uneven
        chosen = self._chosen(view, _labels(view), np.full(count, turns))
        seen = self._seen(chosen.points)
        first = np.flatnonzero(np.diff(chosen.pixel * GROUPS + chosen.group, prepend=-1))
        several = np.diff(first, append=len(chosen.pixel))
        share = np.add.reduceat(chosen.weight, first)

        def mean(values: np.ndarray) -> np.ndarray:
            total: np.ndarray = np.add.reduceat(chosen.weight[:, None] * values, first)
            return total / share[:, None]

        # What varies most inside a pixel is its texture, and no light changes that.
        albedo = mean(seen.known[1]).astype(np.float32)
        seen = replace(seen, known=(seen.known[0], np.repeat(albedo, several, axis=0)))
        turned = 1 - np.linalg.norm(mean(chosen.points.normal), axis=1)
        asks = np.where(turned > CURVED * self._network.alpha2, np.minimum(MORE, several), 1)
        group = np.repeat(np.arange(len(first)), asks)
        # Bounced light varies little inside a pixel.
        lead = np.cumsum(asks) - asks
        order = np.arange(len(group)) - lead[group]
        pixel, weight = chosen.pixel[first[group]], (share / asks)[group]
        start = 5 * view.columns[pixel].astype(np.int64) + 3 * view.rows[pixel].astype(np.int64)
        start += order * several[group] // asks[group]
        colour = np.zeros((count, 3))
        for turn in range(turns):
            asked = seen.of(first[group] + (start + turn) % several[group])
            once = asked.of(lead)
            for light, factor in lights[turn::turns]:
                irradiance = self._arriving(asked.points, light)
                direct = self._directly(asked, irradiance, light)
                colour += factor * sum_by_pixel(pixel, weight, direct, count)
                if not isinstance(self._network, KnownLight):
                    bounced = self._network.bounced_by(once.points, once.known, irradiance[lead], light)
                    colour += factor * sum_by_pixel(pixel[lead], share, bounced, count)
        if isinstance(self._network, KnownLight):
            alone = seen.of(first)
            bounced = self._network.bounced(alone.points, alone.known, _joined(lights))
            colour += sum_by_pixel(chosen.pixel[first], share, bounced, count)
        return colour

    def _lit(
        self, view: View, probes: _Chosen, chosen: _Chosen, seen: _Seen, light: np.ndarray, effort: Effort,
        curved: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Return the colour (p, 3) of the pixels under one light of colour 1.

        `chosen` and what is `seen` there serve each light, but for pixels in which its shadow ends, and
        in which colour changes fast: the more so in those that are `curved` (p,).
        """
        labels, state, split = self._shadows(view, probes, light, effort.shadow_rays)
        coarse, finest = np.full(len(split), effort.shaded), np.full(len(split), effort.shaded_uneven)
        several = isinstance(self._network, KnownLight) and effort.shaded > 1
        if several:
            uneven = view.samples[1]
            labels[1], state[uneven.pixels], split[uneven.pixels] = uneven.label, 0, False
            coarse[uneven.pixels] = UNEVEN_AGAIN * effort.shaded
            finest = np.maximum(finest, coarse)

        def again(pixels: np.ndarray, shaded: np.ndarray) -> None:
            some = self._chosen(view, labels, np.where(pixels, shaded, 0))
            colour[pixels] = self._shaded(some, self._seen(some.points), state, light)[0][pixels]

        colour, answer = self._shaded(chosen, seen, state, light)
        if several:
            ends = mixed(view.edges, len(split), chosen.pixel, answer)
            split[uneven.pixels] = ends[uneven.pixels]
        again(split, coarse)
        if effort.shaded_uneven > effort.shaded:
            shade = srgb_encode((SHOWN * colour / view.coverage[:, None]).astype(np.float32))
            sharp = curved & contrasting(view.edges, shade, SHARP)
            finest[sharp] = np.maximum(finest[sharp], effort.shaded_curved)
            again(contrasting(view.edges, shade, effort.contrast), finest)
        return colour

    def _curved(self, chosen: _Chosen, count: int) -> np.ndarray:
        """Return in which (count,) pixels a smooth piece of surface turns by much of a highlight's width."""
        first = np.flatnonzero(np.diff(chosen.pixel * GROUPS + chosen.group, prepend=-1))
        mean = np.add.reduceat(chosen.weight[:, None] * chosen.points.normal, first)
        mean /= np.add.reduceat(chosen.weight, first)[:, None]
        turned = 1 - np.linalg.norm(mean, axis=1) > TURNED * self._network.alpha2
        curved = np.zeros(count, dtype=bool)
        curved[chosen.pixel[first[turned]]] = True
        return curved

    def _shadows(
        self, view: View, probes: _Chosen, light: np.ndarray, rays: int
    ) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
        """Ask one point a group, and `rays` sub-samples of a pixel where a shadow ends.

        Returns
        -------
        labels
            Groups of `view.samples`, of which those in shadow are numbered from `GROUPS` where one ends.
        state
            (p, 2 * GROUPS) 1 lit, 2 in shadow, 0 not asked.
        split
            (p,) whether a shadow ends in the pixel.
        """
        irradiance, hidden = self._surface.light_from(probes.points, light)
        answer = np.where(irradiance > 0, 1 + hidden, 0)
        state = np.zeros((len(view.rows), 2 * GROUPS), dtype=np.int64)
        state[probes.pixel, probes.group] = answer
        split = mixed(view.edges, len(view.rows), probes.pixel, answer)
        state[split, :GROUPS], state[split, GROUPS:] = 1, 2
        labels = []
        for samples in view.samples:
            label = samples.label.copy()
            inside = np.flatnonzero(split[samples.pixels])
            pixel, sample = samples_to_ask(label, inside, rays, GROUPS)
            points = self._points(view, *view.places(samples, pixel, sample))
            _, hidden = self._surface.light_from(points, light)
            split_groups(label, pixel, sample, hidden, samples.offsets_x, samples.offsets_y, GROUPS)
            labels.append(label)
        return labels, state, split

    def _shaded(
        self, chosen: _Chosen, seen: _Seen, state: np.ndarray, light: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the colour (p, 3) of the pixels from points that were chosen, and these points' states."""
        known = state[chosen.pixel, chosen.group]
        irradiance, hidden = self._surface.light_from(chosen.points, light, known == 0)
        answer = np.where(irradiance > 0, np.where(hidden | (known == 2), 2, 1), 0)
        irradiance[answer == 2] = 0.0
        colour = self._colour(seen, irradiance, light)
        return sum_by_pixel(chosen.pixel, chosen.weight, colour, len(state)), answer


def _labels(view: View) -> list[np.ndarray]:
    return [samples.label for samples in view.samples]


def _cast(view: View, chosen: _Chosen) -> Cast:
    at = chosen.pixel
    order = np.arange(len(at)) - np.searchsorted(at, at)
    count = np.bincount(at, minlength=len(view.rows))[at]
    return Cast(view.columns[at].astype(np.int64), view.rows[at].astype(np.int64), order, count)


def _smoother(view: View, probes: _Chosen) -> Smoother:
    """Return a function that averages over the pixels that see one smooth piece, of one probe each.

    It takes how far normals may turn, and a quantity (p, 3) of the pixels that is averaged as a multiple of
    another.
    """
    first = np.searchsorted(probes.pixel, np.arange(len(view.rows)))
    single = np.bincount(probes.pixel, minlength=len(view.rows)) == 1
    position, normal = probes.points.position[first], probes.points.normal[first] * single[:, None]

    def smooth(turn: float, above: np.ndarray, below: np.ndarray) -> np.ndarray:
        ratio = smoothed(view.slots, SMOOTH_PX, position, normal, turn, SMOOTH_OFF, above, below)
        return np.where(single[:, None] & (below > 0), ratio * below, above)

    return smooth


def _smoothed(probes: _Chosen, gathered: Gathered, smooth: Smoother) -> Gathered:
    """Return what was gathered, smooth in pixels of one probe."""
    first = np.flatnonzero(np.diff(probes.pixel, prepend=-1))
    single = np.diff(first, append=len(probes.pixel)) == 1
    plain = Gathered(gathered.arriving.copy(), gathered.unhindered, gathered.bounced.copy())
    alone = first[single]
    plain.arriving[alone] = smooth(SMOOTH_TURN, gathered.arriving[first], gathered.unhindered[first])[single]
    plain.bounced[alone] = smooth(SMOOTH_TURN, gathered.bounced[first], np.ones((len(first), 3)))[single]
    return plain


def _image(view: View, colour: np.ndarray, crop: Crop) -> np.ndarray:
    """Return the pixels' colours (p, 3) and coverage in their places, (height, width, 4) float32."""
    top, left, height, width = crop
    rgba = np.zeros((height, width, 4), dtype=np.float32)
    row, column = view.rows.astype(np.int64) - top, view.columns.astype(np.int64) - left
    kept = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    rgba[row[kept], column[kept], :3] = (colour * (view.alpha / view.coverage)[:, None])[kept]
    rgba[row[kept], column[kept], 3] = view.alpha[kept]
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


def _joined(lights: list[tuple[np.ndarray, np.ndarray]]) -> Lights:
    """Return places and colours (l, 3) of lights."""
    places, colours = map(np.array, zip(*lights, strict=True))
    return places, colours
