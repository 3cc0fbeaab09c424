"""What light a surface of known material sends to the camera: `CompiledNetwork`, with nothing learned."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.vision.compiled.lattice_values import LatticeMaterial
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.lobes import Cast, lobe_directions, scattered, stepped
from objectfolder.vision.compiled.network import Appearance, reflected_once
from objectfolder.vision.compiled.principled import LEAST_ROUGHNESS, Principled
from objectfolder.vision.compiled.radiosity import Lights, Radiosity
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.incidence import SELF_OFFSET, UnitSurface
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.network_layout import LEAST_COSINE

# Unit-frame lengths to a light that is taken as infinitely far.
INFINITE_DISTANCE = 1e4
# Directions of a point's gloss in which the surface is looked for, and in pixels in which something ends, for
# these are not averaged with others: of matt things, and where there is metal.
GLOSS_SAMPLES, METAL_SAMPLES = (2, 2), (4, 16)
# Times that gloss shows gloss, and what parts the directions of these.
GLOSS_BOUNCES, OFFSET = 2, 977
# Roughness of a dielectric from which on a coarse image shows no surface in it: .5 dB of 44 in the mean.
WIDE_LOBE = 0.2
# Points, their appearance, where they are in an image, and directions (n,) of each.
Gloss = tuple[Points, Appearance, Cast, np.ndarray]


@dataclass(frozen=True)
class Shown:
    """What points (n,) show of the surface itself in their gloss, along directions drawn from it.

    Parameters
    ----------
    row, turn
        (m,) point that shows it, and number of its direction.
    share
        (m, 3) how much of its radiance the point sends on.
    points, appearance
        The (m,) points shown, and their appearance.
    everything
        (n, 3) sum of the shares along all directions, those that meet nothing with them.
    deeper
        What the points shown show in turn; None: nothing.
    """

    row: np.ndarray
    turn: np.ndarray
    share: np.ndarray
    points: Points
    appearance: Appearance
    everything: np.ndarray
    deeper: "Shown | None"

    def sent(self, radiance: np.ndarray) -> np.ndarray:
        """Return what (n, 3) the points send of the radiance (m, 3) of those that they show."""
        columns = (self.share * radiance).T
        return np.stack(
            [np.bincount(self.row, part, minlength=len(self.everything)) for part in columns], axis=1
        )


class KnownLight:
    """Light reflected once in closed form, and light that the surface sends onto itself by radiosity.

    Parameters
    ----------
    lit, surface
        The surface, for kernels and in its unit frame.
    material
        What it is made of.

    Attributes
    ----------
    alpha2
        Squared GGX width where no map gives another.
    samples
        Directions of a point's gloss in which the surface is looked for, and where something ends.
    wide
        Whether all of it is a dielectric of wide lobes.

    Raises
    ------
    FormatError
        A material that is not known in full.
    """

    def __init__(self, lit: LitSurface, surface: UnitSurface, material: Material) -> None:
        appearance = material.appearance
        if appearance is None or not material.states("albedo"):
            raise FormatError("vision", "light of a material that is not stated", "Build it again.")
        self.alpha2 = np.float32(max(appearance.roughness, LEAST_ROUGHNESS) ** 4)
        self._lit, self._surface, self._material = lit, surface, LatticeMaterial(material)
        constant = () if material.mapped("roughness") else (appearance.roughness,)
        self._principled = Principled(appearance.specular, constant)
        metal = material.mapped("metallic") or appearance.metallic > 0
        self.samples = METAL_SAMPLES if metal else GLOSS_SAMPLES
        self.wide = not (metal or material.mapped("roughness") or appearance.roughness < WIDE_LOBE)
        matt = material.mapped("metallic") or appearance.metallic < 1
        self._matt = (lit, surface, material) if matt else None

    @cached_property
    def _radiosity(self) -> Radiosity | None:
        """Made at the first answer that needs it: drafts need none."""
        return None if self._matt is None else Radiosity(*self._matt)

    def features(self, points: Points) -> Appearance:
        """Return the terms (n, `TERMS`) of points that no light changes, and albedo (n, 3), float32."""
        places = self._surface.in_stored(points.face, points.barycentric)
        base, roughness, metallic = (
            self._material.value(name, *places) for name in ("albedo", "roughness", "metallic")
        )
        return self._principled.terms(points, base, roughness, metallic), base.astype(np.float32)

    def bounced(
        self, points: Points, appearance: Appearance, lights: Lights, *, coarse: bool = False
    ) -> np.ndarray:
        """Return what `CompiledNetwork.bounced_by` does, of several lights; `coarse`: see `Effort`."""
        terms, albedo = appearance
        if self._radiosity is None:
            return np.zeros_like(albedo)
        arriving = self._radiosity.irradiance(lights, points.face, points.barycentric, coarse=coarse)
        return np.asarray(albedo * terms[:, 2:3] * arriving, dtype=np.float32)

    def bounced_round(self, points: Points, terms: np.ndarray, around: Environment) -> np.ndarray:
        """Return the bounced light (n, 3) over the albedo of points in an environment."""
        if self._radiosity is None:
            return np.zeros((len(terms), 3))
        return terms[:, 2:3] * self._radiosity.irradiance(_far(around), points.face, points.barycentric)

    def matt_round(self, points: Points, appearance: Appearance, around: Environment) -> np.ndarray:
        """Return pi times the radiance (n, 3) of points in an environment but for their gloss."""
        terms, albedo = appearance
        if self._radiosity is None:
            return np.zeros_like(albedo)
        arriving = self._radiosity.irradiance(_far(around), points.face, points.barycentric, direct=True)
        return np.asarray(albedo * terms[:, 2:3] * arriving)

    def shown(
        self,
        points: Points,
        appearance: Appearance,
        cast: Cast,
        samples: np.ndarray,
        times: int = GLOSS_BOUNCES,
    ) -> Shown:
        """Return what points show of the surface in their gloss, by `samples` (n,) directions each.

        `appearance` is what `features` returned for them. What is shown shows others in turn, `times` in all.
        """
        terms, _ = appearance
        facet = self._lit.facets[points.face] * points.side[:, None]
        start, starts = points.position + SELF_OFFSET * facet, scattered(cast)
        widths, everything = terms[:, 0].astype(np.float64), np.zeros((len(terms), 3))
        parts = []
        for sample in range(samples.max(initial=1)):
            rows = np.flatnonzero(samples > sample)
            numbers = stepped((starts[0][rows], starts[1][rows]), sample)
            towards = -points.direction[rows]
            direction, density = lobe_directions(
                points.normal[rows], facet[rows], towards, widths[rows], *numbers, LEAST_COSINE
            )
            above = density > 0
            sent, density, direction = rows[above], density[above], np.ascontiguousarray(direction[above])
            _, gloss = self._principled.reflected(points, terms, sent, direction)
            cosine = np.einsum("ij,ij->i", direction, points.normal[sent])
            share = gloss * (cosine / (samples[sent] * np.pi * density))[:, None]
            everything[sent] += share
            face, barycentric = self._lit.volumes.first_hits(np.ascontiguousarray(start[sent]), direction)
            met = np.flatnonzero(face >= 0)
            turn = np.full(len(met), sample)
            parts.append((sent[met], turn, share[met], face[met], barycentric[met], direction[met]))
        row, turn, share, *place = (np.concatenate(column) for column in zip(*parts, strict=True))
        met_points = self._lit.points(*place)
        met_appearance = self.features(met_points)
        deeper = None
        if times > 1 and len(row):
            order = (1 + cast.order[row]) * OFFSET + turn
            once = np.ones(len(row), dtype=np.int64)
            again = Cast(cast.columns[row], cast.rows[row], order, once)
            deeper = self.shown(met_points, met_appearance, again, once, times - 1)
            deeper = replace(deeper, turn=turn[deeper.row])
        return Shown(row, turn, share, met_points, met_appearance, everything, deeper)

    def in_gloss(
        self,
        points: Points,
        appearance: Appearance,
        cast: Cast,
        samples: np.ndarray,
        lights: Lights,
        turns: int = 1,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what (n, 3) points show of the lit surface in their gloss, and the share it would all be.

        The share (n, 3) is that of radiance 1 all round. Arguments are as of `shown`, and `turns`: each of
        so many directions asks its own lights.
        """
        shown = self.shown(points, appearance, cast, samples)
        return shown.sent(self.radiance_of(shown, lights, turns)), shown.everything

    def radiance_of(self, shown: Shown, lights: Lights, turns: int, *, coarse: bool = False) -> np.ndarray:
        """Return the radiance (m, 3) of what is shown; arguments as of `in_gloss` and `bounced`."""
        radiance = self.bounced(shown.points, shown.appearance, lights, coarse=coarse).astype(np.float64)
        terms, albedo = shown.appearance
        for turn in range(turns):
            row = np.flatnonzero(shown.turn % turns == turn)
            points, appearance = shown.points.of(row), (terms[row], albedo[row])
            for light, colour in zip(lights[0][turn::turns], lights[1][turn::turns], strict=True):
                irradiance, hidden = self._lit.light_from(points, light)
                irradiance[hidden] = 0.0
                radiance[row] += turns * colour * self.directly(points, appearance, irradiance, light)
        if shown.deeper is not None:
            deeper = self.radiance_of(shown.deeper, lights, turns, coarse=coarse)
            radiance += shown.deeper.sent(deeper)
        return radiance

    def reflected(
        self, points: Points, features: np.ndarray, row: np.ndarray, to_light: np.ndarray, alpha2: np.float32
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what `CompiledNetwork.reflected` does; the terms say how wide the highlight is."""
        return self._principled.reflected(points, features, row, to_light)

    def directly(
        self, points: Points, appearance: Appearance, irradiance: np.ndarray, light: np.ndarray
    ) -> np.ndarray:
        """Return what `CompiledNetwork.directly` does."""
        return reflected_once(self, points, appearance, irradiance, light, self.alpha2)


def _far(around: Environment) -> Lights:
    """Return an environment as far lights."""
    return INFINITE_DISTANCE * around.directions, INFINITE_DISTANCE**2 * around.powers
