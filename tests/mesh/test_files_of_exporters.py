"""Files of many exporters whose looks or parts are easily read otherwise: right, or said, or refused."""

import re
import struct
import zipfile

import numpy as np
import pytest
from hard_checks import BOX, colours_at
from hard_meshes import (
    BOX_QUADS,
    OBJ_SIDES,
    QUAD_CORNERS,
    box,
    encoded,
    fanned,
    ply_bytes,
    quarters,
    stl_bytes,
    write_gltf_box,
    write_obj_box,
    write_text,
)
from test_other_formats import dae_text, off_text, three_mf

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.load import load_mesh, source_files

POINTS, QUARTERS = (np.array(column) for column in zip(*BOX.colours, strict=True))
LINEAR_RED = 0.5776  # 200 of 255
PLAIN = {"pbrMetallicRoughness": {}}


def coloured(rows, **options):
    def change(writer, primitive):
        primitive["attributes"]["COLOR_0"] = writer.accessor(np.tile(rows, (24, 1)), **options)
        writer.header["materials"][0] = PLAIN

    return change


def glowing(writer, primitive):
    parts = {"baseColorFactor": [0, 0, 0, 1]}
    writer.header["materials"][0] = {"pbrMetallicRoughness": parts, "emissiveFactor": [LINEAR_RED, 0, 0]}


@pytest.mark.parametrize(
    ("change", "remark"),
    [
        (coloured(np.array([[147, 0, 0]], dtype="u1")), ""),
        (coloured(np.array([[255 * LINEAR_RED, 0, 0]], dtype="<f4")), "taken to be in 0..255"),
        (coloured(np.array([[LINEAR_RED, 0, 0, 0.5]], dtype="<f4")), "the alpha of COLOR_0 is not used"),
        (glowing, "emissiveFactor of material '0' is taken for its base colour"),
    ],
)  # fmt: skip
def test_colours_of_a_gltf_without_a_picture(tmp_path, change, remark):
    mesh = load_mesh(write_gltf_box(tmp_path / "model.glb", change), up="z")
    np.testing.assert_allclose(colours_at(mesh, POINTS), np.tile([200, 0, 0], (4, 1)), atol=1)
    assert remark in "".join(mesh.remarks)
    assert bool(mesh.remarks) == bool(remark)


def test_scenes_and_animations_of_a_gltf_are_said(tmp_path):
    def change(writer, primitive):
        writer.header["scenes"].append({"nodes": [writer.node(root=False, mesh=0, translation=[9, 0, 0])]})
        writer.header["animations"] = [{"channels": [], "samplers": []}]

    mesh = load_mesh(write_gltf_box(tmp_path / "model.glb", change), up="z")
    np.testing.assert_allclose(mesh.extents, OBJ_SIDES, rtol=1e-6)
    assert [word in remark for word, remark in zip(("2 scenes", "rests"), mesh.remarks, strict=True)]


def test_a_gltf_as_text_under_a_binary_name_is_named(tmp_path):
    path = write_gltf_box(tmp_path / "model.gltf")
    with pytest.raises(InputError, match=r"end in \.gltf"):
        load_mesh(path.rename(tmp_path / "model.glb"))


@pytest.mark.parametrize("spaces", ["", " \t"])
def test_a_line_that_goes_on_in_the_next(tmp_path, spaces):
    def change(text):
        return text.replace("f 5/1 ", f"f \\{spaces}\n5/1 ") + "cstype bspline\nsurf 0 1 0 1 1 2 3 4\nend\n"

    library = f"newmtl skin\nmap_Kd \\{spaces}\n skin.png\n"
    mesh = load_mesh(write_obj_box(tmp_path, library=library, change=change))
    assert len(mesh.faces) == 12
    np.testing.assert_allclose(colours_at(mesh, POINTS), QUARTERS, atol=1)
    assert mesh.remarks == ("its free-form surfaces (surf) are left out",)


def test_an_stl_with_more_triangles_than_it_says(tmp_path):
    data = bytearray(stl_bytes(box(OBJ_SIDES), fanned(BOX_QUADS)))
    for count in (0, 6):
        data[80:84] = struct.pack("<I", count)
        mesh = load_mesh(write_text(tmp_path / "model.stl", bytes(data)))
        assert (len(mesh.faces), mesh.remarks) == (
            12, (f"it says {count} triangles and holds 12, which are read",),
        )  # fmt: skip
    data[80:84] = struct.pack("<I", 12)
    padded = load_mesh(write_text(tmp_path / "model.stl", bytes(data) + bytes(100)))
    assert (len(padded.faces), padded.remarks) == (12, ())


def changed(path, *pairs, **more):
    """A 3MF whose model has some words for others, and more files beside it."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    for old, new in pairs:
        assert old in parts["3D/3dmodel.model"]
        parts["3D/3dmodel.model"] = parts["3D/3dmodel.model"].replace(old, new)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (parts | more).items():
            archive.writestr(name, data)
    return path


def test_what_is_no_part_of_a_printed_solid(tmp_path):
    beside = b'<item objectid="4" transform="1 0 0 0 1 0 0 0 1 900 0 0" '
    path = changed(
        three_mf(tmp_path / "box.3mf"),
        (b"<build>", b'<build><item objectid="9"/>' + beside + b'printable="0"/>'),
        (b'<object id="4">', b'<object id="9" type="support"><components><component objectid="3"/>'
                             b'</components></object><object id="4">'),
    )  # fmt: skip
    mesh = load_mesh(path)
    np.testing.assert_allclose(mesh.extents, OBJ_SIDES, rtol=1e-9)
    assert mesh.remarks == (
        "items that are not to be printed are left out", "supports for printing are left out",
    )  # fmt: skip


def test_a_3mf_whose_shape_is_more_than_its_meshes_is_refused(tmp_path):
    space = b'xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02" '
    path = three_mf(tmp_path / "box.3mf")
    changed(path, (b"<model ", b"<model " + space + b'requiredextensions="p b" '))
    with pytest.raises(InputError, match="beamlattice"):
        load_mesh(path)
    settings = {"Metadata/model_settings.config": b'<part id="3" subtype="modifier_part"/>'}
    with pytest.raises(InputError, match="no part of the solid"):
        load_mesh(changed(three_mf(path), **settings))


def test_emission_and_transparency_of_a_collada(tmp_path):
    texture = '<diffuse><texture texture="s" texcoord="UVMap"/></diffuse>'
    emission = texture.replace("diffuse>", "emission>") + "<diffuse><color>0 0 0 1</color></diffuse>"
    clear = "<transparent opaque='A_ONE'><color>1 1 1 1</color></transparent>"
    clear += "<transparency><float>0.2</float></transparency>"
    write_text(tmp_path / "textures" / "skin.png", encoded(quarters()))
    text = dae_text()
    assert texture in text
    mesh = load_mesh(write_text(tmp_path / "box.dae", text.replace(texture, emission + clear)))
    np.testing.assert_allclose(colours_at(mesh, POINTS), QUARTERS, atol=1)
    assert mesh.remarks == (
        "emission is taken for the colour (diffuse), which is black",
        "its transparency is not read: it is drawn opaque",
    )


def with_vertices(text, *rows):
    """An OBJ whose vertices have more numbers behind x y z, the same ones in turn."""
    lines = text.splitlines()
    for index, line in enumerate(lines):
        if line.startswith("v "):
            lines[index] = f"{line} {rows[index % len(rows)]}"
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("rows", "colour", "remark"),
    [
        (["2"], [204, 204, 204], "weights (w) other than 1"),
        (["1"], [204, 204, 204], ""),
        (["1 0.4 0.2 0.6"], [102, 51, 153], "x y z w r g b"),
        (["0.4 0.2 0.6 1"], [102, 51, 153], "x y z r g b a"),
        (["0.4 0.2"], [204, 204, 204], "more numbers than"),
    ],
)  # fmt: skip
def test_numbers_behind_the_position_of_an_obj(tmp_path, rows, colour, remark):
    def change(text):
        return with_vertices(text.replace("usemtl skin\n", ""), *rows)

    mesh = load_mesh(write_obj_box(tmp_path, mtllib="", textured=False, change=change))
    np.testing.assert_allclose(mesh.extents, OBJ_SIDES, rtol=1e-12)
    np.testing.assert_allclose(colours_at(mesh, POINTS), np.tile(colour, (4, 1)), atol=1)
    remarks = [line for line in mesh.remarks if "texture coordinates" not in line]
    assert [remark in line for line in remarks] == [True] * bool(remark)


@pytest.mark.parametrize(
    ("library", "rows", "colour", "remark"),
    [
        ("Kd .8 .2 .2\nTr .6", [], [204, 51, 51], "write d"),
        ("Kd .8 .2 .2\nmap_Bump -clamp on nothing.png", [], [204, 51, 51], "not followed: -clamp on"),
        ("Kd .8 .2 .2", ["1 1 1"], [204, 51, 51], ""),
        ("Kd .8 .2 .2", ["0 .2 .4"], [0, 51, 102], "colours of its vertices are taken"),
        ("Kd 0 0 0\nKe .8 .2 .2", [], [204, 51, 51], "bright Ke"),
        ("Kd 0 0 0\nKa 1 1 1", [], [0, 0, 0], ""),
        ("Ka .8 .2 .2\nKs .5 .5 .5", [], [204, 51, 51], "bright Ka"),
    ],
)  # fmt: skip
def test_colours_of_an_obj_without_a_picture(tmp_path, library, rows, colour, remark):
    def change(text):
        return with_vertices(text, *rows) if rows else text

    mesh = load_mesh(write_obj_box(tmp_path, library=f"newmtl skin\n{library}\n", change=change))
    np.testing.assert_allclose(colours_at(mesh, POINTS), np.tile(colour, (4, 1)), atol=1)
    assert [remark in line for line in mesh.remarks] == [True] * bool(remark)


def test_what_an_obj_says_besides_its_faces(tmp_path):
    tiled = {"library": "newmtl skin\nmap_Kd skin.<UDIM>.png\n", "image": "skin.1001.png"}
    with pytest.raises(InputError, match=r"'skin\.<UDIM>\.png'.* Bake its tiles"):
        load_mesh(write_obj_box(tmp_path / "tiled", **tiled))

    def change(text):
        return with_vertices(text, "0 0 1").replace("\nf ", "\nfo ") + "call more.obj\n"

    mesh = load_mesh(write_obj_box(tmp_path / "old", change=change))
    np.testing.assert_allclose(colours_at(mesh, POINTS), QUARTERS, atol=1)
    assert [word in line for word, line in zip(("call", "not used"), mesh.remarks, strict=True)]


@pytest.mark.parametrize("name", [r"C:\scan\skin.png", "/home/ann/skin.png", '"skin.png"'])
def test_the_picture_of_any_format_is_found_by_its_name(tmp_path, subtests, name):
    for folder in ("", "textures/"):
        write_text(tmp_path / folder / "skin.png", encoded(quarters()))
        texts = {
            "box.ply": ply_bytes(
                box(OBJ_SIDES), BOX_QUADS, corners=[QUAD_CORNERS] * 6, comments=[f"TextureFile {name}"]
            ),
            "box.dae": dae_text().replace("textures/skin.png", name.strip('"')),
        }
        for file, text in texts.items():
            with subtests.test(file=file, folder=folder):
                path = write_text(tmp_path / file, text)
                np.testing.assert_allclose(colours_at(load_mesh(path), POINTS), QUARTERS, atol=1)
                assert source_files(path)[1:] == (tmp_path / folder / "skin.png",)
        (tmp_path / folder / "skin.png").unlink()


def ply_with(*pairs):
    text = ply_bytes(box(OBJ_SIDES), BOX_QUADS, "", colours=np.tile([200, 30, 30], (8, 1))).decode()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def test_colours_of_a_ply_that_are_said(tmp_path):
    white, faces = np.full((8, 3), 255), np.tile([200, 30, 30], (6, 1))
    both = ply_bytes(box(OBJ_SIDES), BOX_QUADS, colours=white, face_colours=faces)
    clear = ply_with(("blue\n", "blue\nproperty uchar alpha\n"), (" 200 30 30", " 200 30 30 60"))
    for data, remark in ((both, "those of faces are taken"), (clear, "alpha of its colours is not used")):
        mesh = load_mesh(write_text(tmp_path / "box.ply", data))
        np.testing.assert_allclose(colours_at(mesh, POINTS), np.tile([200, 30, 30], (4, 1)), atol=1)
        assert [remark in line for line in mesh.remarks] == [True]
    made_of = "element material 1\nproperty uchar diffuse_red\nelement face"
    text = ply_bytes(box(OBJ_SIDES), BOX_QUADS, "").decode().replace("element face", made_of)
    text = text.replace("\n4 4 5 7 6\n", "\n200\n4 4 5 7 6\n")
    assert load_mesh(write_text(tmp_path / "box.ply", text)).remarks == (
        "its materials are not read: it is drawn grey",
    )
    strips = ply_with(("end_header", "element tristrips 1\nproperty list int int vertex_indices\nend_header"))
    with pytest.raises(InputError, match="triangle strips"):
        load_mesh(write_text(tmp_path / "box.ply", f"{strips}4 0 1 2 3\n"))


def test_colours_of_an_off_and_of_a_3mf_that_are_said(tmp_path):
    numbered = load_mesh(write_text(tmp_path / "a.off", off_text("OFF\n", faces=(" 3",) * 6)))
    clear = load_mesh(write_text(tmp_path / "b.off", off_text("COFF\n", vertex=" 200 30 30 60")))
    path = three_mf(tmp_path / "box.3mf")
    changed(path, (b"#C81E1E", b"#C81E1E40"), (b"<triangle ", b"<triangle paint_color='8' "))
    remarks = [line for mesh in (numbered, clear, load_mesh(path)) for line in mesh.remarks]
    assert [word in line for word, line in zip(("table", "alpha", "painted", "alpha"), remarks, strict=True)]


def test_materials_of_a_collada_that_no_node_binds(tmp_path):
    write_text(tmp_path / "textures" / "skin.png", encoded(quarters()))
    unbound = re.sub("<bind_material>.*</bind_material>", "", dae_text())
    mesh = load_mesh(write_text(tmp_path / "box.dae", unbound))
    assert [name in line for name, line in zip(("'skin'", "'red'"), mesh.remarks, strict=True)]
    by_id = unbound.replace('material="skin"', 'material="skin-m"').replace(
        'material="red"', 'material="red-m"'
    )
    mesh = load_mesh(write_text(tmp_path / "box.dae", by_id))
    np.testing.assert_allclose(colours_at(mesh, POINTS), QUARTERS, atol=1)
    assert mesh.remarks == ()


@pytest.mark.parametrize("value", [1, 0])
def test_colours_of_vertices_of_a_collada(tmp_path, value):
    """White ones say nothing; others are taken, and not the material's."""
    names = "".join(f'<param name="{name}" type="float"/>' for name in "RGB")
    source = (
        f'<source id="c"><float_array id="d" count="24">{f"{value} " * 24}</float_array><technique_common>'
    )
    source += f'<accessor source="#d" count="8" stride="3">{names}</accessor></technique_common></source>'
    position = '<vertices id="v"><input semantic="POSITION" source="#p"/>'
    text = dae_text().replace(position, f'{source}{position}<input semantic="COLOR" source="#c"/>')
    text = text.replace('<texture texture="s" texcoord="UVMap"/>', "<color>0.6 0.2 0.4 1</color>")
    mesh = load_mesh(write_text(tmp_path / "box.dae", text))
    colour = [153, 51, 102] if value else [0, 0, 0]
    np.testing.assert_allclose(colours_at(mesh, POINTS), np.tile(colour, (4, 1)), atol=1)
    assert len(mesh.remarks) == 1 - value
