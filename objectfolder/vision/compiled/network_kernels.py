"""Kernels of the network: features, inputs and perceptrons over blocks of points; see `network.py`."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def, call-overload, operator, assignment"

import math

import numpy as np

from objectfolder.jit import arrayless, inner, relaxed_kernel

# Points at a time: a block's matrices stay in the first cache. Every block is whole, its last point repeated:
# the vector loop and the loop over the points after it would round alike points differently.
NETWORK_POINTS = 64
# The nearest that a light is told to be to a point, unit frame; as in `incidence`.
NEAREST = 1e-3


@inner(arrayless(relaxed_kernel))
def _interpolate(level, half_width, point, features, first, s):
    """Write the features of one level at a point to features[first:, s]: `SparseGrid.interpolation`.

    A level is its table, lookup and resolution.
    """
    (table, lookup, resolution), (x, y, z) = level, point
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


@inner(arrayless(relaxed_kernel))
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


@inner(arrayless(relaxed_kernel))
def _hidden(weight, bias, inputs, out):
    _product(weight, inputs, out)
    zero = np.float32(0.0)
    for row in range(out.shape[0]):
        shift = bias[row]
        for s in range(out.shape[1]):
            out[row, s] = max(out[row, s] + shift, zero)


@inner(arrayless(relaxed_kernel))
def _sigmoid(x):
    return np.float32(1.0) / (np.float32(1.0) + math.exp(-x))


@arrayless(relaxed_kernel)
def _softplus(x):
    return max(x, np.float32(0.0)) + math.log1p(math.exp(-abs(x)))


@inner(arrayless(relaxed_kernel))
def _schlick(facing, rim):
    share = _sigmoid(facing)
    return share + (np.float32(1.0) - share) * rim


@arrayless(relaxed_kernel)
def _features(position, normal, grid, albedo, working, features, base):
    """Write features (n, f) of points and their albedo (n, 3).

    `grid` are tables, lookups and resolutions of its levels, and half its width; `albedo` weights and biases.
    """
    (tables, lookups, resolutions, half_width), (weight, bias), (inputs, out) = grid, albedo, working
    count = len(position)
    for start in range(0, count, NETWORK_POINTS):
        row = np.int64(0)  # a literal would have `_interpolate` compiled twice
        for level in range(4):
            arrays = tables[level], lookups[level], resolutions[level]
            for s in range(NETWORK_POINTS):
                i = min(start + s, count - 1)
                point = position[i, 0], position[i, 1], position[i, 2]
                _interpolate(arrays, half_width, point, inputs, row, s)
            row += tables[level].shape[1]
        for s in range(NETWORK_POINTS):
            i = min(start + s, count - 1)
            for axis in range(3):
                inputs[row + axis, s] = normal[i, axis]
        _product(weight, inputs, out)
        for s in range(min(NETWORK_POINTS, count - start)):
            for term in range(row):
                features[start + s, term] = inputs[term, s]
            for channel in range(3):
                base[start + s, channel] = _sigmoid(out[channel, s] + bias[channel])


@inner(arrayless(relaxed_kernel))
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
def _reflected(lit, points, direct, facing, mirrors, lobe_width, reflected):
    """Write (m, 3) what is reflected evenly over the albedo, and in the highlight, of pairs (m,).

    Parameters
    ----------
    lit
        Point (m,) of each pair, and unit direction (m, 3) of its light.
    points
        Features and normals of the points, and directions of the rays that meet them.
    direct, facing
        Weights and biases of the layers.
    mirrors
        Whether the highlight is a mirror's.
    lobe_width
        Squared GGX width of the highlight, and the least cosine.
    """
    (row, to_light), (features, normal, direction) = lit, points
    (alpha2, least_cosine), (even, gloss) = lobe_width, reflected
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


@inner(arrayless(relaxed_kernel))
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
def _bounced(which, lamps_shifts, irradiance, points, bounced, answer):
    """Write (n, 3) bounced light over the albedo of points, each with one of the lamps (l, 3).

    With the lamps come (l, width) the first layer's biases with what the lamp's place adds to them; `points`
    are positions, features, normals and directions of the rays that meet them.
    """
    (lamps, shifts), (position, features, normal, direction) = lamps_shifts, points
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
