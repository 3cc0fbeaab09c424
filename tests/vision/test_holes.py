"""Holes of a texture's alpha in what a VisionNet shows: primary rays, shadow rays, passes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from compiled_cases import network
from small_visionnets import drawn_visionnet
from test_normal_maps import stored, with_maps
from vision_shapes import cube

from objectfolder.errors import FormatError
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.cameras import look_at
from objectfolder.vision.network.holes import without_holes
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.surface_maps import SurfaceMaps

TILES = 4
CHECKER = (np.indices((TILES, TILES)).sum(axis=0) % 2 == 0).repeat(32, 0).repeat(32, 1)


def pane(alpha: np.ndarray, floor: float | None = None) -> TexturedMesh:
    """A square of side 1 that faces +z with an alpha (h, w) bool, and perhaps an opaque floor below."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    texture = np.full((*alpha.shape, 4), 255, np.uint8)
    texture[..., 3] = 255 * alpha
    parts = [corners] if floor is None else [corners, corners - [0, 0, floor]]
    count = len(parts)
    return TexturedMesh(
        np.concatenate(parts),
        np.concatenate([faces + 4 * index for index in range(count)]),
        np.tile(corners[:, :2][faces], (count, 1, 1)),
        (texture, np.full((1, 1, 4), 255, np.uint8))[:count],
        np.repeat(np.arange(count, dtype=np.int32), 2),
        alpha_cutoffs={0: 0.5},
    )


@cache
def stored_pane(floor: float | None = None) -> tuple[UnitFrame, SurfaceMaps]:
    """The frame and the maps of a pane with a checkerboard of holes."""
    _, frame, maps = stored(pane(CHECKER, floor))
    return frame, maps


def tile_centres() -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 2) of the tiles, and whether the surface is there."""
    row, column = np.indices((TILES, TILES)).reshape(2, -1)
    return np.stack([(column + 0.5) / TILES, 1 - (row + 0.5) / TILES], axis=1), (row + column) % 2 == 0


def test_a_checkerboard_leaves_half_of_a_plane() -> None:
    _, maps = stored_pane()
    cut = without_holes(maps)
    assert cut.surface.area == pytest.approx(0.5, abs=0.01)
    assert (cut.surface.face_normals[:, 2] > 0.999).all()
    at = cut.surface.sample(50, seed=0)
    face, barycentric = cut.in_parent(at.face, at.barycentric)
    np.testing.assert_allclose(maps.surface.points_at(face, barycentric), at.points, atol=1e-9)
    # Edges lie within a quarter of a lattice step, but for the rounded corners of tiles.
    offset = np.abs((at.points[:, :2] * TILES + 0.5) % 1 - 0.5) / TILES
    row, column = (1 - at.points[:, 1]) * TILES // 1, at.points[:, 0] * TILES // 1
    wrong = (row + column) % 2 == 1
    assert (offset[wrong].min(axis=1) < 1 / 256).all()


def test_rays_and_shadow_rays_pass_through_holes() -> None:
    frame, maps = stored_pane(floor=0.3)
    surface = UnitSurface(maps.surface, frame, maps)
    places, is_tile = tile_centres()
    above = frame.to_unit(np.column_stack([places, np.full(len(places), 0.5)]))
    down = np.broadcast_to([0.0, 0.0, -1.0], above.shape)
    face, barycentric = surface.first_hits(above, down)
    height = maps.surface.points_at(*surface.in_stored(face, barycentric))[:, 2]
    np.testing.assert_allclose(height, np.where(is_tile, 0.0, -0.3), atol=1e-5)
    floor = ~is_tile
    far = frame.to_unit(np.array([0.5, 0.5, 9.0]))
    lit = surface.incidence(face[floor], barycentric[floor], down[floor], far)
    # Through the holes, onto most of the floor below them.
    assert (lit.irradiance > 0).sum() >= 6


def test_the_floor_below_shows_the_pattern_of_light() -> None:
    """A lamp straight above a hole lights the floor's point below it, and not the one below a tile."""
    frame, maps = stored_pane(floor=0.3)
    surface = UnitSurface(maps.surface, frame, maps)
    places, is_tile = tile_centres()
    for place, tile in zip(places, is_tile, strict=True):
        below = frame.to_unit(np.array([[*place, -0.1]]))
        face, barycentric = surface.first_hits(below, np.array([[0.0, 0.0, -1.0]]))
        lamp = frame.to_unit(np.array([*place, 1.0]))
        arrived = surface.incidence(face, barycentric, np.array([[0.0, 0.0, -1.0]]), lamp).irradiance
        assert (arrived[0] > 0) == (not tile)


def test_an_image_and_its_passes_have_the_holes() -> None:
    frame, maps = stored_pane()
    net = with_maps(drawn_visionnet(maps.surface), maps, frame)
    camera = look_at(np.array([[0.0, 0.0, 2.0]]) + frame.to_unit(np.array([0.5, 0.5, 0.0])))
    passes = net.render(camera, np.array([0.2, 0.1, 1.0]), 64, 39.6, passes=["rgba", "mask", "depth"])
    alpha = passes["rgba"][0, ..., 3]
    side = 64 / (2 * np.tan(np.radians(39.6 / 2)) * 2)
    assert alpha.sum() == pytest.approx(side**2 / 2, rel=0.01)
    assert np.abs(passes["mask"][0] - alpha)[(alpha == 0) | (alpha == 1)].max() == 0
    np.testing.assert_allclose(passes["depth"][0][passes["mask"][0]], 2.0, atol=1e-5)


def test_a_surface_that_is_one_hole_is_refused() -> None:
    _, maps = stored_pane()
    nothing = {**maps.levels, "alpha": np.zeros_like(maps.levels["alpha"])}
    with pytest.raises(FormatError, match="one hole"):
        without_holes(replace(maps, levels=nothing))


def test_opaque_faces_are_left_as_they_are() -> None:
    mesh = cube()
    opaque, _, _ = network(mesh.surface)
    assert opaque.surface is mesh.surface
    _, maps = stored_pane(floor=0.3)
    cut = without_holes(maps)
    floor = maps.surface.points_at(np.arange(4), np.full((4, 3), 1 / 3))[:, 2] < -0.1
    assert np.bincount(cut.parent)[floor].tolist() == [1, 1]
