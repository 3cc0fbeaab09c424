"""Values on a lattice of faces, looked up at points: `face_lattice.FaceLattice.interpolate`, compiled."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import arrayless, kernel
from objectfolder.vision.compositing import srgb_decode
from objectfolder.vision.network.face_lattice import FaceLattice
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.surface_maps import MAP_WHOLE


class LatticeLookup:
    """A lattice in arrays that kernels take.

    Parameters
    ----------
    lattice
        Of the faces that are asked.
    """

    def __init__(self, lattice: FaceLattice) -> None:
        self._places = *lattice.grids, lattice.owner.astype(np.int32)

    def interpolate(self, values: np.ndarray, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return (n, c) float64 of values (size, c) at barycentric coordinates (n, 3) of faces (n,)."""
        answer = np.empty((len(face), values.shape[1]))
        _interpolate(self._places, values, face, barycentric, answer)
        return answer


class LatticeMaterial:
    """What a surface is made of: `material.Material`, its maps looked up by kernels.

    Parameters
    ----------
    material
        With maps or without.
    """

    def __init__(self, material: Material) -> None:
        self._material = material
        self._lookups: dict[str, LatticeLookup] = {}

    def value(self, name: str, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return what `Material.value` does."""
        maps = self._material.maps
        if maps is None or name not in maps:
            return self._material.value(name, face, barycentric)
        if name not in self._lookups:
            self._lookups[name] = LatticeLookup(maps.lattice(name))
        values = self._lookups[name].interpolate(maps.levels[name], face, barycentric) / MAP_WHOLE[name]
        return srgb_decode(values) if name == "albedo" else values[:, 0]


def mix(values: np.ndarray, rows: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return (v, c) float64 sums of rows (v, k) of values (n, c) by their shares (v, k)."""
    answer = np.zeros((len(rows), values.shape[1]))
    _mix(values, rows, shares, answer)
    return answer


@arrayless(kernel)
def _interpolate(places, values, face, barycentric, answer):
    corners, columns, rows, start, owner = places
    for n in range(len(face)):
        f = face[n]
        x = min(max(barycentric[n, corners[f, 1]], 0.0), 1.0) * columns[f]
        y = min(max(barycentric[n, corners[f, 2]], 0.0), 1.0) * rows[f]
        i, j = min(int(x), columns[f] - 1), min(int(y), rows[f] - 1)
        right, down = x - i, y - j
        at = start[f] + j * (columns[f] + 1) + i
        a, b = owner[at], owner[at + 1]
        c, d = owner[at + columns[f] + 1], owner[at + columns[f] + 2]
        for channel in range(values.shape[1]):
            above = values[a, channel] * (1.0 - right) + values[b, channel] * right
            under = values[c, channel] * (1.0 - right) + values[d, channel] * right
            answer[n, channel] = above * (1.0 - down) + under * down


@arrayless(kernel)
def _mix(values, rows, shares, answer):
    for v in range(len(rows)):
        for k in range(rows.shape[1]):
            for channel in range(values.shape[1]):
                answer[v, channel] += shares[v, k] * values[rows[v, k], channel]
