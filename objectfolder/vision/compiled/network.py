"""The network of `reflectance.py` in compiled kernels: its weights, laid out for these, and its answers."""

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.vision.compiled.lighting import Points
from objectfolder.vision.compiled.network_kernels import (
    NETWORK_POINTS,
    _bounced,
    _features,
    _fresnel,
    _reflected,
)
from objectfolder.vision.network import network_layout
from objectfolder.vision.network.network_layout import MIRROR_WIDTH, has_mirrors, weight_shapes
from objectfolder.vision.network.sparse_grid import GRID_LEVELS, HALF_WIDTH, SparseGrid

# The inputs that this module computes; a network laid out otherwise is refused.
ANGLES, SURROUNDINGS = 12, 31
# Of the surroundings, those that depend on the light alone.
LIGHT_INPUTS = slice(12, 24)
# Features (n, f) and albedo (n, 3) of points, float32: what no light changes.
Appearance = tuple[np.ndarray, np.ndarray]


class Reflecting(Protocol):
    """What reflects light."""

    def reflected(
        self, points: Points, features: np.ndarray, row: np.ndarray, to_light: np.ndarray, alpha2: np.float32
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `CompiledNetwork.reflected`."""


def reflected_once(
    surface: Reflecting, points: Points, appearance: Appearance, irradiance: np.ndarray, light: np.ndarray,
    alpha2: np.float32,
) -> np.ndarray:  # fmt: skip
    """Return (n, 3) float32 radiance over P / (4 pi^2) that a lamp at (3,) causes but for bounced light.

    Parameters
    ----------
    points, appearance, irradiance
        The points, their features and albedo, and what (n,) of the lamp reaches them.
    alpha2
        Squared GGX width of the highlight.
    """
    features, albedo = appearance
    lit = np.flatnonzero(irradiance)
    to_light = light - points.position[lit]
    to_light /= np.maximum(np.linalg.norm(to_light, axis=1, keepdims=True), 1e-9)
    even, gloss = surface.reflected(points, features, lit, to_light, alpha2)
    colour = np.zeros_like(albedo)
    colour[lit] = irradiance[lit, None].astype(np.float32) * (albedo[lit] * even + gloss)
    return colour


class CompiledNetwork:
    """Weights of `reflectance.Reflectance`, laid out for kernels.

    Parameters
    ----------
    grid
        The feature grid.
    weights
        Arrays by name.

    Attributes
    ----------
    mirrors
        Whether the surface is shown in itself.
    alpha2, mirror_alpha2
        Squares of the GGX width of the highlight, and of that seen in mirrors.

    Raises
    ------
    FormatError
        Names or shapes other than those of the network this module evaluates.
    """

    def __init__(self, grid: SparseGrid, weights: Mapping[str, np.ndarray]) -> None:
        supported = (ANGLES, SURROUNDINGS, 4)
        if supported != (network_layout.ANGLES, network_layout.SURROUNDINGS, GRID_LEVELS):
            raise FormatError("vision", "inputs that the compiled renderer does not know", "Use torch.")
        self.mirrors = has_mirrors(weights.keys())
        expected = weight_shapes(grid.sizes, mirrors=self.mirrors)
        for name in sorted(expected.keys() | weights.keys()):
            shape = weights[name].shape if name in weights else None
            if shape != expected.get(name):
                raise FormatError(f"vision.{name}", f"shape {shape}, expected {expected.get(name)}")

        def single(name: str) -> np.ndarray:
            return np.ascontiguousarray(weights[name], dtype=np.float32)

        tables = tuple(single(f"tables.{level}") for level in range(GRID_LEVELS))
        sides = np.array([grid.resolution >> (GRID_LEVELS - 1 - level) for level in range(GRID_LEVELS)])
        self._levels = tables, grid.lookups, sides, HALF_WIDTH
        layers = [single(f"direct.{layer}.{kind}") for layer in (0, 2, 4) for kind in ("weight", "bias")]
        self._direct = tuple(layers)
        bounced = single("bounced.0.weight")
        coarse = bounced.shape[1] - SURROUNDINGS
        of_light = np.arange(coarse, bounced.shape[1])[LIGHT_INPUTS]
        self._bounced_light = bounced[:, of_light]
        self._bounced_bias = single("bounced.0.bias")
        self._bounced = (
            np.ascontiguousarray(np.delete(bounced, of_light, axis=1)),
            *(single(f"bounced.{layer}.{kind}") for layer in (2, 4) for kind in ("weight", "bias")),
        )
        self._albedo = (single("albedo.weight"), single("albedo.bias"))
        self.alpha2 = np.float32(np.exp(2 * np.float32(weights["log_alpha"])))
        # As the albedo's, with no part of the normal.
        facing, bias = np.zeros_like(self._albedo[0]), np.zeros(3, dtype=np.float32)
        if self.mirrors:
            facing[:, :-3], bias = weights["facing.weight"], single("facing.bias")
            self.mirror_alpha2 = np.float32(np.exp(2 * np.float32(weights[MIRROR_WIDTH])))
        self._facing = (facing, bias)

    def bounced_by(
        self, points: Points, appearance: Appearance, irradiance: np.ndarray, light: np.ndarray
    ) -> np.ndarray:
        """Return (n, 3) float32 bounced radiance over P / (4 pi^2) of points, of a lamp at (3,).

        `appearance` is what `features` returns for them, `irradiance` (n,) what of the lamp reaches them.
        """
        features, albedo = appearance
        which = np.zeros(len(albedo), dtype=np.int64)
        answer: np.ndarray = albedo * self.bounced(
            points, features, which, self.lamps(light[None]), irradiance
        )
        return answer

    def directly(
        self, points: Points, appearance: Appearance, irradiance: np.ndarray, light: np.ndarray
    ) -> np.ndarray:
        """Return what `bounced_by` does of the light that is reflected once."""
        return reflected_once(self, points, appearance, irradiance, light, self.alpha2)

    def mirrored(
        self, points: Points, appearance: Appearance, irradiance: np.ndarray, light: np.ndarray
    ) -> np.ndarray:
        """Return what `directly` does for points as mirrors show them, before these take their share."""
        return reflected_once(self, points, appearance, irradiance, light, self.mirror_alpha2)

    def fresnel(self, points: Points) -> np.ndarray:
        """Return the share (n, 3) float32 that mirrors at points reflect of what the camera's rays meet."""
        beside = 1 + np.einsum("ij,ij->i", points.normal, points.direction)
        rim = (np.clip(beside, 0.0, 1.0) ** 5).astype(np.float32)
        share = _rows(len(rim), 3)
        _fresnel(self.features(points)[0], rim, *self._facing, share)
        return share

    def features(self, points: Points) -> Appearance:
        """Return features (n, f) and albedo (n, 3) of points, float32."""
        count, terms = len(points.face), self._albedo[0].shape[1]
        features, albedo = _rows(count, terms - 3), _rows(count, 3)
        working = _rows(terms, NETWORK_POINTS), _rows(3, NETWORK_POINTS)
        _features(points.position, points.normal, self._levels, self._albedo, working, features, albedo)
        return features, albedo

    def reflected(
        self, points: Points, features: np.ndarray, row: np.ndarray, to_light: np.ndarray, alpha2: np.float32
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return pi times the reflectance of points `row` (m,) for lights in directions (m, 3), in parts.

        These are (m, 3) float32: the even part over the albedo, and the highlight.
        """
        answer = _rows(len(row), 3), _rows(len(row), 3)
        places, width = (features, points.normal, points.direction), np.float32(network_layout.LEAST_COSINE)
        _reflected((row, to_light), places, self._direct, self._facing, self.mirrors, (alpha2, width), answer)
        return answer

    def lamps(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return lamps at (l, 3) as `bounced` takes them: with what they alone add to its first layer."""
        waves = [np.sin(math.pi * places), np.cos(math.pi * places), np.sin(2 * math.pi * places)]
        inputs = np.concatenate([places, *waves], axis=1).astype(np.float32)
        return places, self._bounced_bias + inputs @ self._bounced_light.T

    def bounced(
        self, points: Points, features: np.ndarray, which: np.ndarray, lamps: tuple[np.ndarray, np.ndarray],
        irradiance: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Return the bounced light over the albedo (n, 3) float32 of points, each with one of `lamps`.

        Parameters
        ----------
        which, irradiance
            (n,) int64 lamp of each point, and what of it reaches the point.
        """
        answer = _rows(len(which), 3)
        places = points.position, features, points.normal, points.direction
        _bounced(which, lamps, irradiance, places, self._bounced, answer)
        return answer


def _rows(count: int, columns: int) -> np.ndarray:
    return np.empty((count, columns), dtype=np.float32)
