import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from layer_reference import LayerContact
from reference_membrane import trace_membrane
from reference_simulator import ReferenceSimulator
from touch_shapes import box, bumpy, mug, psnr_db, sphere

from objectfolder.errors import QueryError
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.elastic import membrane
from objectfolder.touch.elastic.influence import compliance
from objectfolder.touch.presses.elastic_press import greatest_depth_m
from objectfolder.touch.presses.press import press
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.camera import no_contact_image, ray_grid, resolve, to_bytes
from objectfolder.touch.sensor.gel import gel_normals, gel_sag, gel_slopes, gel_surface
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import read_sensor
from objectfolder.touch.sensor.shading import shade
from tests.drawn_examples import few_examples

SENSOR = Sensor()
BUMPY = FacePatches(bumpy())
BALL_RADIUS = 0.006
BALL = FacePatches(Surface(*sphere(BALL_RADIUS, 6)))
BALL_POINT = np.array([[0.0, 0.0, BALL_RADIUS]])


def gel_curvature(sensor: Sensor) -> float:
    """Of the gel at its apex, 1/m."""
    small = 1e-4
    return 2 * float(gel_sag(sensor, np.array(small**2))) / small**2


@pytest.mark.parametrize("depth", [0.0003, 0.0006])
@pytest.mark.parametrize("thickness", [0.002, 0.004])
def test_force_and_area_on_a_ball_are_those_of_the_integral_equation(depth: float, thickness: float) -> None:
    sensor = replace(SENSOR, gel_thickness_m=thickness)
    touch = press(BALL, sensor, BALL_POINT, Press(depth_m=depth, contact="elastic"))
    radius = 1 / (1 / BALL_RADIUS + gel_curvature(sensor))
    expected = LayerContact(thickness, sensor.gel_poisson_ratio).at_indentation(depth, radius)
    modulus = sensor.gel_youngs_modulus_pa / (1 - sensor.gel_poisson_ratio**2)
    # A ball falls away faster than the paraboloid of its radius: the force is a little less.
    assert touch.force_n[0] == pytest.approx(modulus * expected.force_over_modulus_m2, rel=0.03)
    measured = np.sqrt(touch.contact_area_m2[0] / np.pi)
    assert measured == pytest.approx(expected.contact_radius_m, abs=0.5 * Press().cell_m)
    assert touch.penetration_m[0] == depth
    assert touch.reachable[0]
    assert not touch.saturated[0]


def test_the_image_of_a_half_space_under_a_ball_is_that_of_hertz() -> None:
    """A gel so thick that it is a half-space; its surface in closed form, met by rays to 1e-12 m."""
    sensor = replace(SENSOR, gel_thickness_m=10.0, gel_sagitta_m=0.0, gel_poisson_ratio=0.3)
    radius, depth = 0.012, 0.0006
    ball = Surface(*sphere(radius, 6))
    touch = press(
        ball, sensor, np.array([[0.0, 0.0, radius]]), Press(depth_m=depth, samples=2, contact="elastic")
    )
    a = np.sqrt(radius * depth)

    def displacement(r: np.ndarray) -> np.ndarray:
        out = np.minimum(a / np.maximum(r, a), 1.0)
        outside = ((2 * a * a - r * r) * np.arcsin(out) + r * r * out * np.sqrt(1 - out * out)) / (
            np.pi * radius
        )
        return np.where(r < a, depth - (radius - np.sqrt(np.maximum(radius**2 - r * r, 0))), outside)

    grid = ray_grid(sensor, 2)
    v, u = (part.ravel() for part in np.meshgrid(grid.v, grid.u, indexing="ij"))
    low, high = np.full(len(u), 0.015), np.full(len(u), 0.0221)
    for _ in range(50):
        middle = (low + high) / 2
        inside = middle < sensor.gel_apex_m[0] - displacement(middle * np.hypot(u, v))
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    y, z = low * u, low * v
    r = np.hypot(y, z)
    slope = (displacement(r + 1e-8) - displacement(np.maximum(r - 1e-8, 0))) / 2e-8 / np.maximum(r, 1e-12)
    position = np.stack([low, y, z + sensor.gel_apex_m[2]])
    normal = np.stack([-np.ones_like(y), -slope * y, -slope * z])
    expected = to_bytes(resolve(shade(sensor, position, normal), sensor, 2))
    contact = touch.mask[0]
    assert psnr_db(expected, touch.rgb[0], contact) > 55
    assert psnr_db(expected, touch.rgb[0]) > 62
    assert psnr_db(no_contact_image(sensor), touch.rgb[0], contact) < 30
    depth_map = resolve(displacement(r), sensor, 2)
    assert np.abs(touch.depth_m[0] - depth_map).max() < 0.01 * depth
    touched = resolve((r < a).astype(np.float32), sensor, 2) >= 0.5
    assert (touched != contact).mean() < 0.003


@given(st.floats(0, 0.0015), st.floats(0, 15), st.floats(0, 360), st.integers(0, 10_000))
@few_examples(10)
def test_no_gel_gives_way_more_than_its_label_says(
    depth: float, tilt: float, azimuth: float, seed: int
) -> None:
    point = BUMPY.surface.sample(1, seed).points
    touch = press(
        BUMPY,
        SENSOR,
        point,
        Press(depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth, samples=1, contact="elastic"),
    )
    assert touch.depth_m.max() <= depth * (1 + 1e-5) + 1e-7
    assert touch.penetration_m[0] == depth
    assert touch.force_n[0] >= 0
    if depth > 0.0001:
        # Between two bumps the gel can bulge out to the object: 1.5 % of one contact.
        assert (touch.depth_m[touch.mask] > 0).mean() > 0.95
    # The rigid image of the same touch: same place, and contact within what the gel bulges to.
    rigid = press(BUMPY, SENSOR, point, Press(depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth, samples=1))
    assert np.array_equal(touch.points, rigid.points)
    assert np.allclose(touch.sensor_to_object, rigid.sensor_to_object, rtol=0, atol=1e-9)
    assert touch.first_contact_offset_m == pytest.approx(rigid.first_contact_offset_m, abs=1e-9)
    assert touch.reachable[0] == rigid.reachable[0]


def test_where_the_gel_is_touched_it_lies_on_the_object() -> None:
    points = BUMPY.surface.sample(3, 4).points
    elastic = press(BUMPY, SENSOR, points, Press(depth_m=0.001, samples=1, contact="elastic"))
    rigid = press(BUMPY, SENSOR, points, Press(depth_m=0.001, samples=1))
    for row in range(3):
        inner = elastic.mask[row] & rigid.mask[row]
        assert inner.sum() > 500
        assert np.abs(elastic.depth_m[row] - rigid.depth_m[row])[inner].mean() < 1e-6
        assert psnr_db(rigid.rgb[row], elastic.rgb[row], inner) > 50


def test_a_force_for_a_depth_and_a_depth_for_a_force_agree() -> None:
    points = BUMPY.surface.sample(3, 8).points
    depths = np.array([0.0002, 0.0006, 0.0012])
    by_depth = press(BUMPY, SENSOR, points, Press(depth_m=depths, samples=1, contact="elastic"))
    by_force = press(BUMPY, SENSOR, points, Press(force_n=by_depth.force_n, samples=1, contact="elastic"))
    assert by_force.penetration_m == pytest.approx(depths, rel=1e-4)
    assert by_force.force_n == pytest.approx(by_depth.force_n, rel=1e-9)
    assert np.abs(by_force.rgb.astype(int) - by_depth.rgb).max() <= 2
    assert np.allclose(by_force.sensor_to_object, by_depth.sensor_to_object, atol=1e-6)
    assert by_force.contact_area_m2 == pytest.approx(by_depth.contact_area_m2, rel=0.01)


@pytest.mark.slow
def test_presses_of_any_number_leave_bounded_memory() -> None:
    points = BUMPY.surface.sample(12, 12).points
    depths = np.linspace(0.0001, 0.0015, 12)
    press(BUMPY, SENSOR, points, Press(depth_m=depths, samples=1, contact="elastic"))
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(2):
        press(BUMPY, SENSOR, points, Press(depth_m=depths[::-1], samples=1, contact="elastic"))
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    # What is kept for the next contacts are the influences of at most 64 boxes of cells.
    assert compliance.cache_info().maxsize == 64
    assert grown < 30e6


def test_no_depth_and_no_force_show_the_untouched_gel() -> None:
    for load in ({"depth_m": 0.0}, {"force_n": 0.0}):
        touch = press(BALL, SENSOR, BALL_POINT, Press(**load, contact="elastic"))
        assert np.array_equal(touch.rgb[0], no_contact_image(SENSOR))
        assert not touch.depth_m.any()
        assert not touch.mask.any()
        assert touch.force_n[0] == touch.contact_area_m2[0] == 0
        assert touch.reachable[0]


def test_no_force_indents_nothing_where_a_spike_lies_between_cells() -> None:
    pitch, x, y = Press().cell_m, 0.5 * SENSOR.gel_width_m, 0.5 * SENSOR.gel_height_m
    # Half a cell beside every centre: the nearest centre is above the spike's steep side.
    tip = np.array([0.5 * pitch, 0.5 * pitch, 0.0])
    corners = [[0.1 * pitch * i, 0.1 * pitch * j, -0.01] for i, j in ((0, 0), (10, 0), (10, 10), (0, 10))]
    spike = Surface(np.array([*corners, tip]), np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))
    assert min(x, y) > pitch
    touch = press(spike, SENSOR, tip[None], Press(force_n=0.0, contact="elastic"))
    assert touch.penetration_m[0] == touch.force_n[0] == touch.contact_area_m2[0] == 0
    assert not touch.mask.any()


def test_a_force_beyond_the_gel_saturates_it() -> None:
    touch = press(BALL, SENSOR, BALL_POINT, Press(force_n=1e4, samples=1, contact="elastic"))
    assert touch.saturated[0]
    assert touch.penetration_m[0] == greatest_depth_m(SENSOR)
    assert 0 < touch.force_n[0] < 1e4


def test_an_incompressible_gel_bulges_round_the_contact() -> None:
    soft = replace(SENSOR, gel_poisson_ratio=0.4999, gel_thickness_m=0.002)
    touch = press(BALL, soft, BALL_POINT, Press(depth_m=0.0005, contact="elastic"))
    assert touch.depth_m.min() < -0.00002
    assert (touch.depth_m[touch.mask] > 0).all()


def test_a_batch_answers_as_single_presses_do() -> None:
    points = BUMPY.surface.sample(3, 5).points
    depths = np.array([0.0003, 0.0007, 0.001])
    batch = press(
        BUMPY,
        SENSOR,
        points,
        Press(depth_m=depths, tilt_deg=8.0, azimuth_deg=50.0, samples=1, contact="elastic"),
    )
    for row in range(3):
        single = press(
            BUMPY,
            SENSOR,
            points[row : row + 1],
            Press(depth_m=depths[row], tilt_deg=8.0, azimuth_deg=50.0, samples=1, contact="elastic"),
        )
        for name, values in vars(single).items():
            assert np.array_equal(values, getattr(batch, name)[row : row + 1]), name


@pytest.mark.parametrize("name", ["digit", "gelsight"])
def test_the_oracle_agrees(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    points, sensor = BUMPY.surface.sample(1, 6).points, read_sensor(name)
    query = Press(depth_m=0.0008, samples=1, contact="elastic")
    touches = press(BUMPY, sensor, points, query)
    grid = ray_grid(sensor, 1)
    monkeypatch.setattr("objectfolder.touch.presses.press.Simulator", ReferenceSimulator)
    monkeypatch.setattr(membrane, "_trace", lambda fields, *_: trace_membrane(fields, sensor, grid))
    reference = press(BUMPY, sensor, points, query)
    assert touches.force_n == pytest.approx(reference.force_n, rel=1e-6)
    assert np.abs(touches.rgb.astype(int) - reference.rgb).max() <= 1
    assert np.abs(touches.depth_m - reference.depth_m).max() < 3e-7
    assert (touches.mask == reference.mask).all()


def test_a_flat_sensor_with_a_photometric_table_shows_a_ball() -> None:
    sensor = read_sensor("gelsight")
    touch = press(BALL, sensor, BALL_POINT, Press(depth_m=0.0005, samples=1, contact="elastic"))
    expected = LayerContact(sensor.gel_thickness_m, sensor.gel_poisson_ratio).at_indentation(
        0.0005, BALL_RADIUS
    )
    modulus = sensor.gel_youngs_modulus_pa / (1 - sensor.gel_poisson_ratio**2)
    assert touch.force_n[0] == pytest.approx(modulus * expected.force_over_modulus_m2, rel=0.03)
    moved = np.abs(touch.rgb[0].astype(int) - no_contact_image(sensor, 1)).max(axis=2)
    assert moved[touch.mask[0]].mean() > 10
    assert np.median(moved[~touch.mask[0]]) <= 1


def test_the_minis_force_is_the_measured_one() -> None:
    """Of a force sensor, on a ball of 15 mm (Helmut et al. 2024, arXiv:2411.03315)."""
    ball, depths = Surface(*sphere(0.0075, 6)), np.array([5e-4, 1e-3, 1.5e-3, 2e-3])
    query = Press(depth_m=depths, samples=1, cell_m=0.0003, contact="elastic")
    touches = press(ball, read_sensor("gelsight-mini"), np.tile([[0, 0, 0.0075]], (4, 1)), query)
    assert touches.force_n == pytest.approx([1.650, 5.964, 13.526, 23.253], rel=0.03)


def test_a_sensor_that_leans_more_than_its_pad_is_curved_presses_with_its_middle() -> None:
    sensor = read_sensor("gelsight-mini").at_resolution(60, 80)
    ball, point = Surface(*sphere(0.0075, 5)), np.tile([[0, 0, 0.0075]], (3, 1))
    query = Press(depth_m=0.001, tilt_deg=np.array([0, 2, 8]), samples=1, cell_m=0.0005, contact="elastic")
    touches = press(ball, sensor, point, query)
    assert touches.force_n == pytest.approx(np.full(3, touches.force_n[0]), rel=0.02)
    assert touches.mask[2].sum() > 100


@pytest.mark.slow
def test_finer_cells_converge() -> None:
    edge = FacePatches(Surface(*box((-0.003, -0.003, -0.02), (0.003, 0.003, 0.0))))
    point = np.zeros((1, 3))
    finest = press(edge, SENSOR, point, Press(depth_m=0.0005, cell_m=0.00004, contact="elastic"))
    errors = []
    for cell in (0.00032, 0.00016, 0.00008):
        touch = press(edge, SENSOR, point, Press(depth_m=0.0005, cell_m=cell, contact="elastic"))
        errors.append(abs(touch.force_n[0] / finest.force_n[0] - 1))
    assert errors[2] < 0.01
    assert errors[2] < errors[1] < errors[0] < 0.1


HARD_CASES = [
    *(
        (name, "digit")
        for name in ("box edge", "box corner", "blade", "inside a mug", "flipped", "small ball")
    ),
    *((name, "gelsight") for name in ("box edge", "box corner", "blade", "small ball", "metre-wide face")),
]


def test_hard_cases_have_finite_answers_with_true_labels(subtests: pytest.Subtests) -> None:
    for name, sensor_name in HARD_CASES:
        with subtests.test(name=name):
            cube = box((-0.01, -0.01, -0.01), (0.01, 0.01, 0.01))
            cup = Surface(*mug())
            surface, point = {
                "box edge": (Surface(*cube), (0.01, 0.01, 0.0)),
                "box corner": (Surface(*cube), (0.01, 0.01, 0.01)),
                "blade": (Surface(*box((-0.02, -0.0005, -0.03), (0.02, 0.0005, 0.0))), (0.0, 0.0, 0.0)),
                "inside a mug": (cup, (0.041, 0.0, 0.05)),
                "flipped": (Surface(cube[0], cube[1][:, ::-1]), (0.01, 0.0, 0.0)),
                "small ball": (Surface(*sphere(0.001, 3)), (0.0, 0.0, 0.001)),
                "metre-wide face": (Surface(*box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.0))), (0.0, 0.0, 0.0)),
            }[name]
            sensor = read_sensor(sensor_name)
            touch = press(
                surface, sensor, np.array([point]), Press(depth_m=0.0004, samples=1, contact="elastic")
            )
            rigid = press(surface, sensor, np.array([point]), Press(depth_m=0.0004, samples=1))
            assert touch.reachable[0] == rigid.reachable[0]
            assert np.isfinite(touch.force_n).all()
            assert np.isfinite(touch.depth_m).all()
            assert touch.depth_m.max() <= max(touch.penetration_m[0], 0) + 1e-7
            if rigid.penetration_m[0] > 0:
                assert touch.penetration_m[0] == 0.0004
                assert touch.force_n[0] > 0
            else:
                assert touch.force_n[0] == touch.penetration_m[0] == 0
                assert not touch.mask.any()


def test_the_flat_face_of_a_box_is_flat_in_the_gel_and_steep_round_it() -> None:
    flat = replace(SENSOR, gel_sagitta_m=0.0)
    face = Surface(*box((-0.003, -0.003, -0.02), (0.003, 0.003, 0.0)))
    touch = press(face, flat, np.zeros((1, 3)), Press(depth_m=0.0005, samples=1, contact="elastic"))
    assert touch.depth_m[0][touch.mask[0]] == pytest.approx(0.0005, abs=2e-6)
    around = touch.depth_m[0][~touch.mask[0]]
    assert ((around > 0.00001) & (around < 0.00045)).sum() > 200
    background = no_contact_image(flat, 1)
    moved = np.abs(touch.rgb[0].astype(int) - background).max(axis=2)
    # Light falls on a level gel, deeper by half a millimetre, almost as on the untouched one.
    inner = (touch.depth_m[0] > 0.00049) & touch.mask[0]
    assert np.median(moved[inner]) < 12
    assert moved[~touch.mask[0]].max() > 60


def test_the_surface_of_the_gel_is_known_by_its_slope() -> None:
    y, z = np.array([0.0, 0.004, -0.008]), np.array([0.015, 0.02, 0.004])
    step = 1e-7
    slope_y, slope_z = gel_slopes(SENSOR, y, z)
    down = (gel_surface(SENSOR, y + step, z) - gel_surface(SENSOR, y - step, z)) / (2 * step)
    assert slope_y == pytest.approx(down, abs=1e-6)
    normal = gel_normals(SENSOR, y, z)
    assert normal[1] / -normal[0] == pytest.approx(slope_y, abs=1e-12)
    assert normal[2] / -normal[0] == pytest.approx(slope_z, abs=1e-12)


def test_impossible_queries_are_refused_by_name(subtests: pytest.Subtests) -> None:
    for query, message in [
        ({"depth_m": 0.001, "force_n": 1.0}, "both given"),
        ({"depth_m": -0.001}, "out of range"),
        ({"depth_m": 0.0041}, "Ask for 0 to 0.004"),
        ({"force_n": -1.0}, "force_n: -1.0 N is out of range"),
        ({"force_n": np.nan}, "not finite"),
        ({"depth_m": 0.001, "tilt_deg": 60.0}, "tilt_deg: 60.0 degrees is out of range"),
        ({"depth_m": 0.001, "cell_m": 0.0}, "cell_m"),
        ({"depth_m": 0.001, "cell_m": 0.1}, "cell_m"),
    ]:
        with subtests.test(query=query), pytest.raises(QueryError, match=message):
            press(BALL, SENSOR, BALL_POINT, Press(**query, contact="elastic"))
