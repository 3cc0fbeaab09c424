import numpy as np
import pytest
from touch_shapes import box, bumpy, psnr_db, torus

from objectfolder.making.touches.record import simulate_touches
from objectfolder.products.store import read_product, write_product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet

SENSOR = Sensor()


def _same(first: np.ndarray, second: np.ndarray) -> bool:
    """Equal, where a force that the rigid model does not have is not a number."""
    return np.array_equal(first, second, equal_nan=True)


def test_the_product_states_what_was_asked_and_what_came_of_it(tmp_path) -> None:
    product = simulate_touches(bumpy(), SENSOR, touches=5, held_out_touches=3, seed=4)
    assert product["rgb"].shape == (8, 160, 120, 3)
    assert product["depth"].dtype == np.float32
    assert product["held_out"].tolist() == [False] * 5 + [True] * 3
    assert ((product["depth_m"] >= 0.0005) & (product["depth_m"] <= 0.002)).all()
    assert (product["penetration_m"] == product["depth_m"]).all()
    assert ((product["tilt_deg"] >= 0) & (product["tilt_deg"] <= 15)).all()
    assert ((product["azimuth_deg"] >= 0) & (product["azimuth_deg"] < 360)).all()
    assert product["reachable"].dtype == product["saturated"].dtype == bool
    assert (product["first_contact_offset_m"] >= 0).all()
    assert (product["contact_area_m2"] > 0).all()
    assert np.isnan(product["force_n"]).all()
    assert product.attributes["contact"] == "rigid"
    assert Sensor.from_dict(product.attributes["sensor"]) == SENSOR
    write_product(tmp_path / "touches.zarr.zip", product)
    stored = read_product(tmp_path / "touches.zarr.zip")
    assert all(_same(product[name], stored[name]) for name in product.arrays)


def test_an_elastic_data_set_states_the_force_of_each_touch() -> None:
    product = simulate_touches(
        bumpy(subdivisions=4), SENSOR, touches=2, held_out_touches=1, contact="elastic", seed=4
    )
    assert product.attributes["contact"] == "elastic"
    assert (product["penetration_m"] == product["depth_m"]).all()
    assert (product["force_n"] > 0).all()
    assert not product["saturated"].any()
    assert (product["depth"].max(axis=(1, 2)) <= product["penetration_m"] + 1e-7).all()


def test_touches_are_set_by_their_seed_alone() -> None:
    surface = bumpy(subdivisions=4)
    touches = simulate_touches(surface, SENSOR, touches=2, held_out_touches=2, seed=1)
    same = simulate_touches(surface, SENSOR, touches=2, held_out_touches=2, seed=1)
    assert all(_same(touches[name], same[name]) for name in touches.arrays)
    more = simulate_touches(surface, SENSOR, touches=4, held_out_touches=2, seed=1)
    assert np.array_equal(touches["rgb"][2:], more["rgb"][4:])
    touches_of_seed_2 = simulate_touches(surface, SENSOR, touches=2, held_out_touches=2, seed=2)
    assert not np.array_equal(touches["points"], touches_of_seed_2["points"])


def test_points_cover_the_surface_by_area_and_not_by_vertices() -> None:
    # A box whose top is cut into many small faces: most vertices, a sixth of the area.
    bar = Surface(*box((0, 0, 0), (0.1, 0.1, 0.1)))
    points = simulate_touches(bar, SENSOR, touches=60, held_out_touches=0, seed=0)["points"]
    faces = [np.isclose(points[:, axis], side).sum() for axis in range(3) for side in (0, 0.1)]
    assert min(faces) >= 3


def test_touches_at_every_vertex() -> None:
    cube = Surface(*box((0, 0, 0), (0.05, 0.05, 0.05)))
    product = simulate_touches(cube, SENSOR, touches=100, held_out_touches=1, at_vertices=True, seed=0)
    assert np.allclose(product["points"][:8], cube.vertices)
    some = simulate_touches(cube, SENSOR, touches=3, held_out_touches=0, at_vertices=True, seed=0)
    assert len(some["points"]) == 3
    assert (np.abs(some["points"] - 0.025) == 0.025).all()


def test_a_touchnet_answers_held_out_touches_from_the_compressed_surface() -> None:
    surface = Surface(*torus())
    tensors = encode_surface(surface)
    truth = simulate_touches(surface, SENSOR, touches=0, held_out_touches=12, seed=3)
    net = TouchNet(decode_surface(tensors), SENSOR)
    again = TouchNet.from_tensors(net.tensors(), net.metadata(), net.surface)
    answer = again.press(
        truth["points"],
        Press(depth_m=truth["depth_m"], tilt_deg=truth["tilt_deg"], azimuth_deg=truth["azimuth_deg"]),
    )
    scores = [
        psnr_db(a, b, m) for a, b, m in zip(truth["rgb"], answer.rgb, truth["mask"], strict=True) if m.any()
    ]
    empty = [
        psnr_db(a, net.no_contact, m) for a, m in zip(truth["rgb"], truth["mask"], strict=True) if m.any()
    ]
    assert len(scores) >= 10
    assert np.mean(scores) > 45
    assert np.mean(scores) > np.mean(empty) + 15
    assert (answer.reachable == truth["reachable"]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "object_id", ["062_dice", pytest.param("025_mug", marks=pytest.mark.release("objectfolder.touch"))]
)
def test_a_real_scan_is_answered_at_42_db_in_the_contact(shared_objects, object_id: str) -> None:
    from objectfolder.making.mesh.cleaning import clean
    from objectfolder.making.mesh.readers.load import load_mesh

    mesh, _ = clean(load_mesh(shared_objects / object_id / "model.obj", with_textures=False))
    tensors = encode_surface(mesh.surface)
    assert sum(tensor.nbytes for tensor in tensors.values()) < 200_000
    truth = simulate_touches(mesh.surface, SENSOR, touches=0, held_out_touches=25, seed=3)
    answer = TouchNet(decode_surface(tensors), SENSOR).press(
        truth["points"],
        Press(depth_m=truth["depth_m"], tilt_deg=truth["tilt_deg"], azimuth_deg=truth["azimuth_deg"]),
    )
    pairs = zip(truth["rgb"], answer.rgb, truth["mask"], strict=True)
    assert np.mean([psnr_db(a, b, m) for a, b, m in pairs if m.any()]) > 42
