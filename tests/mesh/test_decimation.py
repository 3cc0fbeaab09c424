"""Decimation: as many faces as are asked for, closed, in the same colours, within the stated distance."""

import re
from pathlib import Path

import numpy as np
import pytest
from hard_checks import colours_at
from hard_meshes import encoded, quarters, write_text

from objectfolder.errors import InputError
from objectfolder.making.materials import Material
from objectfolder.making.mesh.cleaning import clean
from objectfolder.making.mesh.readers.load import load_mesh
from pipeline.cli import main
from pipeline.dataset.catalogue import read_rows
from pipeline.run.single_build import Building, build_object_file

RADIUS = 0.05
ROUND, ROWS = 64, 32


def sphere_text() -> str:
    """A ball whose picture goes around once, with a seam; vertices are given twice there."""
    u, v = np.meshgrid(np.linspace(0, 1, ROUND + 1), np.linspace(0, 1, ROWS + 1), indexing="ij")
    points = on_sphere(u, v).reshape(-1, 3).round(15)  # one point at each pole
    points[-ROWS - 1 :] = points[: ROWS + 1]
    pairs = np.stack([u, v], axis=-1).reshape(-1, 2)
    first = 1 + np.arange(ROUND * (ROWS + 1)).reshape(ROUND, ROWS + 1)[:, :-1].reshape(-1)
    faces = [(a, a + ROWS + 1, a + ROWS + 2, a + 1) for a in first.tolist()]
    lines = ["mtllib ball.mtl"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"vt {s!r} {t!r}" for s, t in pairs.tolist()]
    lines += ["usemtl skin", *("f " + " ".join(f"{i}/{i}" for i in face) for face in faces)]
    return "\n".join(lines) + "\n"


def on_sphere(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    turn, rise = 2 * np.pi * u, np.pi * (v - 0.5)
    ring = np.cos(rise)
    return RADIUS * np.stack([ring * np.cos(turn), ring * np.sin(turn), np.sin(rise)], axis=-1)


def refuse_by_count(building: Building, material: Material) -> None:
    """Refuse what a build is about to be made of, which says of how many faces it is."""
    raise InputError(str(building.mesh), f"as of {len(load_mesh(building.mesh).faces)} faces", "None")


@pytest.mark.slow
def test_a_mesh_is_decimated_as_it_is_built_or_added(tmp_path, monkeypatch, capsys):
    path = write_text(tmp_path / "ball.obj", sphere_text())
    write_text(tmp_path / "ball.mtl", "newmtl skin\nmap_Kd skin.png\n")
    write_text(tmp_path / "skin.png", encoded(quarters(256)))
    monkeypatch.setattr("objectfolder.making.mesh.readers.face_count.MOST_FACES", 1000)
    monkeypatch.setattr("pipeline.run.decimation.DISTANCE_SAMPLES", 500)
    with pytest.raises(InputError, match="--decimate"):
        load_mesh(path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    building = Building(mesh=path, material="wood", decimate=600)
    with pytest.raises(InputError, match=r"decimated/ball.glb: as of 5\d\d|as of 600"):
        build_object_file(building, tmp_path / "ball.safetensors", refuse_by_count)
    table = tmp_path / "table.csv"
    command = ["add", str(path), "--material", "wood", "--licence", "CC0-1.0", "--table", str(table)]
    assert main([*command, "--no-preview", "--decimate", "600"]) == 0
    said = re.search(r"decimated from (\d+) to (\d+) faces: .* within (\S+) mm", capsys.readouterr().out)
    ((_, row),) = read_rows(table)[1]
    decimation = load_mesh(tmp_path / row["mesh"])
    assert (int(said[1]), int(said[2])) == (2 * ROUND * ROWS, len(decimation.faces))
    assert 590 <= len(decimation.faces) <= 600
    mesh, _ = clean(decimation)
    assert mesh.surface.topology.watertight
    inward = RADIUS - np.linalg.norm(mesh.surface.sample(2000, 0).points, axis=1)
    assert float(said[3]) == pytest.approx(1e3 * inward.max(), rel=0.3)
    assert float(said[3]) < 0.03 * 1e3 * RADIUS
    u, v = (
        axis.reshape(-1) for axis in np.meshgrid([0.05, 0.2, 0.45, 0.55, 0.8, 0.95], [0.2, 0.4, 0.6, 0.8])
    )
    image = quarters(256)
    expected = image[(256 * (1 - v)).astype(int), (256 * u).astype(int)]
    np.testing.assert_allclose(colours_at(decimation, on_sphere(u, v), 0.002), expected, atol=2)


def test_too_few_faces_are_refused(tmp_path: Path, capsys):
    path = write_text(tmp_path / "ball.obj", "")
    command = ["add", str(path), "--material", "wood", "--licence", "CC0-1.0"]
    assert main([*command, "--decimate", "3"]) == 2
    assert "3 faces bound no solid" in capsys.readouterr().err
