"""Light that a surface of known material reflects once, in closed form: nothing of it is learned.

A dielectric is Lambert's matt base under a clear coat, its share scaled by what the coat lets through; coat
and metals are GGX surfaces (Walter et al. 2007) of height-correlated Smith masking (Heitz 2014). What such a
surface loses by reflecting once alone comes back (Kulla and Conty 2017, Turquin 2019). The coat's Fresnel
reflection is that of a real dielectric, a metal's Schlick's (1994) from its base colour.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math

import numpy as np

from objectfolder.jit import arrayless, kernel
from objectfolder.vision.compiled.lighting import Points
from objectfolder.vision.network.directional_albedo import (
    reflected_by_dielectric,
    reflected_by_white,
)
from objectfolder.vision.network.thin_glass import index_of

# Of a point: squared GGX width, cosine of the camera, factors of the matt base, of the coat's and (3) of the
# metal's reflection, and the base colour (3).
PRINCIPLED_TERMS = 10
# Of a mirror the highlight of a lamp, a point, would be met by no ray.
LEAST_ROUGHNESS = 0.01


class Principled:
    """The reflection of materials that share a dielectric reflection level.

    Parameters
    ----------
    specular
        Level of the dielectric reflection: 0 none, 0.5 an index of 1.5.
    roughnesses
        Which the surface may have; all of 0..1 if empty.
    """

    def __init__(self, specular: float, roughnesses: tuple[float, ...] = ()) -> None:
        upright = min(0.08 * specular, 0.999)
        self._index = index_of(specular)
        grid = roughnesses or tuple(np.linspace(0, 1, 32))
        self._white, self._mean = reflected_by_white(grid)
        self._rise = np.zeros((16, 16))
        upright_mean = 0.0
        if upright > 0:
            self._rise = reflected_by_dielectric(self._index, grid)
            # Mean of the Fresnel factor over cosines (Kulla and Conty 2017).
            upright_mean = (self._index - 1) / (4.08567 + 1.00071 * self._index)
        self._upright, self._upright_mean = upright, upright_mean

    def terms(
        self, points: Points, base: np.ndarray, roughness: np.ndarray, metallic: np.ndarray
    ) -> np.ndarray:
        """Return all (n, `PRINCIPLED_TERMS`) float32 that no light changes.

        Parameters
        ----------
        points
            Seen along their directions.
        base
            (n, 3) scene-linear base colour.
        roughness, metallic
            (n,) in 0..1.
        """
        terms = np.empty((len(base), PRINCIPLED_TERMS), dtype=np.float32)
        material, tables = (base, roughness, metallic), (self._white, self._mean, self._rise)
        _terms(
            points.normal, points.direction, material, tables, self._upright, self._upright_mean,
            LEAST_ROUGHNESS, terms,
        )  # fmt: skip
        return terms

    def slab_terms(self, points: Points, reflectance: np.ndarray, roughness: np.ndarray) -> np.ndarray:
        """Return the terms of surfaces that reflect a stated share (n, 3) of the camera's light, and no more.

        What one reflection loses comes back as of a surface of this Fresnel factor.
        """
        whole = np.ones(len(roughness))
        terms = self.terms(points, np.ones_like(reflectance), roughness, whole)
        rough, lost = np.clip(roughness, 0, 1), terms[:, 4:7] - 1.0
        all_round = np.interp(rough, np.linspace(0, 1, len(self._mean)), self._mean)[:, None]
        again = reflectance * all_round / (1 - reflectance * (1 - all_round))
        terms[:, 4:7] = reflectance * (1 + again * lost)
        return terms

    def reflected(
        self, points: Points, terms: np.ndarray, row: np.ndarray, to_light: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return pi times the reflectance of points `row` (m,) for lights in directions (m, 3), in parts.

        These are (m, 3) float32: the matt part over the base colour, and the gloss.
        """
        even = np.empty((len(row), 3), dtype=np.float32)
        gloss = np.empty((len(row), 3), dtype=np.float32)
        lit = row, to_light
        _reflected(lit, points.normal, points.upright, points.direction, terms, self._index, even, gloss)
        return even, gloss


@arrayless(kernel)
def _between(table, row, column):
    """Look up a table (r, c) between its cells."""
    i, j = min(int(row), table.shape[0] - 2), min(int(column), table.shape[1] - 2)
    down, right = row - i, column - j
    above = (1.0 - right) * table[i, j] + right * table[i, j + 1]
    below = (1.0 - right) * table[i + 1, j] + right * table[i + 1, j + 1]
    return (1.0 - down) * above + down * below


@arrayless(kernel)
def _terms(normal, direction, material, tables, upright, upright_mean, least_roughness, terms):
    """Write the answer of `Principled.terms`."""
    (base, roughness, metallic), (white, mean, rise) = material, tables
    cells, coat_cells = len(mean) - 1, len(rise) - 1
    for i in range(len(base)):
        cosine, rough = 0.0, min(max(roughness[i], 0.0), 1.0)
        for axis in range(3):
            cosine -= normal[i, axis] * direction[i, axis]
        facing = min(max(cosine, 0.0), 1.0)
        share = _between(white, cells * rough, cells * facing)
        low = min(int(cells * rough), cells - 1)
        over = cells * rough - low
        all_round = (1.0 - over) * mean[low] + over * mean[low + 1]
        lost = (1.0 - share) / share
        again = upright_mean * all_round / (1.0 - upright_mean * (1.0 - all_round))
        coat = 1.0 + again * lost if upright > 0 else 0.0
        albedo = upright + (1.0 - upright) * _between(rise, coat_cells * rough, coat_cells * facing)
        under = min(max(1.0 - coat * share * albedo, 0.0), 1.0) if upright > 0 else 1.0
        metal = metallic[i]
        terms[i, 0] = max(rough, least_roughness) ** 4
        terms[i, 1] = cosine
        terms[i, 2] = (1.0 - metal) * under
        terms[i, 3] = (1.0 - metal) * coat
        for channel in range(3):
            colour = min(max(base[i, channel], 0.0), 1.0)
            # Schlick's mean over cosines.
            average = colour + (1.0 - colour) / 21.0
            again = average * all_round / (1.0 - average * (1.0 - all_round))
            terms[i, 4 + channel] = metal * (1.0 + again * lost)
            terms[i, 7 + channel] = colour


@arrayless(kernel)
def _reflected(lit, normal, upright, direction, terms, index, even, gloss):
    """Write the answer of `Principled.reflected`."""
    row, to_light = lit
    for pair in range(len(row)):
        i = row[pair]
        for channel in range(3):
            even[pair, channel] = terms[i, 2]
            gloss[pair, channel] = 0.0
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        lx, ly, lz = to_light[pair, 0], to_light[pair, 1], to_light[pair, 2]
        camera, light = np.float64(terms[i, 1]), nx * lx + ny * ly + nz * lz
        if not (camera > 0 and light > 0):
            continue
        hx, hy, hz = lx - direction[i, 0], ly - direction[i, 1], lz - direction[i, 2]
        scale = 1.0 / max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-12)
        hx, hy, hz = hx * scale, hy * scale, hz * scale
        middle = nx * hx + ny * hy + nz * hz
        half = min(max(lx * hx + ly * hy + lz * hz, 0.0), 1.0)
        # Of a cosine near 1 rounding leaves no sine.
        qx, qy, qz = ny * hz - nz * hy, nz * hx - nx * hz, nx * hy - ny * hx
        alpha2 = np.float64(terms[i, 0])
        width = qx * qx + qy * qy + qz * qz + alpha2 * middle * middle
        masked = math.sqrt(1.0 + alpha2 * (1.0 / (camera * camera) - 1.0))
        shadowed = math.sqrt(1.0 + alpha2 * (1.0 / (light * light) - 1.0))
        lobe = alpha2 / (width * width) / (2.0 * camera * light * (masked + shadowed))
        # Irradiance has lost what bumps hide from matt surfaces (`incidence.bent_share`); gloss has not.
        turned = upright[i, 0] * nx + upright[i, 1] * ny + upright[i, 2] * nz
        if turned < 1.0 - 1e-9:
            rise = upright[i, 0] * lx + upright[i, 1] * ly + upright[i, 2] * lz
            bump2 = min(max((1.0 / max(turned, 1e-9) ** 2 - 1.0) / 8.0, 0.0), 1.0)
            rise = max(rise, 1e-9)
            lobe *= 0.5 * (1.0 + math.sqrt(1.0 + bump2 * max(1.0 / (rise * rise) - 1.0, 0.0)))
        refracted = math.sqrt(index * index - 1.0 + half * half)
        across = (refracted - half) / (refracted + half)
        along = (half * (refracted + half) - 1.0) / (half * (refracted - half) + 1.0)
        coat = terms[i, 3] * 0.5 * across * across * (1.0 + along * along)
        beside = 1.0 - half
        beside2 = beside * beside
        fifth = beside2 * beside2 * beside
        for channel in range(3):
            colour = terms[i, 7 + channel]
            metal = terms[i, 4 + channel] * (colour + (1.0 - colour) * fifth)
            gloss[pair, channel] = lobe * (coat + metal)
