"""PLY and STL files as users meet them: each comes out right or is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard_checks import BOX, GREY_BOX, PICTURE, Make, check, refused, single
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
    fanned,
    ply_bytes,
    stl_bytes,
    stl_text,
    write_text,
)

# PLY and STL


def as_ply(order: str, truth: Truth = GREY_BOX, **options: Any) -> Make:
    data = ply_bytes(box(OBJ_SIDES), BOX_QUADS, order, **options)
    return lambda folder: (write_text(folder / "model.ply", data), truth)


def triangles_and_quads(order: str) -> Make:
    polygons = [*BOX_QUADS[:3], *fanned(BOX_QUADS[3:]).tolist()]
    data = ply_bytes(box(OBJ_SIDES), polygons, order)
    return lambda folder: (write_text(folder / "model.ply", data), GREY_BOX)


def ply_with_texture(order: str) -> Make:
    def make(folder: Path) -> tuple[Path, Truth]:
        (folder / "my skin.png").write_bytes(PICTURE)
        corners = [QUAD_CORNERS] * 6
        data = ply_bytes(
            box(OBJ_SIDES), BOX_QUADS, order, corners=corners, comments=["TextureFile my skin.png"]
        )
        return write_text(folder / "model.ply", data), BOX

    return make


RED_TOP = tuple((point, RED) for point, _ in BOX.colours)
PLY: dict[str, Make] = {
    "text": as_ply(""),
    "little endian": as_ply("<"),
    "big endian": as_ply(">"),
    "big endian, single precision": as_ply(">", single(GREY_BOX), kind="float"),
    "other name of the list": as_ply("<", index_name="vertex_index"),
    "triangles and quads, text": triangles_and_quads(""),
    "triangles and quads, little endian": triangles_and_quads("<"),
    "triangles and quads, big endian": triangles_and_quads(">"),
    "texture, text": ply_with_texture(""),
    "texture, big endian": ply_with_texture(">"),
    "colours of vertices": as_ply("<", replace(BOX, colours=RED_TOP), colours=np.tile(RED, (8, 1))),
    "colours of faces": as_ply(
        ">", replace(BOX, colours=RED_TOP),
        face_colours=np.array([RED, GREEN, BLUE, WHITE, GREEN, GREEN]),
    ),
    "CRLF in the text": lambda folder: (
        write_text(folder / "model.ply", ply_bytes(box(OBJ_SIDES), BOX_QUADS, "").replace(b"\n", b"\r\n")),
        GREY_BOX,
    ),
    "another element first": lambda folder: (
        write_text(folder / "model.ply", ply_bytes(box(OBJ_SIDES), BOX_QUADS, "").replace(
            b"element vertex",
            b"element camera 2\nproperty float f\nproperty list uchar int k\nelement vertex",
        ).replace(b"end_header\n", b"end_header\n1.5 2 7 8\n2.5 0\n")),
        GREY_BOX,
    ),
}  # fmt: skip
FACES = fanned(BOX_QUADS)
BINARY, TEXT = stl_bytes(box(OBJ_SIDES), FACES), stl_text(box(OBJ_SIDES), FACES)


def as_stl(data: str | bytes, name: str = "m.stl") -> Make:
    truth = single(GREY_BOX) if isinstance(data, bytes) else GREY_BOX
    return lambda folder: (write_text(folder / name, data), truth)


STL: dict[str, Make] = {
    "binary": as_stl(BINARY),
    "binary that says solid": as_stl(stl_bytes(box(OBJ_SIDES), FACES, b"solid of facet endfacet")),
    "binary with more behind": as_stl(BINARY + b"\0" * 30),
    "text": as_stl(TEXT, "m.STL"),
    "text with lone CR": as_stl(TEXT.replace("\n", "\r")),
    "text in capitals": as_stl(TEXT.upper()),
    "text with a byte order mark": as_stl("\ufeff" + TEXT),
    "text that is called like its words": as_stl(
        stl_text(box(OBJ_SIDES), FACES, "facet vertex a b c endfacet")
    ),
    "two solids": as_stl(stl_text(box(OBJ_SIDES), FACES[:6]) + stl_text(box(OBJ_SIDES), FACES[6:])),
}


@pytest.mark.slow
def test_ply_and_stl_of_every_kind(subtests, tmp_path):
    for name in [*PLY, *(f"STL: {name}" for name in STL)]:
        with subtests.test(name=name):
            make = STL[name.removeprefix("STL: ")] if name.startswith("STL: ") else PLY[name]
            check(*make(tmp_path))


def test_ply_and_stl_that_are_refused(subtests, tmp_path):
    for name, data, said in [
        ("m.stl", BINARY[:-20], "says 12 triangles, more than it holds"),
        ("m.stl", TEXT[:-100], "facets"),
        ("m.stl", TEXT.replace("vertex", "vortex", 1), "35 vertices for 12"),
        ("m.stl", TEXT.replace("5.000000000e-02", "five", 1), "could not convert"),
        ("m.stl", stl_bytes(box(OBJ_SIDES, (3e4, 0, 0)), FACES), "so far from the origin"),
        ("m.ply", ply_bytes(box(OBJ_SIDES), BOX_QUADS, "<")[:-4], "it ends within 'face'"),
        ("m.ply", ply_bytes(box(OBJ_SIDES), BOX_QUADS, "")[:-4], "it ends within 'face'"),
        ("m.ply", ply_bytes(box(OBJ_SIDES), [[0, 1, 9]], "<"), "names a vertex that is not there"),
        ("m.ply", ply_bytes(box(OBJ_SIDES), [[0, 1]], "<"), "fewer than three corners"),
        (
            "m.ply",
            ply_bytes(box(OBJ_SIDES), BOX_QUADS, "<").replace(b"vertex 8", b"vertex 900000000"),
            "cannot hold 900000000",
        ),
        (
            "m.ply",
            ply_bytes(box(OBJ_SIDES), BOX_QUADS, "<").replace(b"element face", b"element tristrips"),
            "triangle strips",
        ),
        ("m.ply", ply_bytes(box(OBJ_SIDES), BOX_QUADS, "<").replace(b"double y", b"double w"), "no 'y'"),
        (
            "m.ply",
            ply_bytes(box(OBJ_SIDES), BOX_QUADS, "<", comments=["TextureFile ../x.png"]),
            "texture file does not exist",
        ),
    ]:
        with subtests.test(name=name):
            refused(write_text(tmp_path / name, data), said)


def test_errors_quote_little_of_a_file(subtests, tmp_path):
    for name, data in [
        ("m.obj", "v 0 0 " + 9000 * "[" + "\n"),
        ("m.obj", "v 0 0 0\nf " + 9000 * "9" + " 1 1\n"),
        ("m.stl", TEXT.replace("5.000000000e-02", 9000 * "x")),
        ("m.ply", ply_bytes(box(OBJ_SIDES), BOX_QUADS, "", comments=["TextureFile " + 9000 * "x"])),
        ("m.ply", ply_bytes(box(OBJ_SIDES), BOX_QUADS, "").replace(b"\n4 ", b"\n" + 9000 * b"x" + b" ")),
        ("m.gltf", '{"asset": {"version": "' + 9000 * "9" + '"}}'),
        ("m.gltf", '{"asset": {"version": "2.0"}, "meshes": [1], "nodes": [{"mesh": "' + 9000 * "9" + '"}]}'),
    ]:
        with subtests.test(name=name):
            problem = refused(write_text(tmp_path / name, data))
            assert len(problem.finding) < 400
