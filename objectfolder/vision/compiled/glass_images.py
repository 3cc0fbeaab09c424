"""Images of thin glass: every wall that a ray meets reflects as a slab does, and lets the rest straight on.

The walls of a ray are all found at once. A lamp is seen in each of them through those before it, and its
light has passed those on its way. Alpha is what the walls together keep, in the mean of the channels.
"""

from dataclasses import dataclass

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.vision.cameras import pixel_rays, sub_ray_offsets
from objectfolder.vision.compiled.borders import contrasting, neighbours
from objectfolder.vision.compiled.effort import Effort
from objectfolder.vision.compiled.lattice_values import LatticeMaterial
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.lobes import Cast, lobe_directions, scattered, stepped
from objectfolder.vision.compiled.principled import Principled
from objectfolder.vision.compiled.shading import SHOWN
from objectfolder.vision.compiled.surroundings import SHARPER, looked_up
from objectfolder.vision.compiled.visibility import MARGIN_PX, Crop, Projection
from objectfolder.vision.compositing import srgb_encode
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.incidence import SELF_OFFSET, UnitSurface, bent_share
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.network_layout import LEAST_COSINE
from objectfolder.vision.network.thin_glass import index_of, slab

# Walls of a ray; what lies behind more is not seen.
MOST_WALLS = 16
# Rays through each pixel, and rays that are followed at a time.
COARSE_RAYS, GLASS_RAYS_AT_ONCE = 16, 1 << 16
# Times that a reflection shows reflections, and directions of a single ray's.
REFLECTIONS, RAY_SAMPLES = 1, 8
# A lamp's highlight of less, in units of the data set's lamp, has no shadow ray.
FAINT = 1e-5
# Parts the directions of the walls of a ray.
WALL_ORDER_STEP = 977


@dataclass(frozen=True)
class Light:
    """Places and colours (l, 3) of lamps, and an environment or None."""

    places: np.ndarray
    colours: np.ndarray
    around: Environment | None = None


@dataclass(frozen=True)
class Walls:
    """Walls (m,) that rays meet, ordered by ray and distance.

    Parameters
    ----------
    ray, rank
        (m,) which ray, and how many of its walls are nearer.
    points, terms
        Where it meets them, and `Principled.slab_terms` there.
    reflectance, before
        (m, 3) share that the wall reflects, and that the walls before it let through.
    through
        (n, 3) share that all walls of each ray let through.
    """

    ray: np.ndarray
    rank: np.ndarray
    points: Points
    terms: np.ndarray
    reflectance: np.ndarray
    before: np.ndarray
    through: np.ndarray


class GlassRenderer:
    """The surface of a thing of thin glass, ready to render; methods are those of `CompiledRenderer`.

    Parameters
    ----------
    surface
        In the unit frame.
    material
        What it is made of: its albedo is the share of light that one passage through a wall lets through.
    radiance_scale
        As of `CompiledRenderer`.

    Raises
    ------
    FormatError
        A material that is not known in full.
    """

    def __init__(self, surface: UnitSurface, material: Material, radiance_scale: float) -> None:
        appearance = material.appearance
        if appearance is None or not material.states("albedo"):
            raise FormatError("vision", "glass of a colour that is not stated", "Build it again.")
        self._unit, self._surface, self._material = surface, LitSurface(surface), LatticeMaterial(material)
        self._index = index_of(appearance.specular)
        constant = () if material.mapped("roughness") else (appearance.roughness,)
        self._principled = Principled(appearance.specular, constant)
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
        """Return a view (h, w, 4) under point lights."""
        light = _lamps(light_position, light_colour)
        return self._image(camera_to_world, light, size, field_of_view_deg, sub_rays, crop) * self._scale

    def surrounded(
        self,
        camera_to_world: np.ndarray,
        environment: Environment,
        size: tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int,
        crop: Crop | None = None,
    ) -> np.ndarray:
        """Return a view (h, w, 4) in an environment, which the glass shows in its reflections alone."""
        light = Light(np.empty((0, 3)), np.empty((0, 3)), environment)
        return self._image(camera_to_world, light, size, field_of_view_deg, sub_rays, crop)

    def radiance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
    ) -> np.ndarray:
        """Return (n, 4) float32 along rays, each as if it were alone."""
        origins = np.ascontiguousarray(origins, dtype=np.float64)
        directions = np.ascontiguousarray(directions, dtype=np.float64)
        alone = np.zeros(len(origins), dtype=np.int64)
        cast, light = Cast(alone, alone, alone, 1 + alone), _lamps(light_position, light_colour)
        colour, through = self._along(origins, directions, cast, light, REFLECTIONS, RAY_SAMPLES)
        return _rgba(colour, through) * self._scale

    def _image(
        self, camera_to_world: np.ndarray, light: Light, size: tuple[int, int], field_of_view_deg: float,
        sub_rays: int, crop: Crop | None,
    ) -> np.ndarray:  # fmt: skip
        effort, crop = Effort.of(sub_rays), crop or (0, 0, *size)
        pose = np.ascontiguousarray(camera_to_world, dtype=np.float64)
        projection = Projection.of(
            self._surface.vertices, self._surface.faces, pose, size, field_of_view_deg, crop, MARGIN_PX
        )
        row, column = _covered(projection, effort.samples_uneven)
        pixel = row * size[1] + column

        def followed(which: np.ndarray, rays: int) -> tuple[np.ndarray, np.ndarray]:
            return self._pixels(pose, pixel[which], size, field_of_view_deg, rays, light)

        everywhere = np.arange(len(pixel))
        rgba, uneven = followed(everywhere, min(sub_rays, COARSE_RAYS))
        if sub_rays > COARSE_RAYS and len(pixel):
            slots = np.full((projection.height, projection.width), -1)
            slots[row - projection.top, column - projection.left] = everywhere
            shade = srgb_encode(SHOWN * rgba[:, :3])
            again = np.flatnonzero(
                (uneven > effort.contrast) | contrasting(neighbours(slots), shade, effort.contrast)
            )
            rgba[again], _ = followed(again, sub_rays)
        image = np.zeros((*crop[2:], 4), dtype=np.float32)
        row, column = row - crop[0], column - crop[1]
        inside = (row >= 0) & (row < crop[2]) & (column >= 0) & (column < crop[3])
        image[row[inside], column[inside]] = rgba[inside]
        return image

    def _pixels(
        self, pose: np.ndarray, pixel: np.ndarray, size: tuple[int, int], field_of_view_deg: float,
        rays: int, light: Light,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Return the mean (p, 4) of the rays of pixels, and how far (p,) these are apart, sRGB-encoded."""
        offsets = sub_ray_offsets(rays)
        mean, apart = np.zeros((len(pixel), 4)), np.zeros(len(pixel))
        step = max(1, GLASS_RAYS_AT_ONCE // rays)
        for first in range(0, len(pixel), step):
            part = pixel[first : first + step]
            origins, directions = pixel_rays(pose, part, offsets, size, field_of_view_deg)
            of, order = np.divmod(np.arange(len(origins)), rays)
            cast = Cast(part[of] % size[1], part[of] // size[1], order, np.full(len(of), rays))
            rgba = _rgba(*self._along(np.ascontiguousarray(origins), directions, cast, light, REFLECTIONS))
            rgba = rgba.reshape(len(part), rays, 4)
            mean[first : first + step] = rgba.mean(axis=1)
            shade = np.concatenate([srgb_encode(SHOWN * rgba[..., :3]), rgba[..., 3:]], axis=-1)
            apart[first : first + step] = np.ptp(shade, axis=1).max(axis=1)
        return mean, apart

    def _along(
        self, origins: np.ndarray, directions: np.ndarray, cast: Cast, light: Light, reflections: int,
        samples: int = 1,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Return the radiance (n, 3) that walls send along rays, and what (n, 3) they let through.

        `samples` are the directions of a reflection, and `reflections` how often it shows others. The last
        of them shows an environment as nothing hides it.
        """
        walls = self._walls(origins, directions, np.full(len(origins), np.inf))
        shown = self._highlights(walls, light)
        if reflections:
            for sample in range(samples):
                shown += self._reflected(walls, cast, light, reflections - 1, sample) / samples
        elif light.around is not None:
            shown += self._mirrored(walls, light.around)
        columns = (walls.before * shown).T
        radiance = [np.bincount(walls.ray, column, minlength=len(origins)) for column in columns]
        # Of no walls at all numpy counts in whole numbers.
        return np.stack(radiance, axis=1).astype(np.float64), walls.through

    def _walls(self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray) -> Walls:
        """Return the walls that rays along unit directions meet up to the distances `reach` (n,)."""
        ray, face, barycentric = self._surface.volumes.front_faces(origins, directions, reach, MOST_WALLS)
        points = self._surface.points(face, barycentric, np.ascontiguousarray(directions[ray]))
        places = self._unit.in_stored(face, barycentric)
        colour, roughness = (self._material.value(name, *places) for name in ("albedo", "roughness"))
        cosine = np.einsum("ij,ij->i", points.upright, points.direction)
        reflectance, transmittance = slab(cosine, colour, self._index)
        first = np.searchsorted(ray, ray)
        rank = np.arange(len(ray)) - first
        before = np.ones((len(ray), 3))
        for order in range(1, int(rank.max(initial=0)) + 1):
            row = np.flatnonzero(rank == order)
            before[row] = before[row - 1] * transmittance[row - 1]
        through = np.ones((len(origins), 3))
        through[ray] = before * transmittance  # the last of a ray stays
        terms = self._principled.slab_terms(points, reflectance, roughness)
        return Walls(ray, rank, points, terms, reflectance, before, through)

    def _highlights(self, walls: Walls, light: Light) -> np.ndarray:
        """Return the radiance (m, 3) of lamps in walls."""
        answer, points = np.zeros(walls.before.shape), walls.points
        for place, colour in zip(light.places, light.colours, strict=True):
            irradiance, start = self._surface.unhindered(points, place[None])
            to_light = place - points.position
            to_light /= np.maximum(np.linalg.norm(to_light, axis=1, keepdims=True), 1e-9)
            if self._unit.bends:
                irradiance *= bent_share(points.upright, points.normal, to_light)
            lit = np.flatnonzero(irradiance > 0)
            _, gloss = self._principled.reflected(points, walls.terms, lit, to_light[lit])
            sent = irradiance[lit, None] * gloss
            bright = (sent * walls.before[lit]).max(axis=1, initial=0.0) > FAINT
            lit, sent = lit[bright], sent[bright]
            way = place - start[lit]
            distance = np.linalg.norm(way, axis=1)
            on_the_way = self._walls(start[lit], way / np.maximum(distance, 1e-9)[:, None], distance)
            answer[lit] += colour * sent * on_the_way.through
        return answer

    def _reflected(self, walls: Walls, cast: Cast, light: Light, reflections: int, sample: int) -> np.ndarray:
        """Return what (m, 3) walls show along one direction drawn from each of their lobes."""
        points, answer = walls.points, np.zeros(walls.before.shape)
        facet = self._surface.facets[points.face]
        widths = walls.terms[:, 0].astype(np.float64)
        of_ray = cast.of(walls.ray)
        order = of_ray.order + WALL_ORDER_STEP * walls.rank
        starts = scattered(Cast(of_ray.columns, of_ray.rows, order, of_ray.count))
        direction, density = lobe_directions(
            points.normal, facet, -points.direction, widths, *stepped(starts, sample), LEAST_COSINE
        )
        sent = np.flatnonzero(density > 0)
        direction, density = np.ascontiguousarray(direction[sent]), density[sent]
        _, gloss = self._principled.reflected(points, walls.terms, sent, direction)
        cosine = np.einsum("ij,ij->i", direction, points.normal[sent])
        weight = gloss * (cosine / (np.pi * density))[:, None]
        start = np.ascontiguousarray(points.position[sent] + SELF_OFFSET * facet[sent])
        deeper = Cast(of_ray.columns[sent], of_ray.rows[sent], order[sent], of_ray.count[sent])
        radiance, through = self._along(start, direction, deeper, light, reflections)
        if light.around is not None:
            sparse = 1.0 / (of_ray.count[sent] * density)
            radiance += through * _seen(light.around, direction, sparse)
        answer[sent] = weight * radiance
        return answer

    def _mirrored(self, walls: Walls, around: Environment) -> np.ndarray:
        """Return what (m, 3) walls show of an environment that nothing hides, blurred as their lobe."""
        points = walls.points
        cosine = np.einsum("ij,ij->i", points.normal, points.direction)
        mirror = points.direction - 2 * cosine[:, None] * points.normal
        lobe = 4 * np.pi * walls.terms[:, 0] * np.maximum(cosine**2, LEAST_COSINE)
        return walls.reflectance * _seen(around, mirror, lobe)


def _seen(around: Environment, direction: np.ndarray, solid_angle: np.ndarray) -> np.ndarray:
    """Return the radiance (n, 3) of an environment, over about these (n,) solid angles."""
    texel = 2 * np.pi / around.heights[0] ** 2  # steradians, in the mean
    level = 0.5 * np.log2(solid_angle / texel) - SHARPER
    answer: np.ndarray = looked_up(around.texels, around.heights, direction, level)
    return answer


def _covered(projection: Projection, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column (p,) of the pixels in which at least one of `samples` sub-rays meets a face."""
    count = projection.height * projection.width
    slots = np.arange(count, dtype=np.int32).reshape(projection.height, projection.width)
    offsets = np.ascontiguousarray((sub_ray_offsets(samples) - 0.5).astype(np.float32).T)
    front_faces, _ = projection.sample(slots, count, offsets)
    row, column = np.divmod(np.flatnonzero((front_faces >= 0).any(axis=1)), max(projection.width, 1))
    return projection.top + row, projection.left + column


def _rgba(colour: np.ndarray, through: np.ndarray) -> np.ndarray:
    return np.concatenate([colour, 1 - through.mean(axis=1, keepdims=True)], axis=1).astype(np.float32)


def _lamps(position: np.ndarray, colour: np.ndarray) -> Light:
    """Return lamps (k, 3) that shine at all."""
    places = np.array(position, dtype=np.float64).reshape(-1, 3)
    colours = np.asarray(colour, dtype=np.float64).reshape(-1, 3)
    shines = colours.any(axis=1)
    return Light(places[shines], colours[shines])
