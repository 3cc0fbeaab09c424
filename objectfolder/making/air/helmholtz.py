"""Sound outside a vibrating surface: the exterior Helmholtz problem by boundary elements.

With G = exp(ikr) / 4 pi r and time exp(-i omega t), pressure p and its normal derivative q obey

    (1/2 - K) p + S q = 0,    W p + (K' + 1/2) q = 0,

and each alone fails where the inside resonates. Their sum with weight i / k does not (Burton and Miller,
Proc. R. Soc. A 323, 1971), and the second keeps the two sides of a thin wall apart. Both are tested by the
continuous piecewise linear functions in which p is sought (Galerkin), and W is (Maue, 1949)

    <psi, W p> = int int G (curl psi . curl p - k^2 psi p n . n').

Near one another the static part of G is integrated in closed form, what the wave adds by points of each
triangle; far away the moments of the hat function of a vertex stand for it, which is what a wave sees of it
there.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import lu_factor, lu_solve
from scipy.spatial import cKDTree

from objectfolder.audio.air.multipoles import harmonics, of_surface, regular_waves
from objectfolder.making.air.boundary_kernels import Triangles, add_static_pairs, add_waves, fill_far
from objectfolder.making.device import CPU, device_kind, torch_device
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


Complexes = NDArray[np.complex128]
Singles = NDArray[np.complex64]
Integers = NDArray[np.int64]
# Edges within which static fields are integrated over triangles, and within which the waves are.
NEAR_EDGES, NEAR_WAVES = 4.0, 3.0
CLOSE = 1.5  # edges between centres of triangles below which the outer integral has the finer rule
QUADRATURE = (np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6, np.full(3, 1 / 3))


@dataclass(frozen=True)
class Elements:
    """A closed surface of triangles as boundary elements, with normal velocities on it.

    Attributes
    ----------
    surface : metres, outward
    velocity : (t, 3, m) outward normal velocity of m motions at the corners of each triangle
    centre_m, highest_order : of multipoles
    """

    surface: Surface
    velocity: Floats
    centre_m: Floats
    highest_order: int

    def solve(self, wavenumber: float, motions: NDArray[Any] | slice) -> Singles:
        """Pressures at vertices.

        Parameters
        ----------
        wavenumber
            Of the air, radians a metre, positive.
        motions
            Which of the m are asked: k of them.

        Returns
        -------
        pressures : ndarray
            (n, k) complex64, for a normal derivative of the pressure equal to the normal velocity: times
            i omega rho it is the pressure.
        """
        velocity = np.ascontiguousarray(self.velocity[:, :, motions])
        double, bending, loads = self._waves(wavenumber, velocity)
        rows, columns = self._near[1:]
        static, static_loads = self._static
        double[rows, columns] += static[:, 0]
        bending[rows, columns] += static[:, 1] - wavenumber**2 * static[:, 2]
        loads += static_loads[:, :, motions]
        loads[1] += self.gathered(self._massed(velocity)) / 2
        coupling, faces = 1j / wavenumber, self.surface.faces
        matrix = np.complex64(coupling) * bending - double
        for a, hat in enumerate(np.eye(3)):
            share = self._massed(np.broadcast_to(hat[:, None], (len(faces), 3, 1)))[:, :, 0] / 2
            np.add.at(matrix, (faces, faces[:, [a]]), share)
        return _solve_dense(matrix, (-loads[0] - coupling * loads[1]).astype(np.complex64))

    def _waves(self, wavenumber: float, velocity: Floats) -> tuple[Singles, Singles, Complexes]:
        """K and W (n, n), static near entries left out, and likewise S and K' of velocities (2, n, k)."""
        inner, count = self._inner, len(self.surface.vertices)
        double, bending = (np.empty((count, count), dtype=np.complex64) for _ in range(2))
        loads = np.zeros((2, count, velocity.shape[2]), dtype=np.complex128)
        fill_far(
            wavenumber, self._patches.arrays, self._patches.flows(velocity), inner, double, bending, loads
        )
        add_waves(
            wavenumber,
            self._inner_pairs,
            self._points,
            self._triangles,
            inner,
            velocity,
            (double, bending),
            loads,
        )
        return double, bending, loads

    def multipoles(
        self, order: int, wavenumber: float, pressures: Singles, motions: NDArray[Any] | slice
    ) -> Complexes:
        """Outgoing multipoles (multipoles, k) about `centre_m` of what `solve` returned."""
        surface, hats = self.surface, QUADRATURE[0]

        def at_points(corners: NDArray[Any]) -> NDArray[Any]:
            return np.einsum("qa,tak->tqk", hats, corners).reshape(3 * len(corners), -1)

        areas = np.repeat(surface.face_areas / 3, 3)[:, None]
        distance = np.linalg.norm(self._points.reshape(-1, 3) - self.centre_m, axis=1)
        return of_surface(
            regular_waves(order + 1, wavenumber * distance, self._angular),
            wavenumber,
            areas * np.repeat(surface.face_normals, 3, axis=0),
            at_points(pressures[surface.faces]),
            areas * at_points(self.velocity[:, :, motions]),
        )

    @cached_property
    def _points(self) -> Floats:
        """Points (t, 3, 3) of the rule in each triangle."""
        return np.einsum("qa,tak->tqk", QUADRATURE[0], self.surface.vertices[self.surface.faces])

    @cached_property
    def _angular(self) -> Singles:
        """Spherical harmonics there (multipoles, 3 t), as far as any wavenumber needs them."""
        return harmonics(self.highest_order + 1, self._points.reshape(-1, 3) - self.centre_m).astype(
            np.complex64
        )

    def gathered(self, values: Floats) -> Floats:
        """Sums (n, ...) at vertices of values (t, 3, ...) at corners."""
        total = np.zeros((len(self.surface.vertices), *values.shape[2:]))
        np.add.at(total, self.surface.faces, values)
        return total

    @cached_property
    def edge_m(self) -> float:
        """Root mean square edge."""
        corners = self.surface.vertices[self.surface.faces]
        return float(np.sqrt((np.diff(corners, axis=1, append=corners[:, :1]) ** 2).sum(axis=2).mean()))

    def _massed(self, values: Floats) -> Floats:
        """Integrals (t, 3, m) against the hat functions of linear functions (t, 3, m) of each triangle."""
        total = values + values.sum(axis=1, keepdims=True)
        return np.asarray(total * (self.surface.face_areas / 12)[:, None, None])

    @cached_property
    def _areas(self) -> Floats:
        return self.gathered(np.repeat(self.surface.face_areas[:, None] / 3, 3, axis=1))

    @cached_property
    def _patches(self) -> Patches:
        return Patches(self.surface)

    @cached_property
    def _gradients(self) -> Floats:
        """Gradients (t, 3, 3) of the hat functions of each triangle."""
        corners = self.surface.vertices[self.surface.faces]
        across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        turned = np.cross(self.surface.face_normals[:, None], across)
        return np.asarray(turned / (2 * self.surface.face_areas[:, None, None]))

    @cached_property
    def _near(self) -> tuple[NDArray[np.int32], Integers, Integers]:
        """Numbers (n, n) of entries that are integrated, -1 for others; their rows and columns."""
        return self._entries(NEAR_EDGES)

    @cached_property
    def _inner(self) -> NDArray[np.int32]:
        """Likewise, of those where the waves are."""
        return self._entries(NEAR_WAVES)[0]

    @cached_property
    def _triangles(self) -> Triangles:
        surface = self.surface
        return Triangles(surface.faces, surface.face_areas, surface.face_normals, self._gradients)

    @cached_property
    def _inner_pairs(self) -> Integers:
        """Pairs of triangles, each two once, where the waves are."""
        pairs = self._pairs(self._inner)
        return pairs[pairs[:, 0] <= pairs[:, 1]]

    def _entries(self, reach: float) -> tuple[NDArray[np.int32], Integers, Integers]:
        vertices, faces = self.surface.vertices, self.surface.faces
        close = cKDTree(vertices).query_pairs(reach * self.edge_m, output_type="ndarray")
        near = np.eye(len(vertices), dtype=bool)
        near[close[:, 0], close[:, 1]] = near[close[:, 1], close[:, 0]] = True
        near[faces[:, :, None], faces[:, None]] = True
        slots = np.full(near.shape, -1, dtype=np.int32)
        rows, columns = np.nonzero(near)
        slots[rows, columns] = np.arange(len(rows))
        return slots, rows, columns

    def _pairs(self, slots: NDArray[np.int32]) -> Integers:
        """Pairs of triangles (p, 2) that have a part in near entries."""
        faces = self.surface.faces
        ones, triangle = np.ones(faces.size), np.repeat(np.arange(len(faces)), 3)
        of_vertices = sparse.csr_matrix((ones, (triangle, faces.reshape(-1))), (len(faces), len(slots)))
        pairs = (of_vertices @ sparse.csr_matrix(slots >= 0, dtype=float) @ of_vertices.T).tocoo()
        return np.stack([pairs.row, pairs.col], axis=1).astype(np.int64)

    @cached_property
    def _static(self) -> tuple[Floats, Floats]:
        """Static integrals (entries, 3) and (2, n, m), see `add_static_pairs`."""
        slots, rows, _ = self._near
        surface, count = self.surface, len(self.surface.vertices)
        pairs = self._pairs(slots)
        centres = surface.vertices[surface.faces].mean(axis=1)
        close = np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1) < CLOSE * self.edge_m
        operators = np.zeros((len(rows), 3))
        loads = np.zeros((2, count, self.velocity.shape[2]))
        add_static_pairs(
            pairs,
            surface.vertices,
            self._triangles,
            close,
            (_twelve(), QUADRATURE),
            slots,
            self.velocity,
            (operators, loads),
        )
        return self._closed(operators, loads)

    def _closed(self, operators: Floats, loads: Floats) -> tuple[Floats, Floats]:
        """Static integrals less what far entries have of them, and with the sums of a closed surface.

        Of a constant K makes -1/2 and W nothing, whatever far entries are short of: so errors of W are of
        differences of pressures alone.
        """
        slots, rows, columns = self._near
        count, inner = len(self.surface.vertices), self._inner
        double, bending = (np.empty((count, count), dtype=np.complex64) for _ in range(2))
        patches, flows = self._patches.arrays, self._patches.flows(self.velocity)
        # The loads of far entries within the reach of the static integrals: all of them less those beyond.
        all_far, beyond = (np.zeros(loads.shape, dtype=np.complex128) for _ in range(2))
        fill_far(0.0, patches, flows, slots, double, bending, beyond)
        fill_far(0.0, patches, flows, inner, double, bending, all_far)
        ring = inner[rows, columns] < 0
        diagonal = slots[np.arange(count), np.arange(count)]
        for place, far, row_sum in ((0, double.real, -self._areas / 2), (1, bending.real, 0.0)):
            operators[ring, place] -= far[rows[ring], columns[ring]]
            total = far.sum(axis=1, dtype=np.float64) + np.bincount(rows, operators[:, place], count)
            operators[diagonal, place] += row_sum - total
        operators[ring, 2] = 0.0
        return operators, loads - (all_far - beyond).real


def _twelve() -> tuple[Floats, Floats]:
    """Twelve points of degree 6 (Dunavant, Int. J. Numer. Meth. Eng. 21, 1985), and their weights."""
    rows: list[tuple[float, ...]] = []
    for a, b, weight in (
        (0.501426509658179, 0.249286745170910, 0.116786275726379),
        (0.873821971016996, 0.063089014491502, 0.050844906370207),
    ):
        rows += [(a, b, b, weight), (b, a, b, weight), (b, b, a, weight)]
    inner = 0.053145049844817, 0.310352451033784, 0.636502499121399
    rows += [(*order, 0.082851075618374) for order in permutations(inner)]
    table = np.array(rows)
    return table[:, :3].copy(), table[:, 3].copy()


def _solve_dense(matrix: Singles, right: Singles) -> Singles:
    """Solve by LU decomposition where `objectfolder.making.device` says; `matrix` is overwritten."""
    if device_kind() == CPU:
        return np.asarray(lu_solve(lu_factor(matrix, overwrite_a=True), right))
    device = torch_device()
    import torch

    parts = (torch.from_numpy(part).to(device) for part in (matrix, right))
    return np.asarray(torch.linalg.solve(*parts).cpu().numpy())
