"""Depth, normal, mask and crops of views."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_visionnets import WAYS, drawn_visionnet, visionnet
from vision_shapes import cube, sphere

from objectfolder.vision.cameras import look_at, pixel_rays
from objectfolder.vision.visionnet.visionnet import VisionNet

LIGHT = np.array([0.36, 0.48, 0.8])
SIZE = (30, 44)


@pytest.fixture(scope="module", params=WAYS)
def cubic(request: pytest.FixtureRequest) -> VisionNet:
    return visionnet(cube(), request.param)


@pytest.fixture(scope="module")
def round_() -> VisionNet:
    return drawn_visionnet(sphere(0.2, (200, 200, 200), 5))


def test_the_face_of_a_cube_is_a_plane_in_depth(cubic: VisionNet) -> None:
    camera = look_at(np.array([[0.0, 0.0, 2.5]]))
    passes = cubic.render(camera, LIGHT, 40, 39.6, passes=["depth", "normal", "mask"])
    assert set(passes) == {"depth", "normal", "mask"}
    depth, normal, mask = (passes[name][0] for name in ("depth", "normal", "mask"))
    assert (depth.dtype, normal.dtype, mask.dtype) == (np.float32, np.float32, np.bool_)
    # The face is 2 away all over; along the rays it would be 2 / cos, 1.5 % more at its corners.
    np.testing.assert_allclose(depth[mask], 2.0, atol=1e-6)
    np.testing.assert_allclose(normal[mask], np.broadcast_to([0, 0, 1], normal[mask].shape), atol=1e-6)
    assert np.isinf(depth[~mask]).all()
    assert not normal[~mask].any()
    # Its side of 1 at a distance of 2, in pixels.
    side = 40 / (2 * np.tan(np.radians(39.6 / 2))) / 2
    assert mask.sum() == (2 * round(side / 2)) ** 2


def test_depth_and_normal_of_a_sphere_are_known_at_every_pixel(round_: VisionNet) -> None:
    camera = look_at(np.array([[1.0, -2.0, 1.2]]), target=np.array([0.1, 0.05, 0.0]))
    passes = round_.render(camera, LIGHT, SIZE, 30.0, passes=("depth", "normal", "mask", "rgba"))
    origins, directions = pixel_rays(
        camera[0], np.arange(SIZE[0] * SIZE[1]), np.full((1, 2), 0.5), SIZE, 30.0
    )
    middle = -(origins * directions).sum(axis=1)
    inside = 0.25 - (origins**2).sum(axis=1) + middle**2
    deep = inside > 0.01
    along = middle[deep] - np.sqrt(inside[deep])
    depth = along * -(directions[deep] @ camera[0, :3, 2])
    np.testing.assert_allclose(passes["depth"].ravel()[deep], depth, atol=2e-3)
    np.testing.assert_allclose(
        passes["normal"].reshape(-1, 3)[deep],
        2 * (origins[deep] + along[:, None] * directions[deep]),
        atol=0.02,
    )
    assert not passes["mask"].ravel()[inside < -0.01].any()
    covered = passes["rgba"][..., 3]
    assert passes["mask"][covered == 1].all()
    assert not passes["mask"][covered == 0].any()


def test_passes_leave_the_image_as_it_is(cubic: VisionNet) -> None:
    camera = look_at(np.array([[1.5, -1.7, 1.0]]))
    passes = cubic.render(camera, LIGHT, 20, 39.6, passes=["rgba", "mask"])
    np.testing.assert_array_equal(passes["rgba"], cubic.render(camera, LIGHT, 20, 39.6))
    nothing = cubic.render(np.zeros((0, 4, 4)), LIGHT, 20, 39.6, passes=["normal", "mask"], crop=(1, 2, 3, 4))
    assert nothing["normal"].shape == (0, 3, 4, 3)
    assert nothing["mask"].shape == (0, 3, 4)


@given(st.data(), st.sampled_from([1, 16]))
def test_a_crop_is_that_part_of_the_image(cubic: VisionNet, data: st.DataObject, sub_rays: int) -> None:
    top, left = data.draw(st.integers(0, SIZE[0] - 1)), data.draw(st.integers(0, SIZE[1] - 1))
    height, width = data.draw(st.integers(1, SIZE[0] - top)), data.draw(st.integers(1, SIZE[1] - left))
    camera, every = look_at(np.array([[1.0, -1.2, 0.8]])), ["rgba", "depth", "normal", "mask"]
    whole = cubic.render(camera, LIGHT, SIZE, 39.6, sub_rays, passes=every)
    part = cubic.render(camera, LIGHT, SIZE, 39.6, sub_rays, passes=every, crop=(top, left, height, width))
    for name in every:
        expected = whole[name][:, top : top + height, left : left + width]
        np.testing.assert_array_equal(part[name], expected, err_msg=name)


def test_rows_and_columns_one_at_a_time_make_up_the_image(cubic: VisionNet) -> None:
    """Each pixel lies on the rim of a crop: what a neighbour outside shows counts, as at level edges."""
    camera = look_at(np.array([[0.02, 0.03, 2.5]]), target=np.array([0.02, 0.03, 0.0]))
    whole = cubic.render(camera, LIGHT, SIZE, 39.6, 16)[0]
    rows = [
        cubic.render(camera, LIGHT, SIZE, 39.6, 16, crop=(row, 0, 1, SIZE[1]))[0] for row in range(SIZE[0])
    ]
    np.testing.assert_array_equal(np.concatenate(rows), whole)
    columns = [
        cubic.render(camera, LIGHT, SIZE, 39.6, 16, crop=(0, left, SIZE[0], 1))[0] for left in range(SIZE[1])
    ]
    np.testing.assert_array_equal(np.concatenate(columns, axis=1), whole)


def test_a_crop_of_a_vast_image_costs_no_more_than_itself(cubic: VisionNet) -> None:
    camera = look_at(np.array([[0.0, -2.5, 0.0]]))
    vast = 1 << 20
    part = cubic.render(camera, LIGHT, vast, 39.6, 8, crop=(vast // 2, vast // 2, 4, 5))
    assert part.shape == (1, 4, 5, 4)
    assert (part[..., 3] == 1).all()
