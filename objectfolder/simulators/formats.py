"""The formats of simulators, and the folder of one asset."""

import json
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.simulators.asset import Asset
from objectfolder.simulators.mesh_files import write_meshes
from objectfolder.simulators.mjcf import write_mjcf
from objectfolder.simulators.sdf import write_sdf
from objectfolder.simulators.urdf import write_urdf
from objectfolder.simulators.usd import write_usd

FORMATS: dict[str, tuple[str, Callable[[Path, Asset], None]]] = {
    "mjcf": ("object.xml", write_mjcf),
    "urdf": ("object.urdf", write_urdf),
    "sdf": ("model.sdf", write_sdf),
    "usd": ("object.usda", write_usd),
}
DESCRIPTION = "object.json"


def write_asset(folder: Path, asset: Asset, formats: Collection[str] = tuple(FORMATS)) -> dict[str, Any]:
    """Write an asset into an empty folder; return its description.

    Parameters
    ----------
    formats
        Some of ``mjcf`` (``object.xml``), ``urdf`` (``object.urdf``), ``sdf`` (``model.sdf`` and
        ``model.config``) and ``usd`` (``object.usda``).

    Returns
    -------
    dict
        What ``object.json`` holds: mass, centre, inertia, contact, collision measures, credit, files.

    Raises
    ------
    InputError
        A library that a format needs is missing.
    """
    files = write_meshes(folder, asset)
    for name in formats:
        file, write = FORMATS[name]
        write(folder / file, asset)
        files.append(file)
    described = {
        "object": asset.credit.to_dict(),
        "unit": "metre, kilogram, second; object frame, z up",
        "mass_kg": asset.body.mass_kg,
        "mass_of": asset.mass_of,
        "centre_of_mass_m": np.asarray(asset.body.centre_of_mass_m).tolist(),
        "inertia_kg_m2": np.asarray(asset.body.inertia_kg_m2).tolist(),
        "friction": asset.contact.friction,
        "restitution": asset.contact.restitution,
        "collision": asset.collision.to_dict(),
        "files": files,
    }
    (folder / DESCRIPTION).write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    return described
