"""Surfaces that show themselves: mirror rays against closed forms, and both ways to render them."""

import numpy as np
import pytest
from compiled_cases import SHAPES, network
from small_meshes import joined
from torch_renderer import TorchRenderer
from vision_shapes import sphere

from objectfolder.errors import FormatError
from objectfolder.making.visionnet.fitting import filled_view, fit_visionnet, rays_to_meet, shows_itself
from objectfolder.products.store import Array, Product
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at, pixel_rays, sub_ray_offsets, uniform_on_sphere
from objectfolder.vision.compiled import CompiledRenderer
from objectfolder.vision.compositing import composite_on_white
from objectfolder.vision.lamps import LIGHT_POWER_W
from objectfolder.vision.network.incidence import Incidence, UnitSurface
from objectfolder.vision.visionnet.visionnet import VisionNet

WHITE = np.ones((1, 3))


def rays(position: tuple[float, ...], size: int = 40) -> tuple[np.ndarray, np.ndarray]:
    return pixel_rays(look_at(np.array([position]))[0], np.arange(size**2), sub_ray_offsets(1), size, 39.6)


def corner_of_mirrors() -> UnitSurface:
    """Two squares of side 1 that meet at a right angle along y: every ray leaves as it came."""
    floor = np.array([[-0.5, -0.5, -0.5], [0.5, -0.5, -0.5], [0.5, 0.5, -0.5], [-0.5, 0.5, -0.5]])
    wall = floor[:, [2, 1, 0]]
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    surface = joined((floor, quad), (wall, quad[:, ::-1]))
    return UnitSurface(surface, UnitFrame.of_points(surface.vertices))


def test_a_corner_of_mirrors_shows_what_the_law_of_reflection_says():
    surface = corner_of_mirrors()
    origins, directions = rays((1.5, 0.2, 0.9))
    face, barycentric = surface.first_hits(origins, directions)
    hit = face >= 0
    points = surface.incidence(face[hit], barycentric[hit], directions[hit], np.array([0.5, 0.1, 0.7]))
    met = surface.mirrored(face[hit], points)
    floor = face[hit] < 2
    turned = directions[hit] * np.where(floor[:, None], [1, 1, -1], [-1, 1, 1])
    np.testing.assert_allclose(met.direction, turned[met.row], atol=1e-9)
    # From the floor to the wall and from the wall to the floor, where they are met within their squares.
    start = points.position[met.row]
    axis = np.where(floor[met.row], 0, 2)
    along = (-0.5 - np.take_along_axis(start, axis[:, None], 1)) / np.take_along_axis(
        met.direction, axis[:, None], 1
    )
    position, _ = surface.seen(met.face, met.barycentric, met.direction)
    np.testing.assert_allclose(position, start + along * met.direction, atol=1e-3)
    assert (floor[met.row] == (met.face >= 2)).all()
    assert len(met.row) > 100


def test_a_ball_does_not_see_itself():
    ball = sphere(0.5, (200, 200, 200)).surface
    surface = UnitSurface(ball, UnitFrame.of_points(ball.vertices))
    origins, directions = rays((1.5, 0.2, 0.9))
    face, barycentric = surface.first_hits(origins, directions)
    hit = face >= 0
    points = surface.incidence(face[hit], barycentric[hit], directions[hit], np.array([0.0, 0.0, 1.0]))
    assert len(surface.mirrored(face[hit], points).row) == 0


@pytest.mark.parametrize("shape", ["mug", "furniture"])
def test_both_ways_show_the_surface_in_itself(shape):
    surface, grid, weights = network(SHAPES[shape](), mirrors=True)
    slow = TorchRenderer(surface, grid, weights, 1.0)
    fast = CompiledRenderer(surface, grid, weights, 1.0)
    lights = np.array([[0.3, 0.2, 0.9], [-0.5, -0.7, 0.4]])
    origins, directions = rays((0.8, -1.2, 1.9))
    colours = np.array([[1.0, 0.5, 0.2], [0.3, 0.9, 0.6]])
    expected = slow.radiance(origins, directions, lights, colours)
    answer = fast.radiance(origins, directions, lights, colours)
    off = np.abs(answer - expected).max(axis=1) > 2e-3 * (1 + np.abs(expected).max(axis=1))
    assert off.mean() < 2e-3
    # Without what is seen in the mirror it would be another image.
    no_mirrors = weights | {"facing.bias": np.full(3, -60.0), "facing.weight": 0 * weights["facing.weight"]}
    without = TorchRenderer(surface, grid, no_mirrors, 1.0).radiance(origins, directions, lights, colours)
    assert np.abs(without - expected).max() > 0.05
    pose = look_at(np.array([[0.8, -1.2, 1.9]]))[0]
    image = fast.render(pose, lights, colours, (24, 24), 39.6, 64)
    truth = slow.render(pose, lights, colours, (24, 24), 39.6, 256)
    assert np.sqrt(((image - truth) ** 2).mean()) < 0.02
    part = fast.render(pose, lights, colours, (24, 24), 39.6, 64, (7, 5, 11, 13))
    np.testing.assert_array_equal(part, image[7:18, 5:18])


ROUGHNESS, FACING = 0.3, 0.7


def ggx(points: Incidence) -> np.ndarray:
    """Radiance (n,) over P / (4 pi^2) of a conductor under the lamp."""
    half = points.to_light + points.to_camera
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    light, camera, middle = (
        np.einsum("ij,ij->i", points.normal, vector).clip(1e-3)
        for vector in (points.to_light, points.to_camera, half)
    )
    alpha2 = ROUGHNESS**4
    masked = light * np.sqrt(camera**2 * (1 - alpha2) + alpha2)
    shadowed = camera * np.sqrt(light**2 * (1 - alpha2) + alpha2)
    fresnel = FACING + (1 - FACING) * (1 - np.einsum("ij,ij->i", half, points.to_light)) ** 5
    lobe = alpha2 / (2 * (middle**2 * (alpha2 - 1) + 1) ** 2 * (masked + shadowed))
    return fresnel * lobe * points.irradiance


def path_traced(
    surface: UnitSurface, camera: np.ndarray, light: np.ndarray, size: int, random: np.random.Generator
) -> np.ndarray:
    """Premultiplied (size, size, 4) of the conductor by paths of up to two meetings, half-vectors drawn."""
    origins, directions = pixel_rays(camera, np.arange(size**2), sub_ray_offsets(64), size, 39.6)
    face, barycentric = surface.first_hits(origins, directions)
    hit = np.flatnonzero(face >= 0)
    points = surface.incidence(face[hit], barycentric[hit], directions[hit], light)
    radiance = ggx(points)
    normal, view, alpha2 = points.normal, points.to_camera, ROUGHNESS**4
    u, azimuth = random.random(len(hit)), 2 * np.pi * random.random(len(hit))
    cosine = np.sqrt((1 - u) / (1 + (alpha2 - 1) * u))[:, None]
    aside = np.cross(normal, [0.0, 1.0, 0.0])
    half = np.cos(azimuth)[:, None] * aside + np.sin(azimuth)[:, None] * np.cross(normal, aside)
    half = cosine * normal + np.sqrt(1 - cosine**2) * half
    along = np.einsum("ij,ij->i", view, half)
    onward = 2 * along[:, None] * half - view
    out, camera_cosine = (np.einsum("ij,ij->i", normal, vector) for vector in (onward, view))
    face, barycentric = surface.first_hits(points.position + 1e-4 * normal, onward)
    again = np.flatnonzero((face >= 0) & (out > 0) & (along > 0))
    met = surface.incidence(face[again], barycentric[again], onward[again], light)
    masked = out * np.sqrt(camera_cosine**2 * (1 - alpha2) + alpha2)
    shadowed = camera_cosine * np.sqrt(out**2 * (1 - alpha2) + alpha2)
    # F G v.h / (n.v n.h), G = 2 n.l n.v / (masked + shadowed).
    weight = (FACING + (1 - FACING) * (1 - along.clip(0, 1)) ** 5) * 2 * out * along / (masked + shadowed)
    radiance[again] += (weight / cosine[:, 0])[again] * ggx(met)
    rgba = np.zeros((len(origins), 4))
    rgba[hit, :3], rgba[hit, 3] = radiance[:, None] * LIGHT_POWER_W / (4 * np.pi**2), 1.0
    result: np.ndarray = rgba.reshape(size, size, 64, 4).mean(axis=2)
    return result


def views_of_a_conductor(surface: UnitSurface, count: int, held_out: int, size: int) -> Product:
    random = np.random.default_rng(2)
    away = np.array([1.0, 1.0, 1.0])
    cameras = look_at(np.abs(uniform_on_sphere(count, 2.5, random)) * away)
    lights = np.abs(uniform_on_sphere(count, 1.0, random)) * away
    rgba = np.stack([path_traced(surface, *pair, size, random) for pair in zip(cameras, lights, strict=True)])
    return Product(
        {
            "rgba": Array(rgba.astype(np.float32), ("view", "y", "x", "channel"), "1", "radiance"),
            "camera_to_world": Array(cameras, ("view", "row", "column"), "1", "pose"),
            "light_position": Array(lights, ("view", "axis"), "1", "lamp"),
            "held_out": Array(np.arange(count) >= count - held_out, ("view",), "1", "kept"),
        },
        {
            "field_of_view_deg": 39.6,
            "camera_radius": 2.5,
            "light_power_w": LIGHT_POWER_W,
            "appearance": Appearance(roughness=ROUGHNESS, metallic=1.0).to_dict(),
        },
    )


@pytest.mark.slow
def test_a_fit_with_mirrors_is_nearer_a_path_traced_conductor_and_its_file_answers_alike():
    surface = corner_of_mirrors()
    views = views_of_a_conductor(surface, 12, 4, 16)
    held_out = views["held_out"]
    query = (views["camera_to_world"][held_out], views["light_position"][held_out], 16, 39.6, 64)
    truth = composite_on_white(views["rgba"][held_out])
    errors = []
    toy = {"steps": 120, "batch_pixels": 128, "grid_resolution": 16, "learning_rate": 2e-2}
    for mirrors in (None, False):
        net = fit_visionnet(surface.surface, surface.frame, views, **toy, mirrors=mirrors)
        answer = net.render(*query)
        errors.append(-10 * np.log10(np.mean((composite_on_white(answer) - truth) ** 2)))
        stored = VisionNet.from_tensors(net.tensors(), net.metadata(), surface.surface, surface.frame)
        np.testing.assert_array_equal(stored.render(*query), answer)
    assert errors[0] > errors[1] + 5.0


def test_conductors_show_themselves_where_they_are_smooth_or_face_themselves(subtests):
    ball, mug = sphere(0.5, (200, 200, 200)).surface, SHAPES["mug"]()
    for roughness, metallic, shown, facing_itself, rays in [
        (0.1, 1.0, True, True, 24),
        (0.25, 1.0, True, True, 12),
        (0.0, 1.0, True, True, 24),
        (0.4, 1.0, False, True, 8),
        (0.5, 1.0, False, False, 6),
        (0.7, 0.0, False, False, 4),
        (0.5, 0.0, False, False, 6),
        (0.3, 0.0, False, False, 7),
        (0.2, 0.0, False, False, 24),
        (0.1, 0.0, False, False, 24),
    ]:
        with subtests.test(roughness=roughness):
            appearance = Appearance(roughness=roughness, metallic=metallic)
            assert shows_itself(appearance, ball) is shown
            assert shows_itself(appearance, mug) is facing_itself
            assert rays_to_meet(appearance, facing_itself) == rays


def test_how_much_of_its_own_view_a_surface_fills():
    """Two unit squares at a right angle see each other by the view factor of Howell's catalogue, C-14."""
    assert filled_view(sphere(0.5, (200, 200, 200)).surface) == 0
    # Two identical squares at right angles with a common edge.
    assert filled_view(corner_of_mirrors().surface) == pytest.approx(0.20004, abs=0.02)


@pytest.mark.parametrize("lost", ["log_mirror_alpha", "facing.weight", "facing.bias"])
def test_a_file_that_lost_a_part_of_its_mirrors_is_refused(lost):
    surface, grid, weights = network(SHAPES["cube"](), mirrors=True)
    net = VisionNet(surface.surface, surface.frame, grid, weights, radiance_scale=0.5, camera_radius=2.5)
    tensors = {name: value for name, value in net.tensors().items() if name != f"vision.{lost}"}
    with pytest.raises(FormatError, match=r"vision\.(log_mirror_alpha|facing)"):
        VisionNet.from_tensors(tensors, net.metadata(), surface.surface, surface.frame)
