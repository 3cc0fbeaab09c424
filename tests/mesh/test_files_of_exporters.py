"""Files of many exporters whose looks or parts are easily read otherwise: right, or said, or refused."""

import struct
import zipfile

import numpy as np
import pytest
from hard_checks import BOX, colours_at
from hard_meshes import (
    BOX_QUADS,
    OBJ_SIDES,
    box,
    encoded,
    fanned,
    quarters,
    stl_bytes,
    write_gltf_box,
    write_obj_box,
    write_text,
)
from test_other_formats import dae_text, three_mf

from objectfolder.errors import InputError
from objectfolder.mesh.readers.load import load_mesh

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
