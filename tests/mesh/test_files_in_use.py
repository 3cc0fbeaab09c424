"""Files as people have them, which readers are reported to take otherwise: right, or said, or refused."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hard_checks import BOX, colours_at
from hard_meshes import (
    BOX_QUADS,
    OBJ_SIDES,
    GltfWriter,
    box,
    box_primitive,
    encoded,
    fanned,
    obj_text,
    ply_bytes,
    quarters,
    stl_bytes,
    write_gltf_box,
    write_obj_box,
    write_text,
)

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.gltf_materials import metal_of_gloss
from objectfolder.making.mesh.readers.load import load_mesh, source_files
from objectfolder.surface.textured_mesh import TexturedMesh

POINTS, QUARTERS = (np.array(column) for column in zip(*BOX.colours, strict=True))
TOP = POINTS[:1]
MAP = "map_Kd skin.png\n"


def shows_its_picture(mesh: TexturedMesh) -> bool:
    return np.allclose(colours_at(mesh, POINTS), QUARTERS, atol=1)


def top(mesh: TexturedMesh) -> list[int]:
    """Colour of the middle of a quarter of the top."""
    return colours_at(mesh, TOP)[0].round().tolist()


@pytest.mark.parametrize(
    ("library", "options", "remark"),
    [
        ("newmtl skin\n" + MAP, {"material": ""}, "the only one of its library, 'skin', is taken"),
        ("newmtl skin\n" + MAP, {"material": "None"}, "the only one of its library, 'skin', is taken"),
        (MAP, {"material": "(null)"}, "is taken"),
        ("newmtl Skin\n" + MAP, {}, ""),
        ('newmtl "skin"\nmap_Kd "skin.png"\n', {"mtllib": '"model.mtl"'}, ""),
        ("newmtl skin\n" + MAP, {"mtllib": r"C:\Users\Ann\scan\model.mtl"}, ""),
        ("newmtl skin\nmap_Kd /home/ann/skin.png\n", {"mtllib": "/home/ann/model.mtl"}, ""),
        ("newmtl skin\nmap_Kd ../skin.png\n", {"library_file": "materials/model.mtl"}, ""),
        ("newmtl skin\nmap_Ka skin.png\n", {}, "a picture of ambient (map_Ka)"),
        ("newmtl skin\nKd 0 0 0\nmap_Ke skin.png\n", {}, "a picture of emission (map_Ke)"),
    ],
)  # fmt: skip
def test_the_picture_of_an_obj_is_found(tmp_path, library, options, remark):
    path = write_obj_box(tmp_path, library=library, **options)
    mesh = load_mesh(path)
    assert shows_its_picture(mesh)
    assert remark in " ".join(mesh.remarks)
    assert bool(mesh.remarks) == bool(remark)
    assert {file.name for file in source_files(path)} == {"model.obj", "model.mtl", "skin.png"}


@pytest.mark.parametrize(
    ("library", "colour", "remark"),
    [
        ("newmtl skin\nKd 200 30 30\nnewmtl other\nKd 1 1 1\n", [200, 30, 30], "taken to be in 0..255"),
        ("newmtl skin\nKd 1.5 .2 .2\n", [255, 51, 51], "above 1 is cut off"),
        ("newmtl skin\nKd 0 0 0\nKs .9 .7 .2\nillum 3\n", [230, 178, 51], "a metal"),
        ("newmtl skin\nKd .2 .2 .2\nillum 4\n", [51, 51, 51], "asks for glass"),
        ("newmtl skin\nKd .2 .2 .2\nmap_Ke skin.png\n", [51, 51, 51], "bake it"),
        ("# nothing\n", [204, 204, 204], "defines no material"),
    ],
)  # fmt: skip
def test_colours_of_an_obj_that_are_said(tmp_path, library, colour, remark):
    empty = {"material": "none"} if library.startswith("#") else {}
    mesh = load_mesh(write_obj_box(tmp_path, library=library, **empty))
    assert top(mesh) == colour
    assert len(mesh.remarks) == 1
    assert remark in mesh.remarks[0]
    if "metal" in remark:
        assert mesh.metallic_maps[0].tolist() == [[255]]


def test_an_obj_that_names_no_colours_says_so(tmp_path):
    for folder, material, remark in (("one", "skin", "no library"), ("two", "", "names no picture")):
        path = write_obj_box(tmp_path / folder, mtllib="", material=material)
        mesh = load_mesh(path)
        assert top(mesh) == [204, 204, 204]
        assert len(mesh.remarks) == 1
        assert remark in mesh.remarks[0]
        assert load_mesh(path, path.with_name("skin.png")).remarks == ()


def test_several_materials_and_none_named_is_refused(tmp_path):
    two = "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n"
    path = write_obj_box(tmp_path / "one", library=two, material="")
    with pytest.raises(InputError, match=r"before any usemtl.*'a', 'b'"):
        load_mesh(path)
    with pytest.raises(InputError, match=r"which its material library does not define \(it has: 'a', 'b'\)"):
        load_mesh(write_obj_box(tmp_path / "two", library=two))


def lines_of_box(change) -> str:
    lines = obj_text(box(OBJ_SIDES), fanned(BOX_QUADS).tolist(), material="", textured=False).splitlines()
    return "\n".join(change(lines)) + "\n"


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: sorted(lines, key=lambda line: line[0] != "f"),
        lambda lines: [f"f {' '.join(f'{v}/{v}/{v}' for v in line[2:].split())}" if line[0] == "f" else line
                       for line in lines if line[:2] != "vt"],
        lambda lines: [f"f {' '.join(f'{v}/0/0' for v in line[2:].split())}" if line[0] == "f" else line
                       for line in lines],
        lambda lines: [f"f {' '.join(str(int(v) - 1) for v in line[2:].split())}" if line[0] == "f" else line
                       for line in lines],
    ],
    ids=["faces first", "indices of no table", "index 0 is none", "from 0 on"],
)  # fmt: skip
def test_indices_that_others_take(tmp_path, change):
    mesh = load_mesh(write_text(tmp_path / "model.obj", lines_of_box(change)))
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], box(OBJ_SIDES)[fanned(BOX_QUADS)])


def test_colours_of_some_vertices(tmp_path):
    text = lines_of_box(lambda lines: [*(f"{line} 1 0 0" for line in lines[:4]), *lines[4:]])
    mesh = load_mesh(write_text(tmp_path / "model.obj", text))
    corners = np.array([[0.05, 0.04, -0.03], [0.05, 0.04, 0.03]]) * 0.999
    np.testing.assert_allclose(colours_at(mesh, corners, 1e-3), [[255, 0, 0], [204, 204, 204]], atol=2)
    assert mesh.remarks == ("4 of 8 vertices have no colour and are drawn grey",)


@pytest.mark.parametrize(
    ("names", "kind", "scale"),
    [("diffuse_red diffuse_green diffuse_blue", "uchar", 1), ("r g b", "uchar", 1),
     ("Red Green Blue", "uchar", 1), ("red green blue", "float", 1),
     ("red green blue", "float", 1 / 255), ("red green blue", "int", 1),
     ("red green blue", "ushort", 257)],
)  # fmt: skip
def test_colours_of_a_ply_by_names_and_scales(tmp_path, names, kind, scale):
    text = ply_bytes(box(OBJ_SIDES), BOX_QUADS, "", colours=np.tile([200, 30, 30], (8, 1))).decode()
    for old, new in zip(("red", "green", "blue"), names.split(), strict=True):
        text = text.replace(f"property uchar {old}", f"property {kind} {new}")
    text = text.replace("200 30 30", " ".join(f"{value * scale:.9g}" for value in (200, 30, 30)))
    assert top(load_mesh(write_text(tmp_path / "model.ply", text))) == [200, 30, 30]


def test_coordinates_of_a_ply_without_a_picture_are_said(tmp_path):
    text = ply_bytes(box(OBJ_SIDES), BOX_QUADS, "").decode()
    text = text.replace("element face", "property float s\nproperty float t\nelement face")
    head, _, rows = text.partition("end_header\n")
    lines = rows.splitlines()
    text = head + "end_header\n" + "\n".join([*(f"{row} 0 0" for row in lines[:8]), *lines[8:]]) + "\n"
    assert "names no picture" in load_mesh(write_text(tmp_path / "model.ply", text)).remarks[0]


@pytest.mark.parametrize(("header", "red"), [(b"VisCAM", 31 << 10 | 1 << 15), (b"COLOR=\0\0\0\0", 31)])
def test_colours_of_triangles_of_an_stl(tmp_path, header, red):
    data = bytearray(stl_bytes(box(OBJ_SIDES), fanned(BOX_QUADS), header))
    for face in range(12):
        struct.pack_into("<H", data, 84 + 50 * face + 48, red)
    assert top(load_mesh(write_text(tmp_path / "model.stl", bytes(data)))) == [255, 0, 0]


def emissive(writer: GltfWriter, primitive: dict) -> None:
    parts = writer.header["materials"][0]
    parts["emissiveTexture"] = parts["pbrMetallicRoughness"].pop("baseColorTexture")
    parts["pbrMetallicRoughness"]["baseColorFactor"] = [0, 0, 0, 1]


def darkened(writer: GltfWriter, primitive: dict) -> None:
    writer.header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0, 0, 0, 1]


def glass(writer: GltfWriter, primitive: dict) -> None:
    writer.needs("KHR_materials_transmission", "KHR_materials_ior", "XX_unknown", used_only=True)


def test_what_a_gltf_shows_otherwise_is_said(subtests, tmp_path):
    for change, remark in (
        (emissive, "emissiveTexture of material '0' is taken for its base colour"),
        (darkened, "baseColorFactor of material '0' makes its picture black"),
        (glass, "extensions that are not read: KHR_materials_transmission, XX_unknown"),
    ):
        with subtests.test(change=change.__name__):
            mesh = load_mesh(write_gltf_box(tmp_path / "model.glb", change), up="z")
            assert len(mesh.remarks) == 1
            assert remark in mesh.remarks[0]
            assert change is darkened or shows_its_picture(mesh)


def test_hidden_nodes_are_left_out(tmp_path):
    writer = GltfWriter()
    shape = writer.mesh(box_primitive(writer, material=writer.material(encoded(quarters()))))
    writer.node(mesh=shape)
    below = writer.node(mesh=shape, root=False)
    hidden = {"KHR_node_visibility": {"visible": False}}
    writer.node(translation=[5, 0, 0], children=[below], extensions=hidden)
    writer.needs("KHR_node_visibility")
    mesh = load_mesh(writer.write(tmp_path / "model.glb"), up="z")
    np.testing.assert_allclose(mesh.extents, OBJ_SIDES, rtol=1e-6)
    assert "hidden nodes" in mesh.remarks[0]


def test_a_gltf_that_is_wholly_transparent_is_refused(tmp_path):
    def clear(writer: GltfWriter, primitive: dict) -> None:
        parts = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}, "alphaMode": "BLEND"}
        writer.header["materials"][0] = parts

    with pytest.raises(InputError, match="wholly transparent"):
        load_mesh(write_gltf_box(tmp_path / "model.glb", clear))


def test_gloss_becomes_metal_as_khronos_converts_it():
    """A dielectric keeps its colour; what reflects its colour and scatters nothing is a metal of it."""
    colour = np.full((1, 1, 4), (200, 30, 30, 255), dtype=np.uint8)
    texture, metallic = metal_of_gloss(colour, None, np.full(3, 0.04))
    np.testing.assert_allclose(texture[0, 0], colour[0, 0], atol=1)
    assert metallic is None
    gold = np.full((2, 2, 4), (255, 195, 86, 255), dtype=np.uint8)
    black = np.full((1, 1, 4), (0, 0, 0, 255), dtype=np.uint8)
    texture, metallic = metal_of_gloss(black, gold, np.ones(3))
    assert texture.shape == (2, 2, 4)
    np.testing.assert_allclose(texture[0, 0], gold[0, 0], atol=2)
    assert metallic.min() >= 250


@pytest.mark.parametrize(
    ("name", "content", "finding"),
    [
        ("a.obj", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "Git LFS"),
        ("a.glb", b"\n<!DOCTYPE html><html>", "web page"),
        ("a.ply", b"\x1f\x8b\x08", "gunzip"),
        ("a.obj", b"", "is empty"),
        ("a.obj", b"glTF\x02\0\0\0", "end in .glb"),
        ("a.stl", b"ply\nformat ascii 1.0\n", "end in .ply"),
        ("a.obj", b"Kaydara FBX Binary  \0", "end in .fbx"),
        ("a.obj", b"PK\x03\x04", "Unpack it"),
        ("a.ply", b"<?xml version='1.0'?><COLLADA>", "end in .dae"),
    ],
)  # fmt: skip
def test_files_that_are_no_mesh_are_named_with_the_remedy(tmp_path, name, content, finding):
    with pytest.raises(InputError, match=finding):
        load_mesh(write_text(tmp_path / name, content))


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb"])
def test_too_many_faces_are_refused_by_the_header(tmp_path, monkeypatch, suffix):
    """Nothing of it is read: the rest of the file is not what its kind has."""
    monkeypatch.setattr("objectfolder.making.mesh.readers.face_count.MOST_FACES", 11)
    monkeypatch.setattr("objectfolder.making.mesh.readers.face_count._CHUNK_BYTES", 7)
    monkeypatch.setattr("objectfolder.making.mesh.readers.load._READERS", {})
    faces = fanned(BOX_QUADS)
    path = tmp_path / f"model.{suffix}"
    writers = {
        "obj": lambda: lines_of_box(lambda lines: lines).encode(),
        "ply": lambda: ply_bytes(box(OBJ_SIDES), faces.tolist()),
        "stl": lambda: stl_bytes(box(OBJ_SIDES), faces),
        "glb": lambda: write_gltf_box(path).read_bytes(),
    }
    with pytest.raises(InputError, match="has 12 faces"):
        load_mesh(write_text(path, writers[suffix]()))
    assert Path(path).exists()
