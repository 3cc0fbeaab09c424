"""Lights, cameras and shapes where a renderer of surfaces goes wrong, by name."""

import numpy as np
import pytest
from small_meshes import box, joined
from small_visionnets import WAYS, visionnet
from vision_shapes import cube, sphere

from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import look_at, project, uniform_on_sphere
from objectfolder.vision.visionnet.visionnet import VisionNet

FIELD_OF_VIEW = 39.6


def cavity(low: list[float], high: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """A box whose faces point inwards."""
    vertices, faces = box(low, high)
    return vertices, faces[:, ::-1]


def room() -> Surface:
    """A unit cube with a cubic cavity of side 0.8: a wall of 0.1 all round, and no way out for light."""
    return joined(box([-0.5] * 3, [0.5] * 3), cavity([-0.4] * 3, [0.4] * 3))


def cup() -> Surface:
    """A unit cube whose cavity is open at the top."""
    wall, inner = 0.5, 0.4
    outside, inside = box([-wall] * 3, [wall] * 3), cavity([-inner] * 3, [inner, inner, wall])
    top = [1, 3, 5, 7]  # corners of the upper side of both boxes, at the same height
    faces = [[face for face in part[1].tolist() if not set(face) <= set(top)] for part in (outside, inside)]
    ring = [1, 3, 7, 5]
    rim = [
        face
        for start, end in zip(ring, ring[1:] + ring[:1], strict=True)
        for face in ([start, end + 8, end], [start, start + 8, end + 8])
    ]
    return Surface(
        np.concatenate([outside[0], inside[0]]),
        np.concatenate([np.array(faces[0]), np.array(faces[1]) + 8, np.array(rim)]),
    )


@pytest.fixture(scope="module", params=WAYS)
def way(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def cubic(way: str) -> VisionNet:
    return visionnet(cube(), way)


def irradiance(net: VisionNet, origins, towards, light) -> np.ndarray:
    """What the light sends directly to the first hits of rays, 4 pi / power times W / m^2."""
    directions = np.asarray(towards, dtype=float) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    face, barycentric = net._surface.first_hits(np.asarray(origins, dtype=float), directions)
    assert (face >= 0).all()
    return net._surface.incidence(face, barycentric, directions, np.asarray(light, dtype=float)).irradiance


def test_a_light_inside_a_closed_cavity_lights_the_inside_alone(way: str) -> None:
    net, light = visionnet(room(), way), np.array([0.1, 0.05, 0.0])
    outside = uniform_on_sphere(200, 2.5, np.random.default_rng(0))
    assert not irradiance(net, outside, np.zeros((200, 3)), light).any()
    # The wall x = 0.4 from within: 0.3 away, head on.
    values = irradiance(net, np.array([[0.0, 0.05, 0.0]]), np.array([[0.4, 0.05, 0.0]]), light)
    assert values[0] == pytest.approx(1 / 0.3**2, rel=1e-6)
    images = net.render(look_at(outside[:3]), light, 20, FIELD_OF_VIEW, 16)
    assert np.isfinite(images).all()
    within = net.render(look_at(np.array([[-0.3, 0.0, 0.0]])), light, 20, 90.0, 16)
    assert (within[..., 3] == 1).all()
    assert within[..., :3].max() > 3 * images[..., :3].max()


def test_a_light_in_the_mouth_of_a_cup_lights_its_floor_and_no_outer_wall(way: str) -> None:
    net, light = visionnet(cup(), way), np.array([0.0, 0.0, 0.2])
    floor = irradiance(net, np.array([[0.0, 0.0, 2.0]]), np.array([[0.0, 0.0, 0.0]]), light)
    assert floor[0] == pytest.approx(1 / 0.6**2, rel=1e-6)
    side = np.array([[2.0, 0.1, 0.3], [-2.0, 0.1, 0.3], [0.1, 2.0, -0.3], [0.1, 0.1, -2.0]])
    assert not irradiance(net, side, 0 * side, light).any()
    assert np.isfinite(net.render(look_at(np.array([[0.3, -1.5, 2.0]])), light, 30, FIELD_OF_VIEW, 16)).all()


@pytest.mark.parametrize("light", [[0.0, 0.0, 0.5], [0.5, 0.5, 0.5], [0.1, 0.2, 0.5], [0.5, 0.0, 0.5]])
@pytest.mark.filterwarnings("error")
def test_a_light_on_the_surface_makes_no_number_that_is_none(cubic: VisionNet, light) -> None:
    camera = look_at(np.array([[1.2, -1.0, 1.9]]))
    image = cubic.render(camera, np.array(light), 40, FIELD_OF_VIEW, 16)
    assert np.isfinite(image).all()
    assert (image >= 0).all()
    # Rays right at the light, too: zero distance.
    origins = np.array([[0.2, 0.1, 2.5]])
    straight = cubic.radiance(origins, np.array([light]) - origins, np.array(light))
    assert np.isfinite(straight).all()
    assert straight[0, 3] == 1
    # A light is taken to be at least 1e-3 away: a millionfold of the irradiance at distance 1.
    assert straight.max() < 1e7


@pytest.mark.filterwarnings("error")
def test_a_light_at_the_camera_and_one_a_hair_above_the_surface_are_finite(cubic: VisionNet) -> None:
    position = np.array([0.0, 0.0, 0.5 + 1e-9])
    for light in (position, np.array([1.2, -1.0, 1.9])):
        image = cubic.render(look_at(np.array([[1.2, -1.0, 1.9]])), light, 24, FIELD_OF_VIEW)
        assert np.isfinite(image).all()


def test_a_camera_inside_the_box_sees_the_walls_from_within(cubic: VisionNet) -> None:
    camera = look_at(np.array([[0.1, 0.05, -0.1]]), target=np.array([0.5, 0.05, -0.1]))
    light = np.array([0.3, 0.0, 0.2])
    passes = cubic.render(camera, light, 32, 60.0, 16, passes=["rgba", "depth", "normal"])
    assert np.isfinite(passes["rgba"]).all()
    assert (passes["rgba"][..., 3] == 1).all()
    np.testing.assert_allclose(passes["depth"][0, 10:22, 10:22], 0.4, atol=1e-6)
    # The side that is seen decides: the normal of the outer face is turned to the camera.
    expected = np.broadcast_to([-1.0, 0, 0], (12, 12, 3))
    np.testing.assert_allclose(passes["normal"][0, 10:22, 10:22], expected, atol=1e-6)
    assert passes["rgba"][0, 16, 16, :3].max() > 0


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_a_camera_at_the_pole_has_y_up(cubic: VisionNet, pole: float) -> None:
    camera = look_at(np.array([[0.0, 0.0, 2.5 * pole]]))
    above = project(np.array([[0.0, 0.3, 0.5 * pole]]), camera[0], 40, FIELD_OF_VIEW)[0]
    assert above[0] == pytest.approx(20)
    assert above[1] < 20
    light = np.array([0.0, 0.5, 0.9 * pole])
    image = cubic.render(camera, light, 40, FIELD_OF_VIEW, 16)
    assert np.isfinite(image).all()
    assert (image[0, 20, 20:22, 3] == 1).all()
    # A hair off the pole is the same picture but for that hair, wherever z still fixes the roll.
    near = look_at(np.array([[1e-7, 0.0, 2.5 * pole]]))
    np.testing.assert_allclose(near, camera, atol=1e-6)


def test_an_empty_image_is_empty_in_every_pass(cubic: VisionNet) -> None:
    away = look_at(np.array([[0.0, 0.0, 2.5]]), target=np.array([0.0, 0.0, 5.0]))
    beside = look_at(np.array([[0.0, 0.0, 2.5]]), target=np.array([5.0, 0.0, 2.0]))
    for camera in (away, beside):
        passes = cubic.render(
            camera, np.ones(3), 16, FIELD_OF_VIEW, passes=["rgba", "depth", "normal", "mask"]
        )
        assert not passes["rgba"].any()
        assert np.isinf(passes["depth"]).all()
        assert not passes["normal"].any()
        assert not passes["mask"].any()
    assert cubic.render(np.zeros((0, 4, 4)), np.zeros((0, 3)), 16, FIELD_OF_VIEW).shape == (0, 16, 16, 4)


def test_grazing_rays_at_the_silhouette_of_a_sphere(way: str) -> None:
    net = visionnet(sphere(0.2, (200, 200, 200), 4), way)
    random = np.random.default_rng(3)
    origins = uniform_on_sphere(500, 2.5, random)
    across = np.cross(origins, random.normal(size=(500, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    light = np.array([0.0, 0.6, 0.8])
    # The facets lie between the spheres of 0.5 and of 0.4985: what passes outside misses, inside hits.
    for radius, hit in ((0.5001, 0), (0.4984, 1)):
        # The tangent from the origin of the ray to a sphere of this radius.
        sine = radius / 2.5
        directions = -origins / 2.5 * np.sqrt(1 - sine**2) + across * sine
        answer = net.radiance(origins, directions, light)
        assert np.isfinite(answer).all()
        assert (answer[:, 3] == hit).all()
        assert (answer >= 0).all()


@pytest.mark.parametrize("size", [(12, 60), (60, 12), (2, 40), (33, 17)])
def test_images_that_are_not_square_are_parts_of_the_square_one(cubic: VisionNet, size) -> None:
    camera, light = look_at(np.array([[1.0, -1.4, 0.9]])), np.array([0.0, 0.6, 0.8])
    longer = max(size)
    square = cubic.render(camera, light, longer, FIELD_OF_VIEW, 1)[0]
    top, left = (longer - size[0]) // 2, (longer - size[1]) // 2
    image = cubic.render(camera, light, size, FIELD_OF_VIEW, 1)[0]
    assert image.shape == (*size, 4)
    np.testing.assert_allclose(
        image, square[top : top + size[0], left : left + size[1]], rtol=1e-4, atol=1e-4
    )


def test_each_component_of_an_object_shadows_the_others(way: str) -> None:
    pair = joined(box([-0.5, -0.2, -0.2], [-0.1, 0.2, 0.2]), box([0.1, -0.2, -0.2], [0.5, 0.2, 0.2]))
    net = visionnet(pair, way)
    passes = net.render(
        look_at(np.array([[0.0, -2.5, 0.0]])), np.array([0.9, 0.0, 0.0]), 60, FIELD_OF_VIEW, 16,
        passes=["rgba", "mask"],
    )  # fmt: skip
    # Two pieces with a gap in the middle of the image.
    row = passes["mask"][0, 30]
    assert np.count_nonzero(np.diff(row.astype(int)) == 1) == 2
    assert not row[30]
    # The light is to the right: the left piece's right side lies in the shadow of the right piece.
    between = np.array([[0.0, 0.0, 0.0]])
    assert irradiance(net, between, between - [[1.0, 0.0, 0.0]], [0.9, 0.0, 0.0])[0] == 0
    lit = irradiance(net, between, between - [[1.0, 0.0, 0.0]], [0.05, 0.0, 0.0])[0]
    assert lit == pytest.approx(1 / 0.15**2, rel=1e-6)


def test_flipped_shells_look_as_those_that_are_not(cubic: VisionNet, way: str) -> None:
    mesh = cube()
    flipped = Surface(mesh.vertices, mesh.faces[:, ::-1])
    some = Surface(
        mesh.vertices, np.where(np.arange(len(mesh.faces))[:, None] % 3, mesh.faces, mesh.faces[:, ::-1])
    )
    camera, light = look_at(np.array([[1.0, -1.4, 0.9]])), np.array([0.3, -0.5, 0.8])
    expected = cubic.render(camera, light, 30, FIELD_OF_VIEW, 4, passes=["rgba", "normal"])
    for surface in (flipped, some):
        net = visionnet(surface, way)
        net._weights, net._grid = cubic._weights, cubic._grid
        passes = net.render(camera, light, 30, FIELD_OF_VIEW, 4, passes=["rgba", "normal"])
        np.testing.assert_allclose(passes["rgba"], expected["rgba"], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(passes["normal"], expected["normal"], atol=1e-6)


def test_shells_that_cut_through_one_another_are_drawn_from_both_sides(way: str) -> None:
    crossed = joined(box([-0.5, -0.2, -0.2], [0.5, 0.2, 0.2]), box([-0.2, -0.5, -0.2], [0.2, 0.5, 0.2]))
    net = visionnet(crossed, way)
    cameras = look_at(uniform_on_sphere(4, 2.5, np.random.default_rng(5)))
    images = net.render(cameras, np.array([0.0, 0.0, 1.0]), 24, FIELD_OF_VIEW, 16)
    assert np.isfinite(images).all()
    # Faces of both boxes lie in one plane, z = 0.2, and light both alike.
    lit = irradiance(net, np.array([[0.0, 0.0, 2.0]]), np.zeros((1, 3)), [0.0, 0.0, 1.0])
    assert lit[0] == pytest.approx(1 / 0.8**2, rel=1e-6)
