"""Surfaces of revolution about z, and the profiles of shells with a wall."""

from dataclasses import dataclass

import numpy as np

from pipeline.intake.starter.shape import Shape, quads


@dataclass(frozen=True)
class Revolution:
    """A profile turned about z.

    Parameters
    ----------
    vertices
        (V, 3) metres.
    rings
        (rows, segments + 1) vertex indices; the last column repeats the first, a row on the axis is one
        vertex.
    coordinates
        (rows, segments + 1, 2): u around, v along the profile.
    """

    vertices: np.ndarray
    rings: np.ndarray
    coordinates: np.ndarray

    def surface(self, cells: np.ndarray | None = None) -> Shape:
        """Triangles of the surface, or of the cells (rows - 1, segments) bool of it."""
        part = quads(self.rings, self.coordinates, cells)
        return Shape(self.vertices, part.faces, part.texture_coordinates)


def revolve(profile: np.ndarray, segments: int, v_range: tuple[float, float] = (0.01, 0.99)) -> Revolution:
    """Turn a profile that starts and ends on the axis.

    Parameters
    ----------
    profile
        (P, 2) radius and height, metres, with the solid on its left.
    v_range
        Texture coordinate v at both ends; between them it grows with the length of the profile.
    """
    angles = 2 * np.pi * np.arange(segments) / segments
    rows: list[np.ndarray] = []
    vertices: list[np.ndarray] = []
    for radius, height in profile:
        start = sum(len(ring) for ring in vertices)
        if radius == 0:
            vertices.append(np.array([[0.0, 0.0, height]]))
            rows.append(np.full(segments + 1, start))
        else:
            circle = np.stack(
                [radius * np.cos(angles), radius * np.sin(angles), np.full(segments, height)], axis=1
            )
            vertices.append(circle)
            rows.append(start + np.arange(segments + 1) % segments)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    v = v_range[0] + (v_range[1] - v_range[0]) * length / length[-1]
    u = np.arange(segments + 1) / segments
    coordinates = np.stack(np.broadcast_arrays(u[None, :], v[:, None]), axis=-1)
    return Revolution(np.concatenate(vertices), np.array(rows), coordinates)


def shell_profile(outer: np.ndarray, wall_m: float, rim_points: int = 3) -> np.ndarray:
    """Profile of a shell open at the top: up the outside, over a round rim, down the inside.

    Parameters
    ----------
    outer
        (P, 2) radius and height from the axis, where it is level, to the rim, metres.
    wall_m
        Thickness, measured along the normal of the outside.
    """
    tangent = np.gradient(outer, axis=0)
    tangent[0] = [1, 0]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    inward = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    inner = outer + wall_m * inward
    inner[0, 0] = 0
    middle = (outer[-1] + inner[-1]) / 2
    turn = np.linspace(0, np.pi, rim_points + 2)[1:-1, None]
    rim = middle - wall_m / 2 * (np.cos(turn) * inward[-1] - np.sin(turn) * tangent[-1])
    return np.concatenate([outer, rim, inner[::-1]])


def resampled(points: np.ndarray, count: int) -> np.ndarray:
    """(count, 2) points at equal steps along a polyline."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    steps = np.linspace(0, length[-1], count)
    return np.stack([np.interp(steps, length, points[:, axis]) for axis in range(2)], axis=1)
