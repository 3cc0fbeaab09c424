"""The network of `reflectance.py`, compiled: features, inputs and perceptrons over blocks of points."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def, call-overload, operator, assignment"

import math
from collections.abc import Mapping

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.jit import relaxed_kernel
from objectfolder.vision.network import network_layout
from objectfolder.vision.network.network_layout import MIRROR_WIDTH, has_mirrors, weight_shapes
from objectfolder.vision.network.sparse_grid import HALF_WIDTH, LEVELS, SparseGrid

# Points at a time: a block's matrices stay in the first cache. Every block is whole, its last point repeated:
# the vector loop and the loop over the points after it would round alike points differently.
BLOCK = 64
# The inputs that this module computes; a network laid out otherwise is refused.
ANGLES, SURROUNDINGS = 12, 31
# The nearest that a light is told to be to a point, unit frame; as in `incidence`.
NEAREST = 1e-3
# Of the surroundings, those that depend on the light alone.
LIGHT_INPUTS = slice(12, 24)


class CompiledNetwork:
    """Weights of `reflectance.Reflectance`, laid out for `radiance`.

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

    Raises
    ------
    FormatError
        Names or shapes other than those of the network this module evaluates.
    """

    def __init__(self, grid: SparseGrid, weights: Mapping[str, np.ndarray]) -> None:
        known = (ANGLES, SURROUNDINGS, 4)
        if known != (network_layout.ANGLES, network_layout.SURROUNDINGS, LEVELS):
            raise FormatError("vision", "inputs that the compiled renderer does not know", "Use torch.")
        self.mirrors = has_mirrors(weights.keys())
        expected = weight_shapes(grid.sizes, mirrors=self.mirrors)
        for name in sorted(expected.keys() | weights.keys()):
            found = weights[name].shape if name in weights else None
            if found != expected.get(name):
                raise FormatError(f"vision.{name}", f"shape {found}, expected {expected.get(name)}")

        def single(name: str) -> np.ndarray:
            return np.ascontiguousarray(weights[name], dtype=np.float32)

        self._tables = tuple(single(f"tables.{level}") for level in range(LEVELS))
        self._lookups = grid.lookups
        self._resolutions = np.array([grid.resolution >> (LEVELS - 1 - level) for level in range(LEVELS)])
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
        self._alpha2 = np.float32(np.exp(2 * np.float32(weights["log_alpha"])))
        # As the albedo's, with no part of the normal.
        facing, bias = np.zeros_like(self._albedo[0]), np.zeros(3, dtype=np.float32)
        if self.mirrors:
            facing[:, :-3], bias = weights["facing.weight"], single("facing.bias")
            self._mirror_alpha2 = np.float32(np.exp(2 * np.float32(weights[MIRROR_WIDTH])))
        self._facing = (facing, bias)

    def radiance(
        self,
        position: np.ndarray,
        normal: np.ndarray,
        to_camera: np.ndarray,
        irradiance: np.ndarray,
        light: np.ndarray,
    ) -> np.ndarray:
        """Return (n, 3) float32 radiance over P / (4 pi^2) of points (n, 3) with irradiance (n,)."""
        return self._evaluated(position, normal, to_camera, irradiance, light, self._alpha2, True)

    def mirrored(
        self,
        mirror: np.ndarray,
        camera: np.ndarray,
        position: np.ndarray,
        normal: np.ndarray,
        to_camera: np.ndarray,
        irradiance: np.ndarray,
        light: np.ndarray,
    ) -> np.ndarray:
        """Return (n, 3) float32 radiance over P / (4 pi^2) of points as seen in others.

        Parameters
        ----------
        mirror, camera
            (n, 3) points of the mirror, and the cosine (n,) with which the camera sees them.
        position, normal, to_camera, irradiance
            Of the points seen there, as for `radiance`; `to_camera` is against the mirror ray.
        """
        shown = self._evaluated(position, normal, to_camera, irradiance, light, self._mirror_alpha2, False)
        rim = (np.clip(1 - camera, 0.0, 1.0) ** 5).astype(np.float32)
        answer: np.ndarray = shown * _fresnel(
            mirror, rim, self._tables, self._lookups, self._resolutions, HALF_WIDTH, *self._facing
        )
        return answer

    def _evaluated(
        self, position: np.ndarray, normal: np.ndarray, to_camera: np.ndarray, irradiance: np.ndarray,
        light: np.ndarray, alpha2: np.float32, bounces: bool,
    ) -> np.ndarray:  # fmt: skip
        waves = [np.sin(math.pi * light), np.cos(math.pi * light), np.sin(2 * math.pi * light)]
        inputs = np.concatenate([light, *waves]).astype(np.float32)
        bias = self._bounced_bias + self._bounced_light @ inputs
        answer: np.ndarray = _radiance(
            position, normal, to_camera, irradiance, light,
            self._tables, self._lookups, self._resolutions, HALF_WIDTH,
            self._direct, bias, self._bounced, self._albedo, self._facing, self.mirrors, bounces, alpha2,
            np.float32(network_layout.LEAST_COSINE),
        )  # fmt: skip
        return answer


@relaxed_kernel
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


@relaxed_kernel
def _product(weight, inputs, out):
    """Write the (n, BLOCK) product of (n, m) weights and (m, BLOCK) inputs to `out`.

    BLAS may round a column by its place among the others, as OpenBLAS' kernel for Haswell does: a point's
    radiance would depend on which points are asked with it. Here every column has the same sums in the
    same order. Eight rows of inputs at a time hide the loads: as fast as OpenBLAS on these small matrices.
    """
    rows, terms = weight.shape
    whole = terms - terms % 8
    for row in range(rows):
        w, total = weight[row], out[row]
        for s in range(BLOCK):
            total[s] = np.float32(0.0)
        for k in range(0, whole, 8):
            w0, w1, w2, w3 = w[k], w[k + 1], w[k + 2], w[k + 3]
            w4, w5, w6, w7 = w[k + 4], w[k + 5], w[k + 6], w[k + 7]
            for s in range(BLOCK):
                total[s] += (
                    (w0 * inputs[k, s] + w1 * inputs[k + 1, s])
                    + (w2 * inputs[k + 2, s] + w3 * inputs[k + 3, s])
                    + (w4 * inputs[k + 4, s] + w5 * inputs[k + 5, s])
                    + (w6 * inputs[k + 6, s] + w7 * inputs[k + 7, s])
                )
        for k in range(whole, terms):
            last = w[k]
            for s in range(BLOCK):
                total[s] += last * inputs[k, s]


@relaxed_kernel
def _hidden(weight, bias, inputs, out):
    _product(weight, inputs, out)
    zero = np.float32(0.0)
    for row in range(out.shape[0]):
        shift = bias[row]
        for s in range(out.shape[1]):
            out[row, s] = max(out[row, s] + shift, zero)


@relaxed_kernel
def _sigmoid(x):
    return np.float32(1.0) / (np.float32(1.0) + math.exp(-x))


@relaxed_kernel
def _softplus(x):
    return max(x, np.float32(0.0)) + math.log1p(math.exp(-abs(x)))


@relaxed_kernel
def _schlick(facing, rim):
    share = _sigmoid(facing)
    return share + (np.float32(1.0) - share) * rim


@relaxed_kernel
def _radiance(
    position, normal, to_camera, irradiance, light, tables, lookups, resolutions, half_width,
    direct, bounced_bias, bounced, albedo, facing, mirrors, bounces, alpha2, least_cosine,
):  # fmt: skip
    count = len(position)
    radiance = np.empty((count, 3), np.float32)
    one, zero = np.float32(1.0), np.float32(0.0)
    direct_in = np.zeros((direct[0].shape[1], BLOCK), np.float32)
    bounced_in = np.zeros((bounced[0].shape[1], BLOCK), np.float32)
    albedo_in = np.zeros((albedo[0].shape[1], BLOCK), np.float32)
    sine2 = np.empty(BLOCK, np.float32)
    first = np.empty((direct[0].shape[0], BLOCK), np.float32)
    second = np.empty((direct[2].shape[0], BLOCK), np.float32)
    direct_out = np.empty((6, BLOCK), np.float32)
    bounced_out = np.empty((3, BLOCK), np.float32)
    albedo_out = np.empty((3, BLOCK), np.float32)
    facing_out = np.zeros((3, BLOCK), np.float32)
    features, coarse = albedo_in.shape[0] - 3, bounced_in.shape[0] - 19
    lx, ly, lz = np.float32(light[0]), np.float32(light[1]), np.float32(light[2])
    for start in range(0, count, BLOCK):
        row = np.int64(0)  # a literal would have `_interpolate` compiled twice
        for level in range(4):
            table, lookup, resolution = tables[level], lookups[level], resolutions[level]
            for s in range(BLOCK):
                i = min(start + s, count - 1)
                _interpolate(table, lookup, resolution, half_width,
                             position[i, 0], position[i, 1], position[i, 2], direct_in, row, s)  # fmt: skip
            row += table.shape[1]
        for row in range(features):
            for s in range(BLOCK):
                albedo_in[row, s] = direct_in[row, s]
        for row in range(coarse):
            for s in range(BLOCK):
                bounced_in[row, s] = direct_in[row, s]
        a, b = features, coarse
        for s in range(BLOCK):
            i = min(start + s, count - 1)
            x, y, z = np.float32(position[i, 0]), np.float32(position[i, 1]), np.float32(position[i, 2])
            nx, ny, nz = np.float32(normal[i, 0]), np.float32(normal[i, 1]), np.float32(normal[i, 2])
            cx, cy, cz = (
                np.float32(to_camera[i, 0]), np.float32(to_camera[i, 1]), np.float32(to_camera[i, 2])
            )  # fmt: skip
            tx, ty, tz = lx - x, ly - y, lz - z
            distance = math.sqrt(tx * tx + ty * ty + tz * tz)
            scale = one / max(distance, np.float32(1e-9))
            tx, ty, tz = tx * scale, ty * scale, tz * scale
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
            direct_in[a, s], direct_in[a + 1, s], direct_in[a + 2, s] = nx, ny, nz
            direct_in[a + 3, s], direct_in[a + 4, s] = at_light, at_light * at_light
            direct_in[a + 5, s], direct_in[a + 6, s] = at_camera, rim * rim * rim
            direct_in[a + 7, s], direct_in[a + 8, s] = fresnel2 * fresnel2 * fresnel, grazing
            direct_in[a + 9, s], direct_in[a + 10, s] = middle4, middle16 * middle16
            direct_in[a + 11, s] = middle
            # Of normal and half vector: of a cosine near 1 rounding leaves no sine.
            qx, qy, qz = ny * hz - nz * hy, nz * hx - nx * hz, nx * hy - ny * hx
            sine2[s] = qx * qx + qy * qy + qz * qz if middle > zero else one
            albedo_in[a, s], albedo_in[a + 1, s], albedo_in[a + 2, s] = nx, ny, nz
            mx, my, mz = (
                2 * at_camera * nx - cx, 2 * at_camera * ny - cy, 2 * at_camera * nz - cz
            )  # fmt: skip
            distance = max(distance, np.float32(NEAREST))
            near = min(distance, np.float32(4.0))
            bounced_in[b, s], bounced_in[b + 1, s], bounced_in[b + 2, s] = x, y, z
            bounced_in[b + 3, s], bounced_in[b + 4, s], bounced_in[b + 5, s] = nx, ny, nz
            bounced_in[b + 6, s], bounced_in[b + 7, s], bounced_in[b + 8, s] = cx, cy, cz
            bounced_in[b + 9, s], bounced_in[b + 10, s], bounced_in[b + 11, s] = tx, ty, tz
            bounced_in[b + 12, s], bounced_in[b + 13, s] = at_light, max(at_light, zero)
            bounced_in[b + 14, s], bounced_in[b + 15, s] = at_camera, mx * tx + my * ty + mz * tz
            bounced_in[b + 16, s] = distance
            bounced_in[b + 17, s] = one / (near * near * 4)
            bounced_in[b + 18, s] = math.log(max(np.float32(irradiance[i]), np.float32(1e-3)))
        _hidden(direct[0], direct[1], direct_in, first)
        _hidden(direct[2], direct[3], first, second)
        _product(direct[4], second, direct_out)
        if bounces:
            _hidden(bounced[0], bounced_bias, bounced_in, first)
            _hidden(bounced[1], bounced[2], first, second)
            _product(bounced[3], second, bounced_out)
        _product(albedo[0], albedo_in, albedo_out)
        if mirrors:
            _product(facing[0], albedo_in, facing_out)
        for s in range(BLOCK):
            i = min(start + s, count - 1)
            at_light = max(direct_in[a + 3, s], least_cosine)
            at_camera = max(direct_in[a + 5, s], least_cosine)
            middle = direct_in[a + 11, s]
            width = alpha2 * middle * middle + sine2[s]
            masked = at_light * math.sqrt(at_camera * at_camera * (one - alpha2) + alpha2)
            shadowed = at_camera * math.sqrt(at_light * at_light * (one - alpha2) + alpha2)
            lobe = alpha2 / (2 * width * width * (masked + shadowed))
            arriving = np.float32(irradiance[i])
            for channel in range(3):
                base = _sigmoid(albedo_out[channel, s] + albedo[1][channel])
                diffuse = 2 * base * _sigmoid(direct_out[channel, s] + direct[5][channel])
                strength = direct_out[channel + 3, s] + direct[5][channel + 3]
                if mirrors:
                    share = _schlick(facing_out[channel, s] + facing[1][channel], direct_in[a + 7, s])
                    gloss = share * 2 * _sigmoid(strength) * lobe
                else:
                    gloss = _softplus(strength) * lobe
                radiance[i, channel] = arriving * (diffuse + gloss)
                if bounces:
                    radiance[i, channel] += base * _softplus(bounced_out[channel, s] + bounced[4][channel])
    return radiance


@relaxed_kernel
def _fresnel(position, rim, tables, lookups, resolutions, half_width, weight, bias):
    """Return (n, 3) the shares that mirrors at (n, 3) reflect: `reflectance.Reflectance.fresnel`."""
    share = np.empty((len(position), 3), np.float32)
    features = np.zeros((weight.shape[1], 1), np.float32)
    for i in range(len(position)):
        row = np.int64(0)  # a literal would have `_interpolate` compiled twice
        for level in range(4):
            table, lookup, resolution = tables[level], lookups[level], resolutions[level]
            _interpolate(table, lookup, resolution, half_width,
                         position[i, 0], position[i, 1], position[i, 2], features, row, 0)  # fmt: skip
            row += table.shape[1]
        for channel in range(3):
            total = bias[channel]
            for f in range(row):
                total += weight[channel, f] * features[f, 0]
            share[i, channel] = _schlick(total, rim[i])
    return share
