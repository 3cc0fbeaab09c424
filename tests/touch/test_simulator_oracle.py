"""The compiled kernels against general solvers and single rays: the same but for ties."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from reference_simulator import ReferenceSimulator
from scipy.optimize import linprog, minimize
from touch_shapes import box, bumpy, joined, mug, sphere, torus

from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.indentation import indentation
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.press import press, render_poses
from objectfolder.touch.presses.touches import Press, Touches
from objectfolder.touch.rendering.simulator import Simulator, TouchImage
from objectfolder.touch.sensor.gel import gel_constants, gel_surface
from objectfolder.touch.sensor.point_lights import point_lights
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.sensor_file import read_sensor
from objectfolder.touch.sensor.shading import cook_torrance

SENSOR = Sensor()
SHAPES = {
    "bumpy ball": bumpy(),
    "torus": Surface(*torus()),
    "box": Surface(*box((0, 0, 0), (0.05, 0.04, 0.03))),
    "blade": Surface(*box((0, 0, 0), (0.05, 0.02, 0.0004))),
    "mug": Surface(*mug()),
    "grain": Surface(*sphere(0.0015, 3)),
    "metre": Surface(*box((-0.5, -0.5, -1), (0.5, 0.5, 0))),
    "crossed blades": Surface(
        *joined(box((0, -0.006, 0), (0.12, 0.006, 0.002)), box((0, -0.006, 0.003), (0.06, 0.006, 0.005)))
    ),
    "floor and pillar": Surface(
        *joined(box((-0.05, -0.05, -0.01), (0.05, 0.05, 0)), box((0.0125, -0.01, 0.0), (0.0130, 0.01, 0.02)))
    ),
}


def reference_press(*query: Any) -> Touches:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("objectfolder.touch.presses.press.Simulator", ReferenceSimulator)
        return press(*query)


def reference_poses(*query: Any) -> list[TouchImage]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("objectfolder.touch.presses.press.Simulator", ReferenceSimulator)
        return render_poses(*query)


@pytest.mark.parametrize(("name", "samples"), [(name, 1 + place % 3) for place, name in enumerate(SHAPES)])
def test_both_ways_give_the_same_images(name: str, samples: int) -> None:
    patches, random = FacePatches(SHAPES[name]), np.random.default_rng(samples)
    points = np.concatenate([SHAPES[name].sample(5, samples).points, SHAPES[name].vertices[:2]])
    query: dict[str, Any] = {
        "depth_m": random.uniform(0, 0.003, 7),
        "tilt_deg": random.uniform(0, 20, 7) * (np.arange(7) % 3 > 0),
        "azimuth_deg": random.uniform(0, 360, 7),
    }
    expected = reference_press(patches, SENSOR, points, Press(samples=samples, **query))
    touches = press(patches, SENSOR, points, Press(samples=samples, **query))
    assert np.allclose(touches.contact_area_m2, expected.contact_area_m2, rtol=1e-6, atol=1e-15)
    # But for ties: a mean in the middle between two grey levels, a ray along an edge of a face.
    difference = np.abs(touches.rgb.astype(int) - expected.rgb)
    assert (difference > 1).mean() < 1e-4
    assert (difference > 0).mean() < 1e-3
    assert (touches.mask != expected.mask).mean() < 1e-4
    assert (np.abs(touches.depth_m - expected.depth_m) > 2.5e-7).mean() < 1e-4


def test_both_ways_see_the_same_at_any_pose() -> None:
    patches, random = FacePatches(SHAPES["bumpy ball"]), np.random.default_rng(3)
    poses = press(
        patches, SENSOR, SHAPES["bumpy ball"].sample(6, 3).points, Press(samples=1)
    ).sensor_to_object
    # From far off to with the camera inside the object.
    poses[:, :3, 3] += random.uniform(-0.01, 0.03, 6)[:, None] * poses[:, :3, 0]
    for reference, image in zip(
        reference_poses(patches, SENSOR, poses),
        render_poses(patches, SENSOR, poses),
        strict=True,
    ):
        assert (np.abs(reference.rgb.astype(int) - image.rgb) > 0).mean() < 1e-3
        assert (np.abs(reference.depth - image.depth) > 2.5e-7).mean() < 1e-4
        assert image.contact_area_m2 == pytest.approx(reference.contact_area_m2, rel=1e-6)


@pytest.mark.parametrize("size", [(160, 120), (33, 24), (48, 30)])
def test_both_ways_agree_at_any_resolution(size: tuple[int, int]) -> None:
    sensor, patches = SENSOR.at_resolution(*size), FacePatches(SHAPES["torus"])
    points = SHAPES["torus"].sample(3, 1).points
    reference = reference_press(patches, sensor, points)
    touches = press(patches, sensor, points)
    assert (np.abs(reference.rgb.astype(int) - touches.rgb) > 0).mean() < 1e-3


@pytest.mark.parametrize("samples", [1, 2])
def test_both_ways_agree_with_a_sensor_whose_colours_are_looked_up(samples: int) -> None:
    sensor, patches = read_sensor("gelsight"), FacePatches(SHAPES["bumpy ball"])
    points = SHAPES["bumpy ball"].sample(4, 2).points
    reference = reference_press(patches, sensor, points, Press(tilt_deg=10.0, samples=samples))
    touches = press(patches, sensor, points, Press(tilt_deg=10.0, samples=samples))
    assert reference.mask.any(axis=(1, 2)).all()
    difference = np.abs(reference.rgb.astype(int) - touches.rgb)
    assert difference.max() <= 1
    assert (difference > 0).mean() < 1e-3
    assert (reference.mask == touches.mask).all()


@pytest.mark.parametrize("name", SHAPES)
def test_the_tree_finds_the_closest_faces_that_a_search_over_all_finds(name: str) -> None:
    surface = SHAPES[name]
    random = np.random.default_rng(2)
    points = np.concatenate([surface.sample(100, 1).points, surface.vertices[:50]])
    points = np.concatenate([points, points + random.normal(size=points.shape) * 0.01])
    face, barycentric = FacePatches(surface).closest(points)
    expected = surface.closest_points(points)
    closest = surface.points_at(face, barycentric)
    assert np.abs(np.linalg.norm(closest - points, axis=1) - expected.distance).max() < 1e-14
    assert np.abs(closest - expected.points).max() < 1e-9
    # At a corner of several faces it is the one of lowest index in both.
    at_vertices = slice(100, 100 + min(50, len(surface.vertices)))
    assert (face[at_vertices] == expected.face[at_vertices]).all()


def test_the_tree_finds_every_face_in_a_ball() -> None:
    surface = SHAPES["bumpy ball"]
    patches = FacePatches(surface)
    points = surface.sample(20, 4).points
    starts, faces = patches.in_balls(points, 0.003)
    for i, point in enumerate(points):
        within = (np.linalg.norm(patches.triangles - point, axis=2) < 0.003).any(axis=1)
        assert np.isin(np.flatnonzero(within), faces[starts[i] : starts[i + 1]]).all()


@pytest.mark.parametrize("name", SHAPES)
def test_nothing_reaches_deeper_than_the_faces_that_the_tree_finds_near(name: str) -> None:
    patches, gel = FacePatches(SHAPES[name]), gel_constants(SENSOR)
    points = SHAPES[name].sample(3, 9).points
    for pose in press(patches, SENSOR, points, Press(tilt_deg=9.0, roll_deg=70.0)).sensor_to_object:
        near = Simulator(patches, SENSOR, 1).approach(pose, -0.001)
        local = (patches.triangles - pose[:3, 3]) @ pose[:3, :3]
        reach = np.array([indentation(triangle, gel, np.empty((3, 3))) for triangle in local])
        assert near.greatest == pytest.approx(max(reach.max(), 0.0), abs=1e-12)
        assert (near.bounds >= reach[near.faces] - 1e-12).all()
        assert np.isin(np.flatnonzero(reach > -0.001), near.faces).all()


def test_a_box_is_entered_by_what_has_a_point_within() -> None:
    random = np.random.default_rng(4)
    outcomes = []
    for _ in range(300):
        low = random.normal(size=3) * 0.01
        high = low + random.random(3) * 0.02
        # Triangles about a place on the box, which pass by its edges.
        at = low + random.integers(0, 2, 3) * (high - low) + random.normal(size=3) * 0.005
        corners = at + random.normal(size=(3, 3)) * 0.02
        # The greatest margin to all sides of the box that a mean of the corners has.
        sides = np.concatenate([np.r_[-corners.T, corners.T], np.ones((6, 1))], axis=1)
        limits, mean = np.r_[-low, high], np.array([[1.0, 1.0, 1.0, 0.0]])
        most = linprog([0, 0, 0, -1], sides, limits, mean, [1.0], [(0, 1)] * 3 + [(None, None)])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.linalg.qr(random.normal(size=(3, 3)))[0], random.normal(size=3) * 0.02
        placed = FacePatches(Surface(corners @ pose[:3, :3].T + pose[:3, 3], np.array([[0, 1, 2]])))
        assert placed.enters_box(pose, low, high) == (most.x[3] > 0)
        outcomes.append(most.x[3] > 0)
    assert 40 < sum(outcomes) < 150


@pytest.mark.parametrize("size", [0.002, 0.02, 0.1])
def test_indentations_of_single_triangles_are_those_that_a_search_finds(size: float) -> None:
    random = np.random.default_rng(int(size * 1e4))
    apex, gel = np.array(SENSOR.gel_apex_m), gel_constants(SENSOR)
    half = np.array([SENSOR.gel_width_m, SENSOR.gel_height_m]) / 2
    met = 0
    for _ in range(60):
        centre = apex + random.normal(size=3) * [0.003, 0.006, 0.009]
        triangle = centre + random.normal(size=(3, 3)) * [min(0.2 * size, 0.004), size, size]
        edges = triangle[1:] - triangle[0]
        beside = triangle[0, 1:] - apex[1:]
        sides = np.r_[edges[:, 1:].T, -edges[:, 1:].T, [[1.0, 1.0]]]
        limits = np.r_[half - beside, half + beside, 1.0]
        within = linprog([0, 0], sides, limits, bounds=[(0, 1)] * 2)
        depth = indentation(triangle, gel, np.empty((3, 3)))
        assert np.isfinite(depth) == within.success
        if not within.success:
            continue

        def above(share: np.ndarray, triangle: np.ndarray = triangle, edges: np.ndarray = edges) -> float:
            x, y, z = triangle[0] + share @ edges
            return 1e3 * float(x - gel_surface(SENSOR, y, z))

        under = {"type": "ineq", "fun": lambda share, a=sides, b=limits: b - a @ share}
        searched = minimize(
            above, within.x, bounds=[(0, 1)] * 2, constraints=under, options={"ftol": 1e-14, "maxiter": 500}
        )
        assert depth == pytest.approx(-searched.fun / 1e3, abs=1e-8)
        met += 1
    assert met > 20


def test_shading_by_table_is_the_exact_power_to_a_hundredth_of_a_grey_level() -> None:
    random = np.random.default_rng(0)
    positions = np.array([[0.02], [0.0], [0.015]]) + random.normal(size=(3, 5000)) * 0.004
    normals = random.normal(size=(3, 5000)) + np.array([[-2.0], [0.0], [0.0]])
    # Bright lights saturate, dim ones end below the table.
    for factor in (1e-9, 1e-3, 1.0, 30.0):
        colors = tuple((factor * r, factor * g, factor * b) for r, g, b in SENSOR.light_colours)
        sensor = replace(SENSOR, light_colours=colors)
        exact = cook_torrance(sensor, positions, normals)
        shades = point_lights(sensor).shade(5000, positions.astype(np.float32), normals.astype(np.float32)).T
        assert np.abs(shades - exact).max() < 1e-2 / 255
