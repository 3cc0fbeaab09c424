import numpy as np
import pytest
from vision_shapes import cube, sphere

from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.network.incidence import Incidence, UnitSurface


def seen(mesh, origins, targets, light) -> tuple[Incidence, np.ndarray]:
    frame = UnitFrame.of_points(mesh.vertices)
    surface = UnitSurface(mesh.surface, frame)
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    face, barycentric = surface.first_hits(origins, directions)
    assert (face >= 0).all()
    return surface.incidence(face, barycentric, directions, np.asarray(light, dtype=float)), directions


def test_a_smooth_sphere_is_lit_by_the_law_up_to_its_terminator():
    mesh = sphere(0.5, (200, 200, 200))
    normals = np.random.default_rng(1).normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.array([0.0, 0.0, 1.0])
    points, _ = seen(mesh, 2.5 * normals, np.zeros((1, 3)), light)
    to_light = light - 0.5 * normals
    distance = np.linalg.norm(to_light, axis=1)
    expected = np.maximum(0, (normals * to_light).sum(axis=1) / distance) / distance**2
    # The facets' own terminator must not show: nothing that the smooth sphere lights is in shadow.
    np.testing.assert_allclose(points.irradiance, expected, atol=0.02)


def test_light_does_not_pass_through_a_cube():
    origins = np.array([[0.1, 0.05, 2.5], [0.1, 0.05, -2.5]])
    points, _ = seen(cube(), origins, origins * [1, 1, 0], [0.0, 0.0, 1.0])
    assert points.irradiance[0] == pytest.approx((0.5 / np.hypot(0.5, np.hypot(0.1, 0.05))) / (0.25 + 0.0125))
    assert points.irradiance[1] == 0


def test_the_seen_side_of_an_inverted_face_is_its_front():
    mesh = cube()
    mesh.faces[:] = mesh.faces[:, ::-1]
    origins = np.array([[0.1, 0.05, 2.5]])
    points, directions = seen(mesh, origins, origins * [1, 1, 0], [0.0, 0.0, 1.0])
    assert (points.normal * directions).sum() < 0
    assert points.irradiance[0] > 0
