"""An object of a simulation as it is heard."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.hertz import HertzContact
from objectfolder.audio.synthesis.object_stream import ObjectStream
from objectfolder.audio.synthesis.sources import Motion
from objectfolder.errors import QueryError
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.surface.bounding_boxes import closest_barycentric
from objectfolder.surface.surface import ClosestPoints

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
# Radius of curvature where objects touch, over the longest side: edges and rims. The duration of a contact
# goes with its -1/5 power.
CURVATURE_SHARE = 0.02
# An asset's mass and its Object File's differ by rounding; a scale of 1.01 is three times as much.
MASS_TOLERANCE = 0.01
# Root mean square of the heights of a surface that does not say; most lie between 0.1 and 5 micrometres.
ROUGHNESS_UM = 1.0
# Points of the surface at which contacts that last are heard: 2.5 % of the longest side apart, on a mug.
LISTENING_POINTS, CONTACTS_AT_ONCE = 8192, 16


@dataclass(frozen=True)
class Matter:
    """What a surface is made of, as a contact feels it.

    Attributes
    ----------
    youngs_modulus_pa, poisson_ratio : elasticity
    roughness_m : root mean square of its heights, see `RoughProfile`
    curvature_per_m : where it touches others
    """

    youngs_modulus_pa: float
    poisson_ratio: float
    roughness_m: float = ROUGHNESS_UM * 1e-6
    curvature_per_m: float = 0.0

    def against(self, other: "Matter", mass_kg: float) -> HertzContact:
        """Return the contact of two bodies, of which the sharper one counts."""
        compliance = sum((1 - matter.poisson_ratio**2) / matter.youngs_modulus_pa for matter in (self, other))
        return HertzContact(1 / compliance, 1 / max(self.curvature_per_m, other.curvature_per_m), mass_kg)


@dataclass(frozen=True)
class HeardBody:
    """An Object File with its stream.

    Attributes
    ----------
    file : its Object File
    stream : its sound at the listener
    mass_kg : in the simulation
    """

    file: ObjectFile
    stream: ObjectStream
    mass_kg: float

    @classmethod
    def of(
        cls, name: str, file: ObjectFile, mass_kg: float, rate_hz: float, listener_m: Floats
    ) -> "HeardBody":
        """Return a silent body to a listener (3,) in its frame.

        Raises
        ------
        QueryError
            Another mass than the file's, or a file without sound.
        """
        _require_same_body(name, mass_kg, file)
        return cls(file, file.stream(rate_hz, listener=listener_m), mass_kg)

    @cached_property
    def size_m(self) -> float:
        """Longest side."""
        return float(np.ptp(self.file.surface.bounds, axis=0).max())

    @cached_property
    def matter(self) -> Matter:
        """What it is made of."""
        material = self.file.description["material"]
        stated_um = material.get("roughness_um")
        roughness_m = 1e-6 * (ROUGHNESS_UM if stated_um is None else stated_um)
        curvature = 1 / (CURVATURE_SHARE * self.size_m)
        return Matter(material["youngs_modulus_pa"], material["poisson_ratio"], roughness_m, curvature)

    def nearest(self, local: Floats) -> ClosestPoints:
        """Return the place of the surface nearest to a contact; collision shapes lie centimetres off.

        As `Surface.closest_points`, which is made for many points: no face is nearest whose centre is farther
        than the nearest centre and the largest face together.
        """
        corners, centres, largest_m = self._faces
        reach = centres.query(local)[0] + largest_m
        faces = np.array(sorted(centres.query_ball_point(local, reach)))
        places = np.broadcast_to(local, (len(faces), 3))
        barycentric = closest_barycentric(corners[faces], places)
        points = self.file.surface.points_at(faces, barycentric)
        distance = np.linalg.norm(points - local, axis=1)
        best = np.argmin(distance, keepdims=True)
        return ClosestPoints(points[best], distance[best], faces[best], barycentric[best])

    def motion(self, local: Floats) -> Motion:
        """Return how its modes move at the nearest of `LISTENING_POINTS` points of the surface."""
        place = int(self._tree.query(local)[1])
        if place not in self._motions:
            # A product for one point costs as much as for a few, and a contact goes on to its neighbours.
            near = np.atleast_1d(self._tree.query(self._tree.data[place], CONTACTS_AT_ONCE)[1])
            new = [int(index) for index in near if index not in self._motions]
            self._motions.update(zip(new, self.stream.motions(self._tree.data[new]), strict=True))
        return self._motions[place]

    @cached_property
    def _faces(self) -> tuple[Floats, "cKDTree[None]", float]:
        """Corners (faces, 3, 3), a tree of their centres, and how far a corner is from its centre at most."""
        from scipy.spatial import cKDTree

        corners = self.file.surface.vertices[self.file.surface.faces]
        centres = corners.mean(axis=1)
        return corners, cKDTree(centres), float(np.linalg.norm(corners - centres[:, None], axis=2).max())

    @cached_property
    def _tree(self) -> "cKDTree[None]":
        from scipy.spatial import cKDTree

        return cKDTree(self.file.surface.sample(LISTENING_POINTS, 0).points)

    @cached_property
    def _motions(self) -> dict[int, Motion]:
        return {}


def _require_same_body(body: str, mass_kg: float, file: ObjectFile) -> None:
    """Refuse a body whose mass in the simulation is none of its Object File's."""
    if not (file.description.get("body") and file.description.get("material")):
        finding = f"the file of {body!r} does not say the object's mass and material"
        raise QueryError("files", finding, "Build the file again.")
    masses = [file.description["object"].get("mass_kg")]
    masses += [file.description["body"].get(name) for name in ("mass_kg", "filled_mass_kg")]
    stated = [float(value) for value in masses if value]
    if not any(abs(mass_kg / value - 1) <= MASS_TOLERANCE for value in stated):
        finding = f"{body!r} weighs {mass_kg:.4g} kg in the simulation, {stated[0]:.4g} kg in its Object File"
        raise QueryError("files", finding, "Give the file of that object, at the scale of the simulation.")
