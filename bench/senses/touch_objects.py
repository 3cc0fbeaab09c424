"""Surfaces of a catalogue of meshes, cleaned once and kept."""

import csv
from pathlib import Path

import numpy as np

from objectfolder.mesh.ingest import ingest_object
from objectfolder.mesh.mesh import textured_mesh_of
from objectfolder.surface.surface import Surface

# Of several materials and kinds: bodies, tools, thin walls, figures, sharp boxes.
OBJECTS = (
    "011_banana",
    "006_mustard_bottle",
    "025_mug",
    "048_hammer",
    "062_dice",
    "Diamond_Visions_Scissors_Red",
    "Schleich_African_Black_Rhino",
    "Room_Essentials_Salad_Plate_Turquoise",
    "tea_set_01_teapot_01",
    "Threshold_Porcelain_Teapot_White",
    "013_apple",
    "024_bowl",
    "031_spoon",
    "042_adjustable_wrench",
    "050_medium_clamp",
    "073-f_lego_duplo",
    "Android_Figure_Orange",
    "Cole_Hardware_School_Bell_Solid_Brass_38",
    "ratchet_wrench",
    "Sonny_School_Bus",
)


def names(catalogue: Path) -> set[str]:
    """Return the ids of a catalogue."""
    with catalogue.open(newline="", encoding="utf-8") as file:
        return {row["id"] for row in csv.DictReader(file)}


def surface_of(catalogue: Path, name: str, cache: Path) -> Surface:
    """Return the cleaned surface of an object, without faces that have no area."""
    path = cache / f"{name}.surface.npz"
    if not path.exists():
        product = ingest_object(catalogue.parent / name / "model.obj", None, None, name, with_textures=False)
        surface = textured_mesh_of(product).surface
        np.savez(path, vertices=surface.vertices, faces=surface.faces[surface.face_areas > 0])
    with np.load(path) as found:
        return Surface(found["vertices"], found["faces"])
