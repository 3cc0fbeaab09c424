"""Surface queries against closed forms, a brute-force search, and one another."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.surface.bounding_boxes import BoundingBoxTree, intersect
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface, corner_normals


def _sphere(radius: float = 0.05, subdivisions: int = 4) -> Surface:
    mesh = trimesh.creation.icosphere(subdivisions, radius)
    return Surface(mesh.vertices, mesh.faces)


def _both_engines(vertices: np.ndarray, faces: np.ndarray) -> list[Surface]:
    return [Surface(vertices, faces, use_embree=False), Surface(vertices, faces, use_embree=True)]


def test_rays_hit_a_sphere_where_algebra_says() -> None:
    mesh = trimesh.creation.icosphere(5, 0.05)
    random = np.random.default_rng(1)
    directions = random.normal(size=(500, 3))
    origins = -directions / np.linalg.norm(directions, axis=1, keepdims=True) * 0.2
    for surface in _both_engines(mesh.vertices, mesh.faces):
        hits = surface.ray_hits(origins, -origins)
        assert np.allclose(hits.distance * 0.2, 0.15, atol=0.05 * 1e-3)
        assert np.allclose(
            surface.points_at(hits.face, hits.barycentric), origins * (1 - hits.distance[:, None])
        )


def test_both_engines_see_the_same_first_face_and_the_same_shadows() -> None:
    mesh = trimesh.creation.torus(0.04, 0.012, 48, 24)
    place = np.array([0.3, -0.2, 0.1])  # embree has single precision, about the middle of the object
    numpy_tree, embree = _both_engines(mesh.vertices + place, mesh.faces)
    random = np.random.default_rng(2)
    origins = place + random.normal(size=(4000, 3)) * 0.06
    directions = random.normal(size=(4000, 3))
    first, second = numpy_tree.ray_hits(origins, directions), embree.ray_hits(origins, directions)
    assert (first.face == second.face).mean() > 0.999
    same = (first.face == second.face) & (first.face >= 0)
    np.testing.assert_allclose(first.distance[same], second.distance[same], rtol=1e-9)
    targets = place + random.normal(size=(4000, 3)) * 0.06
    assert (numpy_tree.occluded(origins, targets) == embree.occluded(origins, targets)).mean() > 0.999


@pytest.mark.parametrize("faces", [np.zeros((0, 3), int), [[0, 1, 3]], [[0, 1, -1]]])
def test_faces_without_their_vertices_are_no_surface(faces: np.ndarray) -> None:
    with pytest.raises(ValueError, match="faces that refer to its vertices"):
        Surface(np.eye(3), faces)


def test_tree_finds_what_brute_force_finds() -> None:
    random = np.random.default_rng(3)
    triangles = random.normal(size=(37, 1, 3)) + 0.3 * random.normal(size=(37, 3, 3))
    tree = BoundingBoxTree(triangles)
    origins, directions = random.normal(size=(300, 3)) * 2, random.normal(size=(300, 3))
    distances = np.stack(
        [intersect(np.repeat(t[None], 300, axis=0), origins, directions)[0] for t in triangles], axis=1
    )
    expected = np.where(np.isfinite(distances.min(axis=1)), distances.argmin(axis=1), -1)
    np.testing.assert_array_equal(tree.nearest_hits(origins, directions), expected)
    np.testing.assert_array_equal(tree.occluded(origins, directions), distances.min(axis=1) < 1)


def test_rays_along_the_axes_and_in_the_plane_of_a_box_do_not_fail() -> None:
    box = trimesh.creation.box((1, 1, 1))
    for surface in _both_engines(box.vertices, box.faces):
        hits = surface.ray_hits(np.array([[0.1, 0.2, 3.0]]), np.array([[0.0, 0.0, -1.0]]))
        assert hits.distance[0] == pytest.approx(2.5)
        surface.ray_hits(np.array([[0.5, 0.0, 3.0]]), np.array([[0.0, 0.0, -1.0]]))
        assert surface.ray_hits(np.array([[0.6, 0.0, 3.0]]), np.array([[0.0, 0.0, -1.0]])).face[0] == -1


def test_closest_points_match_an_independent_search() -> None:
    mesh = trimesh.creation.box((0.1, 0.05, 0.02))
    surface = Surface(mesh.vertices, mesh.faces)
    points = np.random.default_rng(4).normal(size=(200, 3)) * 0.05
    _, expected, _ = trimesh.proximity.closest_point_naive(mesh, points)
    closest = surface.closest_points(points)
    np.testing.assert_allclose(closest.distance, expected, atol=1e-12)
    np.testing.assert_allclose(surface.points_at(closest.face, closest.barycentric), closest.points)


def test_closest_points_do_not_depend_on_the_batch() -> None:
    surface = _sphere()
    points = np.random.default_rng(5).normal(size=(50, 3)) * 0.05
    together = surface.closest_points(points)
    for index in range(0, 50, 7):
        alone = surface.closest_points(points[index])
        assert alone.face[0] == together.face[index]
        np.testing.assert_array_equal(alone.points[0], together.points[index])


def test_samples_are_uniform_by_area() -> None:
    # Two squares, one nine times the other.
    vertices = np.array(
        [[0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0], [9, 0, 0], [10, 0, 0], [10, 1, 0], [9, 1, 0]]
    )
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    samples = Surface(vertices, faces).sample(20000, seed=0)
    assert (samples.points[:, 0] < 5).mean() == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose(
        samples.points[samples.points[:, 0] < 5].mean(axis=0), [1.5, 1.5, 0], atol=0.03
    )
    np.testing.assert_allclose(samples.normals, np.broadcast_to([0, 0, 1], (20000, 3)))


def test_normals_are_radial_on_a_sphere_and_keep_the_creases_of_a_box() -> None:
    sphere = _sphere()
    samples = sphere.sample(300, seed=1)
    radial = samples.points / np.linalg.norm(samples.points, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.einsum("ij,ij->i", radial, samples.normals).min())) < 1.0
    box = trimesh.creation.box((1, 1, 1))
    surface = Surface(box.vertices, box.faces)
    np.testing.assert_allclose(
        surface.corner_normals, np.repeat(surface.face_normals[:, None], 3, axis=1), atol=1e-12
    )


@given(st.integers(0, 10_000))
def test_corner_normals_turn_with_the_object(seed: int) -> None:
    mesh = trimesh.creation.icosphere(1, 1.0)
    rotation = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))[:3, :3]
    turned = corner_normals(mesh.vertices @ rotation.T, mesh.faces)
    np.testing.assert_allclose(turned, corner_normals(mesh.vertices, mesh.faces) @ rotation.T, atol=1e-9)


def test_a_face_without_area_gives_finite_normals() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    surface = Surface(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    assert np.isfinite(surface.corner_normals).all()
    assert np.isfinite(surface.sample(100, seed=0).normals).all()


def test_unit_frame_maps_there_and_back() -> None:
    points = np.random.default_rng(6).normal(size=(40, 3)) * 0.1 + 2
    frame = UnitFrame.of_points(points)
    unit = frame.to_unit(points)
    assert np.ptp(unit, axis=0).max() == pytest.approx(1.0)
    np.testing.assert_allclose(unit.min(axis=0) + unit.max(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(frame.to_object(unit), points)
    pose = np.eye(4)
    pose[:3, 3] = points[0]
    np.testing.assert_allclose(frame.camera_to_object(frame.camera_to_unit(pose)), pose)
    assert UnitFrame.from_dict(frame.to_dict()).to_dict() == frame.to_dict()


def test_a_surface_refuses_coordinates_that_are_not_finite() -> None:
    with pytest.raises(ValueError, match="finite"):
        Surface(np.array([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
