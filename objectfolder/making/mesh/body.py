"""Whether a surface bounds a solid, and that solid as a rigid body."""

from collections.abc import Mapping
from typing import Any

import numpy as np

MEASURED = ("topology", "solid", "wall_thickness", "area_m2", "length", "normals_of_source", "warnings")
SOLID_MEASURES = ("volume_m3", "mass_kg", "centre_of_mass_m", "inertia_kg_m2")


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
