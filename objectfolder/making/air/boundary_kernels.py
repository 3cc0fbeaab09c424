"""Kernels of the boundary element method: integrals over flat triangles and what is made of them.

The static integrals are those of Wilton et al., IEEE Trans. Antennas Propag. 32, 1984, and Graglia, 41, 1993.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from objectfolder.jit import kernel, relaxed_kernel

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
FOUR_PI = 4 * math.pi
IN_PLANE = 1e-9  # edges from a triangle's plane below which a point is in it
MATRIX_TILE = 32  # rows and columns of a tile of a matrix


@kernel
def dot(first: Floats, second: Floats) -> float:
    """Scalar product of (3,)."""
    return float(first[0] * second[0] + first[1] * second[1] + first[2] * second[2])


@kernel
def static_potentials(
    x: Floats, corners: Floats, normal: Floats, gradients: Floats, single: Floats, double: Floats
) -> float:
    """Integrals over a triangle of 1 / r, returned, and of psi_b / r and psi_b d(1 / r) / dn, written.

    Parameters
    ----------
    x
        (3,) where they are felt.
    corners, normal, gradients
        (3, 3) of the triangle, (3,), and (3, 3) of its hat functions psi_b.
    """
    n0, n1, n2 = normal[0], normal[1], normal[2]
    height = (x[0] - corners[0, 0]) * n0 + (x[1] - corners[0, 1]) * n1 + (x[2] - corners[0, 2]) * n2
    whole, angle, length = 0.0, 0.0, 0.0
    first0, first1, first2, third0, third1, third2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for edge in range(3):
        stop = (edge + 1) % 3
        s0 = corners[stop, 0] - corners[edge, 0]
        s1 = corners[stop, 1] - corners[edge, 1]
        s2 = corners[stop, 2] - corners[edge, 2]
        length = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
        s0, s1, s2 = s0 / length, s1 / length, s2 / length
        o0, o1, o2 = s1 * n2 - s2 * n1, s2 * n0 - s0 * n2, s0 * n1 - s1 * n0
        a0, a1, a2 = corners[edge, 0] - x[0], corners[edge, 1] - x[1], corners[edge, 2] - x[2]
        outward = a0 * o0 + a1 * o1 + a2 * o2
        low = a0 * s0 + a1 * s1 + a2 * s2
        high = low + length
        square = outward * outward + height * height
        r_low, r_high = math.sqrt(square + low * low), math.sqrt(square + high * high)
        # Of two equal forms the one that does not cancel.
        if low + high >= 0:
            logarithm = math.log((r_high + high) / (r_low + low))
        else:
            logarithm = math.log((r_low - low) / (r_high - high))
        turn = math.atan2(outward * high, square + abs(height) * r_high) - math.atan2(
            outward * low, square + abs(height) * r_low
        )
        whole += outward * logarithm - abs(height) * turn
        angle += turn
        moment = 0.5 * (square * logarithm + high * r_high - low * r_low)
        first0, first1, first2 = first0 + o0 * moment, first1 + o1 * moment, first2 + o2 * moment
        third0, third1, third2 = third0 - o0 * logarithm, third1 - o1 * logarithm, third2 - o2 * logarithm
    solid_angle = math.copysign(angle, height) if abs(height) > IN_PLANE * length else 0.0
    for b in range(3):
        g0, g1, g2 = gradients[b, 0], gradients[b, 1], gradients[b, 2]
        value = 1.0 + (
            g0 * (x[0] - corners[b, 0]) + g1 * (x[1] - corners[b, 1]) + g2 * (x[2] - corners[b, 2])
        )
        single[b] = value * whole + g0 * first0 + g1 * first1 + g2 * first2
        double[b] = value * solid_angle + height * (g0 * third0 + g1 * third1 + g2 * third2)
    return whole


class Triangles(NamedTuple):
    """Corners (t, 3), areas (t,), unit normals (t, 3) and gradients (t, 3, 3) of the hat functions."""

    corners: Integers
    areas: Floats
    normals: Floats
    gradients: Floats


@kernel
def add_static_pairs(
    pairs: Integers,
    vertices: Floats,
    surface: Triangles,
    close: NDArray[np.bool_],
    rules: tuple[tuple[Floats, Floats], tuple[Floats, Floats]],
    slots: NDArray[np.int32],
    velocity: Floats,
    sums: tuple[Floats, Floats],
) -> None:
    """Add the static Galerkin integrals of pairs of triangles to near entries.

    Parameters
    ----------
    pairs
        (p, 2) triangles: where it is felt, and the source.
    close
        (p,) pairs that want the finer rule of the outer integral.
    rules
        The fine and the coarse one: points and weights.
    slots
        (n, n) number of a near entry, -1 for a far one.
    velocity
        (t, 3, m) normal velocities at the corners of triangles.
    sums
        Added to: operators (entries, 3), of K, of the curls' and of the normals' single layer; and loads
        (2, n, m), of the single layer S and of K' applied to the velocities.
    """
    triangles, areas, normals, gradients = surface
    (fine, coarse), (operators, loads) = rules, sums
    single, double = np.zeros(3), np.zeros(3)
    k_block, s_block = np.zeros((3, 3)), np.zeros((3, 3))
    corners, x = np.zeros((3, 3)), np.zeros(3)
    modes = velocity.shape[2]
    for pair in range(len(pairs)):
        felt, source = pairs[pair]
        for b in range(3):
            for axis in range(3):
                corners[b, axis] = vertices[triangles[source, b], axis]
        points, weights = fine if close[pair] else coarse
        k_block[:] = 0.0
        s_block[:] = 0.0
        whole = 0.0
        for q in range(len(weights)):
            for axis in range(3):
                x[axis] = 0.0
                for a in range(3):
                    x[axis] += points[q, a] * vertices[triangles[felt, a], axis]
            weight = weights[q] * areas[felt] / FOUR_PI
            whole += weight * static_potentials(
                x, corners, normals[source], gradients[source], single, double
            )
            for a in range(3):
                for b in range(3):
                    k_block[a, b] += weight * points[q, a] * double[b]
                    s_block[a, b] += weight * points[q, a] * single[b]
        facing = dot(normals[felt], normals[source])
        for a in range(3):
            i = triangles[felt, a]
            for b in range(3):
                j = triangles[source, b]
                slot = slots[i, j]
                if slot < 0:
                    continue
                # n x grad psi_a . n' x grad psi_b
                curls = facing * dot(gradients[felt, a], gradients[source, b])
                curls -= dot(normals[felt], gradients[source, b]) * dot(gradients[felt, a], normals[source])
                operators[slot, 0] += k_block[a, b]
                operators[slot, 1] += whole * curls
                operators[slot, 2] += facing * s_block[a, b]
                for m in range(modes):
                    loads[0, i, m] += s_block[a, b] * velocity[source, b, m]
                    loads[1, j, m] += k_block[a, b] * velocity[felt, a, m]


@relaxed_kernel
def fill_far(
    wavenumber: float,
    patches: tuple[Floats, Floats, Floats, Floats, Floats],
    flows: tuple[Floats, Floats],
    slots: NDArray[np.int32],
    double: NDArray[np.complex64],
    bending: NDArray[np.complex64],
    loads: Complexes,
) -> None:
    """Write far entries, near ones as zero, and add far sources to the loads: patches by their moments.

    Across the patch of a vertex a wave from far away is a plane one of wave vector q. The integral of its hat
    function is then as of a Gaussian of its second moments C, exp(-q . C q / 2), about its centre, and that
    of the hat function along the normals N + i D q in place of N. Two patches see each other by one wave.

    Parameters
    ----------
    patches
        See `objectfolder.making.air.helmholtz.Patches`.
    flows
        (n, m) and (n, 3, m) moments of order 0 and 1 of the velocities.
    slots
        (n, n), symmetric in what is near.
    double, bending
        (n, n) of K and W.
    loads
        (2, n, m) of S and K' applied to the velocities.
    """
    areas, centres, spreads, vectors, tilts = patches
    flow, uneven = flows
    count, modes = flow.shape
    # In tiles, for the entries across the diagonal to lie close to one another in memory.
    for tile_i in range(0, count, MATRIX_TILE):
        for tile_j in range(0, tile_i + 1, MATRIX_TILE):
            for i in range(tile_i, min(tile_i + MATRIX_TILE, count)):
                for j in range(tile_j, min(tile_j + MATRIX_TILE, i + 1)):
                    if slots[i, j] >= 0:
                        double[i, j] = double[j, i] = 0.0
                        bending[i, j] = bending[j, i] = 0.0
                        continue
                    e0 = centres[j, 0] - centres[i, 0]
                    e1 = centres[j, 1] - centres[i, 1]
                    e2 = centres[j, 2] - centres[i, 2]
                    inverse2 = 1.0 / (e0 * e0 + e1 * e1 + e2 * e2)
                    inverse = math.sqrt(inverse2)
                    phase = wavenumber / inverse
                    q0 = wavenumber * inverse * e0
                    q1 = wavenumber * inverse * e1
                    q2 = wavenumber * inverse * e2
                    faded = q0 * q0 * (spreads[i, 0] + spreads[j, 0])
                    faded += q1 * q1 * (spreads[i, 1] + spreads[j, 1])
                    faded += q2 * q2 * (spreads[i, 2] + spreads[j, 2])
                    faded += 2 * q0 * q1 * (spreads[i, 3] + spreads[j, 3])
                    faded += 2 * q0 * q2 * (spreads[i, 4] + spreads[j, 4])
                    faded += 2 * q1 * q2 * (spreads[i, 5] + spreads[j, 5])
                    g = complex(math.cos(phase), math.sin(phase)) * (
                        math.exp(-0.5 * faded) * inverse / FOUR_PI
                    )
                    slope = g * complex(-1.0, phase) * inverse2
                    bend = g * complex(3.0 - phase * phase, -3.0 * phase) * (inverse2 * inverse2)
                    n0 = complex(
                        vectors[i, 0], -(tilts[i, 0, 0] * q0 + tilts[i, 0, 1] * q1 + tilts[i, 0, 2] * q2)
                    )
                    n1 = complex(
                        vectors[i, 1], -(tilts[i, 1, 0] * q0 + tilts[i, 1, 1] * q1 + tilts[i, 1, 2] * q2)
                    )
                    n2 = complex(
                        vectors[i, 2], -(tilts[i, 2, 0] * q0 + tilts[i, 2, 1] * q1 + tilts[i, 2, 2] * q2)
                    )
                    s0 = complex(
                        vectors[j, 0], tilts[j, 0, 0] * q0 + tilts[j, 0, 1] * q1 + tilts[j, 0, 2] * q2
                    )
                    s1 = complex(
                        vectors[j, 1], tilts[j, 1, 0] * q0 + tilts[j, 1, 1] * q1 + tilts[j, 1, 2] * q2
                    )
                    s2 = complex(
                        vectors[j, 2], tilts[j, 2, 0] * q0 + tilts[j, 2, 1] * q1 + tilts[j, 2, 2] * q2
                    )
                    of_i = n0 * e0 + n1 * e1 + n2 * e2
                    of_j = s0 * e0 + s1 * e1 + s2 * e2
                    double[i, j] = slope * (areas[i] * of_j)
                    double[j, i] = -slope * (areas[j] * of_i)
                    bent = bend * (of_i * of_j) + slope * (n0 * s0 + n1 * s1 + n2 * s2)
                    bending[i, j] = bending[j, i] = bent
                    for m in range(modes):
                        turned = uneven[j, 0, m] * q0 + uneven[j, 1, m] * q1 + uneven[j, 2, m] * q2
                        source = complex(flow[j, m], turned)
                        loads[0, i, m] += areas[i] * g * source
                        loads[1, i, m] -= slope * of_i * source
                        turned = uneven[i, 0, m] * q0 + uneven[i, 1, m] * q1 + uneven[i, 2, m] * q2
                        source = complex(flow[i, m], -turned)
                        loads[0, j, m] += areas[j] * g * source
                        loads[1, j, m] += slope * of_j * source


@kernel
def weighted(values: Complexes, result: Complexes) -> None:
    """Write M values M, (3, 3), M the hat functions (1 + 3 I) / 6 at the points of a triangle's rule."""
    for a in range(3):
        row = (values[a, 0] + values[a, 1] + values[a, 2]) / 6
        for b in range(3):
            result[a, b] = row + values[a, b] / 2
    for b in range(3):
        column = (result[0, b] + result[1, b] + result[2, b]) / 6
        for a in range(3):
            result[a, b] = column + result[a, b] / 2


@relaxed_kernel
def add_waves(
    wavenumber: float,
    pairs: Integers,
    points: Floats,
    surface: Triangles,
    slots: NDArray[np.int32],
    velocity: Floats,
    operators: tuple[NDArray[np.complex64], NDArray[np.complex64]],
    loads: Complexes,
) -> None:
    """Add what the waves differ from static fields by, between pairs of triangles, to near entries.

    `pairs` (p, 2) have each two triangles once, a triangle and itself too. `points` (t, 3, 3) are those of
    the three-point rule in each triangle; for the rest see `add_static_pairs` and `fill_far`.
    """
    (triangles, areas, normals, gradients), (double, bending) = surface, operators
    waves, s_block = np.zeros((3, 3), dtype=np.complex128), np.zeros((3, 3), dtype=np.complex128)
    # Of the second triangle felt at the first, and of the first at the second, as [first, second] too.
    slopes, back = np.zeros((3, 3), dtype=np.complex128), np.zeros((3, 3), dtype=np.complex128)
    k_block, k_back = np.zeros((3, 3), dtype=np.complex128), np.zeros((3, 3), dtype=np.complex128)
    modes = velocity.shape[2]
    for pair in range(len(pairs)):
        first, second = pairs[pair]
        weight = areas[first] * areas[second] / (9 * FOUR_PI)
        for p in range(3):
            for q in range(3):
                e0 = points[second, q, 0] - points[first, p, 0]
                e1 = points[second, q, 1] - points[first, p, 1]
                e2 = points[second, q, 2] - points[first, p, 2]
                r = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
                phase = wavenumber * r
                if phase < 1e-3:
                    waves[p, q] = complex(-0.5 * wavenumber * phase, wavenumber) * weight
                    slope = complex(-0.5, -phase / 3.0) * (wavenumber**2 * weight / max(r, 1e-300))
                else:
                    wave = complex(math.cos(phase), math.sin(phase))
                    waves[p, q] = (wave - 1.0) * (weight / r)
                    slope = (wave * complex(-1.0, phase) + 1.0) * (weight / (r * r * r))
                slopes[p, q] = slope * (
                    normals[second, 0] * e0 + normals[second, 1] * e1 + normals[second, 2] * e2
                )
                back[p, q] = -slope * (
                    normals[first, 0] * e0 + normals[first, 1] * e1 + normals[first, 2] * e2
                )
        whole = waves.sum()
        weighted(slopes, k_block)
        weighted(back, k_back)
        weighted(waves, s_block)
        facing = dot(normals[first], normals[second])
        for a in range(3):
            i = triangles[first, a]
            for b in range(3):
                j = triangles[second, b]
                if slots[i, j] < 0:
                    continue
                curls = facing * dot(gradients[first, a], gradients[second, b])
                curls -= dot(normals[first], gradients[second, b]) * dot(gradients[first, a], normals[second])
                bent = curls * whole - wavenumber**2 * facing * s_block[a, b]
                double[i, j] += k_block[a, b]
                bending[i, j] += bent
                for m in range(modes):
                    loads[0, i, m] += s_block[a, b] * velocity[second, b, m]
                    loads[1, j, m] += k_block[a, b] * velocity[first, a, m]
                if first == second:
                    continue
                double[j, i] += k_back[a, b]
                bending[j, i] += bent
                for m in range(modes):
                    loads[0, j, m] += s_block[a, b] * velocity[first, a, m]
                    loads[1, i, m] += k_back[a, b] * velocity[second, b, m]
