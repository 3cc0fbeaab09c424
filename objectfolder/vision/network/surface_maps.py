"""What a stored surface has at each of its points besides the learned: bent normals, holes, reflectance maps.

Each is a lattice of bytes on the faces, present only where the source has such a map.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.stored_values import number
from objectfolder.products.tensor_file import REMEDY
from objectfolder.surface.surface import Surface
from objectfolder.vision.network.face_lattice import FaceLattice, pack_levels, unpack_levels

CHANNELS = {"normal": 2, "alpha": 1, "roughness": 1, "metallic": 1}
FINEST_PITCH = 1 / 1024
UPRIGHT, STEEPEST = 127, 127
"""Level of a normal that is not bent, and levels from it to one that lies in the surface."""


@dataclass(frozen=True)
class SurfaceMaps:
    """Maps on (F, 3, 3) triangles of the unit frame.

    Parameters
    ----------
    surface
        Of these triangles, in any frame that is scaled and shifted only.
    triangles
        Their corners, unit frame.
    pitches
        By name, of `CHANNELS`, the pitch of a map's lattice, unit-frame lengths.
    levels
        By name (size, channels) uint8: roughness, metallic and alpha 0..1 as 0..255; of a normal its parts
        along `tangent_frame`, -1..1 as 0..254.
    """

    surface: Surface
    triangles: np.ndarray
    pitches: Mapping[str, float]
    levels: Mapping[str, np.ndarray]

    @classmethod
    def from_tensors(
        cls,
        surface: Surface,
        triangles: np.ndarray,
        pitches: Mapping[str, Any],
        streams: Mapping[str, np.ndarray],
    ) -> "SurfaceMaps":
        """Read what `tensors` returned.

        Raises
        ------
        FormatError
            An unknown map, one without its stream or the reverse, a damaged stream, a pitch out of range.
        """
        if set(pitches) != set(streams) or not set(pitches) <= set(CHANNELS):
            raise FormatError("vision.maps", "other maps than are described", REMEDY)
        known = {name: number(f"vision.maps.{name}", pitches[name], FINEST_PITCH, 1.0) for name in pitches}
        levels = {}
        for name, pitch in known.items():
            size = FaceLattice(triangles, pitch).size
            try:
                levels[name] = unpack_levels(streams[name], size, CHANNELS[name])
            except ValueError as error:
                raise FormatError(f"vision.map.{name}", f"damaged ({error})", REMEDY) from error
        return cls(surface, triangles, known, levels)

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the maps as streams (n,) uint8 by name."""
        return {name: pack_levels(levels) for name, levels in self.levels.items()}

    @cached_property
    def _lattices(self) -> dict[float, FaceLattice]:
        return {pitch: FaceLattice(self.triangles, pitch) for pitch in set(self.pitches.values())}

    def lattice(self, name: str) -> FaceLattice:
        """Return the lattice of a map."""
        return self._lattices[self.pitches[name]]

    def __contains__(self, name: object) -> bool:
        """Whether there is a map of this name."""
        return name in self.levels

    def value(self, name: str, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return a map (n,) in 0..1 at barycentric coordinates (n, 3) of faces (n,)."""
        return self.lattice(name).interpolate(self.levels[name], face, barycentric)[:, 0] / 255

    def bent(self, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return unit shading normals (n, 3), outside, bent by the map of normals."""
        upright = self.surface.normals_at(face, barycentric)
        levels = self.lattice("normal").interpolate(self.levels["normal"], face, barycentric)
        aside = (levels - UPRIGHT) / STEEPEST
        rise = np.sqrt(np.maximum(1 - (aside**2).sum(axis=1, keepdims=True), 0.0))
        first, second = tangent_frame(self.surface, face, upright)
        bent = aside[:, :1] * first + aside[:, 1:] * second + rise * upright
        return np.asarray(bent / np.maximum(np.linalg.norm(bent, axis=1, keepdims=True), 1e-12))


def tangent_frame(surface: Surface, face: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (n, 3) across normals (n, 3): along the first edge of faces (n,), and beside.

    Both are 0 where that edge has no direction across the normal.
    """
    corners = surface.vertices[surface.faces[face, :2]]
    edge = corners[:, 1] - corners[:, 0]
    edge /= np.maximum(np.linalg.norm(edge, axis=1, keepdims=True), 1e-300)
    across = edge - np.einsum("ij,ij->i", edge, normal)[:, None] * normal
    length = np.linalg.norm(across, axis=1, keepdims=True)
    first = np.where(length > 1e-3, across / np.maximum(length, 1e-3), 0.0)
    return first, np.cross(normal, first)
