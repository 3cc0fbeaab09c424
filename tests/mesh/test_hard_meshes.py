"""OBJ files, their libraries and the dirt of scans as users meet them: each comes out right or is refused."""

import unicodedata
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard_checks import BOX, GREY_BOX, PICTURE, Make, as_obj, check, colours_at, refused
from hard_meshes import (
    BLUE,
    BOX_QUADS,
    GREEN,
    OBJ_SIDES,
    QUAD_CORNERS,
    RED,
    WHITE,
    Truth,
    box,
    box_truth,
    encoded,
    fanned,
    obj_text,
    quarters,
    write_obj_box,
    write_text,
)
from small_meshes import sphere

from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.mesh.readers.load import load_mesh, source_files
from objectfolder.surface.integrals import solid_properties
from objectfolder.surface.textured_mesh import textured_mesh_of

# OBJ as text


def rewritten(change: Callable[[str], str | bytes], truth: Truth = BOX) -> Make:
    return lambda folder: (write_obj_box(folder, change=change), truth)


def negative(text: str) -> str:
    """Indices that count back from where they stand."""
    return "\n".join(
        "f " + " ".join("/".join(str(int(n) - c - 1) for n, c in zip(w.split("/"), (8, 4), strict=True))
                        for w in line.split()[1:])
        if line.startswith("f ") else line for line in text.split("\n")
    )  # fmt: skip


def with_groups(text: str) -> str:
    """Objects, groups and smoothing between the faces, statements of other kinds, tabs and comments."""
    lines = ["# a box", "s off", "vp 0.1 0.2", "vn 0 0 1"]
    for line in text.split("\n"):
        if line.startswith("f "):
            lines += [f"o part {len(lines)}", f"g left right{len(lines)}", "s 1"]
            line = "\t" + line.replace(" ", "\t  ") + " # a face"
        lines.append(line)
    return "\n".join([*lines, "l 1 2", "p 1", "unknown statement"])


TEXTS: dict[str, Make] = {
    "as it should be": rewritten(str),
    "CRLF": rewritten(lambda text: text.replace("\n", "\r\n")),
    "lone CR": rewritten(lambda text: text.replace("\n", "\r")),
    "byte order mark": rewritten(lambda text: b"\xef\xbb\xbf" + text.encode()),
    "byte order mark before a vertex": lambda folder: (
        write_text(folder / "model.obj", "\ufeff" + obj_text(box(OBJ_SIDES), BOX_QUADS, material="")),
        GREY_BOX,
    ),
    "UTF-16": rewritten(lambda text: text.encode("utf-16")),
    "negative indices": rewritten(negative),
    "groups, other statements, tabs and comments": rewritten(with_groups),
    "lines that go on": rewritten(lambda text: text.replace("v -", "v \\\n-").replace(" 3/", " \\\r\n3/")),
    "exponents and signs": lambda folder: (write_obj_box(folder, digits="+.9E"), BOX),
    "no end of line": rewritten(str.rstrip),
    "control characters at the end": rewritten(lambda text: text + "\x1a"),
    "comment behind the library": rewritten(lambda text: text.replace("model.mtl", "model.mtl # skins")),
    "comment behind the material": rewritten(lambda text: text.replace("usemtl skin", "usemtl skin # one")),
    "library named twice": rewritten(lambda text: text + "mtllib model.mtl\n"),
    "library named at the end and indented": rewritten(
        lambda text: text.replace("mtllib model.mtl\n", "") + "  mtllib\tmodel.mtl\n"
    ),
}  # fmt: skip


def test_an_obj_in_any_writing(subtests, tmp_path_factory):
    for name in TEXTS:
        with subtests.test(name=name):
            tmp_path = tmp_path_factory.mktemp("case")
            check(*TEXTS[name](tmp_path))


# Material libraries, names and folders


def library(**options: Any) -> Make:
    return lambda folder: (write_obj_box(folder, **options), BOX)


NFC, NFD = unicodedata.normalize("NFC", "Häuschen 木.png"), unicodedata.normalize("NFD", "Häuschen 木.png")
assert NFC != NFD
LIBRARIES: dict[str, Make] = {
    "space behind the name": library(library="newmtl skin\nmap_Kd skin.png \n"),
    "byte order mark": library(library=b"\xef\xbb\xbfnewmtl skin\nmap_Kd skin.png\n"),
    "lone CR": library(library="newmtl skin\rKd 1 1 1\rmap_Kd skin.png\r"),
    "Latin-1 comment": library(library=b"# gr\xfc\xdfe\nnewmtl skin\nmap_Kd skin.png\n"),
    "Latin-1 names": library(
        library="newmtl Möbel\nmap_Kd größe.png\nnewmtl Mäbel\nKd 1 0 0\n".encode("latin-1"),
        image="größe.png",
        material="Möbel",
        change=lambda text: text.encode("latin-1"),
    ),
    "names that are not ASCII": library(
        library=f"newmtl 木 目\nmap_Kd {NFC}\n", image=NFC, material="木 目",
        mtllib="möbel 1.mtl", library_file="möbel 1.mtl",
    ),
    "accents written in two ways": library(library=f"newmtl skin\nmap_Kd {NFC}\n", image=NFD),
    "other case": library(library="newmtl skin\nmap_Kd Textures\\SKIN.PNG\n", image="textures/skin.png",
                          mtllib="Model.MTL"),
    "spaces": library(library="newmtl my skin\nmap_Kd my skin (1).png\n", image="my skin (1).png",
                      material="my skin", mtllib="my model.mtl", library_file="my model.mtl"),
    "hash signs": library(library="newmtl skin#2\nmap_Kd #1 skin#2.png\nnewmtl skin#3\nKd 0 1 0\n",
                          image="#1 skin#2.png", material="skin#2", mtllib="model#1.mtl",
                          library_file="model#1.mtl"),
    "comment behind the texture": library(library="newmtl skin # s\nmap_Kd skin.png # the skin\n"),
    "path of Windows": library(library="newmtl skin\nmap_Kd C:\\Users\\me\\skin.png\n"),
    "relative path of Windows": library(library="newmtl skin\nmap_Kd ..\\images\\skin.png\n",
                                        image="../images/skin.png"),
    "path from another computer": library(library="newmtl skin\nmap_Kd /home/me/scans/skin.png\n"),
    "Fuel's folders": library(library="newmtl skin\nmap_Kd skin.png\n",
                              image="../materials/textures/skin.png"),
    "folder of textures": library(library="newmtl skin\nmap_Kd skin.png\n", image="textures/skin.png"),
    "library in a folder": library(library="newmtl skin\nmap_Kd skin.png\n", image="parts/skin.png",
                                   mtllib="parts\\model.mtl", library_file="parts/model.mtl"),
    "options": library(library="newmtl skin\nmap_Kd -S 1 1 1 -o 0 0 0 -bm 0.5 -clamp off skin.png\n"),
    "two libraries": library(library="newmtl skin\nmap_Kd skin.png\n", mtllib="model.mtl model.mtl"),
    "name of Blender's": library(mtllib="textured.obj.mtl", library_file="textured.obj.mtl"),
}  # fmt: skip


@pytest.mark.slow
def test_a_material_library_in_any_writing(subtests, tmp_path_factory):
    for name in LIBRARIES:
        with subtests.test(name=name):
            tmp_path = tmp_path_factory.mktemp("case")
            path, truth = LIBRARIES[name](tmp_path)
            check(path, truth)
            files = source_files(path)
            assert len(files) == 3
            assert {file.suffix.lower() for file in files} == {".obj", ".mtl", ".png"}


def test_a_line_of_a_material_library_that_is_refused(subtests, tmp_path_factory):
    for line, said in [
        ("map_Kd -o", "names no texture after its options"),
        ("map_Kd -s 1 1 1", "names no texture after its options"),
        ("map_Kd -clamp on", "names no texture after its options"),
        ("map_Kd -S 2 2 1 skin.png", "option -S 2 2 1 is not supported"),
        ("map_Kd ../../outside.png", "lies outside of the folders of the object"),
        ("map_Kd ../../../../../../../../etc/passwd", "lies outside"),
        ("map_Kd /etc/passwd", "lies outside"),
        ("map_Kd " + 5000 * "x" + ".png", "which is not there"),
        ("map_Kd \x00.png", "which is not there"),
        ("map_Kd .", "which is not there"),
        ("map_d -imfchan m nowhere.png", "which is not there"),
    ]:
        with subtests.test(line=line):
            tmp_path = tmp_path_factory.mktemp("case")
            path = write_obj_box(tmp_path / "a", library=f"newmtl skin\n{line}\n")
            (tmp_path / "outside.png").write_bytes(PICTURE)
            problem = refused(path, said)
            assert "model.mtl line 2" in problem.where
            assert check_shape_alone(path)


def check_shape_alone(path: Path) -> bool:
    return ingest_object(path, object_id="hard", with_textures=False).attributes["solid"]["meaningful"]


def test_a_material_that_its_library_does_not_define_is_refused(tmp_path):
    path = write_obj_box(tmp_path, library="newmtl other\nKd 1 0 0\n")
    refused(path, "uses the material 'skin', which its material library does not define")
    without = write_obj_box(tmp_path / "without", mtllib="")
    assert ingest_object(without, object_id="hard")["texture_0"].tolist() == [[[204, 204, 204, 255]]]


def test_several_materials_and_textures_in_one_file(tmp_path):
    """A box whose six sides have a texture, two colours, an alpha map and a second texture."""
    (tmp_path / "skin.png").write_bytes(PICTURE)
    (tmp_path / "other.webp").write_bytes(encoded(quarters()[::-1], "WEBP", lossless=True))
    (tmp_path / "holes.png").write_bytes(encoded(np.tile(np.array([[0, 128, 255, 255]], np.uint8), (4, 1))))
    (tmp_path / "parts.mtl").write_text(
        "newmtl a\nmap_Kd skin.png\nnewmtl b\nKd 1 0 0\nnewmtl c\nKd 0 0 1\nd 0.5\n"
        "newmtl d\nmap_Kd skin.png\nmap_d holes.png\nnewmtl e\nmap_Kd other.webp\n"
    )
    lines = obj_text(box(OBJ_SIDES), BOX_QUADS, head="mtllib parts.mtl", material="").splitlines()
    names = iter("abcdeb")
    text = "\n".join(f"usemtl {next(names)}\n{line}" if line.startswith("f ") else line for line in lines)
    path = write_text(tmp_path / "model.obj", text)
    product = check(path, BOX)
    mesh = textured_mesh_of(product)
    assert np.bincount(mesh.face_texture).tolist() == [2, 4, 2, 2, 2]
    alphas = [sorted(set(texture[..., 3].reshape(-1).tolist())) for texture in mesh.textures]
    assert alphas == [[255], [255], [128], [0, 128, 255], [255]]
    x, y, z = np.array(OBJ_SIDES) / 2
    # The sides towards -y, +y, -x and +x; u of the second and third is along z.
    points = [[0, -y, 0], [0.5 * x, y, 0.5 * z], [-x, 0.5 * y, -0.5 * z], [x, 0, 0]]
    np.testing.assert_allclose(colours_at(mesh, np.array(points)), [(0, 0, 255), GREEN, BLUE, (255, 0, 0)])


# Texture coordinates


@pytest.mark.parametrize(("low", "high"), [(-6.1, 11.4), (0.0, 1.0), (100.0, 103.0), (-0.5, 0.5)])
def test_textures_repeat(tmp_path, low, high):
    path = write_obj_box(tmp_path, scale_uv=high - low, shift_uv=low)
    mesh = textured_mesh_of(ingest_object(path, object_id="hard"))
    assert mesh.texture_coordinates.min() == pytest.approx(low)
    assert mesh.texture_coordinates.max() == pytest.approx(high)
    share = np.random.default_rng(0).random((200, 2))
    u, v = (low + (high - low) * share).T
    # Where the lookup is a texel away from the borders of quarters, it is exact.
    clear = (np.abs((u * 2) % 1 - 0.5) < 0.4) & (np.abs((v * 2) % 1 - 0.5) < 0.4)
    right, above = (u % 1 > 0.5), (v % 1 > 0.5)
    expected = np.where(
        above[:, None], np.where(right[:, None], GREEN, RED), np.where(right[:, None], WHITE, BLUE)
    )
    points = np.column_stack([(share - 0.5) * OBJ_SIDES[:2], np.full(200, OBJ_SIDES[2] / 2)])
    np.testing.assert_allclose(colours_at(mesh, points)[clear], expected[clear], atol=1)
    assert clear.sum() > 100


# Solids of several parts, open surfaces, and vertices that do not fit: the dirt of real scans


def several(*parts: tuple[np.ndarray, list[list[int]]]) -> tuple[np.ndarray, list[list[int]]]:
    vertices, polygons, offset = [], [], 0
    for part, faces in parts:
        vertices.append(part)
        polygons += [[offset + vertex for vertex in face] for face in faces]
        offset += len(part)
    return np.concatenate(vertices), polygons


def inverted(polygons: list[list[int]]) -> list[list[int]]:
    return [polygon[::-1] for polygon in polygons]


def split_at_seams(folder: Path) -> tuple[Path, Truth]:
    """As copies for MuJoCo have them: as many `v` as `vt`, in six decimals, all edges of the file open."""
    lines = ["mtllib material_0.mtl"]
    quads = box(OBJ_SIDES)[np.array(BOX_QUADS)]
    for index, quad in enumerate(quads.reshape(-1, 3)):
        lines.append("v {:.6f} {:.6f} {:.6f}".format(*quad))
        lines.append("vt {:.6f} {:.6f}".format(*QUAD_CORNERS[index % 4]))
    lines.append("usemtl material_0")
    lines += [f"f {i}/{i} {j}/{j} {k}/{k}" for start in range(1, 25, 4)
              for i, j, k in ((start, start + 1, start + 2), (start, start + 2, start + 3))]  # fmt: skip
    (folder / "skin.png").write_bytes(PICTURE)
    write_text(folder / "material_0.mtl", "newmtl material_0\nmap_Kd skin.png\n")
    return write_text(folder / "model.obj", "\n".join(lines)), box_truth(OBJ_SIDES, faces=12)


def rounded_sphere(folder: Path) -> tuple[Path, Truth]:
    """A fine ball in decimals so coarse that vertices meet, faces collapse and some lie back to back."""
    vertices, faces = sphere(0.05, 5)
    path = write_text(
        folder / "model.obj", obj_text(vertices, faces.tolist(), material="", textured=False, digits=".3f")
    )
    rounded = np.round(vertices, 3)
    volume = solid_properties(rounded, faces).volume_m3
    assert volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=0.01)
    return path, Truth(volume, 4 * np.pi * 0.05**2, (0.1, 0.1, 0.1), tolerance=0.05)


def scattered(folder: Path) -> tuple[Path, Truth]:
    """Vertices, coordinates and normals in different numbers and orders, most of them not used."""
    random = np.random.default_rng(5)
    vertices, order = box(OBJ_SIDES), random.permutation(40)
    stray = np.concatenate([vertices, random.uniform(-0.01, 0.01, (32, 3))])[order]
    place = np.argsort(order)
    coordinates = np.concatenate([QUAD_CORNERS, random.random((60, 2))])[::-1]
    lines = ["mtllib model.mtl", "usemtl skin"]
    lines += ["v {:.9f} {:.9f} {:.9f}".format(*vertex) for vertex in stray]
    lines += ["vt {:.6f} {:.6f} 0.0".format(*pair) for pair in coordinates]
    lines += ["vn 0 0 1"] * 77
    lines += ["f " + " ".join(f"{place[v] + 1}/{64 - i}/{i + 7}" for i, v in enumerate(q)) for q in BOX_QUADS]
    (folder / "skin.png").write_bytes(PICTURE)
    write_text(folder / "model.mtl", "newmtl skin\nmap_Kd skin.png\n")
    return write_text(folder / "model.obj", "\n".join(lines)), BOX


def cube_grid(count: int, side: float = 0.01, step: float = 0.02) -> tuple[np.ndarray, list[list[int]]]:
    places = step * np.stack(np.unravel_index(np.arange(count), (10, 10, 12)), axis=1)
    return several(*((box((side, side, side), place), BOX_QUADS) for place in places))


def boards() -> tuple[np.ndarray, list[list[int]], Truth]:
    """Furniture: five boards of a cabinet that pass through one another, each without its end face."""
    parts = [(box((0.6, 0.4, 0.02), (0, 0, z)), BOX_QUADS[:5]) for z in (0.0, 0.4, 0.8)] + [
        (box((0.02, 0.4, 0.8), (x, 0, 0.4)), BOX_QUADS[1:]) for x in (-0.3, 0.3)
    ]
    area = 3 * (2 * 0.24 + 0.024 + 0.008) + 2 * (2 * 0.32 + 2 * 0.016 + 0.008)
    vertices, polygons = several(*parts)
    return vertices, polygons, Truth(None, area, (0.62, 0.4, 0.82), components=5, watertight=False)


BALL, BALL_FACES = sphere(0.05, 3)
BALL_VOLUME = solid_properties(BALL, BALL_FACES).volume_m3
BALL_AREA = float(np.linalg.norm(np.cross(*(BALL[BALL_FACES[:, k]] - BALL[BALL_FACES[:, 0]] for k in (1, 2))),
                                 axis=1).sum() / 2)  # fmt: skip
TWO_TOUCHING = several((box((0.1, 0.1, 0.1)), BOX_QUADS), (box((0.1, 0.1, 0.1), (0.1, 0.1, 0)), BOX_QUADS))
DIRT: dict[str, Make] = {
    "open boards of furniture": as_obj(*boards()),
    "cavity": as_obj(
        *several((BALL, BALL_FACES.tolist()), (0.9 * BALL, inverted(BALL_FACES.tolist()))),
        Truth(BALL_VOLUME * (1 - 0.9**3), BALL_AREA * 1.81, (0.1, 0.1, 0.1), components=2),
        textured=False,
    ),
    "several closed pieces": as_obj(
        *several((box((0.1, 0.1, 0.1)), BOX_QUADS), (box((0.1, 0.1, 0.02), (0, 0, 0.09)), BOX_QUADS)),
        Truth(1.2e-3, 0.06 + 0.028, (0.1, 0.1, 0.15), components=2),
    ),
    "hole cut open": as_obj(
        BALL, BALL_FACES[16:].tolist(),
        Truth(None, BALL_AREA, (0.1, 0.1, 0.1), watertight=False, tolerance=0.1), textured=False,
    ),
    "inside out": as_obj(box(OBJ_SIDES), inverted(BOX_QUADS), GREY_BOX),
    "some faces turned": as_obj(box(OBJ_SIDES), [*BOX_QUADS[:4], *inverted(BOX_QUADS[4:])], GREY_BOX),
    "seams of MuJoCo": split_at_seams,
    "coarse decimals": rounded_sphere,
    "scattered vertices": scattered,
    "few triangles on large faces": as_obj(
        box((1.1, 0.6, 0.02)), BOX_QUADS, box_truth((1.1, 0.6, 0.02), coloured=False, faces=12)
    ),
    "240 pieces": as_obj(
        *cube_grid(240), Truth(240e-6, 240 * 6e-4, (0.03, 0.19, 0.23), components=240), textured=False
    ),
    "1,200 pieces": as_obj(
        *cube_grid(1200), Truth(1200e-6, 1200 * 6e-4, (0.19, 0.19, 0.23), components=1200), textured=False
    ),
    "24 m": as_obj(box((24.0, 3.0, 5.0)), BOX_QUADS,
                   box_truth((24.0, 3.0, 5.0), coloured=False, length_m=24.0)),
    "far from the origin": as_obj(
        box((0.1, 0.08, 0.06), (4e5, 5.2e6, 120.0)), BOX_QUADS,
        box_truth((0.1, 0.08, 0.06), coloured=False, tolerance=1e-6),
    ),
    "in micrometres": as_obj(
        box((1e5, 8e4, 6e4), (1e9, 0, 0)), BOX_QUADS, box_truth(OBJ_SIDES, coloured=False, length_m=0.1)
    ),
}  # fmt: skip


MANY = pytest.param("1,200 pieces", marks=pytest.mark.release("objectfolder.making.mesh"))


@pytest.mark.parametrize("name", [name for name in DIRT if name not in MANY.values] + [MANY])
def test_the_dirt_of_real_scans(name, tmp_path):
    check(*DIRT[name](tmp_path))


def test_parts_that_touch_along_an_edge_are_reported(tmp_path):
    """Two boxes with one edge in common: no solid has an edge of four faces, and the report says so."""
    vertices, polygons = TWO_TOUCHING
    path = write_text(tmp_path / "model.obj", obj_text(vertices, polygons, material=""))
    attributes = ingest_object(path, object_id="hard").attributes
    assert attributes["topology"]["non_manifold_edges"] == 1
    assert attributes["topology"]["boundary_edges"] == 0
    assert any("1 non-manifold edges" in warning for warning in attributes["warnings"])
    assert attributes["solid"]["volume_m3"] == pytest.approx(2e-3)


def test_parts_that_share_a_whole_face_are_one_solid(tmp_path):
    """Two boxes side by side: the face between them is there twice, back to back, and encloses nothing."""
    # Both faces are cut along the same diagonal.
    top, sides = [[4, 5, 7], [4, 7, 6]], fanned(BOX_QUADS[2:]).tolist()
    vertices, polygons = several(
        (box((0.1, 0.1, 0.1)), [[0, 2, 3], [0, 3, 1], *top, *sides]),
        (box((0.1, 0.1, 0.1), (0, 0, 0.1)), [[0, 3, 1], [0, 2, 3], *top, *sides]),
    )
    path = write_text(tmp_path / "model.obj", obj_text(vertices, polygons, material="", textured=False))
    product = check(path, Truth(2e-3, 0.1, (0.1, 0.1, 0.2), faces=20))
    assert product.attributes["cleaning"]["folded_faces_dropped"] == 4


def test_more_libraries_than_are_read_are_refused_before_one_is_opened(tmp_path):
    path = write_obj_box(tmp_path, mtllib="\nmtllib ".join(f"{number}.mtl" for number in range(101)))
    refused(path, "names 101 material libraries, more than 100")


def test_more_pieces_than_an_object_has_are_refused(tmp_path):
    """Triangles whose corners differ in the last digit: none shares any with another."""
    vertices, faces = sphere(0.05, 5)
    corners = vertices[faces[:2400]].reshape(-1, 3)
    corners += np.random.default_rng(0).normal(scale=1e-9, size=corners.shape)
    polygons = np.arange(len(corners)).reshape(-1, 3).tolist()
    path = write_text(tmp_path / "model.obj", obj_text(corners, polygons, material="", textured=False))
    refused(path, "falls into 2400 pieces", "Merge vertices by distance")


def test_a_file_larger_than_memory_is_refused_unread(tmp_path, monkeypatch):
    path = write_obj_box(tmp_path)
    monkeypatch.setattr(Path, "read_bytes", lambda path: pytest.fail(f"read {path}"))
    with path.open("ab") as file:
        file.truncate(2**28 + 1)
    refused(path, "has 268435457 bytes, more than the 268435456 that are read")


def test_coordinates_that_no_length_explains_are_refused(tmp_path):
    text = obj_text(box(OBJ_SIDES), BOX_QUADS, material="", digits=".2f")
    far = write_text(tmp_path / "far.obj", text.replace("v -0.05", "v -1e300", 1))
    refused(far, "coordinate of 1e+300")
    tiny = obj_text(1e-200 * box(OBJ_SIDES), BOX_QUADS, material="")
    refused(write_text(tmp_path / "tiny.obj", tiny), "long in its own unit")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF", "BMP", "TGA", "GIF", "PPM"])
def test_textures_of_every_kind_and_nothing_that_starts_a_program(tmp_path, kind):
    path = write_obj_box(tmp_path)
    (path.parent / "skin.png").write_bytes(encoded(quarters(), kind))
    mesh = load_mesh(path)
    np.testing.assert_allclose(mesh.textures[0][4, 4, :3], RED, atol=12)
    (path.parent / "skin.png").write_bytes(encoded(quarters(), "EPS"))
    refused(path, "not a readable image", "no known kind")


def test_a_picture_with_more_text_than_it_may_have_is_refused(tmp_path):
    from PIL import Image, PngImagePlugin

    path = write_obj_box(tmp_path)
    said = PngImagePlugin.PngInfo()
    said.add_text("bomb", "x" * (3 * 2**20), zip=True)
    Image.fromarray(quarters()).save(path.parent / "skin.png", pnginfo=said)
    refused(path, "not a readable image")
