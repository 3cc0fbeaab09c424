"""What kind of solid a surface bounds: closed or not, volume, inertia; and that solid as a rigid body."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.surface.overlap import NOTHING, CountedAgain
from objectfolder.surface.surface import Surface, connected_pieces

MEASURED = ("topology", "solid", "wall_thickness", "area_m2", "length", "normals_of_source", "warnings")
SOLID_MEASURES = ("volume_m3", "mass_kg", "centre_of_mass_m", "inertia_kg_m2")


@dataclass(frozen=True)
class Topology:
    """Counts on a welded surface.

    `watertight`: every edge has exactly two faces. `components`: pieces connected through shared vertices.
    `boundary_edges` have one face, `non_manifold_edges` three or more, `zero_area_faces` less than 1e-14 of
    the squared longest side. `consistent`: neighbouring faces are wound alike.
    """

    watertight: bool
    consistent: bool
    components: int
    boundary_edges: int
    non_manifold_edges: int
    zero_area_faces: int


@dataclass(frozen=True)
class SolidProperties:
    """Volume integrals over the enclosed solid for unit density; multiply by a density in kg/m^3 for masses.

    Parameters
    ----------
    volume_m3
        Signed sum over shells and cavities.
    volume_uncertainty_m3
        Standard error of it; 0 where no pieces overlap.
    centre_of_mass_m
        (3,) object frame.
    inertia_per_density_m5
        (3, 3) inertia tensor about the centre of mass, axes of the object frame.
    """

    volume_m3: float
    centre_of_mass_m: np.ndarray
    inertia_per_density_m5: np.ndarray
    volume_uncertainty_m3: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the properties as JSON values."""
        return {
            "volume_m3": self.volume_m3,
            "volume_uncertainty_m3": self.volume_uncertainty_m3,
            "centre_of_mass_m": self.centre_of_mass_m.tolist(),
            "inertia_per_density_m5": self.inertia_per_density_m5.tolist(),
        }


def topology_of(surface: Surface) -> Topology:
    """Count what keeps a welded surface from bounding a solid."""
    table = surface.edges
    smallest = 1e-14 * float(np.ptp(surface.vertices, axis=0).max()) ** 2
    return Topology(
        watertight=bool((table.face_count == 2).all()),
        consistent=bool((table.imbalance[table.face_count == 2] == 0).all()),
        components=connected_pieces(surface.faces)[0],
        boundary_edges=int(np.count_nonzero(table.face_count == 1)),
        non_manifold_edges=int(np.count_nonzero(table.face_count > 2)),
        zero_area_faces=int(np.count_nonzero(surface.face_areas <= smallest)),
    )


def solid_properties(
    vertices: np.ndarray, faces: np.ndarray, again: CountedAgain = NOTHING
) -> SolidProperties:
    """Integrate over the solid bounded by a closed, consistently wound surface.

    Sums over the tetrahedra from one point to each face (Tonon 2005, J. Math. Stat. 1(1), 8-11): with
    ``s = a + b + c`` and ``d = det(a, b, c)`` a tetrahedron adds ``d / 6`` to the volume, ``d s / 24`` to the
    first and ``d (s s' + a a' + b b' + c c') / 120`` to the second moment. On an open surface the sums depend
    on that point, here the centre of the bounding box, and mean nothing.

    Parameters
    ----------
    vertices, faces
        (V, 3) metres and (F, 3).
    again
        What the sums count more than once, and is taken away (see `counted_again`).
    """
    origin = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    triangles = vertices[faces] - origin
    determinants = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))
    sums = triangles.sum(axis=1)
    points = again.points - origin
    volume = float(determinants.sum() / 6 - again.volumes.sum())
    # Sums of numpy: a product of matrices would round as the processor's library does.
    first = (determinants[:, None] * sums).sum(axis=0) - 24 * (again.volumes[:, None] * points).sum(axis=0)
    centre = first / (24 * volume) if volume else np.zeros(3)
    outer = np.einsum("i,ij,ik->jk", determinants, sums, sums)
    outer += np.einsum("i,ivj,ivk->jk", determinants, triangles, triangles)
    second = outer / 120 - np.einsum("i,ij,ik->jk", again.volumes, points, points)
    moments = second - volume * np.outer(centre, centre)
    inertia = np.trace(moments) * np.eye(3) - moments
    return SolidProperties(volume, origin + centre, inertia, again.uncertainty)


def body_of(measured: Mapping[str, Any], density_kg_m3: float, filled: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a homogeneous body of a density, as JSON.

    Parameters
    ----------
    measured
        Attributes `MEASURED` of an objects product (see `mesh.ingest.ingest_object`).
    density_kg_m3
        Of the material.
    filled
        Attributes of the modes: volume, mass, centre and inertia of the solid that they were solved on. It
        exists for open surfaces, too. Each is None where no modes were solved.

    Returns
    -------
    dict
        Lengths in metres, masses in kilograms, inertia about the centre of mass in the object frame.
        ``volume_m3``, ``mass_kg``, ``centre_of_mass_m`` and ``inertia_kg_m2`` are None for a surface that
        bounds no volume; those that begin with ``filled_`` are of the solid that sounds;
        ``normals_of_source`` is the share of corners with normals of the source. ``source_up``, the axis of
        the file that became z, is there only where that was another.
    """
    solid, topology, walls = measured["solid"], measured["topology"], measured["wall_thickness"]
    closed = bool(solid["meaningful"])
    inertia = density_kg_m3 * np.asarray(solid["inertia_per_density_m5"], dtype=np.float64)
    return {
        "watertight": topology["watertight"],
        "components": topology["components"],
        "extents_m": measured["length"]["extents_m"],
        "area_m2": measured["area_m2"],
        "volume_m3": solid["volume_m3"] if closed else None,
        "mass_kg": density_kg_m3 * solid["volume_m3"] if closed else None,
        "centre_of_mass_m": solid["centre_of_mass_m"] if closed else None,
        "inertia_kg_m2": inertia.tolist() if closed else None,
        **{f"filled_{name}": filled[name] for name in SOLID_MEASURES},
        "wall_effective_m": walls["effective_m"],
        "wall_median_m": walls["median_m"],
        "wall_thin_m": walls["thin_m"],
        "normals_of_source": measured["normals_of_source"],
        "warnings": list(measured["warnings"]),
        **({"source_up": measured["source_up"]} if "source_up" in measured else {}),
    }


def told_normals(share: float) -> str:
    """Say whose the normals of a surface are, of which a share 0..1 is the source's.

    >>> told_normals(0.0), told_normals(1.0)
    ('by the angles between faces', 'of the source')
    """
    if share in (0, 1):
        return "of the source" if share else "by the angles between faces"
    return f"of the source at {100 * share:.3g} % of corners, else by the angles between faces"
