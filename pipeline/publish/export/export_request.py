"""What an export is asked for; light to import."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline.dataset.project_files import MATERIALS


@dataclass(frozen=True, kw_only=True)
class Exporting:
    """An export of views or of a surface.

    Parameters
    ----------
    format
        what to write
    overwrite
        replace an earlier export
    frame
        nerf, colmap: longest side 1 and centred, or metres
    exr
        nerf, colmap: also write scene-linear OpenEXR images
    points
        colmap: surface points to draw
    seed
        colmap: seed of the points
    surface
        gltf: the compressed surface of the Object File, or the source mesh (default: the stored one where
        there is an Object File)
    colour
        gltf, stored surface: what VisionNet learned, or the source's texture (default where there is one)
    texture_side
        gltf: texels a side
    vertex_colours
        gltf, stored surface: a colour for each vertex and no texture
    roughness
        gltf: in place of the material's
    metallic
        gltf: in place of the material's
    materials
        materials table (CSV)
    """

    format: Literal["nerf", "colmap", "gltf"]
    overwrite: bool = False
    frame: Literal["unit", "object"] = "unit"
    exr: bool = False
    points: int = 5000
    seed: int = 0
    surface: Literal["stored", "source"] | None = None
    colour: Literal["network", "source"] | None = None
    texture_side: int = 1024
    vertex_colours: bool = False
    roughness: float | None = None
    metallic: float | None = None
    materials: Path = MATERIALS
