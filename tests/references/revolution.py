"""Closed triangle surfaces of bodies of revolution, as a scan would give them."""

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.surface import Surface
from tests.references.meridian import Meridian

Integers = NDArray[np.int64]
LEAST_SEGMENTS = 6


def surface_of_revolution(meridian: Meridian, edge_m: float, segments: int | None = None) -> Surface:
    """Triangles between rings of points of the true surface.

    Parameters
    ----------
    meridian
        Metres; its outline runs from the lower end on the axis to the upper.
    edge_m
        Longest edge along the outline, and about the edge around the axis.
    segments
        Points of every ring; by default as many as the edge asks for at its radius.

    Returns
    -------
    Surface
        Closed, outward.
    """
    outline = meridian.outline(edge_m)
    vertices = [np.array([[0.0, 0.0, outline[0, 1]]])]
    faces: list[Integers] = []
    below = np.zeros(1, dtype=np.int64)
    count = 1
    for ring, (radius, height) in enumerate(outline[1:-1]):
        around = segments or max(LEAST_SEGMENTS, int(np.ceil(2 * np.pi * radius / edge_m)))
        # Every other ring turned by half a step: triangles come out nearly regular.
        angle = (np.arange(around) + ring % 2 / 2) * (2 * np.pi / around)
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(around, height)], axis=1)
        above = count + np.arange(around)
        faces.append(_stitch(below, above, ring % 2 / 2))
        vertices.append(points)
        below, count = above, count + around
    vertices.append(np.array([[0.0, 0.0, outline[-1, 1]]]))
    faces.append(_stitch(below, np.array([count]), 0.0))
    return Surface(np.concatenate(vertices), np.concatenate(faces))


def _stitch(below: Integers, above: Integers, turned: float) -> Integers:
    """Triangles (f, 3) between two rings, the turn of which differs by half a step of one of them.

    `turned` is that of the upper ring; the lower one has the other.
    """
    if len(below) == 1 or len(above) == 1:
        ring, pole = (above, below[0]) if len(below) == 1 else (below, above[0])
        after = np.roll(ring, -1)
        first, second = (after, ring) if len(below) == 1 else (ring, after)
        return np.stack([np.full(len(ring), pole), first, second], axis=1)
    lower, upper = (
        (np.arange(len(below)) + 0.5 - turned) / len(below),
        (np.arange(len(above)) + turned) / len(above),
    )
    faces, i, j = [], 0, 0
    while i < len(below) or j < len(above):
        # Advance on the ring whose next edge has its middle first.
        next_lower = lower[i % len(below)] + i // len(below) + 0.5 / len(below) if i < len(below) else np.inf
        next_upper = upper[j % len(above)] + j // len(above) + 0.5 / len(above) if j < len(above) else np.inf
        b, a = below[i % len(below)], above[j % len(above)]
        if next_lower <= next_upper:
            faces.append((b, below[(i + 1) % len(below)], a))
            i += 1
        else:
            faces.append((b, above[(j + 1) % len(above)], a))
            j += 1
    return np.array(faces, dtype=np.int64)
