import json

import numpy as np
import pytest

from objectfolder.errors import FormatError
from objectfolder.touch.sensor.camera import no_contact_image, ray_grid
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor


def test_a_sensor_survives_json() -> None:
    sensor = Sensor(name="other", roughness=0.5)
    assert Sensor.from_dict(json.loads(json.dumps(sensor.to_dict()))) == sensor


@pytest.mark.parametrize("height", [160, 320, 640])
def test_a_finer_image_sees_the_same_part_of_the_gel(height: int) -> None:
    coarse, fine = ray_grid(Sensor(), 1), ray_grid(Sensor().at_resolution(height, height * 3 // 4), 1)
    factor = height // 160
    assert len(fine.v) == height
    assert fine.cell * factor**2 == pytest.approx(coarse.cell)
    # The rays of a coarse pixel's fine pixels lie evenly round its own ray.
    assert np.allclose(fine.v.reshape(-1, factor).mean(axis=1), coarse.v, atol=1e-15)
    assert np.allclose(fine.u.reshape(-1, factor).mean(axis=1), coarse.u, atol=1e-15)


def test_a_sensor_that_cannot_be_is_refused(subtests: pytest.Subtests) -> None:
    for field, value, finding in [
        ("gel_poisson_ratio", 0.5, "gel_poisson_ratio is 0.5"),
        ("gel_youngs_modulus_pa", 0.0, "Young's modulus"),
        ("gel_thickness_m", 0.0, "thickness"),
        ("image_height", 1, "2 x 2 pixels"),
        ("gel_radius_m", 0.018, "gel_radius_m"),
    ]:
        with subtests.test(field=field), pytest.raises(ValueError, match=finding):
            Sensor(**{field: value})


def test_a_description_with_a_wrong_key_is_refused_by_name() -> None:
    values = Sensor().to_dict()
    del values["near_m"]
    with pytest.raises(FormatError, match=r"missing fields \['near_m'\], unknown fields \['nere_m'\]"):
        Sensor.from_dict({**values, "nere_m": 0.001})


def test_the_lights_are_tactos() -> None:
    positions = np.array(Sensor().light_positions_m) - [0.005, 0, 0.015]
    assert np.allclose(np.linalg.norm(positions, axis=1), 0.02)
    assert np.allclose(positions[2], [0, 0, -0.02])
    assert np.sum(Sensor().light_colours) == pytest.approx(3 / 255)


def test_the_gels_corners_lie_at_the_sagitta() -> None:
    sensor = Sensor()
    apex, corner = gel_surface(sensor, np.array([0.0, 0.01]), np.array([0.015, 0.03]))
    assert (apex, corner) == pytest.approx((0.022, 0.017))


def test_rays_meet_the_gel_on_its_surface() -> None:
    sensor = Sensor()
    grid = ray_grid(sensor, 1)
    v, u = np.meshgrid(grid.v, grid.u, indexing="ij")
    x = grid.gel_depth
    assert np.allclose(gel_surface(sensor, u.ravel() * x, 0.015 + v.ravel() * x), x, atol=1e-15)


def test_a_pixel_at_the_apex_is_a_sixth_of_a_millimetre() -> None:
    assert np.sqrt(ray_grid(Sensor(), 1).cell) * 0.022 == pytest.approx(0.159e-3, rel=1e-2)


def test_a_camera_that_sees_past_the_gel_is_refused() -> None:
    with pytest.raises(ValueError, match="past the gel"):
        ray_grid(Sensor(field_of_view_deg=75.0), 1)


def test_the_untouched_gel_is_lit_by_three_colours_from_three_sides() -> None:
    image = no_contact_image(Sensor()).astype(int)
    assert image.shape == (160, 120, 3)
    # Red from the image's upper left (+y, +z), green from the upper right, blue from below.
    assert image[10, 10].argmax() == 0
    assert image[10, -10].argmax() == 1
    assert image[-10, 60].argmax() == 2
    assert image.min() > 60
    assert image.max() < 250
