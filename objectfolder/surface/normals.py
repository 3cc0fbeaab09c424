"""Shading normals that keep creases: one rule for rendering, relighting and touch."""

import numpy as np

SMOOTH_BELOW_DEG = 30.0
SHARP_ABOVE_DEG = 50.0


def face_normals_and_areas(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (F, 3) and areas (F,) of triangles; a face without area has a zero normal."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    cross = np.cross(b - a, c - a)
    doubled = np.linalg.norm(cross, axis=1)
    normals = np.divide(cross, doubled[:, None], out=np.zeros_like(cross), where=doubled[:, None] > 0)
    return normals, doubled / 2


def corner_angles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Interior angles (F, 3) in radians at each corner; 0 where an edge has no length."""
    corners = vertices[faces]
    angles = np.zeros(faces.shape)
    for corner in range(3):
        u = corners[:, (corner + 1) % 3] - corners[:, corner]
        v = corners[:, (corner + 2) % 3] - corners[:, corner]
        angles[:, corner] = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
    return angles


def corner_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Smooth normals (F, 3, 3) at the corners of each face, unit length.

    A corner averages the faces around its vertex, weighted by their angle there and by how little
    they turn from the corner's own face: fully below 30 degrees, not at all above 50, smoothly
    between, so that a small displacement of a vertex never switches a crease on or off.
    """
    normals, _ = face_normals_and_areas(vertices, faces)
    angles = corner_angles(vertices, faces)
    vertex = faces.ravel()
    order = np.argsort(vertex, kind="stable")
    count = np.bincount(vertex, minlength=len(vertices))
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    # Every ordered pair of corners that share a vertex.
    partners = count[vertex]
    own = np.repeat(np.arange(len(vertex)), partners)
    rank = np.arange(len(own)) - np.repeat(np.cumsum(partners) - partners, partners)
    other = order[np.repeat(start[vertex], partners) + rank]
    cosine = np.einsum("ij,ij->i", normals[own // 3], normals[other // 3])
    low, high = np.cos(np.radians(SHARP_ABOVE_DEG)), np.cos(np.radians(SMOOTH_BELOW_DEG))
    ramp = np.clip((cosine - low) / (high - low), 0.0, 1.0)
    weight = angles.ravel()[other] * ramp * ramp * (3 - 2 * ramp)
    weighted = normals[other // 3] * weight[:, None]
    total = np.stack([np.bincount(own, weighted[:, axis], len(vertex)) for axis in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1)
    flat = length < 1e-12
    total[flat] = normals[np.flatnonzero(flat) // 3]
    length[flat] = np.maximum(np.linalg.norm(total[flat], axis=1), 1e-300)
    return (total / length[:, None]).reshape(len(faces), 3, 3)
