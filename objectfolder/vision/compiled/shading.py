"""Points that stand for parts of pixels, and their colours: what images of all kinds of light share."""

from dataclasses import dataclass, replace

import numpy as np

from objectfolder.vision.cameras import sub_ray_offsets
from objectfolder.vision.compiled.grouping import GROUPS, choose_samples
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.lobes import Cast
from objectfolder.vision.compiled.network import Appearance, CompiledNetwork
from objectfolder.vision.compiled.radiosity import Lights
from objectfolder.vision.compiled.rasteriser import meet_planes
from objectfolder.vision.compiled.visibility import View

# Radiance of one unit as it is commonly shown: contrast is judged as the eye would, without asking a scale.
SHOWN = 0.3
# Where in the box around a group the points that stand for it should lie: [k - 1] for k of them.
MOST_SHADED = 64
TARGETS = np.zeros((MOST_SHADED, MOST_SHADED, 2), dtype=np.float32)
for _count in range(1, MOST_SHADED + 1):
    TARGETS[_count - 1, :_count] = sub_ray_offsets(_count)
# Number of lights from which each is asked at one point of a group only, the next light at another.
LIGHTS_IN_TURN = 32


@dataclass(frozen=True)
class Chosen:
    """Points that stand for a group of a pixel each: pixel, group and share of the pixel (n,)."""

    pixel: np.ndarray
    group: np.ndarray
    weight: np.ndarray
    points: Points

    def thinned(self, most: int, pixels: np.ndarray) -> tuple[np.ndarray, "Chosen"]:
        """Return which rows are up to `most` points of each group of pixels marked (p,), and these points.

        Those of a group have equal shares.
        """
        first = np.flatnonzero(np.diff(self.pixel * GROUPS + self.group, prepend=-1))
        several = np.diff(first, append=len(self.pixel))
        counts = np.where(pixels[self.pixel[first]], np.minimum(several, most), 0)
        of = np.repeat(np.arange(len(first)), counts)
        order = np.arange(len(of)) - (np.cumsum(counts) - counts)[of]
        row = first[of] + (2 * order + 1) * several[of] // (2 * counts[of])
        weight = (np.add.reduceat(self.weight, first) / np.maximum(counts, 1))[of]
        return row, Chosen(self.pixel[row], self.group[row], weight, self.points.of(row))


@dataclass(frozen=True)
class VisiblePoints:
    """Points (n,) with all about them that no light changes.

    Parameters
    ----------
    points, appearance
        The points, and their features and albedo.
    place
        (n,) row of `met` that is seen mirrored in each, or -1.
    met, met_appearance, share
        Points (m,) seen in mirrors, their appearance, and the share (m, 3) that the mirror reflects.
    """

    points: Points
    appearance: Appearance
    place: np.ndarray
    met: Points
    met_appearance: Appearance
    share: np.ndarray

    def of(self, row: np.ndarray) -> "VisiblePoints":
        """Return some of the points, all that they may show in mirrors with them."""
        features, albedo = self.appearance
        return replace(
            self, points=self.points.of(row), appearance=(features[row], albedo[row]), place=self.place[row]
        )


@dataclass(frozen=True)
class Shading:
    """A surface and what it reflects.

    Parameters
    ----------
    surface, network
        The surface, and its light as it was learned or is known.
    """

    surface: LitSurface
    network: CompiledNetwork | KnownLight

    def chosen(self, view: View, labels: list[np.ndarray], counts: np.ndarray) -> Chosen:
        """Choose `counts` (p,) points of each group of each pixel."""
        parts = []
        for samples, label in zip(view.samples, labels, strict=True):
            pixel, sample, group, weight = choose_samples(
                label, 2 * GROUPS, samples.offsets, counts[samples.pixels], TARGETS
            )
            parts.append((samples.start + pixel, group, weight, *view.places(samples, pixel, sample)))
        pixel, group, weight, face, x, y = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Chosen(pixel, group, weight, self.points(view, face, x, y))

    def points(self, view: View, face: np.ndarray, x: np.ndarray, y: np.ndarray) -> Points:
        """Return the points of faces (n,) at places (n,) of the image, pixels."""
        at = view.projection
        barycentric, _, direction = meet_planes(
            at.functions, face, x, y, at.camera_to_world, at.focal, *at.centre
        )
        return self.surface.points(face, barycentric, direction)

    def visible(self, points: Points) -> VisiblePoints:
        """Return all about points that no light changes."""
        place = np.full(len(points.face), -1)
        met, share = points.of(np.empty(0, dtype=np.int64)), np.empty((0, 3), dtype=np.float32)
        if not isinstance(self.network, KnownLight) and self.network.mirrors:
            row, met = self.surface.mirrored(points)
            place[row] = np.arange(len(row))
            share = self.network.fresnel(points.of(row))
        of_met = self.network.features(met)
        return VisiblePoints(points, self.network.features(points), place, met, of_met, share)

    def arriving(self, points: Points, light: np.ndarray) -> np.ndarray:
        """Return the irradiance (n,) of points."""
        irradiance, hidden = self.surface.light_from(points, light)
        irradiance[hidden] = 0.0
        return irradiance

    def colour(
        self, visible: VisiblePoints, irradiance: np.ndarray, light: np.ndarray, *, coarse: bool = False
    ) -> np.ndarray:
        """Return the colour (n, 3) of visible points, of irradiance (n,) by a light; `coarse`: `Effort`."""
        points, appearance = visible.points, visible.appearance
        if isinstance(self.network, KnownLight):
            colour = self.network.bounced(points, appearance, (light[None], np.ones((1, 3))), coarse=coarse)
        else:
            colour = self.network.bounced_by(points, appearance, irradiance, light)
        return colour + self.directly(visible, irradiance, light)

    def directly(self, visible: VisiblePoints, irradiance: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return the colour (n, 3) but for bounced light."""
        colour = self.network.directly(visible.points, visible.appearance, irradiance, light)
        if not isinstance(self.network, KnownLight) and self.network.mirrors:
            row = np.flatnonzero(visible.place >= 0)
            met, (features, albedo) = visible.place[row], visible.met_appearance
            points = visible.met.of(met)
            appearance, arriving = (features[met], albedo[met]), self.arriving(points, light)
            colour[row] += visible.share[met] * self.network.mirrored(points, appearance, arriving, light)
        return colour


def labels_of(view: View) -> list[np.ndarray]:
    """Return the groups of a view's samples."""
    return [samples.label for samples in view.samples]


def cast_of(view: View, chosen: Chosen) -> Cast:
    """Return where in an image chosen points are."""
    at = chosen.pixel
    order = np.arange(len(at)) - np.searchsorted(at, at)
    count = np.bincount(at, minlength=len(view.rows))[at]
    return Cast(view.columns[at].astype(np.int64), view.rows[at].astype(np.int64), order, count)


def join_lights(lights: list[tuple[np.ndarray, np.ndarray]]) -> Lights:
    """Return places and colours (l, 3) of lights."""
    places, colours = map(np.array, zip(*lights, strict=True))
    return places, colours
