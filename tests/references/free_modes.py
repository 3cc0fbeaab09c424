"""Modes of a free body by the project's solver, to be read anywhere on its boundary."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.materials import Material
from objectfolder.making.modes.adaptive import Goal, adapt_spectrum
from objectfolder.making.modes.boundary import Boundary
from objectfolder.making.modes.canonical import canonical_rotation
from objectfolder.making.modes.modes import waves_of
from objectfolder.making.modes.spectrum import space_on
from objectfolder.making.solid.filling import fill
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
SIGNED_AT = 2000  # points that decide the signs of modes and the bases of repeated ones
LIMIT_HZ, MOST_MODES, ACCURACY_CENTS, MOST_UNKNOWNS = 20_000.0, 128, 5.0, 180_000


@dataclass(frozen=True)
class FreeModes:
    """Modes below 20 kHz.

    Attributes
    ----------
    boundary : of the elements
    vectors : (functions, 3, modes) coefficients, of unit modal mass for a body of unit density and length
    frequencies_hz : (modes,) without damping
    length_m : that unit of length
    """

    boundary: Boundary
    vectors: Floats
    frequencies_hz: Floats
    length_m: float

    @classmethod
    def of(cls, surface: Surface, material: Material) -> "FreeModes":
        """Fill a surface (metres) and solve, as products of modes are."""
        solid = fill(surface, waves=waves_of(material, LIMIT_HZ, MOST_MODES))
        length = float(np.ptp(solid.vertices, axis=0).max())
        radians_per_s = material.shear_speed_m_s / length
        space, _ = space_on(solid, 5, length, bend=True)
        below = (2 * np.pi * LIMIT_HZ / radians_per_s) ** 2
        goal = Goal(below, ACCURACY_CENTS, MOST_MODES, MOST_UNKNOWNS, 0)
        solution = adapt_spectrum(space, solid.component, material.poisson_ratio, goal)
        frequencies = np.sqrt(solution.eta_squared) * radians_per_s / (2 * np.pi)
        boundary = Boundary(solid, solution.space, length)
        places = boundary.surface.sample(SIGNED_AT, 0)
        shapes = boundary.at(solution.vectors, places.face, places.barycentric)
        turned = solution.vectors @ canonical_rotation(solution.eta_squared, shapes, places.points)
        return cls(boundary, turned, frequencies, length)

    def normal_velocity(self, mesh: Surface, modes: list[int]) -> Floats:
        """Normal component (faces, modes) in the middles of a mesh's faces, at the nearest places."""
        near = self.boundary.surface.closest_points(mesh.vertices[mesh.faces].mean(axis=1))
        moved = self.boundary.at(self.vectors[:, :, modes], near.face, near.barycentric)
        return np.asarray(np.einsum("tk,tkm->tm", mesh.face_normals, moved))
