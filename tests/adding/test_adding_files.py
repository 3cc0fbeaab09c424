"""Meshes copied with what they refer to: bytes untouched, names safe, nothing needed from outside."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.load import load_mesh
from pipeline.dataset.catalogue import check_id
from pipeline.intake.add.addition import check_unit, possible_lengths
from pipeline.intake.add.source_copy import (
    Layout,
    copy_files,
    digest_of,
    folder_digest,
    layout_of,
    object_id_of,
    safe_name,
)

CUBE = trimesh.creation.box((0.1, 0.06, 0.04))


def write_obj(path: Path, texture: str, library: str = "model.mtl") -> Path:
    """A textured box; `texture` as the library names it, the file made where that leads."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"mtllib {library}", "usemtl skin", *(f"v {x} {y} {z}" for x, y, z in CUBE.vertices)]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", *(f"f {a + 1}/1 {b + 1}/2 {c + 1}/3" for a, b, c in CUBE.faces)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (path.parent / library).write_text(f"newmtl skin\nmap_Kd {texture}\n", encoding="utf-8")
    image = path.parent / texture
    image.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3)).save(image)
    return path


def write_format(folder: Path, suffix: str) -> Path:
    """The box in each format, with a texture where the format has one."""
    folder.mkdir(parents=True, exist_ok=True)
    if suffix == ".obj":
        return write_obj(folder / "My box (1).obj", "a texture.png")
    colours = np.zeros((len(CUBE.vertices), 2))
    picture = Image.fromarray(np.full((2, 2, 3), 90, np.uint8))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture)
    mesh = CUBE.copy()
    if suffix in (".gltf", ".glb"):
        mesh.visual = trimesh.visual.TextureVisuals(uv=colours, material=material)
    if suffix == ".gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
            (folder / ("My box (1).gltf" if name == "model.gltf" else name)).write_bytes(data)
        return folder / "My box (1).gltf"
    path = folder / f"My box (1){suffix}"
    mesh.export(path)
    return path


def copy_of(mesh: Path, texture: Path | None, parent: Path) -> tuple[Path, Path | None]:
    """The copied mesh and texture, in the place they were renamed to."""
    layout = layout_of(mesh, texture)
    copy_files(layout, parent / "thing")
    assert [path.name for path in parent.iterdir()] == ["thing"]
    assert folder_digest(parent / "thing") == digest_of(layout.files)
    return parent / "thing" / layout.mesh, layout.texture and parent / "thing" / layout.texture


@pytest.mark.parametrize("suffix", [".obj", ".gltf", ".glb", ".ply", ".stl"])
def test_every_format_is_copied_whole(tmp_path, suffix):
    mesh = write_format(tmp_path / "from here", suffix)
    before = {path.name: path.read_bytes() for path in (tmp_path / "from here").iterdir()}
    loaded = load_mesh(mesh)
    copy, _ = copy_of(mesh, None, tmp_path / "to")
    assert copy.name == f"My_box_1{suffix}"
    assert copy.read_bytes() == mesh.read_bytes()
    shutil.rmtree(tmp_path / "from here")
    again = load_mesh(copy)
    np.testing.assert_array_equal(again.vertices, loaded.vertices)
    np.testing.assert_array_equal(again.textures[0], loaded.textures[0])
    companions = {path.name: path.read_bytes() for path in copy.parent.iterdir() if path != copy}
    assert companions == {name: data for name, data in before.items() if name != mesh.name}


def test_a_texture_beside_the_meshes_folder_stays_beside_it(tmp_path):
    mesh = write_obj(tmp_path / "gso" / "meshes" / "model.obj", "../materials/textures/texture.png")
    (tmp_path / "gso" / "model.sdf").write_text("not read")
    copy, _ = copy_of(mesh, None, tmp_path / "to")
    files = sorted(
        path.relative_to(tmp_path / "to/thing").as_posix() for path in (tmp_path / "to").rglob("*.*")
    )
    assert files == ["materials/textures/texture.png", "meshes/model.mtl", "meshes/model.obj"]
    shutil.rmtree(tmp_path / "gso")
    assert load_mesh(copy).textures[0].shape[:2] == (4, 4)


def test_a_texture_named_beside_the_mesh_replaces_its_own(tmp_path):
    mesh = write_obj(tmp_path / "a" / "model.obj", "own.png")
    (tmp_path / "b").mkdir()
    shutil.copy(tmp_path / "a" / "own.png", tmp_path / "b" / "Bild öde.PNG")
    copy, texture = copy_of(mesh, tmp_path / "b" / "Bild öde.PNG", tmp_path / "to")
    assert texture.name == "Bild_ode.png"
    assert sorted(path.name for path in copy.parent.iterdir()) == ["Bild_ode.png", "model.obj"]


def test_a_copy_that_reads_other_files_is_refused(tmp_path):
    mesh = write_obj(tmp_path / "a" / "model.obj", "own.png")
    whole = layout_of(mesh, None)
    part = Layout(
        {place: file for place, file in whole.files.items() if place.suffix != ".png"}, whole.mesh, None
    )
    with pytest.raises(InputError, match="--texture"):
        copy_files(part, tmp_path / "to" / "thing")
    assert not list((tmp_path / "to").iterdir())


def test_a_failed_copy_leaves_nothing(tmp_path):
    mesh = write_obj(tmp_path / "a" / "model.obj", "own.png")
    layout = layout_of(mesh, None)
    (tmp_path / "a" / "own.png").unlink()
    with pytest.raises(FileNotFoundError):
        copy_files(layout, tmp_path / "to" / "thing")
    assert list((tmp_path / "to").iterdir()) == []


@pytest.mark.parametrize(
    ("name", "object_id"),
    [
        ("mug.glb", "mug"),
        ("Tasse à café (2).obj", "Tasse_a_cafe_2"),
        ("-rf.obj", "rf"),
        (".hidden.glb", "hidden"),
        ("a;b|c$(d).stl", "a_b_c_d"),
        ("чашка.ply", "object"),
        ("x" * 150 + ".obj", "x" * 100),
    ],
)
def test_identifiers_from_hostile_names(name, object_id):
    assert object_id_of(Path("/somewhere") / name) == object_id
    check_id(object_id, "--id")


@pytest.mark.parametrize(
    ("path", "object_id"),
    [
        ("ycb/025_mug/google_16k/textured.obj", "025_mug"),
        ("ACE_Coffee_Mug/meshes/model.obj", "ACE_Coffee_Mug"),
        ("poly/Television_01/Television_01_1k.gltf", "Television_01_1k"),
    ],
)
def test_identifiers_from_the_folders_of_collections(path, object_id):
    assert object_id_of(Path("/data") / path) == object_id


def test_safe_names_are_safe():
    assert safe_name("../../etc/passwd") == "etc_passwd"
    assert safe_name("a\nb\0c") == "a_b_c"


def test_units_are_told_with_the_length_to_write():
    assert possible_lengths(120.0) == {"millimetres": pytest.approx(0.12), "centimetres": pytest.approx(1.2)}
    for side, remedy in (
        (120.0, "If it is in millimetres: --length 0.12; if it is in centimetres: --length 1.2"),
        (12.0, "if it really is 12 m long: --length 12"),
        (1e6, "State the longest side"),
        (1e-4, "State the longest side"),
        (3.2, "if it really is 3.2 m long"),
    ):
        with pytest.raises(InputError, match="which is hardly in metres") as caught:
            check_unit("mug", side)
        assert remedy in caught.value.remedy
    for side in (0.01, 2.6):
        check_unit("mug", side)
