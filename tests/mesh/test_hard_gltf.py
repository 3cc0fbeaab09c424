"""glTF files as users meet them: each comes out right, held against what is true of it, or is refused."""

import base64
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard_checks import BOX, GREY_BOX, PICTURE, SINGLE, Make, check, colours_at, refused, single
from hard_meshes import (
    BOX_QUADS,
    OBJ_SIDES,
    RED,
    GltfWriter,
    Truth,
    box,
    box_corners,
    box_primitive,
    encoded,
    fanned,
    quarters,
    write_gltf_box,
    write_obj_box,
    write_text,
)

from objectfolder.errors import InputError
from objectfolder.export.files import Credit
from objectfolder.export.gltf import Part, write_glb
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.mesh.readers.load import load_mesh, source_files
from objectfolder.surface.textured_mesh import textured_mesh_of
from objectfolder.vision.appearance import Appearance

# glTF


def gltf(change: Callable[[GltfWriter, dict[str, Any]], None] | None = None, *, truth: Truth = BOX,
         suffix: str = ".glb", image: bytes | str | None = None, **node: Any) -> Make:  # fmt: skip
    return lambda folder: (write_gltf_box(folder / f"model{suffix}", change, image=image, **node), truth)


def quantised(positions: str, coordinates: str, *, normalised: bool) -> Make:
    """Positions in steps of a whole type, brought back by the node; coordinates likewise."""

    def change(writer: GltfWriter, primitive: dict[str, Any]) -> None:
        corners, uv, _ = box_corners(OBJ_SIDES)
        dtype = np.dtype(positions)
        most = np.iinfo(dtype).max
        low = -most if dtype.kind == "i" else 0
        span = 0.1 / (most - low)
        whole = np.round((corners + 0.05) / span) + low
        primitive["attributes"]["POSITION"] = writer.accessor(whole.astype(dtype), normalized=normalised)
        unit = most if normalised else 1.0
        writer.header["nodes"][0] |= {
            "scale": [span * unit] * 3,
            "translation": [-0.05 - low * span] * 3,
        }
        kind = np.dtype(coordinates)
        largest = np.iinfo(kind).max
        primitive["attributes"]["TEXCOORD_0"] = writer.accessor(
            np.round(uv * largest).astype(kind), normalized=True
        )
        writer.needs("KHR_mesh_quantization")

    steps = np.iinfo(np.dtype(positions)).max
    return gltf(change, truth=replace(BOX, tolerance=4 / steps))


def compressed(writer: GltfWriter, primitive: dict[str, Any], *, required: bool = True) -> None:
    """The primitive by Draco alone."""
    import DracoPy

    corners, uv, indices = box_corners(OBJ_SIDES)
    data = DracoPy.encode(
        corners.astype("<f4"), indices.reshape(-1, 3).astype(np.uint32), tex_coord=uv.astype(np.float64),
        preserve_order=True, quantization_bits=16, compression_level=7,
    )  # fmt: skip
    decoded = DracoPy.decode(data)
    kinds = {int(entry["attribute_type"]): entry["unique_id"] for entry in decoded.attributes}
    attributes = {"POSITION": kinds[0], "TEXCOORD_0": kinds[3]}
    primitive["extensions"] = {
        "KHR_draco_mesh_compression": {"bufferView": writer.view(data), "attributes": attributes}
    }
    primitive["attributes"] = {
        "POSITION": writer.accessor(corners.astype("<f4"), view=-1),
        "TEXCOORD_0": writer.accessor(uv.astype("<f4"), view=-1),
    }
    primitive["indices"] = writer.accessor(indices.astype("<u2"), view=-1)
    writer.needs("KHR_draco_mesh_compression", used_only=not required)


def draco(*, required: bool = True) -> Make:
    return gltf(partial(compressed, required=required), truth=replace(BOX, tolerance=1e-4))


def sparse(*, with_base: bool) -> Make:
    """Positions stored as zeros, or as another box, and overwritten by a sparse accessor."""

    def change(writer: GltfWriter, primitive: dict[str, Any]) -> None:
        corners, _, _ = box_corners(OBJ_SIDES)
        positions = corners.astype("<f4")
        base = (
            np.where(np.arange(24)[:, None] % 3 == 0, positions, 7).astype("<f4")
            if with_base
            else 0 * positions
        )
        rows = np.flatnonzero((base != positions).any(axis=1))
        index = writer.accessor(base, view=None if with_base else -1)
        writer.header["accessors"][index]["sparse"] = {
            "count": len(rows),
            "indices": {"bufferView": writer.view(rows.astype("<u2").tobytes()), "componentType": 5123},
            "values": {"bufferView": writer.view(positions[rows].tobytes())},
        }
        primitive["attributes"]["POSITION"] = index

    return gltf(change, truth=SINGLE)


def moved_texture(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    """Coordinates shrunk, turned by a right angle and shifted; the extension undoes it."""
    _, uv, _ = box_corners(OBJ_SIDES)
    scale, shift = np.array([2.0, 4.0]), np.array([0.25, 0.75])
    # Of uv' = R S uv + t with R = [[0, 1], [-1, 0]]: u' = s1 v + t0, v' = -s0 u + t1.
    target = uv - shift
    stored = np.stack([-target[:, 1] / scale[0], target[:, 0] / scale[1]], axis=1)
    primitive["attributes"]["TEXCOORD_0"] = writer.accessor(stored.astype("<f4"))
    said = {"offset": shift.tolist(), "rotation": np.pi / 2, "scale": scale.tolist()}
    base = writer.header["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    base["extensions"] = {"KHR_texture_transform": said}
    writer.needs("KHR_texture_transform", used_only=True)


def second_set(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    _, uv, _ = box_corners(OBJ_SIDES)
    primitive["attributes"]["TEXCOORD_1"] = writer.accessor(uv.astype("<f4"))
    primitive["attributes"]["TEXCOORD_0"] = writer.accessor((0 * uv + 0.3).astype("<f4"))
    writer.header["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1


def webp(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    """The texture as webp, beside a fallback of another picture."""
    view = writer.view(encoded(quarters(), "WEBP", lossless=True))
    source = writer.entry("images", bufferView=view, mimeType="image/webp")
    writer.header["textures"][0]["extensions"] = {"EXT_texture_webp": {"source": source}}
    writer.needs("EXT_texture_webp")


def nested(folder: Path) -> tuple[Path, Truth]:
    """One mesh of three nodes in a chain: turned, stretched, mirrored, one by a matrix, one of no mesh."""
    writer = GltfWriter()
    mesh = writer.mesh(box_primitive(writer, (0.1, 0.1, 0.1), material=writer.material(PICTURE)))
    half = float(np.sqrt(0.5))
    mirrored = writer.node(root=False, mesh=mesh, translation=[0, 0, 0.4], scale=[-1, 1, 1])
    empty = writer.node(root=False, children=[mirrored], name="door", translation=[0.5, 0, 0])
    matrix = np.diag([1.0, 2.0, 1.0, 1.0])
    matrix[:3, 3] = [0.0, 0.3, 0.0]
    stretched = writer.node(root=False, mesh=mesh, matrix=matrix.T.reshape(-1).tolist(), children=[empty])
    writer.node(mesh=mesh, scale=[2, 1, 1], rotation=[0, 0, half, half], children=[stretched], name="Körper")
    # Volumes: 2, 2 * 2 and 2 * 2 times the box. A quarter turn about z after the stretch along x.
    path = writer.write(folder / "model.glb")
    # In the frame of the root: x to y, y to -x. The root box is 0.1 wide in x and 0.2 in y.
    sides = [np.array([0.1, 0.2, 0.1]), np.array([0.2, 0.2, 0.1]), np.array([0.2, 0.2, 0.1])]
    centres = [np.zeros(3), np.array([-0.3, 0, 0]), np.array([-0.3, 1.0, 0.4])]
    low = np.min([c - s / 2 for c, s in zip(centres, sides, strict=True)], axis=0)
    high = np.max([c + s / 2 for c, s in zip(centres, sides, strict=True)], axis=0)
    area = sum(2 * (s[0] * s[1] + s[1] * s[2] + s[2] * s[0]) for s in sides)
    # The mirrored part's red quarter lies where u, along its own x, is small: its own x points to -y here.
    third = tuple((centres[2] + [-0.05, 0.05, 0.05]).tolist())
    colours = (((-0.025, -0.05, 0.05), RED), (third, RED))
    truth = Truth(10e-3, float(area), tuple((high - low).tolist()), colours, components=3, tolerance=2e-6)
    return path, truth


def shared_mesh(folder: Path) -> tuple[Path, Truth]:
    """A set of ten nodes of one mesh, each scaled in its own way."""
    writer = GltfWriter()
    mesh = writer.mesh(box_primitive(writer, (0.1, 0.1, 0.1)))
    volume = area = 0.0
    for index in range(10):
        scale = np.array([1.0, 1 + 0.1 * index, 0.5]) * (-1 if index % 2 else 1)
        writer.node(mesh=mesh, translation=[0.2 * index, 0, 0], scale=scale.tolist())
        x, y, z = 0.1 * np.abs(scale)
        volume, area = volume + x * y * z, area + 2 * (x * y + y * z + z * x)
    return writer.write(folder / "set.gltf"), Truth(
        volume, area, (1.9, 0.19, 0.05), components=10, tolerance=2e-6
    )


def strips_and_fans(folder: Path) -> tuple[Path, Truth]:
    """A box whose top is a fan, whose bottom is a strip and whose sides have no indices, beside lines."""
    writer = GltfWriter()
    corners = box(OBJ_SIDES).astype("<f4")
    positions = writer.accessor(corners)
    loose = corners[fanned(BOX_QUADS[2:]).reshape(-1)]
    writer.node(
        mesh=writer.mesh(
            {"attributes": {"POSITION": positions}, "indices": writer.accessor(np.array([4, 5, 7, 6], "u1")),
             "mode": 6},
            {"attributes": {"POSITION": positions}, "indices": writer.accessor(np.array([0, 2, 1, 3], "<u4")),
             "mode": 5},
            {"attributes": {"POSITION": writer.accessor(loose)}},
            {"attributes": {"POSITION": positions}, "mode": 1},
        )
    )  # fmt: skip
    return writer.write(folder / "model.glb"), single(GREY_BOX)


def colours_of_vertices(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    """Scene-linear colours times a factor: half of a fifth of the light in red is 89 of 255."""
    linear = np.zeros((24, 4))
    linear[:, 0], linear[:, 3] = 0.2, 0.3
    rows = np.round(65535 * linear).astype("<u2")
    primitive["attributes"]["COLOR_0"] = writer.accessor(rows, normalized=True)
    writer.header["materials"][0] = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1]}}


def glossy(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    texture = writer.header["materials"][0].pop("pbrMetallicRoughness")["baseColorTexture"]
    said = {"diffuseTexture": texture, "glossinessFactor": 0.2, "specularFactor": [0.04, 0.04, 0.04]}
    writer.header["materials"][0]["extensions"] = {"KHR_materials_pbrSpecularGlossiness": said}
    writer.needs("KHR_materials_pbrSpecularGlossiness", used_only=True)


def clamped(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    writer.header["textures"][0]["sampler"] = writer.entry("samplers", wrapS=33071, wrapT=33648)


def meshopt_with_fallback(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    """Views that are compressed by meshopt as well, for who can, and plain for all others."""
    for view in writer.header["bufferViews"]:
        view["extensions"] = {"EXT_meshopt_compression": {"buffer": 0, "byteLength": 4}}
    writer.needs("EXT_meshopt_compression", used_only=True)


def images_by_name(name: str, uri: str) -> Make:
    def make(folder: Path) -> tuple[Path, Truth]:
        write_text(folder / name, PICTURE)
        return write_gltf_box(folder / "model.gltf", image=uri), SINGLE

    return make


def in_one_file(folder: Path) -> tuple[Path, Truth]:
    path = write_gltf_box(folder / "model.gltf")
    header = json.loads(path.read_text())
    blob = (folder / "model.bin").read_bytes()
    header["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    path.write_text(json.dumps(header))
    (folder / "model.bin").unlink()
    return path, SINGLE


IN_BASE64 = base64.b64encode(PICTURE).decode()
GLTF: dict[str, Make] = {
    "GLB": gltf(truth=SINGLE),
    "glTF": gltf(truth=SINGLE, suffix=".gltf"),
    "all in one file": in_one_file,
    "texture in a folder": images_by_name("textures/skin.png", "textures/skin.png"),
    "escaped name": images_by_name("my skin ü.png", "my%20skin%20%C3%BC.png"),
    "name that is not escaped": images_by_name("my skin ü#1.png", "my skin ü#1.png"),
    "name with a percent sign": images_by_name("100%25.png", "100%25.png"),
    "other case of the name": images_by_name("Textures/SKIN.png", "textures/skin.png"),
    "texture in the file": images_by_name("x.png", "data:image/png;base64," + IN_BASE64),
    "16-bit positions": quantised("<i2", "<u2", normalised=True),
    "16-bit positions, not normalised": quantised("<i2", "<u1", normalised=False),
    "unsigned 16-bit positions": quantised("<u2", "<u2", normalised=False),
    "8-bit positions": quantised("i1", "u1", normalised=True),
    "Draco": draco(),
    "Draco, said to be used only": draco(required=False),
    "sparse positions": sparse(with_base=False),
    "sparse positions over others": sparse(with_base=True),
    "texture moved": gltf(moved_texture, truth=SINGLE),
    "second set of coordinates": gltf(second_set, truth=SINGLE),
    "webp": gltf(webp, truth=SINGLE, image=encoded(np.zeros((4, 4, 3), np.uint8))),
    "webp in a file": images_by_name("skin.webp", "skin.webp"),
    "nested nodes": nested,
    "shared mesh": shared_mesh,
    "strips and fans": strips_and_fans,
    "colours of vertices": gltf(
        colours_of_vertices, truth=replace(SINGLE, colours=(((0.01, 0.01, 0.03), (89, 0, 0)),))
    ),
    "specular and glossiness": gltf(glossy, truth=SINGLE),
    "sampler that clamps": gltf(clamped, truth=SINGLE),
    "meshopt with a fallback": gltf(meshopt_with_fallback, truth=SINGLE),
}  # fmt: skip


@pytest.mark.slow
def test_gltf_of_every_kind(subtests, tmp_path):
    for name in GLTF:
        with subtests.test(name=name):
            path, truth = GLTF[name](tmp_path)
            if name == "webp in a file":
                (tmp_path / "skin.webp").write_bytes(encoded(quarters(), "WEBP", lossless=True))
            first, second = (
                check(path, truth),
                ingest_object(path, object_id="hard"),
            )
            assert first.attributes["digests"] == second.attributes["digests"]


def cone(folder: Path) -> Path:
    """A cone of 12 cm that stands on the ground of a glTF: its apex is at y = 0.12 m."""
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    rim = np.stack([0.03 * np.cos(angles), 0 * angles, 0.03 * np.sin(angles)], axis=1)
    vertices = np.concatenate([rim, [[0, 0.12, 0], [0, 0, 0]]])
    faces = [[k, 8, (k + 1) % 8] for k in range(8)] + [[(k + 1) % 8, 9, k] for k in range(8)]
    writer = GltfWriter()
    positions = writer.accessor(vertices.astype("<f4"))
    indices = writer.accessor(np.array(faces, dtype="<u4").reshape(-1))
    writer.node(mesh=writer.mesh({"attributes": {"POSITION": positions}, "indices": indices}))
    return writer.write(folder / "cone.glb")


def test_an_axis_that_is_up_becomes_z(subtests, tmp_path):
    """A glTF's y by its standard, or what is said; the record says which where it was not z."""
    path = cone(tmp_path)
    for up, apex in ((None, [0, 0, 0.12]), ("y", [0, 0, 0.12]), ("z", [0, 0.12, 0]), ("x", [0.12, 0, 0])):
        with subtests.test(up=up):
            product = ingest_object(path, up=up)
            vertices = product["vertices"]
            farthest = vertices[np.argmax(np.linalg.norm(vertices, axis=1))]
            np.testing.assert_allclose(farthest, apex, atol=1e-7)
            assert product.attributes["solid"]["volume_m3"] > 0
            assert product.attributes.get("source_up", "z") == (up or "y")
    with pytest.raises(InputError, match="'w' is no axis"):
        load_mesh(path, up="w")


def test_an_exported_glb_comes_back_the_same(tmp_path):
    """Export turns z to glTF's y by the node, and reading turns it back: bit for bit."""
    mesh = load_mesh(cone(tmp_path))
    corners = mesh.vertices[mesh.faces].astype(np.float32)
    normals = np.broadcast_to([0.0, 0.0, 1.0], corners.shape)
    part = Part(corners, normals, np.zeros((len(corners), 3, 2)), np.full((1, 1, 4), 255, np.uint8))
    credit = Credit("cone", "Cone", "made by code", "CC0-1.0", "the tests")
    write_glb(tmp_path / "back.glb", [part], Appearance(0.5, 0.0), credit, mipmaps=False)
    back = load_mesh(tmp_path / "back.glb")
    np.testing.assert_array_equal(back.vertices[back.faces], corners)


def test_alpha_and_maps_of_parts_stay_theirs(tmp_path):
    """Three boxes of one file: cut out, see-through and opaque, with the same picture and other layers."""
    rgba = np.dstack([quarters(), np.where(quarters()[..., 0] == 200, 40, 255).astype(np.uint8)])
    layers = np.zeros((2, 2, 3), np.uint8)
    layers[..., 1] = [[10, 20], [30, 40]]
    writer = GltfWriter()
    picture = encoded(rgba)
    for index, outer in enumerate(({"alphaMode": "MASK", "alphaCutoff": 0.4}, {"alphaMode": "BLEND"}, {})):
        material = writer.material(picture)
        writer.header["materials"][material] |= outer
        if index:
            source = writer.entry("images", bufferView=writer.view(encoded(layers)))
            texture = {"index": writer.entry("textures", source=source)}
            writer.header["materials"][material]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = texture
        box_ = box_primitive(writer, material=material)
        writer.node(mesh=writer.mesh(box_), translation=[0.2 * index, 0, 0])
    truth = Truth(3 * 0.1 * 0.08 * 0.06, 3 * BOX.area_m2, (0.5, 0.08, 0.06), components=3, tolerance=2e-6)
    mesh = textured_mesh_of(check(writer.write(tmp_path / "model.glb"), truth))
    assert dict(mesh.alpha_cutoffs) == {0: 0.4}
    assert [int(texture[0, 0, 3]) for texture in mesh.textures] == [40, 40, 255]
    assert sorted(mesh.roughness_maps) == [1, 2]
    np.testing.assert_array_equal(mesh.roughness_maps[1], [[10, 20], [30, 40]])
    assert colours_at(mesh, np.array([[0.4 - 0.025, -0.03, 0.02]])).round().tolist() == [list(RED)]


def skinned(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    writer.header["nodes"][0]["skin"] = 0


def morphed(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    writer.header["meshes"][0]["weights"] = [0.0, 0.5]


def instanced(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    writer.header["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {}}}


def clamped_outside(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    clamped(writer, primitive)
    _, uv, _ = box_corners(OBJ_SIDES)
    primitive["attributes"]["TEXCOORD_0"] = writer.accessor((3 * uv - 1).astype("<f4"))


def painted_texture(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    primitive["attributes"]["COLOR_0"] = writer.accessor(np.full((24, 3), 0.5, "<f4"))


def coarse(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    corners, _, _ = box_corners(OBJ_SIDES)
    primitive["attributes"]["POSITION"] = writer.accessor((corners + np.array([4e4, 0, 0])).astype("<f4"))


def tampered(**entries: Any) -> Callable[[GltfWriter, dict[str, Any]], None]:
    def change(writer: GltfWriter, primitive: dict[str, Any]) -> None:
        writer.header |= entries

    return change


def in_header(kind: str, **entries: Any) -> Callable[[GltfWriter, dict[str, Any]], None]:
    def change(writer: GltfWriter, primitive: dict[str, Any]) -> None:
        writer.header[kind][0] |= entries

    return change


def in_last_view(**entries: Any) -> Callable[[GltfWriter, dict[str, Any]], None]:
    """Into the view of what was written last, the indices."""
    return lambda writer, primitive: writer.header["bufferViews"][-1].update(entries)


def in_primitive(**entries: Any) -> Callable[[GltfWriter, dict[str, Any]], None]:
    return lambda writer, primitive: primitive.update(entries)


def without_fallback(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    meshopt_with_fallback(writer, primitive)
    writer.needs("EXT_meshopt_compression")


REFUSED: dict[str, tuple[Callable[[GltfWriter, dict[str, Any]], None], str]] = {
    "meshopt": (without_fallback, "EXT_meshopt_compression"),
    "other extension": (tampered(extensionsRequired=["EXT_secret"]), "EXT_secret"),
    "KTX": (in_header("textures", source=None, extensions={"KHR_texture_basisu": {"source": 0}}),
            "KHR_texture_basisu"),
    "skeleton": (skinned, "posed by a skeleton"),
    "shape keys": (morphed, "shape keys"),
    "instances": (instanced, "EXT_mesh_gpu_instancing"),
    "clamped outside": (clamped_outside, "clamps or mirrors"),
    "painted texture": (painted_texture, "colours of vertices"),
    "single precision far away": (coarse, "so far from the origin"),
    "version 1": (tampered(asset={"version": "1.0"}), "version is '1.0'"),
    "cycle": (in_header("nodes", children=[0]), "node 0 is reached twice"),
    "child that is not there": (in_header("nodes", children=[7]), "nodes has no entry 7"),
    "negative index": (in_header("nodes", mesh=-1), "'-1' where a whole number is needed"),
    "text for an index": (in_header("nodes", mesh="0"), "'0' where a whole number"),
    "turned by nothing": (in_header("nodes", rotation=[0, 0, 0, 0]), "rotation of a node is zero"),
    "projection": (in_header("nodes", matrix=[1.0] * 16), "no affine transform"),
    "huge count": (in_header("accessors", count=2**40), "ends behind its bytes"),
    "huge count of nothing": (in_header("accessors", bufferView=None, count=2**40), "cannot be read"),
    "stride of nothing": (in_last_view(byteStride=0), "ends behind its bytes"),
    "view behind the buffer": (in_header("bufferViews", byteLength=10**9), "ends behind its buffer"),
    "material that is not there": (in_primitive(material=9), "materials has no entry 9"),
    "strange mode": (in_primitive(mode=9), "mode 9"),
    "no meshes": (tampered(meshes=[]), "meshes has no entry 0"),
    "no nodes in the scene": (tampered(scenes=[{"nodes": []}]), "holds no faces"),
    "list for an object": (tampered(materials=[[]]), "no object"),
}  # fmt: skip


def test_gltf_that_is_refused(subtests, tmp_path):
    for name in REFUSED:
        with subtests.test(name=name):
            change, said = REFUSED[name]
            path, _ = gltf(change)(tmp_path)
            refused(path, said)


def test_gltf_reads_no_image_elsewhere(subtests, tmp_path):
    for uri in [
        "../skin.png",
        "%2e%2e/skin.png",
        "/etc/passwd",
        "file:///etc/passwd",
        "http://localhost/x.png",
        "..\\skin.png",
        "",
        ".",
        "nowhere.png",
        "data:image/png,abc",
        "data:image/png;base64,!!",
        "\x00",
        "x" * 5000,
        "//skin.png",
        "~/skin.png",
    ]:
        with subtests.test(uri=uri):
            (tmp_path / "skin.png").write_bytes(PICTURE)
            path = write_gltf_box(tmp_path / "model" / "model.gltf", image=uri)
            refused(path)
            assert source_files(path) == (path, tmp_path / "model" / "model.bin")


def test_a_mesh_that_many_nodes_name_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("objectfolder.making.mesh.readers.gltf.MOST_TRIANGLES", 100)
    writer = GltfWriter()
    mesh = writer.mesh(box_primitive(writer))
    for _ in range(10):
        writer.node(mesh=mesh)
    refused(writer.write(tmp_path / "model.glb"), "more than 100 triangles")


def test_textures_are_read_once_and_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("objectfolder.making.mesh.readers.textures.TEXTURE_BYTES", 4 * 32 * 32)
    check(*GLTF["GLB"](tmp_path / "one"))
    path = write_obj_box(
        tmp_path / "two", library="newmtl skin\nmap_Kd skin.png\nnewmtl b\nmap_Kd skin.png\n"
    )
    load_mesh(path)
    path.with_name("b.png").write_bytes(encoded(quarters(64)))
    path.with_name("model.mtl").write_text("newmtl skin\nmap_Kd b.png\n")
    refused(path, "more than 4096 bytes")
