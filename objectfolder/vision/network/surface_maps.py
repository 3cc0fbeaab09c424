"""What a stored surface has at each of its points besides the learned: bent normals, holes, reflectance.

Each is a lattice of bytes on the faces; albedo always, the others where the source has such a map.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.stored_values import number, whole_number
from objectfolder.products.tensor_file import REMEDY
from objectfolder.surface.surface import Surface
from objectfolder.vision.network.face_lattice import (
    MOST_PLACES,
    FaceLattice,
    facing,
    pack_levels,
    unpack_levels,
)

MAP_CHANNELS = {"normal": 2, "alpha": 1, "albedo": 3, "roughness": 1, "metallic": 1}
MAP_WHOLE = {"normal": 64, "alpha": 255, "albedo": 63, "roughness": 63, "metallic": 63}
"""Levels from 0 to 1: what 8 bits keep beyond these is below the error between the places."""
FINEST_PITCH = 1 / 1024
MOST_PITCHES = 3
"""Of a file: that of alpha, that of albedo, that of the others; a lattice of each takes time and memory."""
UPRIGHT = MAP_WHOLE["normal"]
"""Level of a normal that is not bent."""


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
        By name, of `MAP_CHANNELS`, the pitch of a map's lattice, unit-frame lengths.
    levels
        By name (size, channels) uint8: roughness, metallic, alpha, sRGB-encoded albedo 0..1 as 0 to
        `MAP_WHOLE`; of a normal its parts along `tangent_frame`, -1..1 as 0 to twice that.
    streams
        By name the packed levels, as `tensors` returns them, of maps that are packed already.
    """

    surface: Surface
    triangles: np.ndarray
    pitches: Mapping[str, float]
    levels: Mapping[str, np.ndarray]
    streams: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def from_tensors(
        cls,
        surface: Surface,
        triangles: np.ndarray,
        said: Mapping[str, Any],
        streams: Mapping[str, np.ndarray],
    ) -> "SurfaceMaps":
        """Read what `tensors` and `metadata` returned; whether values fit the faces shows at their first use.

        Raises
        ------
        FormatError
            An unknown map, one without its stream or the reverse, a damaged stream, a pitch out of range,
            more pitches than `MOST_PITCHES`.
        """
        if set(said) != set(streams) or not set(said) <= set(MAP_CHANNELS):
            raise FormatError("vision.maps", "other maps than are described", REMEDY)
        pitches, levels = {}, {}
        for name in said:
            pitches[name] = number(f"vision.maps.{name}", said[name]["pitch"], FINEST_PITCH, 1.0)
            size = whole_number(f"vision.maps.{name}", said[name]["values"], 1, MOST_PLACES)
            try:
                levels[name] = _joined(unpack_levels(streams[name], size, MAP_CHANNELS[name]))
            except ValueError as error:
                raise FormatError(f"vision.map.{name}", f"damaged ({error})", REMEDY) from error
        if len(set(pitches.values())) > MOST_PITCHES:
            raise FormatError("vision.maps", f"more than {MOST_PITCHES} pitches", REMEDY)
        return cls(surface, triangles, pitches, levels, streams)

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the maps as streams (n,) uint8 by name."""
        return {
            name: self.streams[name] if name in self.streams else pack_levels(_parted(levels))
            for name, levels in self.levels.items()
        }

    def metadata(self) -> dict[str, Any]:
        """Return pitch and number of values of each map, as JSON."""
        return {
            name: {"pitch": self.pitches[name], "values": len(levels)} for name, levels in self.levels.items()
        }

    @cached_property
    def _lattices(self) -> dict[tuple[float, bool], FaceLattice]:
        return {}

    @cached_property
    def _facing(self) -> np.ndarray:
        return facing(self.triangles)

    def lattice(self, name: str) -> FaceLattice:
        """Return the lattice of a map, one for all of a pitch.

        Raises
        ------
        FormatError
            It does not have as many values as the map.
        """
        pitch = self.pitches[name]
        key = pitch, name == "alpha"
        if key not in self._lattices:
            self._lattices[key] = lattice_of(name, self.triangles, pitch)
        if self._lattices[key].size != len(self.levels[name]):
            raise FormatError(f"vision.map.{name}", "a number of values that the faces do not have", REMEDY)
        return self._lattices[key]

    def __contains__(self, name: object) -> bool:
        """Whether there is a map of this name."""
        return name in self.levels

    def value(self, name: str, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return a map (n, channels) in 0..1 at barycentric coordinates (n, 3) of faces (n,)."""
        return self.lattice(name).interpolate(self.levels[name], face, barycentric) / MAP_WHOLE[name]

    def bent(self, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Return unit shading normals (n, 3), outside, bent by the map of normals."""
        upright = self.surface.normals_at(face, barycentric)
        levels = self.lattice("normal").interpolate(self.levels["normal"], face, barycentric)
        aside = (levels - UPRIGHT) / MAP_WHOLE["normal"]
        rise = np.sqrt(np.maximum(1 - (aside**2).sum(axis=1, keepdims=True), 0.0))
        first, second = tangent_frame(self._facing[face], upright)
        bent = aside[:, :1] * first + aside[:, 1:] * second + rise * upright
        return np.asarray(bent / np.maximum(np.linalg.norm(bent, axis=1, keepdims=True), 1e-12))


def tangent_frame(facing: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (n, 3) across normals (n, 3) of faces that look as `face_lattice.facing` says.

    The first lies above the axis after the one that the face looks along: alike on all faces that look that
    way. Both are 0 where a normal is along that axis.
    """
    axis = np.eye(3)[(facing // 2 + 1) % 3]
    across = axis - np.einsum("ij,ij->i", axis, normal)[:, None] * normal
    length = np.linalg.norm(across, axis=1, keepdims=True)
    first = np.where(length > 1e-3, across / np.maximum(length, 1e-3), 0.0)
    return first, np.cross(normal, first)


def _parted(levels: np.ndarray) -> np.ndarray:
    """Colours (n, 3) as green, and red and blue less green, which vary less; other levels as they are."""
    if levels.shape[1] != 3:
        return levels
    return levels - levels[:, 1:2] * np.array([1, 0, 1], dtype=np.uint8)


def _joined(levels: np.ndarray) -> np.ndarray:
    """Undo `_parted`."""
    if levels.shape[1] != 3:
        return levels
    return levels + levels[:, 1:2] * np.array([1, 0, 1], dtype=np.uint8)


def lattice_of(name: str, triangles: np.ndarray, pitch: float) -> FaceLattice:
    """Return the lattice of a map of a name: that of alpha has a value a place, for its edges are sharp."""
    return FaceLattice(triangles, pitch, shared=name != "alpha")
