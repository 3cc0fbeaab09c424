"""Surfaces for tests of touch, made by code; metres."""

import numpy as np

from objectfolder.surface.surface import Surface

QUADS = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Eight vertices, twelve outward triangles."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
    faces = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
    return np.asarray(low) + corners * (np.asarray(high) - np.asarray(low)), faces


def joined(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + offset for (_, faces), offset in zip(parts, offsets, strict=True)]),
    )


def sphere(radius: float, subdivisions: int = 5) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    for _ in range(subdivisions):
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (len(vertices) + inverse.ravel()).reshape(3, -1)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c = faces.T
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def revolved(profile: np.ndarray, sides: int = 96) -> tuple[np.ndarray, np.ndarray]:
    """Turn a closed loop of (radius, height), counter-clockwise seen with the radius to the right."""
    angle = 2 * np.pi * np.arange(sides) / sides
    count = len(profile)
    vertices = np.stack(
        [
            profile[:, 0] * np.cos(angle)[:, None],
            profile[:, 0] * np.sin(angle)[:, None],
            np.broadcast_to(profile[:, 1], (sides, count)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    side, step = (part.ravel() for part in np.meshgrid(np.arange(sides), np.arange(count), indexing="ij"))
    a, b = side * count + step, side * count + (step + 1) % count
    c, d = (side + 1) % sides * count + step, (side + 1) % sides * count + (step + 1) % count
    return vertices, np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])


def torus(large: float = 0.03, small: float = 0.01, sides: int = 96) -> tuple[np.ndarray, np.ndarray]:
    angle = 2 * np.pi * np.arange(48) / 48
    return revolved(np.stack([large + small * np.cos(angle), small * np.sin(angle)], axis=1), sides)


def mug(radius: float = 0.045, height: float = 0.1, wall: float = 0.004) -> tuple[np.ndarray, np.ndarray]:
    """An open cup round z, its bottom at 0."""
    inner = radius - wall
    outside = [(1e-4, 0.0), (radius, 0.0), (radius, height / 2), (radius, height)]
    inside = [(inner, height), (inner, height / 2), (inner, wall), (1e-4, wall)]
    return revolved(np.array(outside + inside))


def bumpy(radius: float = 0.025, amplitude: float = 0.0006, subdivisions: int = 5) -> Surface:
    """A sphere with ripples a few millimetres long."""
    vertices, faces = sphere(1.0, subdivisions)
    ripple = np.sin(9 * vertices[:, 0]) * np.sin(11 * vertices[:, 1]) * np.sin(10 * vertices[:, 2] + 1)
    return Surface(vertices * (radius + amplitude * ripple)[:, None], faces)


def psnr_db(truth: np.ndarray, answer: np.ndarray, mask: np.ndarray | None = None) -> float:
    error = (truth.astype(np.float64) - answer) ** 2
    return float(10 * np.log10(255**2 / max(float((error if mask is None else error[mask]).mean()), 1e-6)))
