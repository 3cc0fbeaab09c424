"""Albedo, roughness and metallic beside an image: those of the source, at the pixel's centre."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from small_visionnets import drawn_visionnet
from test_normal_maps import stored, with_maps
from vision_shapes import FACE_COLOURS, cube

from objectfolder.errors import QueryError
from objectfolder.making.views.passes import cast_passes
from objectfolder.making.views.render_request import unit_scene
from objectfolder.making.visionnet import map_sampling
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at
from objectfolder.vision.compositing import srgb_decode, srgb_encode
from pipeline.publish.export.base_colour import network_colour

CAMERAS = look_at(np.array([[1.4, -1.5, 1.3], [-1.4, 1.5, -1.3]]))
LIGHT = np.array([0.3, 0.2, 1.0])
ALL = ("mask", "albedo", "roughness", "metallic")


@cache
def stored_cube() -> Any:
    return stored(cube())


def mapped_cube() -> TexturedMesh:
    mesh = cube()
    half = np.full((16, 96), 51, np.uint8)
    half[:, 48:] = 204
    return TexturedMesh(
        mesh.vertices, mesh.faces, mesh.texture_coordinates, mesh.textures, mesh.face_texture,
        roughness_maps={0: half},
    )  # fmt: skip


def test_passes_are_those_of_the_truth() -> None:
    mesh, frame, maps = stored(mapped_cube())
    net = with_maps(drawn_visionnet(maps.surface), maps, frame)
    passes = net.render(CAMERAS, LIGHT, 64, 39.6, passes=ALL)
    truth = cast_passes(unit_scene(mesh, Appearance(0.3, 1.0), frame), CAMERAS, (64, 64), 39.6)
    np.testing.assert_array_equal(passes["mask"], truth.mask)
    for name in ("albedo", "roughness", "metallic"):
        assert passes[name].dtype == np.float32
        assert not passes[name][~truth.mask].any()
    mask = truth.mask
    assert (passes["metallic"][mask] == 1).all()
    off = np.abs(srgb_encode(passes["albedo"][mask]) - srgb_encode(truth.albedo[mask].astype(float)))
    assert np.median(off) < 0.01
    assert (off.max(axis=1) < 0.05).mean() > 0.9  # but beside edges of the texture
    rough = np.abs(passes["roughness"][mask] - truth.roughness[mask])
    assert (rough < 0.02).mean() > 0.97


@pytest.mark.slow
def test_albedo_is_as_fine_as_its_bytes_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = cube()
    plain = TexturedMesh(
        mesh.vertices, mesh.faces, mesh.texture_coordinates, (np.full((1, 1, 4), 255, np.uint8),),
        mesh.face_texture,
    )  # fmt: skip
    _, _, maps = stored(plain)
    assert len(maps.tensors()["albedo"]) < 300
    _, _, finest = stored_cube()
    assert set(finest.levels) == {"albedo"}, "the source has no other map"
    budget = len(finest.tensors()["albedo"]) - 1
    monkeypatch.setattr(map_sampling, "ALBEDO_BYTES", {"learned": budget})
    _, _, maps = stored(mesh)
    assert 0.5 * budget < len(maps.tensors()["albedo"]) <= budget


def test_an_export_takes_the_stated_base_colour() -> None:
    _, frame, maps = stored_cube()
    net = with_maps(drawn_visionnet(maps.surface), maps, frame)
    centre = np.full((1, 3), 1 / 3)
    for face in range(len(maps.surface.faces)):
        colour = network_colour(net, maps.surface, frame, np.array([face]), centre, 0.0)[0]
        colours = np.concatenate([FACE_COLOURS, FACE_COLOURS // 3]) / 255
        assert np.abs(colours - colour[:3]).max(axis=1).min() < 0.02


def test_a_file_that_states_none_says_so() -> None:
    surface = cube().surface
    net = drawn_visionnet(surface)
    for name in ("albedo", "roughness", "metallic"):
        with pytest.raises(QueryError, match="not stated"):
            net.render(CAMERAS, LIGHT, 16, 39.6, passes=[name])
        with pytest.raises(QueryError, match="not stated"):
            net.reflectance(name, np.array([0]), np.full((1, 3), 1 / 3))
    assert UnitFrame.of_points(surface.vertices).scale > 0
    assert srgb_decode(np.ones(1))[0] == 1
