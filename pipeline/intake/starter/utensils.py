"""A fork with four tines and a slotted spatula."""

import numpy as np
from scipy.interpolate import CubicSpline

from objectfolder.surface.textured_mesh import TexturedMesh
from pipeline.intake.starter.patterns import (
    between,
    flat,
    paint,
    smooth_noise,
    smooth_step,
    to_texture,
    unit_square,
)
from pipeline.intake.starter.slab import slab

_TINES = 4

_FORK_ARCH_MM = np.array(
    [[0, 8], [30, 5], [65, 2.5], [95, 5], [118, 7.5], [140, 3.5], [160, 1], [175, 2], [190, 7]]
)
"""Height of the fork's middle along its length."""


def fork() -> TexturedMesh:
    """Fork of 190 mm, 2.2 mm thick, with four tapered tines; brushed, chevrons on the handle."""
    length, root, stations = 0.190, 0.143, 95
    x = np.linspace(0, length, stations)
    root_station = int(np.searchsorted(x, root))
    handle = 0.0105 - 0.0070 * smooth_step((x - 0.02) / 0.075)
    handle -= 0.0055 * (1 - np.sqrt(np.clip(1 - (1 - np.clip(x / 0.010, 0, 1)) ** 2, 0, 1)))
    half_width = handle + 0.0095 * smooth_step((x - 0.108) / 0.030)

    tine = 0.15
    gap = (2 - 2 * _TINES * tine) / (_TINES - 1)
    centres = -1 + tine + (2 * tine + gap) * np.arange(_TINES)
    lines = np.sort(np.concatenate([centres - tine, centres, centres + tine]))
    taper = 1 - 0.55 * smooth_step((x - 0.155) / (length - 0.155))
    nearest = centres[np.abs(lines[:, None] - centres[None, :]).argmin(axis=1)]
    y = half_width[:, None] * (nearest + taper[:, None] * (lines - nearest))

    arch = CubicSpline(_FORK_ARCH_MM[:, 0], _FORK_ARCH_MM[:, 1])(1000 * x) / 1000
    middle = np.stack(
        [np.broadcast_to(x[:, None], y.shape), y, np.broadcast_to(arch[:, None], y.shape)], axis=-1
    )
    cells = np.ones((stations - 1, len(lines) - 1), dtype=bool)
    cells[root_station:, 2::3] = False
    thickness = np.broadcast_to((0.0022 - 0.0007 * smooth_step((x - 0.15) / 0.04))[:, None], y.shape)
    shape = slab(middle, _thinned_at_ends(thickness, cells, 0.65), cells)

    u, v = unit_square()
    image = flat((0.62, 0.63, 0.65)) + 0.22 * (smooth_noise(4, 128, 51, 2) - 0.5)[..., None]
    across = np.abs((v % 0.47) / 0.47 - 0.5)
    chevrons = (
        between((u * 40 + 6 * across) % 1, 0.0, 0.45, 0.05)
        * between(u, 0.04, 0.34)
        * between(across, -1, 0.16)
    )
    image = paint(image, (0.20, 0.21, 0.24), 0.85 * chevrons)
    image = paint(
        image, (0.30, 0.31, 0.34), between(u, 0.40, 0.41) + between(u, 0.42, 0.425) + between(u, 0.74, 0.745)
    )
    return shape.textured(to_texture(image))


def spatula() -> TexturedMesh:
    """Spatula of 300 mm with three slots, 7 mm thick at the handle and 4 mm at the blade; wood grain."""
    length, stations = 0.300, 91
    x = np.linspace(0, length, stations)
    blade = smooth_step((x - 0.185) / 0.045)
    half_width = 0.010 + 0.022 * blade - 0.006 * (1 - np.sqrt(1 - (1 - np.clip(x / 0.012, 0, 1)) ** 2))
    half_width -= 0.008 * smooth_step((x - 0.285) / 0.030)
    slot_lines = np.array([-0.58, -0.40, -0.09, 0.09, 0.40, 0.58])
    lines = np.sort(np.concatenate([[-1, -0.79, -0.245, 0.245, 0.79, 1], slot_lines]))
    y = half_width[:, None] * lines
    lift = 0.020 * smooth_step((0.22 - x) / 0.2)
    middle = np.stack(
        [np.broadcast_to(x[:, None], y.shape), y, np.broadcast_to(lift[:, None], y.shape)], axis=-1
    )
    cells = np.ones((stations - 1, len(lines) - 1), dtype=bool)
    first, last = np.searchsorted(x, [0.225, 0.280])
    for left in slot_lines[::2]:
        cells[first:last, int(np.searchsorted(lines, left))] = False
    thickness = np.broadcast_to((0.007 - 0.003 * blade)[:, None], y.shape)
    shape = slab(middle, _thinned_at_ends(thickness, cells, 0.6), cells)

    u, v = unit_square()
    bend = smooth_noise(3, 6, 61)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (18 * v + 5 * bend))
    image = flat((0.70, 0.50, 0.29))
    image = paint(image, (0.50, 0.32, 0.16), 0.75 * rings**3)
    image = image + 0.12 * (smooth_noise(6, 120, 62, 2) - 0.5)[..., None]
    image = paint(
        image,
        (0.22, 0.12, 0.07),
        between(u, 0.03, 0.08, 0.01) + between(u, 0.50, 0.515) + between(u, 0.53, 0.54),
    )
    return shape.textured(to_texture(image))


def _thinned_at_ends(thickness: np.ndarray, cells: np.ndarray, factor: float) -> np.ndarray:
    """Multiply the thickness by `factor` at the grid points where the material ends."""
    padded = np.pad(cells, 1)
    full = padded[:-1, :-1] & padded[1:, :-1] & padded[:-1, 1:] & padded[1:, 1:]
    return np.where(full, thickness, factor * thickness)
