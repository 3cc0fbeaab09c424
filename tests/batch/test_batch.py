"""Batches on the CPU device: the loops of the same bodies that a GPU runs, against single queries."""

import sys

import numpy as np
import pytest
import torch
from known_corner import known_corner

import objectfolder
from bench.gpu import __main__ as gpu_bench
from bench.gpu.elastic import elastic_errors
from bench.gpu.run import EFFORTS, Run
from objectfolder.batch import Batch, SightBatch, TouchImages, WorldTouch, targets
from objectfolder.errors import QueryError
from objectfolder.touch.contact.height_field import gap_field
from objectfolder.touch.elastic.contact_problem import solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.markers import moved_markers
from objectfolder.touch.elastic.shear import solve_shear
from objectfolder.touch.presses.press import press
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.sensor_file import read_sensor
from objectfolder.vision.cameras import look_at
from tests.docstring_examples import run_example

pytestmark = pytest.mark.slow  # the bodies are compiled


@pytest.fixture(scope="module")
def files():
    return [objectfolder.example("mug"), objectfolder.example("bell")]


@pytest.fixture(scope="module")
def presses(files):
    """Touches of both objects, mixed: numbers of objects, points, and how to press."""
    random = np.random.default_rng(3)
    which = np.array([1, 0, 0, 1, 0, 1, 1, 0])
    points = np.empty((len(which), 3))
    for index, file in enumerate(files):
        points[which == index] = file.sample_contacts(4, seed=2, reachable=False)[0]
    turns = {name: random.uniform(0, 360, len(which)) for name in ("azimuth_deg", "roll_deg")}
    depth, tilt = random.uniform(0.0002, 0.002, len(which)), random.uniform(0, 30, len(which))
    return which, points, {"depth_m": depth, "tilt_deg": tilt, **turns}


@pytest.fixture(scope="module")
def single(files, presses):
    which, points, loads = presses
    rows = [np.flatnonzero(which == index) for index in range(2)]
    return [
        (row, file.press(points[row], **{name: value[row] for name, value in loads.items()}))
        for row, file in zip(rows, files, strict=True)
    ]


AT_GREATER_PRECISION = pytest.mark.release("objectfolder.batch", "objectfolder.touch")


@pytest.mark.parametrize(
    ("precision", "most"), [pytest.param("double", 1, marks=AT_GREATER_PRECISION), ("single", 8)]
)
def test_touches_of_several_objects_equal_single_presses(files, presses, single, precision, most):
    which, points, loads = presses
    answer = Batch(files, "cpu", precision=precision).touch.press(which, points, **loads)
    for rows, true in single:
        levels = np.abs(answer.rgb.numpy()[rows].astype(int) - true.rgb)
        assert levels.max() <= most
        assert np.count_nonzero(levels > 1) <= (0 if precision == "double" else 1e-5 * levels.size)
        agree = answer.mask.numpy()[rows] == true.mask
        assert np.count_nonzero(~agree) <= 1
        assert np.abs(answer.depth_m.numpy()[rows] - true.depth_m)[agree].max() <= 5e-7
        for name in ("sensor_to_object", "points", "normals", "first_contact_offset_m", "penetration_m"):
            np.testing.assert_allclose(getattr(answer, name).numpy()[rows], getattr(true, name), atol=1e-12)
        assert (answer.reachable.numpy()[rows] == true.reachable).all()
        assert (answer.saturated.numpy()[rows] == true.saturated).all()
        assert 0 < true.mask.mean() < 1


def test_the_device_check_compares_touches_of_any_precision_with_single_presses():
    checked = gpu_bench.touch_equality(Run(True, "none"), "single", 4)
    assert checked["mask_pixels_that_differ"] <= 1
    assert checked["rgb_levels"] <= 8
    assert checked["same_bytes_twice"]
    assert checked["alone_as_in_batch"]


def test_a_touch_in_a_batch_is_what_it_is_alone_and_fills_the_room_it_is_given(files, presses):
    which, points, loads = presses
    touch = Batch(files, "cpu").touch
    out = TouchImages.empty(len(which), touch.sensor, "cpu")
    together = touch.press(which, points, **loads, out=out)
    assert together.rgb.data_ptr() == out.rgb.data_ptr()
    alone = touch.press(which[2:3], points[2:3], **{name: value[2:3] for name, value in loads.items()})
    assert together.shear is None
    for name in vars(alone).keys() - {"shear"}:
        value = getattr(alone, name)
        np.testing.assert_array_equal(value[0], getattr(together, name)[2], err_msg=name)
    reached = ~(together.penetration_m == 0)
    images = touch.see(which, together.sensor_to_object)
    assert bool((images.rgb[reached] == together.rgb[reached]).all())
    depths = touch.penetrations(which, together.sensor_to_object)
    assert float((depths - together.penetration_m)[reached].abs().max()) < 1e-12


@pytest.mark.parametrize(("name", "size"), [("gelsight", (48, 64)), ("digit", (64, 48))])
def test_a_table_and_shadows_are_seen_as_by_a_single_press(files, name, size):
    sensor = read_sensor(name).at_resolution(*size)
    bell = files[1]
    points, _ = bell.sample_contacts(2, seed=2)
    touch = Batch([bell], "cpu", sensor=sensor).touch
    for contact, levels in (("rigid", 1), ("elastic", 2)):
        true = press(bell.touch.net._patches, sensor, points, Press(contact=contact, cell_m=0.0005))
        answer = touch.press(0, points, contact=contact, cell_m=0.0005, steps=40)
        assert np.abs(answer.rgb.numpy().astype(int) - true.rgb).max() <= levels, contact
        assert true.mask.any()


@pytest.mark.parametrize(
    "load", [{"depth_m": [0.0003, 0.0012, 0.0009, 0.001]}, {"force_n": [0.0, 4.0, 500.0, 4.0]}]
)
def test_elastic_touches_are_those_of_single_presses_and_state_their_residuals(files, load):
    sensor = files[0].touch.sensor.at_resolution(40, 30)
    which, load = np.array([1, 0, 1, 0]), {name: np.array(value) for name, value in load.items()}
    points = np.concatenate([files[index].sample_contacts(1, seed=2)[0] for index in which])
    points[3] = 0.022, -0.02, 0.0035  # in the mug, where the sensor does not fit
    touch, cells = Batch(files, "cpu", sensor=sensor).touch, {"cell_m": 0.0005, "tilt_deg": 10.0}
    answer = touch.press(which, points, contact="elastic", steps=40, **cells, **load)
    assert float(answer.relative_residual.max()) < 2e-5
    singles = []
    for row, index in enumerate(which):
        query = Press(contact="elastic", **cells, **{name: value[row] for name, value in load.items()})
        true = press(files[index].touch.net._patches, sensor, points[row : row + 1], query)
        singles.append((np.array([row]), true))
        for name, close in (
            ("force_n", 1e-5 * true.force_n[0]), ("penetration_m", 1e-8), ("sensor_to_object", 1e-8),
            ("first_contact_offset_m", 1e-12), ("depth_m", 3e-7),
        ):  # fmt: skip
            difference = np.abs(getattr(answer, name)[row].numpy() - getattr(true, name)[0]).max()
            assert difference <= close, (row, name, difference)
        assert np.abs(answer.rgb[row].numpy().astype(int) - true.rgb[0]).max() <= 2
        assert np.count_nonzero(answer.mask[row].numpy() != true.mask[0]) <= 1
        assert bool(answer.reachable[row]) == true.reachable[0]
        assert bool(answer.saturated[row]) == true.saturated[0]
    assert elastic_errors(answer, singles)["depth_um"] <= 0.3
    fewer = touch.press(which, points, contact="elastic", steps=4, **cells, **load).relative_residual
    assert 1e-3 < float(fewer.max()) < 1


@pytest.mark.parametrize("twisted", [False, True])
def test_sheared_gels_move_their_markers_as_those_of_single_queries(files, twisted):
    sensor = files[0].touch.sensor.at_resolution(40, 30)
    which, forces = np.array([1, 0, 1, 0]), np.array([2.0, 4.0, 3.0, 0.0])
    points = np.concatenate([files[index].sample_contacts(1, seed=2)[0] for index in which])
    across = np.array([[0.6, 0.4], [-0.5, 1.0], [0.0, 2.9], [0.1, 0.0]])  # the third slides, the last is off
    torques = np.array([0.001, -0.003, 0.001, 0.0]) if twisted else [None] * 4
    touch = Batch(files, "cpu", sensor=sensor).touch
    query = {"force_n": forces, "cell_m": 0.0005, "marker_grid": (5, 4), "friction": 0.8, "across_n": across}
    query |= {"torque_nm": torques} if twisted else {}
    answer = touch.press(which, points, steps=40, **query)
    shear, images = answer.shear, answer.shear.markers.drawn_on(answer.rgb)
    assert shear.sliding.tolist() == [False, False, True, True]
    assert float(shear.relative_residual.max()) < 3e-5
    gel = Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)
    contacts = []
    for row, index in enumerate(which):
        first = answer.sensor_to_object[row].numpy().copy()
        first[:3, 3] -= float(answer.penetration_m[row]) * first[:3, 0]
        gap = gap_field(files[index].touch.net._patches, sensor, first, (60, 40))
        contact = solve_contact(gap, 0.0005, gel, force_n=forces[row])
        contacts.append(contact)
        true = solve_shear(contact, gel, 0.8, across[row], torque_nm=torques[row], tolerance=1e-6)
        markers = moved_markers(sensor, contact, true, (5, 4))
        for name, close in (("displacement_m", 2e-8), ("pixels", 1e-4), ("rest_m", 0), ("rest_pixels", 0)):
            moved = getattr(shear.markers, name)
            moved = moved[row] if moved.ndim == 3 else moved
            assert np.abs(moved.numpy() - getattr(markers, name)).max() <= close, (row, name)
        assert (
            np.abs(shear.shift_m[row].numpy() - true.shift_m).max() < 2e-8 + 2e-3 * np.abs(true.shift_m).max()
        )
        assert float(shear.twist_rad[row]) == pytest.approx(true.twist_rad, rel=2e-3, abs=1e-6)
        levels = images[row].numpy().astype(int) - markers.drawn_on(answer.rgb[row].numpy())
        assert np.abs(levels).max() <= 1
    assert float((shear.markers.displacement_m[:3].abs()).max()) > 1e-4
    assert (images != answer.rgb).any()
    pressed = touch.press(which[0], points[:1], force_n=2.0, cell_m=0.0005, marker_grid=(5, 4)).shear
    still = moved_markers(sensor, contacts[0], solve_shear(contacts[0], gel, 0.8, (0.0, 0.0)), (5, 4))
    assert np.abs(pressed.markers.displacement_m[0].numpy() - still.displacement_m).max() < 2e-8
    assert not pressed.sliding.any()
    few = touch.press(which, points, steps=3, **query).shear.relative_residual
    assert 1e-3 < float(few.max()) < 1


def test_strikes_equal_single_ones_to_a_millionth_of_their_peaks(files):
    which = np.array([1, 0, 1])
    points = np.stack([files[index].sample_contacts(1, seed=4)[0][0] for index in which])
    impulses = np.random.default_rng(0).normal(size=(3, 3))
    sound = Batch(files, "cpu").sound
    torch.set_float32_matmul_precision("high")
    try:
        for batch, alone in (
            ({}, {}),
            ({"pulse_s": 0.0007}, {"pulse": 0.0007}),
            ({"listener": [0.5, 0.4, 0.3]}, {"listener": [0.5, 0.4, 0.3]}),
        ):
            answer = sound.strike(which, points, impulses, 0.3, **batch).numpy()
            for row, index in enumerate(which):
                true = np.asarray(files[index].strike(points[row], impulses[row], 0.3, **alone))[0]
                assert np.abs(answer[row] - true).max() <= 1e-6 * np.abs(true).max()
        assert torch.get_float32_matmul_precision() == "high"  # as the caller had it
    finally:
        torch.set_float32_matmul_precision("highest")


def test_views_are_those_of_single_queries(files):
    views = [file.sample_views(1, seed=1, lit=True) for file in files]
    camera, light = views[0]
    views.append((camera, 1e5 * light))  # a lamp beyond the range of float16
    cameras, lights = (np.concatenate(parts[::-1]) for parts in zip(*views, strict=True))
    # The first is of known material, and none of the views shows it.
    sight = SightBatch([known_corner(), *(file.sight for file in files)], "cpu")
    images = sight.render([1, 2, 1], cameras, lights, 96)
    for image, file, view in zip(images.numpy(), [files[0], *files[::-1]], views[::-1], strict=True):
        error = ((image.astype(float) - file.render(*view, 96)[0]) ** 2).mean()
        assert 10 * np.log10(255**2 / error) >= 42
    measured = list(EFFORTS.values())[1]  # as the default's
    assert (sight.render([1, 2, 1], cameras, lights, 96, **measured) == images).all()


def test_the_inside_of_a_bell_mirrors_itself_as_in_a_single_query(files):
    pose = look_at(np.array([[0.02, 0.01, -0.15]]), np.array([0.0, 0.0, 0.05]))
    light = np.array([[0.05, 0.01, -0.15]])
    answer = SightBatch([files[1].sight], "cpu").render_linear(0, pose, light, 48)[0].numpy()
    true = files[1].sight.render_passes(pose, ["linear"], light, 48)["linear"][0]
    inside = (true[..., 3] > 0.999) & (answer[..., 3] > 0.999)
    error = np.abs(answer - true)[inside].sum(axis=1) / true[inside][:, :3].sum(axis=1)
    # Curved mirrors enlarge roundings. With rays that meet their own place a third of the light is wrong.
    assert inside.sum() > 1000
    assert np.median(error) < 0.1


def test_known_material_shows_light_its_maps_and_itself_as_in_single_queries(files):
    corner, (camera, lamp) = known_corner(), files[0].sample_views(1)
    pose = look_at(np.array([[1.0, -1.1, 1.1]]))
    pose[:, :3, 3] += 0.5
    light = np.array([[1.2, 0.2, 1.4]])
    cameras, lights = np.concatenate([camera, pose]), np.concatenate([lamp, light])
    sight = SightBatch([corner, files[0].sight], "cpu")
    answer = sight.render_linear([1, 0], cameras, lights, 64, sub_rays=32).numpy()[1]
    true = corner.render_passes(pose, ["linear"], light, 64)["linear"][0]
    # Gloss is sampled: means of 8 x 8 pixels. Without it these differ by 13 %, without bounced light by 12.
    blocks, expected = (image.reshape(8, 8, 8, 8, 4).mean(axis=(1, 3)) for image in (answer, true))
    inside = expected[..., 3] > 0.999
    assert inside.sum() > 10
    colour, expected_colour = (part[inside][:, :3] for part in (blocks, expected))
    error = np.abs(colour - expected_colour).sum(axis=1) / expected_colour.sum(axis=1)
    assert error.max() < 0.05
    assert np.median(error) < 0.005
    assert np.abs(answer[..., 3] - true[..., 3]).mean() < 0.002


def test_more_rays_without_light_say_how_much_of_a_pixel_is_covered(files):
    camera, light = files[0].sample_views(1)
    views = 0, camera, light, 32
    sight = SightBatch([files[0].sight], "cpu")
    few, finer, many = (
        sight.render_linear(*views, sub_rays=rays, coverage_rays=coverage, contrast=0.0).numpy()[0]
        for rays, coverage in ((4, 0), (4, 64), (64, 0))
    )
    outline = (few[..., 3] > 0) & (few[..., 3] < 1)
    assert outline.sum() > 20
    np.testing.assert_allclose(finer[outline][:, 3], many[outline][:, 3], atol=1e-6)
    assert np.abs(few[outline][:, 3] - many[outline][:, 3]).max() > 0.05
    scale = finer[outline][:, 3:] / few[outline][:, 3:]  # the colour stays
    np.testing.assert_allclose(finer[outline][:, :3], few[outline][:, :3] * scale, atol=1e-6)
    assert (finer[~outline] == few[~outline]).all()


def test_what_misses_the_centres_of_pixels_is_found_from_its_neighbours(files, monkeypatch):
    camera, light = files[0].sample_views(1)
    camera[:, :3, 3] *= 3.0  # 32 pixels show a part of it
    sight = SightBatch([files[0].sight], "cpu")
    views = 0, camera, light, 32
    true = sight.render_linear(*views, sub_rays=64, contrast=-1.0).numpy()[..., 3]
    alpha = {}
    for rounds in (1, 4):
        monkeypatch.setattr("objectfolder.batch.sight.ROUNDS", rounds)
        alpha[rounds] = sight.render_linear(*views, sub_rays=64, contrast=0.0).numpy()[..., 3]
    assert np.abs(alpha[4] - true).max() < 1e-6
    assert np.abs(alpha[1] - true).max() > 0.05


def test_two_fingers_in_eight_worlds_feel_their_objects_wherever_the_worlds_put_them(files):
    worlds, random = 8, np.random.default_rng(0)
    objects = np.repeat(np.arange(worlds) % 2, 2)
    touch = Batch(files, "cpu", sensor=files[0].touch.sensor.at_resolution(32, 24)).touch
    points = np.stack(
        [files[index].sample_contacts(1, seed=seed)[0][0] for seed, index in enumerate(objects)]
    )
    poses = touch.press(objects, points).sensor_to_object.numpy()
    turns = np.repeat(np.linalg.qr(random.normal(size=(worlds, 3, 3)))[0], 2, axis=0)
    turns *= np.linalg.det(turns)[:, None, None]
    places = np.repeat(random.uniform(-10, 10, (worlds, 3)), 2, axis=0)
    fingers = WorldTouch(touch, objects)
    position = places + np.einsum("nij,nj->ni", turns, poses[:, :3, 3])
    bodies = position, turns @ poses[:, :3, :3], places, turns
    fingers.update(*(torch.from_numpy(part.reshape(worlds, 2, *part.shape[1:])) for part in bodies))
    expected = touch.see(objects, poses)
    assert fingers.tactile_depth_image.shape == (2 * worlds, 32, 24, 1)
    assert float((fingers.tactile_depth_image[..., 0] - expected.depth_m).abs().max()) < 1e-6
    levels = (fingers.tactile_rgb_image.int() - expected.rgb.int()).abs()
    assert float((levels > 1).float().mean()) < 1e-3
    np.testing.assert_allclose(fingers.penetration_depth.numpy(), np.full((16, 1), 0.001), atol=1e-9)


@pytest.mark.parametrize("documented", [Batch, WorldTouch])
def test_example_yields_what_it_says(documented, small_file, monkeypatch):
    monkeypatch.chdir(small_file.parent)
    run_example(documented.__name__, documented)


def test_impossible_queries_name_what_is_wrong(files, monkeypatch):
    touch = Batch(files, "cpu").touch
    for objects in ([0, 2], [0.5], [0, 0, 0]):
        with pytest.raises(QueryError, match="objects"):
            touch.press(objects, np.zeros((2, 3)))
    with pytest.raises(QueryError, match="points"):
        touch.press(0, np.zeros((2, 4)))
    with pytest.raises(QueryError, match="out"):
        touch.see(0, np.eye(4)[None], out=TouchImages.empty(2, touch.sensor, "cpu"))
    with pytest.raises(QueryError, match="across_n"):
        touch.press(0, np.zeros((1, 3)), marker_grid=(2, 2))
    with pytest.raises(QueryError, match="both given"):
        touch.press(0, np.zeros((1, 3)), 0.001, force_n=1.0)


def test_a_device_that_cannot_be_used_is_one_line(files, monkeypatch, capsys):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for device in ("cuda", "meta", "abacus"):
        with pytest.raises(QueryError, match="device"):
            Batch(files, device)
    monkeypatch.setattr(sys, "argv", ["bench.gpu"])
    with pytest.raises(SystemExit, match="1"):
        gpu_bench.main()
    assert capsys.readouterr().err == "device: torch finds no cuda device here. Use 'cpu'.\n"

    def without_driver():
        raise RuntimeError("Error at driver init:\n\nno driver.\n:\n")

    targets._launch_nothing.cache_clear()
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(targets, "cuda_module", without_driver)
    with pytest.raises(QueryError) as error:
        Batch(files, "cuda")
    assert str(error.value) == (
        "device: numba-cuda cannot use it: Error at driver init: no driver. Use 'cpu'."
    )
