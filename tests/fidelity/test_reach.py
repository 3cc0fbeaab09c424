import numpy as np
import pytest

from objectfolder.fidelity.feel import measure_reach
from objectfolder.making.touches.record import simulate_touches
from objectfolder.products.store import Product
from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.sensor import Sensor


def plates(gap: float) -> Surface:
    """Two square plates, 80 x 80 x 2 mm, one `gap` metres over the other."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    quads = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    lower = (corners - [0.5, 0.5, 0]) * [0.08, 0.08, 0.002]
    upper = lower + np.array([0, 0, 0.002 + gap])
    return Surface(np.concatenate([lower, upper]), np.concatenate([faces, faces + 8]))


def touched(surface: Surface) -> Product:
    return simulate_touches(surface, Sensor(), touches=120, held_out_touches=0, tilt_deg=0.0, seed=1)


def test_the_inside_of_two_near_plates_is_out_of_reach() -> None:
    touches = touched(plates(0.01))
    inner = (np.abs(touches["points"][:, 2] - 0.007) < 0.0051) & (
        np.abs(touches["points"][:, :2]) < 0.039
    ).all(1)
    reach = measure_reach(touches)
    # No DIGIT fits between: half of the area, but for the narrow sides.
    assert not touches["reachable"][inner].any()
    assert inner.mean() > 0.4
    assert inner.mean() <= reach["unreachable_share"] < inner.mean() + 0.1
    assert reach["beyond_label_m"] == 0
    assert reach["saturated_share"] == 0


def test_a_plate_is_within_reach() -> None:
    two = plates(0.08)
    reach = measure_reach(touched(Surface(two.vertices[:8], two.faces[:12])))
    assert reach["unreachable_share"] == 0
    assert reach["unreachable_by_housing_share"] == 0


def test_between_plates_far_apart_the_sensor_fits_but_has_no_straight_way() -> None:
    touches = touched(plates(0.08))
    # Nearer to the border than the contact radius, 2 mm, normals lean outwards.
    inner = (np.abs(touches["points"][:, 2] - 0.042) < 0.0401) & (
        np.abs(touches["points"][:, :2]) < 0.0379
    ).all(1)
    reach = measure_reach(touches)
    assert not touches["reachable"][inner].any()
    assert inner.mean() <= reach["unreachable_share"] < inner.mean() + 0.1
    assert reach["unreachable_by_housing_share"] == reach["unreachable_share"]
    assert (touches["penetration_m"][inner] > 0).all()


def test_a_ledge_meets_the_housing_where_the_gel_would_reach() -> None:
    # 35 mm between plates: the gel fits, the housing behind it does not.
    touches = touched(plates(0.035))
    reach = measure_reach(touches)
    assert reach["unreachable_by_housing_share"] > 0.4
    assert reach["unreachable_by_housing_share"] == reach["unreachable_share"]


def test_an_image_deeper_than_its_label_is_found() -> None:
    touches = touched(plates(0.08))
    lied = {**touches.arrays}
    wrong = touches.arrays["penetration_m"]
    lied["penetration_m"] = type(wrong)(wrong.data * 0.5, wrong.dims, wrong.units, wrong.long_name)
    assert measure_reach(Product(lied, {}))["beyond_label_m"] > 1e-4


def test_no_touches_have_no_reach() -> None:
    none = simulate_touches(plates(0.08), Sensor(), touches=0, held_out_touches=0)
    assert set(measure_reach(none).values()) == {0.0}


@pytest.mark.parametrize(
    ("object_id", "least", "most"),
    [
        ("052_extra_large_clamp", 0.45, 0.75),
        ("Diamond_Visions_Scissors_Red", 0.3, 0.55),
        ("011_banana", 0, 0.06),
    ],
)
def test_much_of_a_tool_is_out_of_reach(shared_objects, object_id: str, least: float, most: float) -> None:
    from objectfolder.making.mesh.cleaning import clean
    from objectfolder.making.mesh.readers.load import load_mesh

    mesh, _ = clean(load_mesh(shared_objects / object_id / "model.obj", with_textures=False))
    touches = simulate_touches(mesh.surface, Sensor(), touches=100, held_out_touches=0, tilt_deg=0.0, seed=2)
    reach = measure_reach(touches)
    assert least <= reach["unreachable_share"] <= most
    assert reach["offset_over_1mm_share"] <= reach["offset_over_100um_share"]
    assert reach["beyond_label_m"] == 0
