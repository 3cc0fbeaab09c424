"""A question before an object is built whose size is probably a mistake of unit."""

import sys
from typing import TYPE_CHECKING

import numpy as np

from objectfolder.errors import InputError

if TYPE_CHECKING:
    from objectfolder.audio.materials import Material
    from pipeline.run.single_build import Building

LARGE_M, HEAVY_KG = 1.0, 100.0


def confirm_size(building: "Building", material: "Material") -> None:
    """Ask on a terminal whether a doubtful size is meant; elsewhere refuse it.

    Raises
    ------
    InputError
        An object of `LARGE_M` or more whose length is not stated, or above `HEAVY_KG`, that nobody confirms.
    """
    doubts = _doubts(building, material)
    if not doubts:
        return
    finding = " and ".join(doubts)
    if sys.stdin.isatty() and sys.stderr.isatty():
        print(f"{building.mesh}: {finding}. Build it? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    remedy = "State --length in metres" if building.length_m is None else "Correct --length or --material"
    raise InputError(str(building.mesh), finding, f"{remedy}, or give --yes.")


def _doubts(building: "Building", material: "Material") -> list[str]:
    """Return what is doubtful about length and mass; the mass is that of the solid that the mesh bounds."""
    from objectfolder.mesh.readers.load import load_mesh

    mesh = load_mesh(building.mesh, with_textures=False)
    vertices = mesh.surface.vertices
    extent = float(np.ptp(vertices, axis=0).max())
    length_m = building.length_m or extent
    # Seen from its middle, a mesh with holes bounds about its volume, too.
    corners = (vertices - vertices.mean(axis=0))[mesh.surface.faces]
    volume = abs(float(np.linalg.det(corners).sum())) / 6
    mass_kg = building.mass_kg
    if mass_kg is None and building.shell_m is None and extent > 0:
        mass_kg = material.density_kg_m3 * volume * (length_m / extent) ** 3
    doubts = []
    if building.length_m is None and extent >= LARGE_M:
        doubts.append(f"{extent:.4g} m long by the file")
    if mass_kg is not None and mass_kg > HEAVY_KG:
        doubts.append(f"{mass_kg:.0f} kg of {material.name}")
    return doubts
