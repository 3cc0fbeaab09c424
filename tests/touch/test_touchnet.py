import numpy as np
import pytest
from touch_shapes import bumpy, psnr_db

from objectfolder.errors import FormatError, QueryError
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.reading import calibrated, synthetic_background, with_noise
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import read_sensor
from objectfolder.touch.touchnet import TouchNet

SURFACE = bumpy(subdivisions=4)
POINTS = SURFACE.sample(3, 1).points


@pytest.fixture(scope="module")
def net() -> TouchNet:
    return TouchNet(SURFACE)


@pytest.mark.parametrize("factor", [2, 4])
def test_a_finer_image_shows_the_same_touch(net: TouchNet, factor: int) -> None:
    query = {"depth_m": np.array([0.0005, 0.001, 0.002]), "tilt_deg": 5.0, "azimuth_deg": 40.0}
    coarse = net.press(POINTS, Press(**query, samples=factor))
    fine = net.press(POINTS, Press(**query, samples=1), resolution=(160 * factor, 120 * factor))
    assert fine.rgb.shape == (3, 160 * factor, 120 * factor, 3)
    means = fine.rgb.reshape(3, 160, factor, 120, factor, 3).mean(axis=(2, 4))
    # What differs: where in a pixel its rays lie, and rounding to 8 bits before the mean or after.
    assert min(psnr_db(a, b) for a, b in zip(coarse.rgb, means, strict=True)) > 46
    np.testing.assert_allclose(fine.contact_area_m2, coarse.contact_area_m2, rtol=2e-3)
    np.testing.assert_array_equal(fine.sensor_to_object, coarse.sensor_to_object)


def test_reading_adds_background_and_then_noise_to_the_image_alone(net: TouchNet) -> None:
    background = synthetic_background(net.sensor, 3)
    plain = net.press(POINTS)
    read = net.press(POINTS, background=background, noise_seed=5)
    laid = calibrated(plain.rgb, net.no_contact, background, net.sensor)
    np.testing.assert_array_equal(read.rgb, with_noise(laid, net.sensor, 5))
    np.testing.assert_array_equal(read.depth_m, plain.depth_m)
    np.testing.assert_array_equal(net.press(POINTS, noise_seed=5).rgb, with_noise(plain.rgb, net.sensor, 5))


def test_a_background_is_of_the_size_asked_for(net: TouchNet) -> None:
    with pytest.raises(QueryError, match=r"shape \(320, 240, 3\)"):
        net.press(POINTS, resolution=(320, 240), background=synthetic_background(net.sensor, 0))


def test_a_flat_sensor_answers_from_the_same_surface() -> None:
    net = TouchNet(SURFACE, read_sensor("gelsight"))
    again = TouchNet.from_tensors(net.tensors(), net.metadata(), SURFACE)
    touches = again.press(POINTS, Press(depth_m=0.001))
    assert touches.rgb.shape == (3, 240, 320, 3)
    untouched = np.broadcast_to(net.no_contact, touches.rgb.shape)
    # Away from the contact nothing moves (but where a pixel sees less than a depth step of it); in it the
    # slopes show.
    moved = (touches.rgb != untouched).any(axis=-1)
    assert (moved & (touches.depth_m == 0)).mean() < 5e-4
    inside = touches.depth_m > 1e-4
    change = np.abs(touches.rgb[inside].astype(int) - untouched[inside]).max(axis=1)
    assert np.median(change) > 5 * net.sensor.noise_sigma_grey_levels
    assert touches.mask.any(axis=(1, 2)).all()


@pytest.mark.parametrize("sensor", ["digit", "gelsight"])
def test_an_elastic_gel_touches_less_than_the_object_lies_in_it(sensor: str) -> None:
    net = TouchNet(SURFACE, read_sensor(sensor))
    rigid, elastic = net.press(POINTS), net.press(POINTS, Press(contact="elastic"))
    np.testing.assert_array_equal(elastic.penetration_m, rigid.penetration_m)
    assert (elastic.mask.sum(axis=(1, 2)) < rigid.mask.sum(axis=(1, 2))).all()
    assert (elastic.depth_m.min(axis=(1, 2)) < 0).all()  # it bulges
    assert (elastic.depth_m.max(axis=(1, 2)) <= elastic.penetration_m + 1e-7).all()
    assert (elastic.force_n > 0.1).all()


def test_a_force_is_a_touch_with_an_elastic_gel(net: TouchNet) -> None:
    pressed = net.press(POINTS, Press(depth_m=0.0007, contact="elastic"))
    forced = net.press(POINTS, Press(force_n=pressed.force_n))
    np.testing.assert_allclose(forced.penetration_m, 0.0007, rtol=1e-3)
    np.testing.assert_allclose(forced.force_n, pressed.force_n, rtol=1e-6)
    assert min(psnr_db(a, b) for a, b in zip(pressed.rgb, forced.rgb, strict=True)) > 50
    with pytest.raises(QueryError, match="force"):
        net.press(POINTS, Press(force_n=1.0, contact="rigid"))
    with pytest.raises(QueryError, match="contact"):
        net.press(POINTS, Press(contact="soft"))


def test_the_contact_model_of_the_data_set_is_stored() -> None:
    net = TouchNet(SURFACE, Sensor(), contact="elastic")
    assert TouchNet.from_tensors({}, net.metadata(), SURFACE).contact == "elastic"
    with pytest.raises(FormatError, match="'soft'"):
        TouchNet.from_tensors({}, {**net.metadata(), "contact": "soft"}, SURFACE)
