"""What fingers are: a closed body as large as the sensor is shown, a ball or a box as its gel collides."""

import numpy as np
import pytest

import objectfolder
from objectfolder.live.gripper import gripper, recess_m, shown_finger
from objectfolder.touch import read_sensor


def test_a_finger_is_its_housing_and_its_gel():
    sensor = read_sensor("digit")
    surface = shown_finger(sensor).surface
    low, high = surface.bounds
    np.testing.assert_allclose(low, sensor.housing_low_m)
    np.testing.assert_allclose(high, [sensor.gel_apex_m[0], *sensor.housing_high_m[1:]])
    assert surface.edges.imbalance.max(initial=0) == 0, "closed"
    corners = surface.vertices[surface.faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    box = np.prod(np.subtract(sensor.housing_high_m, sensor.housing_low_m))
    assert box < volume < 1.2 * box, "faces look outward"


@pytest.mark.parametrize(
    ("name", "size", "behind"),
    [
        ("digit", [0.0325, 0, 0], 0.0325 - np.sqrt(0.0325**2 - 0.01**2)),
        ("gelsight", [0.01425, 0.012625, 0.010375], 0.0),
    ],
)
def test_a_finger_collides_by_the_shape_of_its_gel(name, size, behind):
    sensor = read_sensor(name)
    model = gripper(objectfolder.example("mug"), sensor=sensor)
    geom = model.body("left").geomadr[0]
    np.testing.assert_allclose(model.geom_size[geom], size)
    front = model.geom_pos[geom] + [model.geom_size[geom][0], 0, 0]
    np.testing.assert_allclose(front, sensor.gel_apex_m, atol=1e-12)
    recess = recess_m(sensor, np.array([0, 0.01, 0.04]), np.zeros(3))
    np.testing.assert_allclose(recess, [0, behind, np.inf])
