"""Closed bodies of revolution about z, made from half an outline."""

import numpy as np

from objectfolder.surface.surface import Surface

SECTORS = 64


def revolved(outline: list[tuple[float, float]], sectors: int = SECTORS) -> Surface:
    """A closed surface with outward faces.

    Parameters
    ----------
    outline
        (r, z) from the axis to the axis, r = 0 at both ends, with the inside on its left.
    """
    return Surface(*revolved_arrays(outline, sectors))


def revolved_arrays(
    outline: list[tuple[float, float]], sectors: int = SECTORS
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of `revolved`."""
    first, *rings, last = outline
    turn = 2 * np.pi * np.arange(sectors) / sectors
    vertices = [[0.0, 0.0, first[1]]]
    vertices += [[r * np.cos(t), r * np.sin(t), z] for r, z in rings for t in turn]
    vertices += [[0.0, 0.0, last[1]]]
    sector, beside = np.arange(sectors), (np.arange(sectors) + 1) % sectors
    faces = [np.stack([np.zeros_like(sector), 1 + beside, 1 + sector], axis=1)]
    for ring in range(len(rings) - 1):
        a, b = 1 + ring * sectors + sector, 1 + ring * sectors + beside
        faces += [np.stack([a, b, a + sectors], axis=1), np.stack([b, b + sectors, a + sectors], axis=1)]
    top = 1 + (len(rings) - 1) * sectors
    faces += [np.stack([np.full_like(sector, len(vertices) - 1), top + sector, top + beside], axis=1)]
    return np.array(vertices), np.concatenate(faces)


def can(radius: float = 0.05, height: float = 0.14) -> list[tuple[float, float]]:
    """A solid cylinder."""
    return [(0, 0), (radius, 0), (radius, height), (0, height)]


def bottle(radius: float = 0.03) -> list[tuple[float, float]]:
    """A solid bottle with a shoulder and a cap of 0.4 of its radius."""
    neck = 0.4 * radius
    return [
        (0, 0), (radius, 0), (radius, 4 * radius), (neck, 5 * radius), (neck, 6 * radius), (0, 6 * radius)
    ]  # fmt: skip


def cup(
    wall: float, radius: float = 0.04, height: float = 0.09, base: float | None = None
) -> list[tuple[float, float]]:
    """An open cup with a wall and a base of a thickness; a thick base makes it filled from below."""
    inner, floor = radius - wall, wall if base is None else base
    return [(0, 0), (radius, 0), (radius, height), (inner, height), (inner, floor), (0, floor)]


def ball(radius: float = 0.035, rings: int = 32) -> list[tuple[float, float]]:
    """A ball."""
    polar = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    outline = [(radius * np.cos(angle), radius * np.sin(angle)) for angle in polar]
    return [(0, -radius), *[(float(r), float(z)) for r, z in outline[1:-1]], (0, radius)]


def with_cavity(outer: Surface, inner: Surface) -> Surface:
    """One surface around another, whose faces are turned into the hollow."""
    return Surface(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)]),
    )


def raised(outline: list[tuple[float, float]], height: float) -> list[tuple[float, float]]:
    """The outline, higher."""
    return [(r, z + height) for r, z in outline]
