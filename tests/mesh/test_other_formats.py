"""OFF, 3MF, COLLADA, and what Blender reads: units, the axis that is up, colours, and what is refused."""

import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hard_checks import BOX, colours_at
from hard_meshes import BOX_QUADS, OBJ_SIDES, box, encoded, quarters, write_text

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.face_count import face_count
from objectfolder.making.mesh.readers.load import load_mesh, source_files
from objectfolder.surface.textured_mesh import TexturedMesh

CORNERS = box(OBJ_SIDES)
POINTS, QUARTERS = (np.array(column) for column in zip(*BOX.colours, strict=True))
TOP, BOTTOM = CORNERS[BOX_QUADS[0]].mean(axis=0), CORNERS[BOX_QUADS[1]].mean(axis=0)
UV = "0 0 1 0 1 1 0 1"


def same_box(mesh: TexturedMesh, atol: float = 1e-9) -> None:
    """Hold positions and winding to those of the box."""
    x, y, z = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert np.einsum("fi,fi->", x, np.cross(y, z)) / 6 == pytest.approx(np.prod(OBJ_SIDES), rel=1e-5)
    used = np.unique(mesh.vertices[mesh.faces].reshape(-1, 3).round(7), axis=0)
    np.testing.assert_allclose(used, np.unique(CORNERS.round(7), axis=0), atol=atol)


def colour(mesh: TexturedMesh, point: np.ndarray) -> list[int]:
    return colours_at(mesh, point[None])[0].round().tolist()


def off_text(keyword: str, *, vertex: str = "", faces: tuple[str, ...] = ("",) * 6) -> str:
    rows = [" ".join(map(repr, corner.tolist())) + vertex for corner in CORNERS]
    rows += [f"4 {' '.join(map(str, quad))}{said}" for quad, said in zip(BOX_QUADS, faces, strict=True)]
    return f"{keyword}8 6 0\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("text", "top"),
    [
        (off_text("OFF\n# by hand\n"), [204, 204, 204]),
        (off_text("OFF"), [204, 204, 204]),
        (off_text("COFF\n", vertex=" 200 30 30 255"), [200, 30, 30]),
        (off_text("CNOFF\n", vertex=" 0 0 1 .5 0. 1. 1"), [128, 0, 255]),
        (off_text("OFF\n", faces=(" 0.2 0.4 0.6",) + ("",) * 5), [51, 102, 153]),
    ],
    ids=["plain", "counts behind the keyword", "colours of vertices", "with normals", "of one face"],
)
def test_off(tmp_path, text, top):
    mesh = load_mesh(write_text(tmp_path / "box.off", text))
    same_box(mesh)
    assert colour(mesh, TOP) == top


def three_mf(path: Path, *, unit: str = "millimeter", item: str = "", scale: float = 1000.0) -> Path:
    """A box of which one half is in a component of another part of the archive, textured on its top."""
    points = "".join('<vertex x="{!r}" y="{!r}" z="{!r}"/>'.format(*(scale * p).tolist()) for p in CORNERS)

    def mesh(quads: list[list[int]], properties: str) -> str:
        rows = "".join(
            f'<triangle v1="{q[0]}" v2="{q[a]}" v3="{q[b]}" {properties.format(0, a, b)}/>'
            for q in quads
            for a, b in ((1, 2), (2, 3))
        )
        return f"<mesh><vertices>{points}</vertices><triangles>{rows}</triangles></mesh>"

    model = (
        '<model unit="{}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
        'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" '
        'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"><resources>{}</resources>'
        "<build>{}</build></model>"
    )
    pairs = "".join(f'<m:tex2coord u="{u}" v="{v}"/>' for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)))
    corners = "pid='2' p1='{}' p2='{}' p3='{}'"
    top = (
        '<m:texture2d id="1" path="/3D/skin.png" contenttype="image/png"/>'
        f'<m:texture2dgroup id="2" texid="1">{pairs}</m:texture2dgroup>'
        f'<object id="7">{mesh(BOX_QUADS[:1], corners)}</object>'
    )
    rest = (
        '<basematerials id="5"><base name="red" displaycolor="#C81E1E"/></basematerials>'
        f'<object id="3" pid="5" pindex="0">{mesh(BOX_QUADS[1:], "")}</object>'
        '<object id="4"><components><component objectid="3"/>'
        '<component objectid="7" p:path="/3D/Objects/top.model"/></components></object>'
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", model.format(unit, rest, f'<item objectid="4" {item}/>'))
        archive.writestr("3D/Objects/top.model", model.format(unit, top, ""))
        archive.writestr("3D/skin.png", encoded(quarters()))
    return path


@pytest.mark.parametrize(
    ("unit", "scale", "item"),
    [
        ("millimeter", 1000.0, ""),
        ("inch", 1 / 0.0254, ""),
        ("meter", 0.5, 'transform="2 0 0 0 2 0 0 0 2 0 0 0"'),
        ("meter", 1.0, 'transform="-1 0 0 0 1 0 0 0 1 0 0 0"'),
    ],
)
def test_three_mf(tmp_path, unit, scale, item):
    path = three_mf(tmp_path / "box.3mf", unit=unit, item=item, scale=scale)
    mesh = load_mesh(path)
    same_box(mesh)
    assert source_files(path) == (path,)
    mirrored = POINTS * [-1 if "-1" in item else 1, 1, 1]
    np.testing.assert_allclose(colours_at(mesh, mirrored), QUARTERS, atol=1)
    assert colour(mesh, BOTTOM) == [200, 30, 30]


def dae_text(*, up: str = "Z_UP", metre: float = 1.0, kind: str = "polylist") -> str:
    """A box of polygons with its picture, and its last side of another material."""
    points = CORNERS / metre
    if up == "Y_UP":  # (x, y, z) of the file becomes (x, -z, y)
        points = points[:, [0, 2, 1]] * [1, 1, -1]
    numbers = " ".join(map(repr, points.reshape(-1).tolist()))

    def primitive(quads: list[list[int]], material: str) -> str:
        inputs = '<input semantic="VERTEX" source="#v" offset="0"/>'
        inputs += '<input semantic="TEXCOORD" source="#t" offset="1" set="0"/>'
        if kind == "triangles":
            loops = [[(q[k], k) for k in corner] for q in quads for corner in ((0, 1, 2), (0, 2, 3))]
        else:
            loops = [list(zip(q, range(4), strict=True)) for q in quads]
        rows = [" ".join(f"{v} {t}" for v, t in loop) for loop in loops]
        counts = f"<vcount>{' '.join(str(len(loop)) for loop in loops)}</vcount>" * (kind == "polylist")
        body = "".join(f"<p>{row}</p>" for row in rows) if kind == "polygons" else f"<p>{' '.join(rows)}</p>"
        return f'<{kind} count="{len(loops)}" material="{material}">{inputs}{counts}{body}</{kind}>'

    def effect(name: str, params: str, diffuse: str) -> str:
        technique = f'<technique sid="c"><lambert><diffuse>{diffuse}</diffuse></lambert></technique>'
        return f'<effect id="{name}-e"><profile_COMMON>{params}{technique}</profile_COMMON></effect>'

    sampler = (
        '<newparam sid="f"><surface type="2D"><init_from>skin</init_from></surface></newparam>'
        '<newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>'
    )
    texture = '<texture texture="s" texcoord="UVMap"/>'
    floats = '<source id="{0}"><float_array id="{0}-a" count="{1}">{2}</float_array><technique_common>'
    floats += '<accessor source="#{0}-a" count="{3}" stride="{4}">{5}</accessor></technique_common></source>'
    xyz, st = ("".join(f'<param name="{n}" type="float"/>' for n in names) for names in ("XYZ", "ST"))
    bind = "".join(
        f'<instance_material symbol="{name}" target="#{name}-m">'
        '<bind_vertex_input semantic="UVMap" input_semantic="TEXCOORD" input_set="0"/></instance_material>'
        for name in ("skin", "red")
    )
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset><unit name="u" meter="{metre}"/><up_axis>{up}</up_axis></asset>'
        '<library_images><image id="skin"><init_from>textures/skin.png</init_from></image></library_images>'
        f"<library_effects>{effect('skin', sampler, texture)}"
        f"{effect('red', '', '<color>0.6 0.2 0.4 1</color>')}</library_effects><library_materials>"
        '<material id="skin-m"><instance_effect url="#skin-e"/></material>'
        '<material id="red-m"><instance_effect url="#red-e"/></material></library_materials>'
        '<library_geometries><geometry id="g"><mesh>'
        f"{floats.format('p', 24, numbers, 8, 3, xyz)}{floats.format('t', 8, UV, 4, 2, st)}"
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f"{primitive(BOX_QUADS[:1], 'skin')}{primitive(BOX_QUADS[1:], 'red')}</mesh></geometry>"
        '</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">'
        f'<instance_geometry url="#g"><bind_material><technique_common>{bind}</technique_common>'
        "</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>"
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


@pytest.mark.parametrize(
    ("up", "metre", "kind"),
    [("Z_UP", 1.0, "polylist"), ("Y_UP", 0.01, "triangles"), ("Y_UP", 0.0254, "polygons")],
)
def test_collada(tmp_path, up, metre, kind):
    path = write_text(tmp_path / "box.dae", dae_text(up=up, metre=metre, kind=kind))
    picture = write_text(tmp_path / "textures" / "skin.png", encoded(quarters()))
    mesh = load_mesh(path)
    same_box(mesh, 1e-7)
    np.testing.assert_allclose(colours_at(mesh, POINTS), QUARTERS, atol=1)
    assert colour(mesh, BOTTOM) == [153, 51, 102]
    assert source_files(path) == (path, picture)


@pytest.mark.parametrize(
    ("name", "content", "finding"),
    [
        ("a.off", "OFF BINARY\n", "it does not begin with OFF, or is binary"),
        ("a.off", "OFF\n8 6 0\n0 0 0\n", "1 lines for 8 vertices and 6 faces"),
        ("a.off", "OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "names a vertex that is not there"),
        ("a.3mf", b"PK\3\4", "cannot be read as 3MF"),
        ("a.dae", '<!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>', "it declares a document type"),
        ("a.dae", "<COLLADA", "no XML"),
        ("a.dae", dae_text(), "'textures/skin.png', which is not there"),
        ("a.dae", dae_text().replace(" 7 2 ", " 9 2 "), "cannot be read as COLLADA"),
        pytest.param("a.fbx", "Kaydara FBX Binary", "cannot be read by Blender", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_what_is_not_whole_is_refused(tmp_path, name, content, finding):
    with pytest.raises(InputError, match=finding):
        load_mesh(write_text(tmp_path / name, content))


@pytest.mark.parametrize("suffix", [".off", ".3mf", ".dae"])
def test_faces_are_counted_before_anything_is_read(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"box{suffix}"
    if suffix == ".3mf":
        three_mf(path)
    else:
        write_text(path, off_text("OFF\n") if suffix == ".off" else dae_text())
    monkeypatch.setattr("objectfolder.making.mesh.readers.face_count._CHUNK_BYTES", 7)
    assert face_count(path) == (12 if suffix == ".3mf" else 6)


USD = """#usda 1.0
(
    defaultPrim = "box"
    metersPerUnit = 0.01
    upAxis = "Y"
)
def Mesh "box" {{
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = {indices}
    point3f[] points = [{points}]
    color3f[] primvars:displayColor = [(1, 0, 0)]
}}
"""
BLENDER = """
import bpy, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
mesh = bpy.data.meshes.new("box")
mesh.from_pydata({points}, [], {quads})
box = bpy.data.objects.new("box", mesh)
bpy.context.collection.objects.link(box)
material = bpy.data.materials.new("red")
material.use_nodes = True
material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (1, 0, 0, 1)
mesh.materials.append(material)
bpy.ops.export_scene.fbx(filepath="box.fbx")
bpy.context.scene.unit_settings.scale_length = 0.001
box.scale = (1000, 1000, 1000)
tree = material.node_tree
noise = tree.nodes.new("ShaderNodeTexNoise")
tree.links.new(noise.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])
bpy.ops.wm.save_as_mainfile(filepath="noise.blend")
"""


@pytest.mark.slow
def test_what_blender_reads_has_its_units_and_its_axis_up(tmp_path, subtests):
    """USD and FBX have y up and centimetres, the .blend file millimetres."""
    indices = [index for quad in BOX_QUADS for index in quad]
    turned = 100 * CORNERS[:, [0, 2, 1]] * [1, 1, -1]
    points = ", ".join(str(tuple(point)) for point in turned.tolist())
    write_text(tmp_path / "box.usda", USD.format(indices=indices, points=points))
    program = BLENDER.format(points=CORNERS.tolist(), quads=BOX_QUADS)
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True, capture_output=True)
    for name in ("box.usda", "box.fbx", "noise.blend"):
        with subtests.test(name=name):
            mesh = load_mesh(tmp_path / name)
            same_box(mesh, 1e-6)
            assert mesh.remarks[0].startswith("read by Blender")
            assert source_files(tmp_path / name) == (tmp_path / name,)
            if name == "noise.blend":
                assert "(Noise Texture): bake it" in mesh.remarks[1]
            else:
                assert colour(mesh, TOP) == [255, 0, 0]
                assert len(mesh.remarks) == 1
