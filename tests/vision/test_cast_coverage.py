import dataclasses

import numpy as np
from vision_shapes import cube, sphere

from objectfolder.making.views.passes import with_cast_coverage
from objectfolder.making.views.render_request import Scene, unit_scene
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at

POSES, WIDTH = look_at(np.array([[0.0, -2.5, 0.0], [0.0, -2.5, 0.0]])), 16
FIELD_OF_VIEW_DEG = 30.0


def scene_of(mesh) -> Scene:
    return unit_scene(mesh, Appearance(), UnitFrame.of_points(mesh.vertices))


def rendered(alpha: float) -> np.ndarray:
    """Two views of one straight colour, of which each pixel of the middle column is covered in part."""
    rgba = np.zeros((2, WIDTH, WIDTH, 4), dtype=np.float16)
    rgba[:, :, 4] = alpha * np.array([0.5, 0.25, 0.125, 1.0])
    rgba[:, :, 8] = [0.5, 0.25, 0.125, 1.0]
    return rgba


def test_the_outline_of_a_cube_has_the_area_of_its_pixels():
    # The near face, at distance 2, ends at this column's edge.
    half = WIDTH / 2 / np.tan(np.radians(FIELD_OF_VIEW_DEG / 2)) * 0.5 / 2.0
    left = WIDTH / 2 - half
    column, share = int(left), 1 - left % 1
    rgba = np.zeros((2, WIDTH, WIDTH, 4), dtype=np.float16)
    rgba[:, 6:10, column] = 0.9 * np.array([0.5, 0.25, 0.125, 1.0])
    images = with_cast_coverage(scene_of(cube()), rgba, POSES, np.array([0, 1]), FIELD_OF_VIEW_DEG)
    np.testing.assert_allclose(images[:, 6:10, column, 3], share, atol=0.004)
    straight = images[:, 6:10, column, :3] / images[:, 6:10, column, 3:]
    np.testing.assert_allclose(straight, np.broadcast_to([0.5, 0.25, 0.125], straight.shape), rtol=4e-3)


def test_seeds_cast_independently_and_whole_and_empty_pixels_stay():
    scene, original = scene_of(sphere(0.5, (128, 128, 128), 3)), rendered(0.75)
    images = with_cast_coverage(scene, original, POSES, np.array([0, 1]), FIELD_OF_VIEW_DEG)
    again = with_cast_coverage(scene, original, POSES, np.array([0, 1]), FIELD_OF_VIEW_DEG)
    np.testing.assert_array_equal(images, again)
    columns = np.delete(np.arange(WIDTH), 4)
    np.testing.assert_array_equal(images[:, :, columns], original[:, :, columns])
    first, second = images[..., 4, 3]
    assert not np.array_equal(first, second)
    np.testing.assert_allclose(first, second, atol=0.01)


def test_what_a_texture_leaves_out_is_the_renderers_to_judge():
    mesh = dataclasses.replace(cube(), textures=(np.array([[[9, 9, 9, 100]]], np.uint8),))
    original = rendered(0.75)
    images = with_cast_coverage(scene_of(mesh), original, POSES, np.array([0, 1]), FIELD_OF_VIEW_DEG)
    np.testing.assert_array_equal(images, original)
