"""The Object File that most tests ask: a glass bar, made at a very small size by the real tasks.

It lies in `FOLDER` with its truth of sight and sound, so that what is downstream of solving solves nothing.
``python -m tests.small_file`` makes all of it anew, and tests/test_small_file.py compares.
"""

import dataclasses
from pathlib import Path

import numpy as np
import trimesh

from objectfolder.fidelity.verification import verify_object
from objectfolder.making.damping import RAYLEIGH
from objectfolder.making.encoding import encode_object
from objectfolder.making.materials import read_materials
from objectfolder.making.modes.modes import simulate_modes
from objectfolder.making.touches.record import simulate_touches
from objectfolder.making.views.views import simulate_views
from objectfolder.products.store import write_product
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.vision.appearance import Appearance

FOLDER = Path(__file__).parent / "data" / "bar"
NAME = "bar.safetensors"
TRUTHS = ("views", "modes")
MATERIALS = Path(__file__).parents[1] / "data" / "materials.csv"


def bar_mesh() -> TexturedMesh:
    """Return a 120 x 30 x 8 mm bar with a striped texture."""
    box = trimesh.creation.box((0.12, 0.03, 0.008)).subdivide_to_size(0.02)
    stripes = np.zeros((8, 64, 4), dtype=np.uint8)
    stripes[..., 3] = 255
    stripes[:, :, 0] = np.where(np.arange(64) // 8 % 2, 210, 60)
    stripes[:, :, 1] = 140
    corners = np.asarray(box.vertices)[box.faces]
    return TexturedMesh(
        np.asarray(box.vertices, dtype=np.float64),
        np.asarray(box.faces, dtype=np.int64),
        corners[..., :2] / (0.12, 0.03) + 0.5,
        (stripes,),
        np.zeros(len(box.faces), dtype=np.int32),
    )


def make(folder: Path) -> None:
    """Write the verified Object File and its truth, ``NAME.zarr.zip`` for each name of `TRUTHS`."""
    mesh, sensor, glass = bar_mesh(), Sensor(), read_materials(MATERIALS)["glass"]
    views = simulate_views(
        mesh,
        Appearance(glass.roughness, glass.metallic),
        resolution=24,
        field_of_view_deg=39.6,
        camera_radius=2.5,
        training_views=6,
        training_samples=4,
        held_out_views=2,
        held_out_samples=16,
        seed=0,
    )
    # By Rayleigh's law, whose high modes die soon: the sounds that tests make are short.
    modes = simulate_modes(
        mesh.surface, glass, training_points=120, held_out_points=20, seed=0, damping=RAYLEIGH
    )
    touches = simulate_touches(mesh.surface, sensor, touches=1, held_out_touches=6, seed=0)
    origin = {
        "id": "bar",
        "name": "Glass bar",
        "source": "made by code",
        "licence": "CC0-1.0",
        "attribution": "the tests",
    }
    described = {"object": origin, "material": dataclasses.asdict(glass), "body": None, "provenance": {}}
    fit = {"visionnet": {"steps": 60, "grid_resolution": 64}, "audionet": {}, "seed": 0}
    file = encode_object(mesh.surface, views, modes, sensor, described, **fit)
    verify_object(file, views, modes, touches).file.save(folder / NAME)
    for name, truth in zip(TRUTHS, (views, modes), strict=True):
        write_product(folder / f"{name}.zarr.zip", truth)


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    make(FOLDER)
