"""Walls of known thickness, made by code."""

import numpy as np

from objectfolder.surface.surface import Surface


def spherical_cap(
    radius: float, wall: float, angle: float = np.radians(75), rings: int = 24, sectors: int = 64
) -> Surface:
    """A bowl: the part of a hollow sphere, mid-surface of `radius`, up to a polar angle."""
    polar = np.linspace(0, angle, rings + 1)[1:]
    outer, inner = radius + wall / 2, radius - wall / 2
    rows = [(outer * np.sin(a), -outer * np.cos(a)) for a in polar]
    rows += [(inner * np.sin(a), -inner * np.cos(a)) for a in polar[::-1]]
    turn = np.arange(sectors) * 2 * np.pi / sectors
    vertices = [[0.0, 0.0, -outer]]
    vertices += [[r * np.cos(t), r * np.sin(t), z] for r, z in rows for t in turn]
    vertices += [[0.0, 0.0, -inner]]
    sector, beside = np.arange(sectors), (np.arange(sectors) + 1) % sectors
    faces = [np.stack([np.zeros_like(sector), 1 + beside, 1 + sector], axis=1)]
    for row in range(len(rows) - 1):
        a, b = 1 + row * sectors + sector, 1 + row * sectors + beside
        faces += [np.stack([a, b, a + sectors], axis=1), np.stack([b, b + sectors, a + sectors], axis=1)]
    last = 1 + (len(rows) - 1) * sectors
    faces += [np.stack([np.full_like(sector, len(vertices) - 1), last + sector, last + beside], axis=1)]
    return Surface(np.array(vertices), np.concatenate(faces))


def cap_volume(radius: float, wall: float, angle: float = np.radians(75)) -> float:
    """Volume of the piece of a hollow sphere, with its rim along a cone."""
    return 2 * np.pi / 3 * ((radius + wall / 2) ** 3 - (radius - wall / 2) ** 3) * (1 - np.cos(angle))
