"""What is doubtful about the size of an object before it is built: probably a mistake of unit."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from objectfolder.audio.materials import Material
    from pipeline.run.single_build import Building

LARGE_M, HEAVY_KG = 1.0, 100.0


def size_doubts(building: "Building", material: "Material") -> list[str]:
    """Return what is doubtful about length and mass; the mass is that of the solid that the mesh bounds.

    An object is doubtful that has `LARGE_M` or more by its file and no stated length, and one above
    `HEAVY_KG`.
    """
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
