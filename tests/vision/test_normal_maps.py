"""Maps of normals: read, bent as renderers bend, stored on faces, and lit."""

from unittest import mock

import numpy as np
import pytest
from compiled_cases import sheet
from hypothesis import given
from hypothesis import strategies as st
from small_visionnets import drawn_visionnet
from vision_shapes import sphere

from objectfolder.errors import FormatError
from objectfolder.making.mesh.normal_maps import MappedNormals, corner_tangents
from objectfolder.making.visionnet import map_sampling
from objectfolder.making.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at
from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.network.face_lattice import FaceLattice, pack_levels, unpack_levels
from objectfolder.vision.network.incidence import UnitSurface, bent_share
from objectfolder.vision.network.surface_maps import SurfaceMaps
from objectfolder.vision.visionnet.visionnet import VisionNet

TILTED = np.array([0.36, 0.48, 0.8])
WHITE = np.full((1, 1, 4), 255, np.uint8)


def level(normal: np.ndarray) -> np.ndarray:
    """A map (1, 1, 3) of one normal."""
    return np.rint(127.5 * (np.asarray(normal) + 1)).astype(np.uint8).reshape(1, 1, 3)


def plane(*, mirrored: bool = False, image: np.ndarray | None = None) -> TexturedMesh:
    """The square 0..1 of x and y that faces +z, u along x (or against it) and v along y."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    coordinates = corners[:, :2] * [-1 if mirrored else 1, 1]
    maps = {0: level(TILTED) if image is None else image}
    return TexturedMesh(corners, faces, coordinates[faces], (WHITE,), np.zeros(2, np.int32), normal_maps=maps)


def mapped(mesh: TexturedMesh) -> MappedNormals:
    return MappedNormals(
        mesh.vertices, mesh.faces, mesh.surface.corner_normals, mesh.texture_coordinates,
        mesh.face_texture, mesh.normal_maps,
    )  # fmt: skip


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_constant_map_tilts_a_plane_along_its_texture(mirrored: bool) -> None:
    samples = plane(mirrored=mirrored).surface.sample(20, seed=0)
    normals = mapped(plane(mirrored=mirrored)).at(samples.face, samples.barycentric)
    expected = TILTED * [-1 if mirrored else 1, 1, 1]
    np.testing.assert_allclose(normals, np.broadcast_to(expected, normals.shape), atol=0.005)


def test_tangents_of_a_ball_follow_its_meridians_and_meet_at_shared_corners() -> None:
    ball = sphere(1.0, (9, 9, 9), 3)
    x, y, z = np.moveaxis(ball.vertices[ball.faces], 2, 0)
    away = (np.abs(z) < 0.8).all(axis=1) & (np.ptp(np.arctan2(y, x), axis=1) < 3)
    coordinates = np.stack([np.arctan2(y, x) / (2 * np.pi), np.arcsin(z) / np.pi], axis=-1)
    tangents, handedness = corner_tangents(
        ball.vertices, ball.faces, ball.surface.corner_normals, coordinates
    )
    around = np.stack([-y, x, np.zeros_like(x)], axis=-1) / np.maximum(np.hypot(x, y), 1e-9)[..., None]
    assert (handedness[away] == 1).all()
    assert (np.einsum("fij,fij->fi", tangents, around)[away] > 0.97).all()
    # Inside, corners of one vertex have one tangent, though the faces' own differ.
    inner = away & (np.abs(z) < 0.6).all(axis=1) & (np.abs(np.arctan2(y, x)) < 2.5).all(axis=1)
    vertex = ball.faces[inner][0, 0]
    same = tangents[inner][ball.faces[inner] == vertex]
    np.testing.assert_allclose(same, np.broadcast_to(same[0], same.shape), atol=1e-9)


def test_without_texture_coordinates_that_span_a_map_says_nothing() -> None:
    flat = plane()
    pointlike = TexturedMesh(
        flat.vertices, flat.faces, np.zeros((2, 3, 2)), flat.textures, flat.face_texture,
        normal_maps=flat.normal_maps,
    )  # fmt: skip
    normals = mapped(pointlike).at(np.array([0, 1]), np.full((2, 3), 1 / 3))
    np.testing.assert_array_equal(normals, [[0, 0, 1], [0, 0, 1]])


@given(st.integers(0, 2**31), st.floats(0.02, 2.0))
def test_a_lattice_gives_back_what_is_linear_on_each_face(seed: int, pitch: float) -> None:
    random = np.random.default_rng(seed)
    triangles = random.normal(size=(6, 3, 3)) * np.array([1.0, 1.0, 0.1])
    lattice = FaceLattice(triangles, pitch, shared=False)
    face, barycentric = lattice.places(np.zeros((1, 2)))
    at_corners = random.normal(size=(6, 3))
    values = np.einsum("ij,ij->i", barycentric, at_corners[face])[:, None]
    where = random.dirichlet(np.ones(3), 50)
    faces = random.integers(0, 6, 50)
    # Values beyond a slanted edge are moved onto it: exact one step from there.
    inside = where.min(axis=1) > 1.5 * pitch / np.linalg.norm(
        np.roll(triangles, -1, axis=1) - triangles, axis=2
    ).min(axis=1)[faces]  # fmt: skip
    answers = lattice.interpolate(values, faces, where)[:, 0]
    expected = np.einsum("ij,ij->i", where, at_corners[faces])
    np.testing.assert_allclose(answers[inside], expected[inside], atol=1e-9)


@given(st.integers(1, 40), st.integers(1, 2), st.integers(0, 2**31))
def test_levels_survive_packing(size: int, channels: int, seed: int) -> None:
    levels = np.random.default_rng(seed).integers(0, 256, (size, channels)).astype(np.uint8)
    np.testing.assert_array_equal(unpack_levels(pack_levels(levels), size, channels), levels)


def stored(mesh: TexturedMesh) -> tuple[TexturedMesh, UnitFrame, SurfaceMaps]:
    """A mesh as a file has it, its frame, and its maps; albedo on the coarser half of the lattices."""
    file_mesh = stored_mesh(mesh, decode_surface(encode_surface(mesh.surface)))
    frame = UnitFrame.of_points(file_mesh.vertices)
    with mock.patch.object(map_sampling, "ALBEDO_PITCHES", map_sampling.ALBEDO_PITCHES[:3]):
        return file_mesh, frame, sample_maps(file_mesh, frame, Appearance())


def test_stored_normals_are_the_maps() -> None:
    u, v = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(64) + 0.5) / 64)
    waves = np.dstack([0.5 * np.sin(6 * u), 0.4 * np.cos(5 * v), np.ones_like(u)])
    waves /= np.linalg.norm(waves, axis=2, keepdims=True)
    mesh, _, maps = stored(plane(image=np.rint(127.5 * (waves + 1)).astype(np.uint8)))
    samples = maps.surface.sample(500, seed=1)
    inside = (np.abs(samples.points[:, :2] - 0.5) < 0.47).all(axis=1)  # a map repeats at its rim
    normals = maps.bent(samples.face, samples.barycentric)[inside]
    expected = mapped(mesh).at(samples.face, samples.barycentric)[inside]
    angle = np.degrees(np.arccos(np.clip((normals * expected).sum(axis=1), -1, 1)))
    assert angle.max() < 1.5
    assert angle.mean() < 0.6


def test_a_tilted_map_is_lit_as_a_tilted_plane() -> None:
    """Cos / d^2 of the tilted normal, but for light that grazes the plane."""
    _, frame, maps = stored(plane())
    surface = UnitSurface(maps.surface, frame, maps)
    samples = maps.surface.sample(50, seed=2)
    light = np.array([-0.3, -0.2, 1.0])
    down = np.broadcast_to([0.0, 0.0, -1.0], samples.points.shape)
    points = surface.incidence(samples.face, samples.barycentric, down, light)
    towards = light - frame.to_unit(samples.points)
    distance = np.linalg.norm(towards, axis=1)
    expected = np.maximum(towards @ TILTED, 0) / distance**3
    steep = towards[:, 2] > 0.7 * distance
    assert steep.sum() > 10
    np.testing.assert_allclose(points.irradiance[steep], expected[steep], rtol=0.03, atol=2e-3)
    assert (points.irradiance < 1.02 * expected + 2e-3).all()
    np.testing.assert_allclose(points.normal, np.broadcast_to(TILTED, points.normal.shape), atol=0.006)
    # From behind the same point shows the other side of the same normal.
    behind = surface.incidence(samples.face, samples.barycentric, -down, -light)
    np.testing.assert_allclose(behind.normal, -points.normal, atol=1e-12)


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_bending_never_lights_what_the_surface_hides(parts: list[float]) -> None:
    upright, light = np.array([[0.0, 0.0, 1.0]]), np.array([[*parts[:2], abs(parts[2]) + 1e-3]])
    bent = np.array([[*parts[3:5], abs(parts[5]) + 1e-3]])
    light, bent = (vector / np.linalg.norm(vector) for vector in (light, bent))
    share = bent_share(upright, bent, light)
    assert np.isfinite(share).all()
    assert 0 <= share[0] * light[0, 2] <= max(float(bent[0] @ light[0]), 0.0) + 1e-9
    np.testing.assert_allclose(bent_share(upright, upright, light), 1.0)


def test_rounding_under_the_most_grazing_light_leaves_a_number() -> None:
    upright = np.array([[0.0, 0.0, 1 + 2e-16]])
    light = np.array([[1.0, 0.0, 1e-12]])
    assert np.isfinite(bent_share(upright, upright, light)).all()


def waved_sheet() -> tuple[UnitSurface, UnitFrame, SurfaceMaps]:
    surface = sheet()
    frame = UnitFrame.of_points(surface.vertices)
    triangles = frame.to_unit(surface.vertices)[surface.faces]
    size = FaceLattice(triangles, 1 / 32).size
    levels = np.random.default_rng(3).integers(20, 108, (size, 2)).astype(np.uint8)
    maps = SurfaceMaps(surface, triangles, {"normal": 1 / 32}, {"normal": levels})
    return UnitSurface(surface, frame, maps), frame, maps


def test_kernels_light_bent_normals_as_the_reference_does() -> None:
    surface, _, _ = waved_sheet()
    samples = surface.surface.sample(400, seed=4)
    random = np.random.default_rng(5)
    directions = random.normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    light = np.array([0.3, -0.2, 0.7])
    expected = surface.incidence(samples.face, samples.barycentric, directions, light)
    lit = LitSurface(surface)
    points = lit.points(samples.face, samples.barycentric, directions)
    irradiance, hidden = lit.light_from(points, light)
    np.testing.assert_allclose(points.normal, expected.normal, atol=1e-12)
    np.testing.assert_allclose(np.where(hidden, 0, irradiance), expected.irradiance, atol=1e-9)


def with_maps(net: VisionNet, maps: SurfaceMaps, frame: UnitFrame) -> VisionNet:
    return VisionNet(
        maps.surface, frame, net._grid, net._weights, radiance_scale=0.5, camera_radius=2.5, maps=maps,
        appearance=Appearance(0.3, 1.0),
    )  # fmt: skip


def test_maps_travel_in_the_file_and_damaged_ones_are_refused() -> None:
    _, frame, maps = waved_sheet()
    net = with_maps(drawn_visionnet(maps.surface), maps, frame)
    again = VisionNet.from_tensors(net.tensors(), net.metadata(), maps.surface, frame)
    camera, light = look_at(np.array([[0.5, -1.2, 1.8]])), np.array([0.4, 0.1, 0.9])
    image = net.render(camera, light, 24, 39.6, 4)
    np.testing.assert_array_equal(again.render(camera, light, 24, 39.6, 4), image)
    plain = drawn_visionnet(maps.surface)
    assert np.abs(plain.render(camera, light, 24, 39.6, 4) - image).max() > 0.02
    assert "maps" not in plain.metadata()
    opened = VisionNet.from_tensors(plain.tensors(), plain.metadata(), maps.surface, frame)
    np.testing.assert_array_equal(
        opened.render(camera, light, 24, 39.6, 4), plain.render(camera, light, 24, 39.6, 4)
    )
    stream = net.tensors()["vision.map.normal"]
    bad = [
        ({**net.tensors(), "vision.map.normal": stream[:-9]}, net.metadata()),
        ({**net.tensors(), "vision.map.shine": stream}, net.metadata()),
        (net.tensors(), {**net.metadata(), "maps": {"normal": {"pitch": 1e-9, "values": 9}}}),
        (net.tensors(), {**net.metadata(), "maps": {}}),
        (plain.tensors(), net.metadata()),
    ]
    for tensors, metadata in bad:
        with pytest.raises(FormatError):
            VisionNet.from_tensors(tensors, metadata, maps.surface, frame)
    finer = {**net.metadata(), "maps": {"normal": {**net.metadata()["maps"]["normal"], "pitch": 1 / 64}}}
    finer_net = VisionNet.from_tensors(net.tensors(), finer, maps.surface, frame)
    with pytest.raises(FormatError, match="values that the faces do not have"):
        finer_net.render(camera, light, 24, 39.6, 4)


def test_a_lattice_of_too_many_values_is_refused() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    with pytest.raises(FormatError, match="more than"):
        FaceLattice(np.tile(corners, (9, 1, 1)), 1 / 1024)


def test_faces_of_one_cube_share_values_and_the_sides_of_a_wall_do_not() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
    wall = np.stack([corners, corners[::-1] + np.array([0, 0, 1e-4])])
    alone, both = FaceLattice(wall[:1], 0.02), FaceLattice(wall, 0.02)
    assert both.size == 2 * alone.size
    halves = np.array([[corners[0], corners[1], (corners[1] + corners[2]) / 2],
                       [corners[0], (corners[1] + corners[2]) / 2, corners[2]]])  # fmt: skip
    assert abs(FaceLattice(halves, 0.02).size - alone.size) <= 5
