"""Hat functions of a surface's vertices by their moments, which is what a wave far away sees of them."""

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
# Integrals over a triangle of area 1 of products of two and of three of its hat functions.
PAIRS = (1 + np.eye(3)) / 12
TRIPLES = np.array([[[1 / 60, 1 / 30, 1 / 10][3 - len({a, b, c})] for c in range(3)] for b in range(3)
                    for a in range(3)]).reshape(3, 3, 3)  # fmt: skip
SYMMETRIC = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)


class Patches:
    """Moments of the hat function psi of each vertex, and of velocities times it.

    Attributes
    ----------
    arrays
        Integrals (n,) of psi; its centres (n, 3); its second moments about them over the integral (n, 6), xx,
        yy, zz, xy, xz, yz; integrals N (n, 3) of psi times the normal, and D (n, 3, 3) of these times the
        offset from the centre.
    """

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        areas, normals = surface.face_areas, surface.face_normals
        corners = surface.vertices[surface.faces]
        # (t, 3, 3, 3): of each corner of a triangle to each.
        self._offsets = corners[:, None] - corners[:, :, None]
        whole = self._gathered(np.repeat(areas[:, None] / 3, 3, axis=1))
        first = np.einsum("t,ab,tabx->tax", areas, PAIRS, self._offsets, optimize=True)
        self._shift = self._gathered(first) / whole[:, None]
        offsets = self._offsets
        second = np.einsum("t,abc,tabx,tacy->taxy", areas, TRIPLES, offsets, offsets, optimize=True)
        spread = self._gathered(second) / whole[:, None, None]
        spread -= self._shift[:, :, None] * self._shift[:, None]
        vectors = self._gathered(np.repeat((areas[:, None] / 3 * normals)[:, None], 3, axis=1))
        tilts = self._gathered(normals[:, None, :, None] * first[:, :, None])
        tilts -= vectors[:, :, None] * self._shift[:, None]
        self.arrays = (
            whole,
            surface.vertices + self._shift,
            np.ascontiguousarray(spread[:, SYMMETRIC[0], SYMMETRIC[1]]),
            vectors,
            tilts,
        )

    def flows(self, velocity: Floats) -> tuple[Floats, Floats]:
        """Integrals (n, m) of psi times velocities (t, 3, m) at corners, and (n, 3, m) times the offset."""
        areas = self._surface.face_areas
        flow = self._gathered(np.einsum("t,ab,tbm->tam", areas, PAIRS, velocity, optimize=True))
        uneven = self._gathered(
            np.einsum("t,abc,tabx,tcm->taxm", areas, TRIPLES, self._offsets, velocity, optimize=True)
        )
        return flow, uneven - self._shift[:, :, None] * flow[:, None]

    def _gathered(self, values: Floats) -> Floats:
        """Sums (n, ...) at vertices of values (t, 3, ...) at corners."""
        total = np.zeros((len(self._surface.vertices), *values.shape[2:]))
        np.add.at(total, self._surface.faces, values)
        return total
