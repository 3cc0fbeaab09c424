"""What is added on reading: noise, and a real sensor's background."""

import numpy as np
import pytest

from objectfolder.errors import QueryError
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.reading import blur_kernel, calibrated, synthetic_background, with_noise
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import read_sensor

DIGIT = Sensor()


def images(count: int = 3, seed: int = 5) -> np.ndarray:
    random = np.random.default_rng(seed)
    return random.integers(0, 256, (count, 160, 120, 3), dtype=np.uint8)


def test_noise_has_the_sensors_deviation_and_no_mean() -> None:
    grey = np.full((4, 160, 120, 3), 128, dtype=np.uint8)
    added = with_noise(grey, DIGIT, seed=1).astype(float) - 128
    # Rounding adds a twelfth of a squared level.
    assert added.std() == pytest.approx(np.sqrt(49 + 1 / 12), rel=0.01)
    assert abs(added.mean()) < 0.06
    channels = added.reshape(-1, 3)
    assert np.abs(np.corrcoef(channels.T) - np.eye(3)).max() < 0.02


def test_two_noisy_readings_agree_as_little_as_said() -> None:
    grey = np.full((160, 120, 3), 128, dtype=np.uint8)
    difference = with_noise(grey, DIGIT, 1).astype(float) - with_noise(grey, DIGIT, 2)
    assert 10 * np.log10(255**2 / (difference**2).mean()) == pytest.approx(28.2, abs=0.2)


def test_noise_is_set_by_seed_and_row_alone() -> None:
    three = images()
    noisy = with_noise(three, DIGIT, 7)
    assert np.array_equal(with_noise(three, DIGIT, 7), noisy)
    assert np.array_equal(with_noise(three[:2], DIGIT, 7), noisy[:2])
    assert np.array_equal(with_noise(three[0], DIGIT, 7), noisy[0])
    assert not np.array_equal(with_noise(three, DIGIT, 8), noisy)
    assert not np.array_equal(with_noise(three[[0, 0]], DIGIT, 7)[0], with_noise(three[[0, 0]], DIGIT, 7)[1])


def test_noise_neither_wraps_round_nor_touches_its_input() -> None:
    extremes = np.zeros((160, 120, 3), dtype=np.uint8)
    extremes[:80] = 255
    original = extremes.copy()
    noisy = with_noise(extremes, DIGIT, 0)
    assert np.array_equal(extremes, original)
    assert noisy[:80].min() > 200
    assert noisy[80:].max() < 55


def test_without_noise_nothing_changes() -> None:
    assert np.array_equal(with_noise(images(), Sensor(noise_sigma_grey_levels=0.0), 3), images())


def test_the_blur_is_opencvs(subtests: pytest.Subtests) -> None:
    for size in [1, 3, 5, 7, 9, 21]:
        with subtests.test(size=size):
            cv2 = pytest.importorskip("cv2")
            assert np.allclose(blur_kernel(size), cv2.getGaussianKernel(size, 0).ravel(), atol=1e-15)


def test_a_calibrated_image_is_tactos() -> None:
    cv2 = pytest.importorskip("cv2")
    untouched = no_contact_image(DIGIT)
    background = synthetic_background(DIGIT, 1)
    rgb = images(2)
    answers = calibrated(rgb, untouched, background, DIGIT)
    for image, answer in zip(rgb, answers, strict=True):
        difference = cv2.GaussianBlur((image.astype(float) - untouched) * 0.5, (7, 7), 0)
        tacto = np.clip(difference + background, 0, 255).astype(np.uint8)
        # The last bit of a sum that falls on a whole number may round it down or not.
        assert (np.abs(tacto.astype(int) - answer) <= 1).all()
        assert (tacto != answer).mean() < 1e-3


def test_where_nothing_touches_the_background_shows() -> None:
    untouched, background = no_contact_image(DIGIT), synthetic_background(DIGIT, 2)
    assert np.array_equal(calibrated(untouched, untouched, background, DIGIT), background)


def test_a_sensor_without_gain_loss_and_blur_adds_its_difference() -> None:
    sensor = read_sensor("gelsight")
    untouched = no_contact_image(sensor)
    touch = untouched.copy()
    touch[50:60, 50:60] += 20
    background = synthetic_background(sensor, 0)
    laid = calibrated(touch, untouched, background, sensor).astype(int) - background
    assert (laid[50:60, 50:60] == 20).all()
    laid[50:60, 50:60] = 0
    assert not laid.any()


@pytest.mark.parametrize("background", [np.zeros((120, 160, 3), dtype=np.uint8), np.zeros((160, 120, 3))])
def test_a_background_of_another_size_or_type_is_refused(background: np.ndarray) -> None:
    with pytest.raises(QueryError, match=r"Give a uint8 image of shape \(160, 120, 3\)"):
        calibrated(images(1), no_contact_image(DIGIT), background, DIGIT)


def test_synthetic_backgrounds_are_of_one_make_but_not_the_same() -> None:
    untouched = no_contact_image(DIGIT).astype(float)
    background, second_background = synthetic_background(DIGIT, 0), synthetic_background(DIGIT, 1)
    assert np.array_equal(background, synthetic_background(DIGIT, 0))
    assert not np.array_equal(background, second_background)
    # In the middle a channel differs by its balance and unevenness; in a corner of the image, at 36 degrees
    # from the axis, the light is down to 0.43.
    ratio = background / untouched
    assert np.abs(ratio[75:85, 55:65] - 1).max() < 0.14
    corner = ratio[0, 0] / ratio[80, 60]
    u, v = 0.75 * np.tan(np.pi / 6), np.tan(np.pi / 6)
    assert corner == pytest.approx((1 + u**2 + v**2) ** -2, rel=0.08)
