"""Environments: maps and their sums, furnaces, suns and crops."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_meshes import box, joined, sphere
from small_visionnets import drawn_visionnet
from vision_shapes import cube

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import look_at, uniform_on_sphere
from objectfolder.vision.compiled.lobes import Cast, lobe_directions
from objectfolder.vision.compiled.renderer import CompiledRenderer
from objectfolder.vision.compiled.surroundings import Surroundings, looked_up
from objectfolder.vision.environment import Environment, pixel_directions
from objectfolder.vision.visionnet.visionnet import VisionNet

CAMERAS = look_at(np.array([[1.5, -1.7, 1.0], [-1.2, 0.9, -1.8]]))


@pytest.fixture(scope="module")
def net() -> VisionNet:
    return drawn_visionnet(cube())


def bright_sky(seed: int, height: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.exp(random.normal(0, 2, (height, 2 * height, 1))) * random.random((height, 2 * height, 3))


def test_solid_angles_fill_the_sphere_and_directions_are_blender_s() -> None:
    directions, solid_angle = pixel_directions(32)
    assert solid_angle.sum() * 64 == pytest.approx(4 * np.pi, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    assert directions[0, 0, 2] > 0.99
    assert directions[31, 0, 2] < -0.99
    np.testing.assert_allclose(directions[15:17, 31:33].mean(axis=(0, 1)), [1, 0, 0], atol=3e-3)
    np.testing.assert_allclose(directions[15:17, 15:17].mean(axis=(0, 1)), [0, 1, 0], atol=3e-3)
    # The mean over the sphere of n n^T is a third of the identity.
    second = np.einsum("hwi,hwj,h->ij", directions, directions, solid_angle) / (4 * np.pi)
    np.testing.assert_allclose(second, np.eye(3) / 3, atol=1e-3)


@given(st.integers(0, 1000), st.integers(1, 40))
def test_no_power_is_lost_whatever_the_map(seed: int, height: int) -> None:
    sky = bright_sky(seed, height) * (np.random.default_rng(seed).random((height, 2 * height, 1)) > 0.5)
    around = Environment.of(sky)
    power = (sky * pixel_directions(height)[1][:, None, None]).sum(axis=(0, 1))
    np.testing.assert_allclose(around.powers.sum(axis=0), power, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(around.directions, axis=1), 1.0)
    # The coarsest level is the mean over the sphere.
    np.testing.assert_allclose(around.texels[-2:].mean(axis=0), power / (4 * np.pi), rtol=1e-5)


@pytest.mark.parametrize("height", [48, 300])
def test_the_irradiance_of_a_plane_is_that_of_the_map(height: int) -> None:
    sky = bright_sky(1, height)
    around = Environment.of(sky)
    directions, solid_angle = pixel_directions(height)
    size, level = np.array([len(around.irradiance)]), np.zeros(20)
    normals = uniform_on_sphere(20, 1.0, np.random.default_rng(0))
    irradiance = looked_up(around.irradiance.reshape(-1, 3), size, normals, level)
    for normal, value in zip(normals, irradiance, strict=True):
        share = np.maximum(directions @ normal, 0) * solid_angle[:, None]
        np.testing.assert_allclose(value, (sky * share[..., None]).sum(axis=(0, 1)), rtol=0.02)


def test_a_map_is_looked_up_where_blender_has_it() -> None:
    sky = np.zeros((16, 32, 3))
    sky[4, 6] = 1.0
    around = Environment.of(sky)
    at = pixel_directions(16)[0]
    rgb = looked_up(around.texels, around.heights, np.ascontiguousarray(at.reshape(-1, 3)), np.zeros(512))
    np.testing.assert_allclose(rgb.reshape(sky.shape), sky, atol=1e-5)


def test_directions_of_a_lobe_have_the_density_they_say() -> None:
    count, alpha2 = 200_000, 0.16
    random = np.random.default_rng(2)
    normal = np.tile([0.0, 0.6, 0.8], (count, 1))
    camera = np.array([0.5, 0.1, 0.7])
    camera = np.tile(camera / np.linalg.norm(camera), (count, 1))
    direction, density = lobe_directions(
        normal, normal, camera, np.full(count, alpha2), random.random(count), random.random(count), 0.01
    )
    valid = density > 0
    assert valid.mean() > 0.8
    # The mean of 1 / density over a cap that the lobe fills is the cap's solid angle.
    mirror = 2 * (camera[0] @ normal[0]) * normal[0] - camera[0]
    inside = valid & (direction @ mirror > 0.9)
    assert (1 / density[inside]).sum() / count == pytest.approx(2 * np.pi * 0.1, rel=0.01)


def test_radiance_follows_the_light_and_neither_company_nor_crop_count(net: VisionNet) -> None:
    sky = bright_sky(3, 32)
    around = Environment.of(sky)
    images = net.render(CAMERAS, around, 40, 39.6)
    assert images[..., :3].max() > 0
    np.testing.assert_array_equal(net.render(CAMERAS[1], around, 40, 39.6)[0], images[1])
    part = net.render(CAMERAS[1], around, 40, 39.6, crop=(9, 13, 17, 11))
    np.testing.assert_array_equal(part[0], images[1, 9:26, 13:24])
    twice = net.render(CAMERAS, Environment.of(2 * sky), 40, 39.6, 1)
    np.testing.assert_allclose(
        twice[..., :3], 2 * net.render(CAMERAS, around, 40, 39.6, 1)[..., :3], rtol=1e-5
    )


def test_a_turned_sky_turns_the_light(net: VisionNet) -> None:
    sky = np.zeros((16, 32, 3))
    sky[7:9, 15:17] = 100.0  # along +x
    lit = [
        net.render(look_at(2.5 * np.array([side])), Environment.of(np.roll(sky, -8 * turn, axis=1)), 24, 39.6)
        for turn in range(2)
        for side in ([1.0, 0.2, 0.3], [0.2, 1.0, 0.3])
    ]
    toward_x, beside_x, beside_y, toward_y = (image[..., :3].mean() for image in lit)
    assert toward_x > 2 * beside_x
    assert toward_y > 2 * beside_y


def test_a_highlight_shows_the_object_where_that_hides_a_white_furnace(net: VisionNet) -> None:
    renderer = net._rendering()
    surface, network, count = renderer._surface, renderer._network, len(renderer._surface.facets)
    points = surface.points(np.arange(count), np.full((count, 3), 1 / 3), -surface.facets)
    at = np.arange(count)
    cast = Cast(at, at, np.zeros_like(at), np.ones_like(at))
    around = Surroundings(surface, network, Environment.of(np.ones((16, 32, 3))))
    gathered, matt, gloss = around.gathered(points, cast), [], []
    for hidden in (False, True):
        volumes = SimpleNamespace(occluded=lambda start, *_, all_of=hidden: np.full(len(start), all_of))
        around._surface = SimpleNamespace(facets=surface.facets, volumes=volumes)
        parts = around.shown(points, gathered, cast, 4, network.alpha2)
        matt.append(parts[0])
        gloss.append(parts[1])
        np.testing.assert_array_equal(parts[2], around.outlined(points, gathered)[1])
    assert (gloss[0] > 0).any()
    np.testing.assert_allclose(gloss[1], gloss[0] * matt[0] / np.pi, rtol=1e-6)


WHITE = SimpleNamespace(  # and matt; what bounces is as bright as the light
    alpha2=np.float32(0.1),
    mirrors=False,
    features=lambda points: (points.position, np.ones_like(points.position)),
    lamps=lambda directions: directions,
    reflected=lambda points, features, row, *_: (np.ones((len(row), 3)), np.zeros((len(row), 3))),
    bounced=lambda points, features, light, lamps, irradiance: irradiance[:, None] * np.ones(3),
)


def white(surface: Surface) -> CompiledRenderer:
    renderer = drawn_visionnet(surface, resolution=8)._rendering()
    renderer._network = WHITE
    return renderer


def matt_radiance(
    renderer: CompiledRenderer, face: np.ndarray, barycentric: np.ndarray, sky: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pi times the radiance (n,) of points, what bounces to them, and their normals (n, 3)."""
    points = renderer._surface.points(face, barycentric, -renderer._surface.facets[face])
    rows, columns = np.divmod(np.arange(len(face)), 4)
    cast = Cast(columns, rows, np.zeros_like(rows), np.ones_like(rows))
    around = Surroundings(renderer._surface, WHITE, Environment.of(sky))
    matt = around.shown(points, around.gathered(points, cast, bounces=False), cast, 1, WHITE.alpha2)[0]
    cast = Cast(0 * rows, 0 * rows, 0 * rows, np.ones_like(rows))  # all ask the same lights
    return matt[:, 0], around.gathered(points, cast).bounced[:, 0], points.normal


def half_bright(axis: int, sign: int) -> np.ndarray:
    return np.repeat(sign * pixel_directions(32)[0][..., [axis]] >= 0, 3, axis=2).astype(float)


@pytest.mark.parametrize(("sky", "share", "behind"), [
    (np.ones((32, 64, 3)), 1.0, True), (half_bright(0, 1), 0.5, False), (half_bright(0, -1), 0.5, True),
], ids=["furnace", "before", "behind"])  # fmt: skip
def test_a_wall_hides_the_light_behind_it(sky: np.ndarray, share: float, behind: bool) -> None:
    """By the view factor of a rectangle from a plane at its foot (Howell's catalogue, B-4)."""
    surface = joined(box((0, -0.5, -0.1), (1, 0.5, 0)), box((-0.1, -0.5, -0.1), (0, 0.5, 0.9)))
    distance, height, half = 0.05, 0.9, 0.5
    places = surface.closest_points(np.tile([distance, 0.0, 0.0], (16, 1)))
    far = np.hypot(height, distance)
    wall = (np.arctan(half / distance) - distance / far * np.arctan(half / far)) / np.pi
    matt, _, _ = matt_radiance(white(surface), places.face, places.barycentric, sky)
    # The irradiance of a plane that looks along a pole of the map is that of one 3 degrees off.
    assert matt.mean() == pytest.approx(np.pi * (share - behind * wall), abs=0.1)


def test_a_white_ball_is_as_bright_as_the_half_of_the_sky_that_it_faces() -> None:
    renderer = white(Surface(*sphere()))
    count = len(renderer._surface.facets)
    middle = np.full((count, 3), 1 / 3)
    matt, bounced, normal = matt_radiance(renderer, np.arange(count), middle, half_bright(2, 1))
    np.testing.assert_allclose(matt, np.pi * (1 + normal[:, 2]) / 2, atol=0.15)
    # A lamp lights a ball by a quarter of what it sends, wherever it stands.
    assert bounced.mean() == pytest.approx(2 * np.pi / 4, rel=0.05)


def test_a_picture_of_a_white_body_is_in_the_unit_of_its_sky() -> None:
    renderer = white(cube().surface)
    renderer._network = SimpleNamespace(**{**vars(WHITE), "bounced": lambda *_: 0.0})
    image = renderer.surrounded(CAMERAS[0], Environment.of(half_bright(2, 1)), (24, 24), 39.6, 4)
    apart = np.abs(image[image[..., 3] == 1, :1] - [0.5, 1.0])
    assert (apart.min(axis=1) < 0.03).mean() > 0.9
    assert ((apart < 0.03).sum(axis=0) > 20).all()


def test_what_is_no_light_is_refused(net: VisionNet, subtests: pytest.Subtests) -> None:
    for light, word in [
        ("disco", "lights: 'disco' is none"),
        (np.ones((4, 8)), "lights: shape"),
        (np.ones((4, 4, 3)), "lights: shape"),
        (np.ones((0, 0, 3)), "lights: shape"),
        ([[1, 2], [3]], "light"),
        (-np.ones((4, 8, 3)), "negative"),
        (np.full((4, 8, 3), np.nan), "not finite"),
        (np.full((4, 8, 3), np.inf), "not finite"),
    ]:
        with subtests.test(light=light), pytest.raises(QueryError, match=word):
            Environment.of(light)
    black = net.render(CAMERAS, Environment.of(np.zeros((4, 8, 3))), 16, 39.6)
    assert black[..., 3].any()
    assert not black[..., :3].any()
