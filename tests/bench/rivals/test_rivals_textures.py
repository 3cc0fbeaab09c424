import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vision_shapes import cube, sphere

from bench.rivals.vision.textures import TexturedSurface, mean_colour, texture_colours
from objectfolder.errors import InputError, QueryError
from objectfolder.making.views.views import simulate_views
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at
from objectfolder.vision.compositing import composite_on_white, srgb_decode

pytestmark = pytest.mark.release("bench.rivals")

POWER_W = 12.0


def textured(mesh: TexturedMesh, shading: str) -> TexturedSurface:
    return TexturedSurface(mesh, UnitFrame.of_points(mesh.vertices), shading, POWER_W)


def triangle(texture: np.ndarray) -> TexturedMesh:
    """A triangle whose corner weights (1 - u - v, u, v) are its texture coordinates."""
    return TexturedMesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        np.array([[0, 1, 2]]),
        np.array([[[0.0, 0], [1, 0], [0, 1]]]),
        (texture,),
        np.zeros(1, dtype=np.int32),
    )


def wall_above_floor() -> TexturedMesh:
    """A white square floor, and a small square held above its middle."""
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.5
    vertices = np.concatenate([square, square * 0.2 + [0, 0, 0.25]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    white = np.full((1, 1, 4), 255, dtype=np.uint8)
    return TexturedMesh(vertices, faces, np.zeros((4, 3, 2)), (white,), np.zeros(4, dtype=np.int32))


def test_a_texel_has_its_colour_at_its_centre_and_the_mean_between_two():
    texture = np.random.default_rng(0).integers(0, 256, (4, 8, 4)).astype(np.uint8)
    texture[..., 3] = 255
    u, v = (2 + 0.5) / 8, 1 - (1 + 0.5) / 4
    places = np.array([[u, v], [u + 0.5 / 8, v], [u, v - 0.5 / 4]])
    # Barycentric weights outside the triangle reach the coordinates all the same.
    weights = np.column_stack([1 - places.sum(axis=1), places])
    colours = texture_colours(triangle(texture), np.zeros(3, dtype=int), weights)
    stored = texture[..., :3] / 255.0
    expected = [stored[1, 2], (stored[1, 2] + stored[1, 3]) / 2, (stored[1, 2] + stored[2, 2]) / 2]
    np.testing.assert_allclose(colours, srgb_decode(np.array(expected)), atol=1e-6)


@given(
    st.integers(-3, 3),
    st.integers(-3, 3),
    st.floats(0, 1, exclude_max=True),
    st.floats(0, 1, exclude_max=True),
)
def test_textures_repeat_outside_the_unit_square(right, up, u, v):
    texture = np.random.default_rng(1).integers(0, 256, (3, 5, 4)).astype(np.uint8)
    places = np.array([[u, v], [u + right, v + up]])
    weights = np.column_stack([1 - places.sum(axis=1), places])
    first, second = texture_colours(triangle(texture), np.zeros(2, dtype=int), weights)
    np.testing.assert_allclose(first, second, atol=1e-4)


def test_several_textures_are_told_apart():
    mesh = cube()
    grey = np.full((1, 1, 4), 128, dtype=np.uint8)
    chosen = np.arange(len(mesh.faces), dtype=np.int32) % 2
    both = TexturedMesh(mesh.vertices, mesh.faces, mesh.texture_coordinates, (*mesh.textures, grey), chosen)
    middle = np.full((len(mesh.faces), 3), 1 / 3)
    colours = texture_colours(both, np.arange(len(mesh.faces)), middle)
    alone = texture_colours(mesh, np.arange(len(mesh.faces)), middle)
    np.testing.assert_array_equal(colours[chosen == 0], alone[chosen == 0])
    np.testing.assert_allclose(colours[chosen == 1], srgb_decode(np.array(128 / 255)), atol=1e-6)


@pytest.mark.parametrize("shading", ["lambert", "shadowed lambert"])
def test_a_lit_sphere_has_the_analytic_radiance(shading):
    mesh = sphere(0.5, (188, 120, 60))
    camera, light = np.array([[0.0, -2.5, 0.0]]), np.array([[0.3, -0.9, 0.5]])
    image = textured(mesh, shading).render(look_at(camera), light, 65, 30.0)[0]
    row, column = np.mgrid[:65, :65]
    focal = 32.5 / np.tan(np.radians(15))
    directions = np.stack([(column - 32) / focal, np.ones((65, 65)), (32 - row) / focal], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    along = directions[..., 1] * 2.5
    root = along**2 - (2.5**2 - 0.25)
    inside = root > 0.02
    point = camera[0] + (along - np.sqrt(np.maximum(root, 0)))[..., None] * directions
    to_light = light[0] - point
    distance = np.linalg.norm(to_light, axis=-1)
    cosine = np.maximum((point / 0.5 * to_light).sum(axis=-1) / distance, 0)
    albedo = srgb_decode(np.array([188, 120, 60]) / 255)
    expected = albedo * (POWER_W / (4 * np.pi**2) * cosine / distance**2)[..., None]
    np.testing.assert_allclose(image[inside][:, :3], expected[inside], atol=0.006)


def test_a_shadow_lies_where_the_light_is_hidden_and_nowhere_else():
    mesh = wall_above_floor()
    # From below nothing; from above at height 1, the small square at 1/4 shades a square 4/3 as wide.
    light = np.array([[0.0, 0.0, 1.0 - 0.125]])
    view = look_at(np.array([[0.0, 0.0, 1.875]]))
    lit, shaded = (
        textured(mesh, shading).render(view, light, 64, 39.6, sub_rays=4)[0]
        for shading in ("lambert", "shadowed lambert")
    )
    oblique = look_at(np.array([[0.6, 0.0, 1.2]]))
    lit_aside, shaded_aside = (
        textured(mesh, shading).render(oblique, light, 64, 39.6, sub_rays=4)[0]
        for shading in ("lambert", "shadowed lambert")
    )
    assert (shaded <= lit + 1e-6).all()
    dark = (lit_aside[..., 0] > 0) & (shaded_aside[..., 0] == 0)
    assert 4 < dark.sum() < 400
    unchanged = shaded_aside[..., 0] == lit_aside[..., 0]
    assert unchanged.mean() > 0.9


def test_the_unlit_texture_knows_no_light():
    surface = textured(cube(), "unlit")
    view = look_at(np.array([[1.5, -1.5, 1.2]]))
    first = surface.render(view, np.array([[0.0, 0.0, 1.0]]), 24, 39.6)
    second = surface.render(view, np.array([[0.0, 0.0, -1.0]]), 24, 39.6)
    np.testing.assert_array_equal(first, second)
    assert first[..., 3].max() == 1.0


def test_a_matt_convex_object_is_what_cycles_makes_of_it():
    """No light bounces within a convex object, so that shadowed Lambert is the whole truth of a matt one."""
    mesh = cube()
    views = simulate_views(
        mesh, Appearance(roughness=1.0, specular=0.0), resolution=48, training_views=1, training_samples=1,
        held_out_views=4, held_out_samples=256, light_power_w=POWER_W, seed=2,
    )  # fmt: skip
    held_out = views["held_out"]
    answer = textured(mesh, "shadowed lambert").render(
        views["camera_to_world"][held_out], views["light_position"][held_out], 48, 39.6, sub_rays=256
    )
    truth = composite_on_white(views["rgba"][held_out])
    error = np.mean((truth - composite_on_white(answer)) ** 2)
    assert -10 * np.log10(error) > 42


def test_the_mean_colour_is_that_of_covered_pixels_of_training_views():
    views = simulate_views(
        sphere(0.1, (255, 255, 255), 2), Appearance(), resolution=16, training_views=2, training_samples=4,
        held_out_views=1, held_out_samples=4, seed=0,
    )  # fmt: skip
    rgba = views["rgba"][:2].astype(np.float64)
    total = sum(rgba[view, y, x, :3] for view in range(2) for y in range(16) for x in range(16))
    cover = sum(rgba[view, y, x, 3] for view in range(2) for y in range(16) for x in range(16))
    np.testing.assert_allclose(mean_colour(views), total / cover)


def test_unknown_shadings_and_unequal_queries_are_refused():
    with pytest.raises(InputError, match="phong"):
        textured(cube(), "phong")
    with pytest.raises(QueryError, match="one light a camera"):
        textured(cube(), "unlit").render(np.eye(4), np.zeros((2, 3)), 4, 39.6)
