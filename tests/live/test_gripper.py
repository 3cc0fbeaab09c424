"""What is shown of a finger: a closed body as large as a DIGIT, whose gel is foremost."""

import numpy as np

from objectfolder.live.gripper import shown_finger
from objectfolder.touch.sensor.sensor import Sensor


def test_a_finger_is_its_housing_and_its_gel():
    sensor, surface = Sensor(), shown_finger().surface
    low, high = surface.bounds
    np.testing.assert_allclose(low, sensor.housing_low_m)
    np.testing.assert_allclose(high, [sensor.gel_apex_m[0], *sensor.housing_high_m[1:]])
    assert surface.edges.imbalance.max(initial=0) == 0, "closed"
    corners = surface.vertices[surface.faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    box = np.prod(np.subtract(sensor.housing_high_m, sensor.housing_low_m))
    assert box < volume < 1.2 * box, "faces look outward"
