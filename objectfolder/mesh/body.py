"""An object as a rigid body: what a simulator of contacts asks of it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

MEASURED = ("topology", "solid", "wall_thickness", "area_m2", "length", "warnings")


def body_of(measured: Mapping[str, Any], density_kg_m3: float, filled_volume_m3: float) -> dict[str, Any]:
    """Describe a homogeneous body of a density, as JSON.

    Parameters
    ----------
    measured
        Attributes `MEASURED` of an objects product (see `mesh.ingest.ingest_object`).
    density_kg_m3
        Of the material.
    filled_volume_m3
        Volume of the solid that the modes were solved on; it exists for open surfaces, too.

    Returns
    -------
    dict
        Lengths in metres, masses in kilograms, inertia about the centre of mass in the object frame.
        ``volume_m3``, ``mass_kg``, ``centre_of_mass_m`` and ``inertia_kg_m2`` are None for a surface that
        bounds no volume; ``filled_mass_kg`` is the mass of the solid that sounds.
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
        "filled_volume_m3": filled_volume_m3,
        "filled_mass_kg": density_kg_m3 * filled_volume_m3,
        "wall_effective_m": walls["effective_m"],
        "wall_median_m": walls["median_m"],
        "wall_thin_m": walls["thin_m"],
        "warnings": list(measured["warnings"]),
    }
