"""Directions drawn from the highlights of points, evenly spread over those of a pixel."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from dataclasses import dataclass

import numpy as np

from objectfolder.jit import arrayless, kernel

# Irrational steps of a sequence that fills the unit square evenly (Roberts 2018).
SEQUENCE_STEPS = (0.7548776662466927, 0.5698402909980532)


@dataclass(frozen=True)
class Cast:
    """Where points (n,) are in an image, int64: whatever is drawn for them follows from this.

    Parameters
    ----------
    columns, rows
        Pixels of the image.
    order, count
        Number of the point in its pixel, and how many there are.
    """

    columns: np.ndarray
    rows: np.ndarray
    order: np.ndarray
    count: np.ndarray

    def of(self, row: np.ndarray) -> "Cast":
        """Return some of the points."""
        return Cast(self.columns[row], self.rows[row], self.order[row], self.count[row])


def scattered(cast: Cast) -> tuple[np.ndarray, np.ndarray]:
    """Return two numbers (n,) of [0, 1) for points, evenly spread for those of one pixel."""
    bits = (cast.columns * 0x9E3779B1) ^ (cast.rows * 0x85EBCA77)
    for shift, factor in ((16, 0x21F0AAAD), (15, 0x735A2D97)):
        bits = ((bits ^ (bits >> shift)) & 0xFFFFFFFF) * factor & 0xFFFFFFFF
    bits ^= bits >> 15
    starts = (bits & 0xFFFF) / 65536, (bits >> 16) / 65536
    first, second = (
        (start + 64 * cast.order * step) % 1.0 for start, step in zip(starts, SEQUENCE_STEPS, strict=True)
    )
    return first, second


def stepped(starts: tuple[np.ndarray, np.ndarray], sample: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers (n,) of a point's direction `sample`, from those that `scattered` returned."""
    first, second = (
        (start + sample * step) % 1.0 for start, step in zip(starts, SEQUENCE_STEPS, strict=True)
    )
    return first, second


def lobe_directions(
    normal: np.ndarray, facet: np.ndarray, to_camera: np.ndarray, alpha2: np.ndarray, first: np.ndarray,
    second: np.ndarray, least_cosine: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Draw directions (n, 3) from GGX lobes, and their densities (n,) over solid angle, 0 below the surface.

    Half vectors are drawn as the camera sees them (Heitz 2018), of lobes of squared widths `alpha2` (n,), by
    two numbers (n,) of [0, 1) each.
    """
    answer = np.zeros(normal.shape), np.zeros(len(normal))
    _lobe_directions((normal, facet, to_camera), alpha2, (first, second), least_cosine, answer)
    return answer


@arrayless(kernel)
def _lobe_directions(points, alpha2, numbers, least_cosine, answer):
    """Write the answer of `lobe_directions`, which is 0 at first."""
    (normal, facet, to_camera), (first, second), (direction, density) = points, numbers, answer
    for i in range(len(normal)):
        square = alpha2[i]
        alpha = math.sqrt(square)
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        # Two axes across the normal (Duff et al. 2017).
        sign = 1.0 if nz >= 0 else -1.0
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        x0, x1, x2 = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
        y0, y1, y2 = b, sign + ny * ny * a, -ny
        cx, cy, cz = to_camera[i, 0], to_camera[i, 1], to_camera[i, 2]
        vx, vy = x0 * cx + x1 * cy + x2 * cz, y0 * cx + y1 * cy + y2 * cz
        vz = max(nx * cx + ny * cy + nz * cz, least_cosine)
        scale = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
        # The lobe stretched to a hemisphere, seen from the camera as a disc.
        sx, sy, sz = alpha * vx, alpha * vy, vz
        scale = 1.0 / math.sqrt(sx * sx + sy * sy + sz * sz)
        sx, sy, sz = sx * scale, sy * scale, sz * scale
        flat = math.sqrt(sx * sx + sy * sy)
        tx, ty = (-sy / flat, sx / flat) if flat > 1e-7 else (1.0, 0.0)
        radius, angle = math.sqrt(first[i]), 2 * math.pi * second[i]
        p, q = radius * math.cos(angle), radius * math.sin(angle)
        half = 0.5 * (1.0 + sz)
        q = (1.0 - half) * math.sqrt(max(1.0 - p * p, 0.0)) + half * q
        r = math.sqrt(max(1.0 - p * p - q * q, 0.0))
        hx, hy = alpha * (p * tx - q * sz * ty + r * sx), alpha * (p * ty + q * sz * tx + r * sy)
        hz = max(q * (sx * ty - sy * tx) + r * sz, 1e-6)
        scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx * scale, hy * scale, hz * scale
        along = 2.0 * (vx * hx + vy * hy + vz * hz)
        lx, ly, lz = along * hx - vx, along * hy - vy, along * hz - vz
        dx, dy, dz = x0 * lx + y0 * ly + nx * lz, x1 * lx + y1 * ly + ny * lz, x2 * lx + y2 * ly + nz * lz
        if lz <= 1e-4 or dx * facet[i, 0] + dy * facet[i, 1] + dz * facet[i, 2] <= 0:
            continue
        direction[i, 0], direction[i, 1], direction[i, 2] = dx, dy, dz
        width = square * hz * hz + hx * hx + hy * hy
        masking = vz + math.sqrt(square + (1.0 - square) * vz * vz)
        density[i] = square / (math.pi * width * width) / (2.0 * masking)
