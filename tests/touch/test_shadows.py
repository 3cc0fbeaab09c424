"""Shadows of what indents the gel, against rays from every pixel to every lamp."""

from dataclasses import replace
from math import atan, degrees

import numpy as np
import pytest
from touch_shapes import sphere

from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import Press, press, render_poses
from objectfolder.touch.rendering.shadows import shadow_caster
from objectfolder.touch.sensor.sensor import Sensor

# The camera sees 40 x 30 mm of a flat gel 20 mm before it.
FLAT = Sensor(
    image_height=120,
    image_width=160,
    field_of_view_deg=2 * degrees(atan(0.015 / 0.020)),
    camera_position_m=(0.0, 0.0, 0.0),
    gel_apex_m=(0.020, 0.0, 0.0),
    gel_width_m=0.042,
    gel_height_m=0.032,
    gel_sagitta_m=0.0,
    shadow_positions_m=((0.012, 0.030, 0.004),),
    shadow_shares=((0.5, 0.25, 0.0),),
    shadow_penumbra_m=1e-5,
)


def pressed_in(sensor: Sensor, centre: tuple[float, float], size: float, deep: float) -> np.ndarray:
    """Depth map of a disc of gel pressed in evenly, as the flat sensor's camera sees it."""
    pitch = 0.030 / sensor.image_height
    rows, columns = np.mgrid[: sensor.image_height, : sensor.image_width] + 0.5
    scale = (0.020 - deep) / 0.020  # what is nearer looks larger
    y, z = (sensor.image_width / 2 - columns) * pitch, (sensor.image_height / 2 - rows) * pitch
    inside = np.hypot(y * scale - centre[0], z * scale - centre[1]) < size
    return np.where(inside, deep, 0.0).astype(np.float32)


def traced(sensor: Sensor, depth: np.ndarray) -> np.ndarray:
    """Which gel no lamp's ray reaches: points of each ray, one by one, against the disc under them."""
    pitch = 0.030 / sensor.image_height
    rows, columns = np.mgrid[: sensor.image_height, : sensor.image_width] + 0.5
    y, z = (sensor.image_width / 2 - columns) * pitch, (sensor.image_height / 2 - rows) * pitch
    start = np.stack([np.full_like(y, 0.020), y, z])
    lamp = np.array(sensor.shadow_positions_m[0])[:, None, None]
    hidden = np.zeros(y.shape, dtype=bool)
    for share in np.linspace(0.002, 0.9, 900):
        x, across, up = start + share * (lamp - start)
        j = np.floor(sensor.image_width / 2 - across / x * 0.020 / pitch).astype(int)
        i = np.floor(sensor.image_height / 2 - up / x * 0.020 / pitch).astype(int)
        inside = (i >= 0) & (j >= 0) & (i < depth.shape[0]) & (j < depth.shape[1])
        met = depth[np.clip(i, 0, depth.shape[0] - 1), np.clip(j, 0, depth.shape[1] - 1)]
        hidden |= inside & (met > 0) & (0.020 - met < x)
    return hidden & (depth == 0)


@pytest.mark.parametrize("lamp", [(0.012, 0.030, 0.004), (0.014, -0.020, -0.025), (0.010, 0.002, 0.030)])
def test_shadows_fall_where_rays_to_the_lamp_are_blocked(lamp: tuple[float, float, float]) -> None:
    sensor = replace(FLAT, shadow_positions_m=(lamp,))
    depth = pressed_in(sensor, (0.003, 0.002), 0.003, 0.002)
    caster = shadow_caster(sensor)
    assert caster is not None
    dark = caster.light(depth)[..., 0] < 0.75
    expected = traced(sensor, depth)
    assert expected.sum() > 160
    gel = depth == 0
    assert (dark & expected)[gel].sum() > 0.85 * (dark | expected)[gel].sum()


def test_a_shadow_takes_its_share_of_each_colour_and_nothing_elsewhere() -> None:
    depth = pressed_in(FLAT, (0.0, 0.0), 0.003, 0.002)
    caster = shadow_caster(FLAT)
    assert caster is not None
    grey = np.full((120, 160, 3), 100, dtype=np.uint8)
    caster.cast(grey, depth)
    assert grey.min(axis=(0, 1)).tolist() == [50, 75, 100]
    assert (grey[:, :60] == 100).all()  # towards the lamp
    untouched = np.full((120, 160, 3), 100, dtype=np.uint8)
    caster.cast(untouched, np.zeros((120, 160), dtype=np.float32))
    assert (untouched == 100).all()


def test_the_higher_the_lamp_reaches_the_softer_the_end_of_its_shadow() -> None:
    depth = pressed_in(FLAT, (0.0, 0.0), 0.003, 0.002)
    between = []
    for height in (0.0, 0.006):
        caster = shadow_caster(replace(FLAT, shadow_lamp_height_m=height))
        assert caster is not None
        light = caster.light(depth)[..., 0]
        between.append(int(((light > 0.55) & (light < 0.95)).sum()))
    assert between[1] > 1.5 * between[0]


def test_a_lamp_in_the_cameras_view_or_behind_it_is_refused() -> None:
    for lamp, finding in [((0.018, 0.0, 0.001), "in the camera's view"), ((-0.001, 0.03, 0.0), "behind")]:
        with pytest.raises(ValueError, match=finding):
            replace(FLAT, shadow_positions_m=(lamp,))


@pytest.mark.parametrize("contact", ["rigid", "elastic"])
def test_a_pressed_ball_casts_its_shadows_away_from_the_lamp(contact: str) -> None:
    point, query = np.array([[0.0, 0.0, 0.004]]), Press(depth_m=0.0015, samples=1, contact=contact)
    ball = Surface(*sphere(0.004, 4))
    plain = replace(FLAT, shadow_positions_m=(), shadow_shares=(), gel_thickness_m=0.004)
    dark = replace(FLAT, gel_thickness_m=0.004)
    lost = press(ball, plain, point, query).rgb[0].astype(int) - press(ball, dark, point, query).rgb[0]
    assert lost.min() >= 0
    # The lamp stands at +y, the image's left.
    assert lost[40:80, 80:, 0].sum() > 20 * lost[40:80, :72, 0].sum()
    assert lost[..., 2].max() == 0
    assert (render_poses(ball, dark, np.eye(4)[None] + 0.5)[0].rgb == render_poses(
        ball, plain, np.eye(4)[None] + 0.5
    )[0].rgb).all()  # fmt: skip
