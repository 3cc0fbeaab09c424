"""Readers of the four formats, material libraries and textures, on files made here."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from small_meshes import (
    CUBE_FACES,
    CUBE_VERTICES,
    checker,
    cube,
    png,
    write_gltf,
)

from objectfolder.errors import InputError
from objectfolder.making.mesh.cleaning import clean
from objectfolder.making.mesh.readers.load import load_mesh, source_files
from objectfolder.making.mesh.readers.textures import read_texture
from objectfolder.making.mesh.readers.vertex_colours import vertex_colours_of

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def colours_at_corners(mesh, face: int) -> np.ndarray:
    """RGB of the texels that the corners of a face lie in, (3, 3)."""
    texture = mesh.textures[mesh.face_texture[face]]
    height, width = texture.shape[:2]
    u, v = mesh.texture_coordinates[face].T
    column = np.clip((u * width).astype(int), 0, width - 1)
    row = np.clip(((1 - v) * height).astype(int), 0, height - 1)
    return texture[row, column, :3]


def test_obj_negative_indices_count_back_from_the_line_they_stand_on(tmp_path):
    path = tmp_path / "model.obj"
    path.write_text(QUAD + "f -4 -3 -2\nv 5 5 5\nf -1 1 2\n")
    np.testing.assert_array_equal(load_mesh(path).faces, [[0, 1, 2], [4, 0, 1]])


def test_custom_and_split_normals_of_an_obj_are_those_of_its_corners(tmp_path):
    path = tmp_path / "model.obj"
    path.write_text(QUAD + "vn 0 0 2\nvn 0 .6 .8\nvn 0 0 -1\nf 1//1 2//-2 3//3\nf 1 3 4\n")
    mesh, _ = clean(load_mesh(path))
    # One points inwards, and a face has none: these are left to the rule.
    np.testing.assert_allclose(mesh.normals[0], [[0, 0, 1], [0, 0.6, 0.8], [0, 0, 0]], atol=1e-6)
    assert not mesh.normals[1].any()
    np.testing.assert_allclose(
        mesh.surface.corner_normals[0], [[0, 0, 1], [0, 0.6, 0.8], [0, 0, 1]], atol=1e-6
    )
    path.write_text(QUAD + "vn 0 0 1\nf 1//1 2//1 3//2\n")
    with pytest.raises(InputError, match=r"line 6: .*normal 2 of 1"):
        load_mesh(path)


def test_normals_turn_with_faces_that_are_reversed():
    inside_out = cube()
    outwards = np.sign(inside_out.vertices - inside_out.vertices.mean(axis=0))[inside_out.faces]
    mesh = replace(inside_out, faces=inside_out.faces[:, ::-1], normals=-outwards[:, ::-1])
    np.testing.assert_allclose(clean(mesh)[0].normals, outwards / np.sqrt(3), atol=1e-6)
    # A file may say outwards with its normals and inwards with the order of corners.
    mesh = replace(mesh, normals=outwards[:, ::-1])
    np.testing.assert_allclose(clean(mesh)[0].normals, outwards / np.sqrt(3), atol=1e-6)


def test_normals_of_vertices_of_a_ply(tmp_path):
    path = tmp_path / "model.ply"
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{properties}element face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0 0 0 1\n1 0 0 0 .6 .8\n1 1 0 0 0 3\n3 0 1 2\n"
    )
    np.testing.assert_allclose(load_mesh(path).normals[0], [[0, 0, 1], [0, 0.6, 0.8], [0, 0, 3]], atol=1e-6)


@pytest.mark.parametrize("scale", [[1, 1, 4], [-1, 1, 4]], ids=["stretched", "mirrored"])
def test_normals_of_gltf_stay_normal_in_stretched_and_mirrored_nodes(tmp_path, scale):
    path = write_gltf(tmp_path / "model.gltf", node={"scale": scale})
    header = json.loads(path.read_text())
    header["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 3
    # Of a plane that rises along x: not that of the triangle, which a custom normal need not be.
    normal = np.array([-0.6, 0, 0.8] * 3, dtype="<f4")
    (tmp_path / "normals.bin").write_bytes(normal.tobytes())
    header["buffers"].append({"uri": "normals.bin", "byteLength": 36})
    header["bufferViews"].append({"buffer": 1, "byteLength": 36})
    header["accessors"].append({"bufferView": 3, "componentType": 5126, "count": 3, "type": "VEC3"})
    path.write_text(json.dumps(header))
    mesh = load_mesh(path, up="z")
    along = np.array([0.8 * scale[0], 0, 0.6 * scale[2]])  # in that plane
    np.testing.assert_allclose(mesh.normals @ along, 0, atol=1e-6)
    facet = np.cross(mesh.vertices[mesh.faces[0, 1]] - mesh.vertices[mesh.faces[0, 0]],
                     mesh.vertices[mesh.faces[0, 2]] - mesh.vertices[mesh.faces[0, 0]])  # fmt: skip
    assert (mesh.normals[0] @ facet > 0).all()


def test_vertex_colours_up_to_one_are_shares_and_others_are_bytes():
    for rows, colour in (([[1.0, 0.0, 0.5], []], (1, 0, 0.5)), ([[255.0, 0.0, 51.0]], (1, 0, 0.2))):
        np.testing.assert_allclose(vertex_colours_of(Path("box.obj"), rows, [])[0], colour)


def test_ply_with_vertex_colours(tmp_path):
    colours = np.random.default_rng(0).integers(0, 256, (8, 4), dtype=np.uint8)
    trimesh.Trimesh(CUBE_VERTICES, CUBE_FACES, vertex_colors=colours, process=False).export(
        tmp_path / "model.ply"
    )
    mesh = load_mesh(tmp_path / "model.ply")
    for face in range(12):
        np.testing.assert_array_equal(colours_at_corners(mesh, face), colours[mesh.faces[face], :3])


def test_ply_with_texture_coordinates_and_a_texture_file(tmp_path):
    (tmp_path / "skin.png").write_bytes(png(checker()))
    header = (
        "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 3\n"
        "property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n"
        "element face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    path = tmp_path / "model.ply"
    path.write_text(header + "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n3 0 1 2\n")
    mesh = load_mesh(path)
    np.testing.assert_array_equal(colours_at_corners(mesh, 0), checker()[[7, 7, 0], [0, 7, 7]])
    assert source_files(path) == (path, tmp_path / "skin.png")
    (tmp_path / "skin.png").unlink()
    with pytest.raises(InputError, match=r"skin\.png: the texture file does not exist"):
        load_mesh(path)


def test_gltf_base_colour_factor_is_linear_and_multiplies(tmp_path):
    path = write_gltf(tmp_path / "model.gltf", node={}, material={"baseColorFactor": [0.5, 1, 1, 1]})
    texture = load_mesh(path).textures[0]
    np.testing.assert_array_equal(texture[..., 1:3], checker()[..., 1:3])
    # Half of the light of white is 188 of 255 when encoded.
    np.testing.assert_array_equal(
        texture[7, :, 0], round(255 * (1.055 * (0.5 * linear(252)) ** (1 / 2.4) - 0.055))
    )


def linear(level: int) -> float:
    return float(((level / 255 + 0.055) / 1.055) ** 2.4)


def save_texture(path: Path, values: np.ndarray, mode: str | None = None) -> Path:
    image = Image.fromarray(values)
    (image if mode is None else image.convert(mode)).save(path)
    return path


def test_textures_of_every_kind_become_rgba(tmp_path):
    grey = np.arange(64, dtype=np.uint8).reshape(8, 8) * 4
    rgb = checker()
    rgba = np.dstack([rgb, np.full((8, 8), 77, dtype=np.uint8)])
    expected_grey = np.dstack([grey, grey, grey])
    cases = {
        "grey.png": (save_texture(tmp_path / "grey.png", grey), expected_grey),
        "grey16.png": (save_texture(tmp_path / "grey16.png", grey.astype(np.uint16) * 257), expected_grey),
        "grey16.tif": (save_texture(tmp_path / "grey16.tif", grey.astype(np.uint16) * 257), expected_grey),
        "rgb.png": (save_texture(tmp_path / "rgb.png", rgb), rgb),
        "rgba.png": (save_texture(tmp_path / "rgba.png", rgba), rgb),
        "rgb.webp": (tmp_path / "rgb.webp", rgb),
        "cmyk.tif": (save_texture(tmp_path / "cmyk.tif", rgb, "CMYK"), rgb),
        "palette.png": (save_texture(tmp_path / "palette.png", rgb, "P"), None),
    }
    Image.fromarray(rgb).save(tmp_path / "rgb.webp", lossless=True)
    for name, (path, expected) in cases.items():
        texture = read_texture(path)
        assert (texture.shape, texture.dtype) == ((8, 8, 4), np.uint8), name
        if expected is not None:
            np.testing.assert_array_equal(texture[..., :3], expected, err_msg=name)
    assert read_texture(tmp_path / "rgba.png")[0, 0, 3] == 77
