"""The network of `reflectance.py`, compiled: features, inputs and perceptrons over blocks of points."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def, call-overload, operator, assignment"

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.jit import arrayless, relaxed_kernel
from objectfolder.vision.compiled.lighting import Points
from objectfolder.vision.network import network_layout
from objectfolder.vision.network.network_layout import MIRROR_WIDTH, has_mirrors, weight_shapes
from objectfolder.vision.network.sparse_grid import GRID_LEVELS, HALF_WIDTH, SparseGrid

# Points at a time: a block's matrices stay in the first cache. Every block is whole, its last point repeated:
# the vector loop and the loop over the points after it would round alike points differently.
NETWORK_POINTS = 64
# The inputs that this module computes; a network laid out otherwise is refused.
ANGLES, SURROUNDINGS = 12, 31
# The nearest that a light is told to be to a point, unit frame; as in `incidence`.
NEAREST = 1e-3
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

        self._tables = tuple(single(f"tables.{level}") for level in range(GRID_LEVELS))
        self._lookups = grid.lookups
        self._resolutions = np.array(
            [grid.resolution >> (GRID_LEVELS - 1 - level) for level in range(GRID_LEVELS)]
        )
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
        _features(
            points.position, points.normal, self._tables, self._lookups, self._resolutions, HALF_WIDTH,
            *self._albedo, _rows(terms, NETWORK_POINTS), _rows(3, NETWORK_POINTS), features, albedo,
        )  # fmt: skip
        return features, albedo

    def reflected(
        self, points: Points, features: np.ndarray, row: np.ndarray, to_light: np.ndarray, alpha2: np.float32
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return pi times the reflectance of points `row` (m,) for lights in directions (m, 3), in parts.

        These are (m, 3) float32: the even part over the albedo, and the highlight.
        """
        even, gloss = _rows(len(row), 3), _rows(len(row), 3)
        _reflected(
            row, to_light, features, points.normal, points.direction, self._direct, self._facing,
            self.mirrors, alpha2, np.float32(network_layout.LEAST_COSINE), even, gloss,
        )  # fmt: skip
        return even, gloss

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
        _bounced(
            which, *lamps, irradiance, points.position, features, points.normal, points.direction,
            self._bounced, answer,
        )  # fmt: skip
        return answer


def _rows(count: int, columns: int) -> np.ndarray:
    return np.empty((count, columns), dtype=np.float32)


@arrayless(relaxed_kernel)
def _interpolate(table, lookup, resolution, half_width, x, y, z, features, first, s):
    """Write the features of one level at a point to features[first:, s]: `SparseGrid.interpolation`."""
    one, zero = np.float32(1.0), np.float32(0.0)
    scale, limit = resolution / (2 * half_width), resolution * (1 - 1e-7)
    px = min(max((x + half_width) * scale, 0.0), limit)
    py = min(max((y + half_width) * scale, 0.0), limit)
    pz = min(max((z + half_width) * scale, 0.0), limit)
    i, j, k = int(px), int(py), int(pz)
    fx, fy, fz = np.float32(px - i), np.float32(py - j), np.float32(pz - k)
    side = resolution + 1
    base = (i * side + j) * side + k
    up = side * side
    r0, r1 = lookup[base], lookup[base + 1]
    r2, r3 = lookup[base + side], lookup[base + side + 1]
    r4, r5 = lookup[base + up], lookup[base + up + 1]
    r6, r7 = lookup[base + up + side], lookup[base + up + side + 1]
    gx, gy, gz = one - fx, one - fy, one - fz
    w0, w1, w2, w3 = gx * gy * gz, gx * gy * fz, gx * fy * gz, gx * fy * fz
    w4, w5, w6, w7 = fx * gy * gz, fx * gy * fz, fx * fy * gz, fx * fy * fz
    if min(min(min(r0, r1), min(r2, r3)), min(min(r4, r5), min(r6, r7))) < 0:
        w0, r0 = (w0, r0) if r0 >= 0 else (zero, 0)
        w1, r1 = (w1, r1) if r1 >= 0 else (zero, 0)
        w2, r2 = (w2, r2) if r2 >= 0 else (zero, 0)
        w3, r3 = (w3, r3) if r3 >= 0 else (zero, 0)
        w4, r4 = (w4, r4) if r4 >= 0 else (zero, 0)
        w5, r5 = (w5, r5) if r5 >= 0 else (zero, 0)
        w6, r6 = (w6, r6) if r6 >= 0 else (zero, 0)
        w7, r7 = (w7, r7) if r7 >= 0 else (zero, 0)
        share = one / max(w0 + w1 + w2 + w3 + w4 + w5 + w6 + w7, np.float32(1e-6))
        w0, w1, w2, w3 = w0 * share, w1 * share, w2 * share, w3 * share
        w4, w5, w6, w7 = w4 * share, w5 * share, w6 * share, w7 * share
    for f in range(table.shape[1]):
        features[first + f, s] = (
            (w0 * table[r0, f] + w1 * table[r1, f] + w2 * table[r2, f] + w3 * table[r3, f])
            + (w4 * table[r4, f] + w5 * table[r5, f] + w6 * table[r6, f] + w7 * table[r7, f])
        )  # fmt: skip


@arrayless(relaxed_kernel)
def _product(weight, inputs, out):
    """Write the (n, NETWORK_POINTS) product of (n, m) weights and (m, NETWORK_POINTS) inputs to `out`.

    BLAS may round a column by its place among the others, as OpenBLAS' kernel for Haswell does: a point's
    radiance would depend on which points are asked with it. Here every column has the same sums in the
    same order. Eight rows of inputs at a time hide the loads: as fast as OpenBLAS on these small matrices.
    """
    rows, terms = weight.shape
    whole = terms - terms % 8
    for row in range(rows):
        w, total = weight[row], out[row]
        for s in range(NETWORK_POINTS):
            total[s] = np.float32(0.0)
        for k in range(0, whole, 8):
            w0, w1, w2, w3 = w[k], w[k + 1], w[k + 2], w[k + 3]
            w4, w5, w6, w7 = w[k + 4], w[k + 5], w[k + 6], w[k + 7]
            for s in range(NETWORK_POINTS):
                total[s] += (
                    (w0 * inputs[k, s] + w1 * inputs[k + 1, s])
                    + (w2 * inputs[k + 2, s] + w3 * inputs[k + 3, s])
                    + (w4 * inputs[k + 4, s] + w5 * inputs[k + 5, s])
                    + (w6 * inputs[k + 6, s] + w7 * inputs[k + 7, s])
                )
        for k in range(whole, terms):
            last = w[k]
            for s in range(NETWORK_POINTS):
                total[s] += last * inputs[k, s]


@arrayless(relaxed_kernel)
def _hidden(weight, bias, inputs, out):
    _product(weight, inputs, out)
    zero = np.float32(0.0)
    for row in range(out.shape[0]):
        shift = bias[row]
        for s in range(out.shape[1]):
            out[row, s] = max(out[row, s] + shift, zero)


@arrayless(relaxed_kernel)
def _sigmoid(x):
    return np.float32(1.0) / (np.float32(1.0) + math.exp(-x))


@arrayless(relaxed_kernel)
def _softplus(x):
    return max(x, np.float32(0.0)) + math.log1p(math.exp(-abs(x)))


@arrayless(relaxed_kernel)
def _schlick(facing, rim):
    share = _sigmoid(facing)
    return share + (np.float32(1.0) - share) * rim


@arrayless(relaxed_kernel)
def _features(position, normal, tables, lookups, resolutions, half_width, albedo, albedo_bias,
              inputs, out, features, base):  # fmt: skip
    """Write features (n, f) of points and their albedo (n, 3); `inputs` and `out` are working memory."""
    count = len(position)
    for start in range(0, count, NETWORK_POINTS):
        row = np.int64(0)  # a literal would have `_interpolate` compiled twice
        for level in range(4):
            table, lookup, resolution = tables[level], lookups[level], resolutions[level]
            for s in range(NETWORK_POINTS):
                i = min(start + s, count - 1)
                _interpolate(table, lookup, resolution, half_width,
                             position[i, 0], position[i, 1], position[i, 2], inputs, row, s)  # fmt: skip
            row += table.shape[1]
        for s in range(NETWORK_POINTS):
            i = min(start + s, count - 1)
            for axis in range(3):
                inputs[row + axis, s] = normal[i, axis]
        _product(albedo, inputs, out)
        for s in range(min(NETWORK_POINTS, count - start)):
            for term in range(row):
                features[start + s, term] = inputs[term, s]
            for channel in range(3):
                base[start + s, channel] = _sigmoid(out[channel, s] + albedo_bias[channel])


@arrayless(relaxed_kernel)
def _incidence(normal, direction, to_light, alpha2, least_cosine, inputs, a, s):
    """Write the terms of the directions to column s of `inputs` from row a on; return the masked GGX lobe.

    The unit vectors (3,) are the surface's normal, the ray that meets it and the way to the light.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    nx, ny, nz = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
    cx, cy, cz = -np.float32(direction[0]), -np.float32(direction[1]), -np.float32(direction[2])
    tx, ty, tz = np.float32(to_light[0]), np.float32(to_light[1]), np.float32(to_light[2])
    hx, hy, hz = tx + cx, ty + cy, tz + cz
    scale = one / max(math.sqrt(hx * hx + hy * hy + hz * hz), np.float32(1e-9))
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    at_light = nx * tx + ny * ty + nz * tz
    at_camera = nx * cx + ny * cy + nz * cz
    middle = min(max(nx * hx + ny * hy + nz * hz, zero), one)
    grazing = min(max(tx * hx + ty * hy + tz * hz, zero), one)
    rim, fresnel = min(max(one - at_camera, zero), one), one - grazing
    fresnel2, middle2 = fresnel * fresnel, middle * middle
    middle4 = middle2 * middle2
    middle16 = (middle4 * middle4) * (middle4 * middle4)
    inputs[a, s], inputs[a + 1, s], inputs[a + 2, s] = nx, ny, nz
    inputs[a + 3, s], inputs[a + 4, s] = at_light, at_light * at_light
    inputs[a + 5, s], inputs[a + 6, s] = at_camera, rim * rim * rim
    inputs[a + 7, s], inputs[a + 8, s] = fresnel2 * fresnel2 * fresnel, grazing
    inputs[a + 9, s], inputs[a + 10, s] = middle4, middle16 * middle16
    inputs[a + 11, s] = middle
    qx, qy, qz = ny * hz - nz * hy, nz * hx - nx * hz, nx * hy - ny * hx
    sine2 = qx * qx + qy * qy + qz * qz if middle > zero else one
    at_light, at_camera = max(at_light, least_cosine), max(at_camera, least_cosine)
    width = alpha2 * middle2 + sine2
    masked = at_light * math.sqrt(at_camera * at_camera * (one - alpha2) + alpha2)
    shadowed = at_camera * math.sqrt(at_light * at_light * (one - alpha2) + alpha2)
    return alpha2 / (2 * width * width * (masked + shadowed))


@relaxed_kernel
def _reflected(row, to_light, features, normal, direction, direct, facing, mirrors, alpha2, least_cosine,
               even, gloss):  # fmt: skip
    """Write (m, 3) what is reflected evenly over the albedo, and in the highlight, of pairs (m,).

    Parameters
    ----------
    row, to_light
        Point (m,) of each pair, and unit direction (m, 3) of its light.
    features, normal, direction
        Of the points, the last of the rays that meet them.
    """
    pairs, count = len(row), features.shape[1]
    # Here and not by the caller: LLVM sees that they are apart, and is 7 % faster.
    inputs = np.empty((direct[0].shape[1], NETWORK_POINTS), np.float32)
    first = np.empty((direct[0].shape[0], NETWORK_POINTS), np.float32)
    second = np.empty((direct[2].shape[0], NETWORK_POINTS), np.float32)
    out = np.empty((8, NETWORK_POINTS), np.float32)
    lobe, fifth = out[6], out[7]
    for start in range(0, pairs, NETWORK_POINTS):
        for s in range(NETWORK_POINTS):
            pair = min(start + s, pairs - 1)
            i = row[pair]
            for term in range(count):
                inputs[term, s] = features[i, term]
            lobe[s] = _incidence(
                normal[i], direction[i], to_light[pair], alpha2, least_cosine, inputs, count, s
            )
            fifth[s] = inputs[count + 7, s]
        _hidden(direct[0], direct[1], inputs, first)
        _hidden(direct[2], direct[3], first, second)
        _product(direct[4], second, out)
        for s in range(min(NETWORK_POINTS, pairs - start)):
            i = row[start + s]
            for channel in range(3):
                even[start + s, channel] = 2 * _sigmoid(out[channel, s] + direct[5][channel])
                strength = out[channel + 3, s] + direct[5][channel + 3]
                if mirrors:
                    total = facing[1][channel]
                    for term in range(count):
                        total += facing[0][channel, term] * features[i, term]
                    gloss[start + s, channel] = _schlick(total, fifth[s]) * 2 * _sigmoid(strength) * lobe[s]
                else:
                    gloss[start + s, channel] = _softplus(strength) * lobe[s]


@arrayless(relaxed_kernel)
def _surroundings(position, normal, direction, light, irradiance, inputs, b, s):
    """Write the 19 inputs that depend on a point, and not on the lamp alone, to column s from row b on.

    `position`, `normal`, `direction` and `light` are (3,), the third of the ray that meets the point.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    x, y, z = np.float32(position[0]), np.float32(position[1]), np.float32(position[2])
    nx, ny, nz = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
    cx, cy, cz = -np.float32(direction[0]), -np.float32(direction[1]), -np.float32(direction[2])
    tx, ty, tz = np.float32(light[0]) - x, np.float32(light[1]) - y, np.float32(light[2]) - z
    distance = max(math.sqrt(tx * tx + ty * ty + tz * tz), np.float32(NEAREST))
    scale = one / distance
    tx, ty, tz = tx * scale, ty * scale, tz * scale
    at_light = nx * tx + ny * ty + nz * tz
    at_camera = nx * cx + ny * cy + nz * cz
    mx, my, mz = (
        2 * at_camera * nx - cx, 2 * at_camera * ny - cy, 2 * at_camera * nz - cz
    )  # fmt: skip
    near = min(distance, np.float32(4.0))
    inputs[b, s], inputs[b + 1, s], inputs[b + 2, s] = x, y, z
    inputs[b + 3, s], inputs[b + 4, s], inputs[b + 5, s] = nx, ny, nz
    inputs[b + 6, s], inputs[b + 7, s], inputs[b + 8, s] = cx, cy, cz
    inputs[b + 9, s], inputs[b + 10, s], inputs[b + 11, s] = tx, ty, tz
    inputs[b + 12, s], inputs[b + 13, s] = at_light, max(at_light, zero)
    inputs[b + 14, s], inputs[b + 15, s] = at_camera, mx * tx + my * ty + mz * tz
    inputs[b + 16, s] = distance
    inputs[b + 17, s] = one / (near * near * 4)
    inputs[b + 18, s] = math.log(max(np.float32(irradiance), np.float32(1e-3)))


@relaxed_kernel
def _bounced(which, lamps, shifts, irradiance, position, features, normal, direction, bounced,
             answer):  # fmt: skip
    """Write (n, 3) bounced light over the albedo of points, each with one of the lamps (l, 3).

    `shifts` (l, width) are the first layer's biases with what the lamp's place adds to them.
    """
    count = len(which)
    zero = np.float32(0.0)
    b = bounced[0].shape[1] - 19
    inputs = np.empty((b + 19, NETWORK_POINTS), np.float32)
    first = np.empty((bounced[0].shape[0], NETWORK_POINTS), np.float32)
    second = np.empty((bounced[1].shape[0], NETWORK_POINTS), np.float32)
    out = np.empty((3, NETWORK_POINTS), np.float32)
    for start in range(0, count, NETWORK_POINTS):
        for s in range(NETWORK_POINTS):
            i = min(start + s, count - 1)
            for term in range(b):
                inputs[term, s] = features[i, term]
            _surroundings(position[i], normal[i], direction[i], lamps[which[i]], irradiance[i], inputs, b, s)
        _product(bounced[0], inputs, first)
        for s in range(NETWORK_POINTS):
            shift = shifts[which[min(start + s, count - 1)]]
            for k in range(first.shape[0]):
                first[k, s] = max(first[k, s] + shift[k], zero)
        _hidden(bounced[1], bounced[2], first, second)
        _product(bounced[3], second, out)
        for s in range(min(NETWORK_POINTS, count - start)):
            for channel in range(3):
                answer[start + s, channel] = _softplus(out[channel, s] + bounced[4][channel])


@arrayless(relaxed_kernel)
def _fresnel(features, rim, weight, bias, share):
    """Write (n, 3) the shares that mirrors of features (n, f) reflect: `reflectance.Reflectance.fresnel`."""
    for i in range(len(features)):
        for channel in range(3):
            total = bias[channel]
            for f in range(features.shape[1]):
                total += weight[channel, f] * features[i, f]
            share[i, channel] = _schlick(total, rim[i])
