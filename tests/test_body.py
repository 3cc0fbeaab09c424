"""Mass and inertia of simple bodies, and what is not said of open ones."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from objectfolder.making.mesh.body import body_of
from objectfolder.making.mesh.ingest import ingest_object

FILLED = {
    "volume_m3": 1e-3,
    "mass_kg": 0.75,
    "centre_of_mass_m": [0.0, 0.0, 0.0],
    "inertia_kg_m2": np.eye(3).tolist(),
}


def test_a_box_has_the_mass_and_inertia_of_a_box(tmp_path: Path) -> None:
    sides, density = np.array([0.2, 0.1, 0.05]), 750.0
    trimesh.creation.box(sides).export(tmp_path / "box.ply")
    body = body_of(
        ingest_object(tmp_path / "box.ply", object_id="box").attributes,
        density,
        FILLED,
    )
    mass = density * sides.prod()
    assert body["mass_kg"] == pytest.approx(mass)
    assert body["filled_mass_kg"] == 0.75
    squared = sides**2
    np.testing.assert_allclose(
        body["inertia_kg_m2"], np.diag(mass / 12 * (squared.sum() - squared)), rtol=1e-6, atol=1e-12
    )
    assert body["watertight"]
    assert body["wall_thin_m"] == pytest.approx(0.05, rel=0.1)


def test_an_open_surface_has_the_mass_of_what_fills_it_and_no_inertia(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    trimesh.Trimesh(box.vertices, box.faces[:-1], process=False).export(tmp_path / "open.ply")
    body = body_of(
        ingest_object(tmp_path / "open.ply", object_id="open").attributes,
        1000.0,
        FILLED,
    )
    assert body["mass_kg"] is None
    assert body["inertia_kg_m2"] is None
    assert body["filled_mass_kg"] == 0.75
    assert body["filled_inertia_kg_m2"] == FILLED["inertia_kg_m2"]
    assert body["warnings"]
