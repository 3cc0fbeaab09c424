"""Shapes on which touch simulators go wrong, by name."""

import numpy as np
import pytest
from touch_shapes import box, joined, mug, psnr_db, sphere

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import press, render_poses
from objectfolder.touch.presses.touches import Press, Touches
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.sensor import Sensor

SENSOR = Sensor()
CUBE = Surface(*box((0, 0, 0), (0.06, 0.06, 0.06)))


def touch(surface: Surface, point: list[float], depth: float = 0.001, samples: int = 2) -> Touches:
    return press(surface, SENSOR, np.array([point]), Press(depth_m=depth, samples=samples))


def test_sharp_edge() -> None:
    touches = touch(CUBE, [0.06, 0.03, 0.06])
    assert touches.reachable[0]
    assert touches.first_contact_offset_m[0] < 1e-9
    # Two faces at 45 degrees: a ridge about twice as wide as deep, and as long as the gel's sag allows.
    rows, columns = np.nonzero(touches.mask[0])
    assert touches.mask[0].sum() > 300
    extent = sorted([np.ptp(rows), np.ptp(columns)])
    assert extent[1] > 5 * extent[0]
    assert 0.0009 < touches.depth_m[0].max() <= 0.001


def test_corner() -> None:
    touches = touch(CUBE, [0.06, 0.06, 0.06], depth=0.002)
    assert touches.reachable[0]
    assert touches.depth_m[0].max() > 0.0018
    row, column = np.argwhere(touches.mask[0]).mean(axis=0)
    assert abs(row - 79.5) < 3
    assert abs(column - 59.5) < 3


def test_box_with_eight_vertices_in_the_middle_of_a_face() -> None:
    touches = touch(CUBE, [0.03, 0.03, 0.06])
    assert np.allclose(touches.normals[0], [0, 0, 1])
    # The contact is the gel's own disc, a circle in the centre.
    assert touches.contact_area_m2[0] == pytest.approx(np.pi * 0.0081**2, rel=0.02)


def test_flat_face_of_a_metre() -> None:
    large = Surface(*box((-0.5, -0.5, -1), (0.5, 0.5, 0)))
    small = Surface(*box((-0.03, -0.03, -1), (0.03, 0.03, 0)))
    points = [0.0, 0.0, 0.0]
    assert (touch(large, points).rgb == touch(small, points).rgb).all()
    off_centre = touch(large, [0.31, -0.47, 0.0])
    assert psnr_db(off_centre.rgb, touch(large, points).rgb) > 60


def test_face_that_reaches_behind_the_camera() -> None:
    # A sloping plane of a metre, under the gel on one side and level with the camera on the other.
    plane = Surface(
        np.array([[0, -1, -1], [0, 1, -1], [0.08, 1, 1], [0.08, -1, 1.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    image = render_poses(plane, SENSOR, np.eye(4)[None], samples=1)[0]
    x = 0.04 + 0.04 * 0.015
    assert not image.mask.any()
    lower = plane.vertices - [x - 0.021, 0, 0]
    image = render_poses(Surface(lower, plane.faces), SENSOR, np.eye(4)[None], samples=1)[0]
    assert image.mask[80, 60]
    assert image.depth[80, 60] == pytest.approx(0.001, abs=3e-5)


def test_inside_of_a_mug() -> None:
    cup = Surface(*mug())
    inside = touch(cup, [0.041, 0.0, 0.055], depth=0.0008)
    assert np.allclose(inside.normals[0], [-1, 0, 0], atol=1e-3)
    # The sensor fits in, but its straight way there goes through the other side.
    assert not inside.reachable[0]
    assert inside.penetration_m[0] == 0.0008
    assert inside.mask[0].sum() > 1000
    outside = touch(cup, [0.045, 0.0, 0.05], depth=0.0008)
    assert outside.reachable[0]
    # The gel follows the hollow wall further than the round one.
    assert inside.contact_area_m2[0] > 1.5 * outside.contact_area_m2[0]


def test_inside_of_a_narrow_tube_the_sensor_cannot_stand() -> None:
    tube = Surface(*mug(radius=0.012))
    touches = touch(tube, [0.008, 0.0, 0.05])
    assert not touches.reachable[0]
    assert touches.depth_m[0].max() <= touches.penetration_m[0] + 1e-12
    assert touches.penetration_m[0] <= 0.001


def test_bottom_of_a_mug_that_the_housing_does_not_fit() -> None:
    wide = touch(Surface(*mug(radius=0.06)), [0.0, 0.0, 0.004])
    narrow = touch(Surface(*mug(radius=0.02)), [0.0, 0.0, 0.004])
    assert wide.reachable[0]
    assert not narrow.reachable[0]


def test_depth_of_zero_shows_the_untouched_gel() -> None:
    touches = touch(CUBE, [0.03, 0.03, 0.06], depth=0.0)
    assert (touches.rgb[0] == no_contact_image(SENSOR)).all()
    assert not touches.mask.any()
    assert touches.contact_area_m2[0] == touches.penetration_m[0] == 0.0
    assert touches.reachable[0]


def test_flipped_shell_is_as_visible_as_the_shell() -> None:
    vertices, faces = sphere(0.02, 4)
    pose = press(Surface(vertices, faces), SENSOR, vertices[:3]).sensor_to_object
    shell = render_poses(Surface(vertices, faces), SENSOR, pose)
    flipped = render_poses(Surface(vertices, faces[:, ::-1]), SENSOR, pose)
    for image, flipped_image in zip(shell, flipped, strict=True):
        assert image.mask.sum() > 500
        assert np.abs(image.rgb.astype(int) - flipped_image.rgb).max() <= 1


def test_degenerate_faces_change_nothing() -> None:
    vertices, faces = sphere(0.02, 3)
    extra = np.array([[0, 0, 1], [5, 5, 5], [7, 8, 7]])
    collinear = np.array([[0.0, 0.0, 0.021], [0.001, 0.0, 0.021], [0.002, 0.0, 0.021]])
    more = np.concatenate([vertices, collinear])
    last = len(vertices) + np.arange(3)
    spoilt = Surface(more, np.concatenate([faces, extra, last[None]]))
    point = vertices[40:41]
    touches, spoilt_touches = press(Surface(vertices, faces), SENSOR, point), press(spoilt, SENSOR, point)
    assert (touches.rgb == spoilt_touches.rgb).all()
    assert np.isfinite(spoilt_touches.sensor_to_object).all()
    # The nearest face is one without area: what it belongs to is touched.
    needle = press(spoilt, SENSOR, np.array([[0.001, 0.0, 0.021]]))
    assert needle.reachable[0]
    assert np.linalg.norm(needle.points[0]) < 0.0201


def test_a_surface_without_area_cannot_be_touched() -> None:
    needle = Surface(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.array([[0, 1, 2]]))
    with pytest.raises(QueryError, match="no face has an area"):
        touch(needle, [0.5, 0.0, 0.0])


def test_scissors_have_points_that_cannot_be_reached() -> None:
    # Two blades, one higher, crossing at a small angle: the lower is reached only away from the upper.
    lower = box((0.0, -0.006, 0.0), (0.12, 0.006, 0.002))
    upper = box((0.0, -0.006, 0.003), (0.06, 0.006, 0.005))
    scissors = Surface(*joined(lower, upper))
    covered = touch(scissors, [0.055, 0.0, 0.002])
    assert not covered.reachable[0]
    beside = touch(scissors, [0.063, 0.0, 0.002])
    # The upper blade meets the gel first: 3 mm higher, less the gel's sag 3 mm out.
    assert beside.first_contact_offset_m[0] == pytest.approx(0.003 - 0.000137, abs=3e-5)
    assert not beside.reachable[0]
    assert beside.penetration_m[0] == 0.001
    assert beside.depth_m[0].max() <= 0.001
    assert beside.mask[0].any()
    assert touch(scissors, [0.1, 0.0, 0.002]).reachable[0]
    assert touch(scissors, [0.03, 0.0, 0.005]).reachable[0]


def test_a_part_that_only_the_housing_meets_makes_a_point_unreachable() -> None:
    floor = box((-0.05, -0.05, -0.01), (0.05, 0.05, 0.0))
    pillar = box((0.0125, -0.01, 0.0), (0.0130, 0.01, 0.02))
    touches = touch(Surface(*joined(floor, pillar)), [0.0, 0.0, 0.0])
    assert touches.first_contact_offset_m[0] < 1e-9
    assert not touches.reachable[0]
    assert touch(Surface(*floor), [0.0, 0.0, 0.0]).reachable[0]


def test_edge_of_a_blade() -> None:
    blade = Surface(*box((0, 0, 0), (0.05, 0.02, 0.0004)))
    touches = touch(blade, [0.02, 0.02, 0.0002])
    assert np.allclose(touches.normals[0], [0, 1, 0], atol=1e-9)
    assert touches.reachable[0]
    assert touches.first_contact_offset_m[0] < 1e-9
    # A strip as wide as the blade is thick, 0.4 mm or 2.4 pixels, and as long as the gel's sag allows.
    rows, columns = np.nonzero(touches.mask[0])
    extent = sorted([np.ptp(rows) + 1, np.ptp(columns) + 1])
    assert 2 <= extent[0] <= 4
    assert extent[1] > 60
    assert touches.depth_m[0].max() == pytest.approx(0.001, abs=2e-6)


def test_flat_of_a_blade_from_either_side() -> None:
    blade = Surface(*box((-0.025, -0.02, -0.0002), (0.025, 0.02, 0.0002)))
    for side in (1.0, -1.0):
        touches = touch(blade, [0.0, 0.0, side * 0.0002], depth=0.002)
        # Two millimetres deep: the far side, 0.4 mm off, is in the gel too, but behind.
        assert np.allclose(touches.normals[0], [0, 0, side], atol=1e-12)
        assert touches.reachable[0]
        assert touches.depth_m[0].max() == pytest.approx(0.002, abs=2e-6)


def test_a_shell_turned_inside_out_is_pressed_from_within_and_not_invisible() -> None:
    vertices, faces = sphere(0.02, 4)
    touches = press(Surface(vertices, faces[:, ::-1]), SENSOR, vertices[[100, 700]])
    assert np.sum(touches.normals * vertices[[100, 700]], axis=1).max() < 0
    # The sensor does not fit into the ball, and the labels say so.
    assert not touches.reachable.any()
    assert (touches.depth_m.max(axis=(1, 2)) <= touches.penetration_m + 1e-12).all()
    # Where it fits, the shell shows: a hemisphere of 6 cm, open, seen from its hollow side.
    vertices, faces = sphere(0.06, 5)
    bowl = faces[vertices[faces][:, :, 2].max(axis=1) <= 0]
    inside = touch(Surface(vertices, bowl[:, ::-1]), [0.0, 0.0, -0.06])
    assert inside.reachable[0]
    assert inside.mask[0].sum() > 1000


def test_normals_at_a_texture_seam_are_those_without_it() -> None:
    vertices, faces = sphere(0.02, 4)
    smooth = Surface(vertices, faces)
    # Every face with corners of its own, as where texture coordinates are split.
    split = Surface(vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))
    smooth_touches, split_touches = (press(surface, SENSOR, vertices[:3]) for surface in (smooth, split))
    assert np.abs(smooth_touches.rgb.astype(int) - split_touches.rgb).max() <= 1
    assert np.allclose(smooth_touches.normals, split_touches.normals, atol=1e-12)


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_units_wrong_by_a_thousand_are_answered_with_labels_that_hold(factor: float) -> None:
    vertices, faces = box((0, 0, 0), (0.06, 0.06, 0.06))
    touches = touch(Surface(vertices * factor, faces), [0.03 * factor, 0.03 * factor, 0.06 * factor])
    assert np.isfinite(touches.sensor_to_object).all()
    assert touches.penetration_m[0] == 0.001
    assert touches.depth_m[0].max() <= 0.001
    if factor > 1:
        assert touches.mask[0].sum() > 5000
    else:
        # Sixty micrometres: less than half of a pixel, and it may lie between the samples.
        assert not touches.mask[0].any()


def test_depth_beyond_saturation_is_refused_and_its_limit_labelled() -> None:
    with pytest.raises(QueryError, match=r"Ask for 0 to 0.005"):
        touch(CUBE, [0.03, 0.03, 0.06], depth=0.0051)
    limit = touch(CUBE, [0.03, 0.03, 0.06], depth=SENSOR.maximum_depth_m)
    assert limit.saturated[0]
    assert limit.penetration_m[0] == SENSOR.maximum_depth_m
    assert limit.depth_m[0].max() <= limit.penetration_m[0]
    # The corners of the gel have given way by its sagitta: the cube is all that is seen.
    assert limit.mask[0].all()


def test_two_near_points_of_an_underside_give_near_images() -> None:
    # The underside of a scan: flat to a fraction of a milliradian, round the pole of the roll's convention.
    side = np.linspace(-0.03, 0.03, 13)
    x, y = (part.ravel() for part in np.meshgrid(side, side))
    height = 5e-7 * np.random.default_rng(0).normal(size=len(x))
    corner = (np.arange(12)[:, None] * 13 + np.arange(12)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 13, corner + 1], axis=1),
            np.stack([corner + 1, corner + 13, corner + 14], axis=1),
        ]
    )
    underside = Surface(np.stack([x, y, height], axis=1), faces)
    points = np.stack([np.linspace(-0.01, 0.01, 21), np.full(21, 0.003), np.zeros(21)], axis=1)
    touches = press(underside, SENSOR, points)
    assert (touches.normals[:, 2] < -0.999999).all()
    rotation = touches.sensor_to_object[:, :3, :3]
    assert np.abs(rotation[1:] - rotation[:-1]).max() < 2e-3
    assert min(psnr_db(a, b) for a, b in zip(touches.rgb[1:], touches.rgb[:-1], strict=True)) > 40


def test_a_point_on_a_corner_of_three_boxes_in_one_place() -> None:
    stacked = Surface(*joined(*(box((0, 0, 0), (0.06, 0.06, 0.06)) for _ in range(3))))
    single, three = touch(CUBE, [0.06, 0.06, 0.06]), touch(stacked, [0.06, 0.06, 0.06])
    assert np.allclose(single.normals, three.normals, atol=1e-12)
    assert (single.mask == three.mask).all()
