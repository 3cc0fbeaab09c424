import dataclasses

import numpy as np
import pytest
from vision_shapes import cube

from objectfolder.errors import FormatError, InputError, QueryError
from objectfolder.making.views.cycles_process import render_in_children
from objectfolder.making.views.render_request import Shots, unit_scene
from objectfolder.making.views.views import simulate_views
from objectfolder.making.visionnet.fitting import fit_visionnet
from objectfolder.products.store import Product
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at
from objectfolder.vision.compositing import composite_on_white
from objectfolder.vision.environment import ENVIRONMENTS, Environment, named_map
from objectfolder.vision.visionnet.visionnet import VisionNet

MATT = Appearance(roughness=0.9, metallic=0.0)
SLOW_FIXTURES = ("views",)
TINY = {"steps": 300, "batch_pixels": 512, "grid_resolution": 32}


@pytest.fixture(scope="module")
def views() -> Product:
    return simulate_views(
        cube(), MATT, resolution=40, training_views=30, training_samples=16,
        held_out_views=6, held_out_samples=64, seed=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def fitted(views: Product) -> VisionNet:
    return fit_visionnet(
        cube().surface, UnitFrame.from_dict(views.attributes["frame"]), views, **TINY, seed=0
    )


def psnr(truth: np.ndarray, answer: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((composite_on_white(truth) - composite_on_white(answer)) ** 2)))


def test_held_out_views_are_far_better_than_the_trivial_answers(views, fitted):
    held_out = views["held_out"]
    truth = views["rgba"][held_out].astype(np.float64)
    answer = fitted.render(
        views["camera_to_world"][held_out], views["light_position"][held_out], 40, 39.6, 64
    )
    alpha = truth[..., 3:]
    training = views["rgba"][~held_out].astype(np.float64)
    mean_colour = training[..., :3].sum(axis=(0, 1, 2)) / training[..., 3].sum()
    # Each silhouette in its own view's mean colour, which the trivial answer could not even know.
    best = truth[..., :3].sum(axis=(1, 2), keepdims=True) / alpha.sum(axis=(1, 2), keepdims=True)
    trivial = max(
        psnr(truth, np.concatenate([colour * alpha, alpha], axis=-1)) for colour in (mean_colour, best)
    )
    np.testing.assert_allclose(answer[..., 3:], alpha, atol=0.15)
    assert psnr(truth, answer) > max(34.0, trivial + 10)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        ENVIRONMENTS[0],
        *(pytest.param(name, marks=pytest.mark.release("objectfolder.vision")) for name in ENVIRONMENTS[1:]),
    ],
)
def test_in_an_environment_it_is_as_cycles_shows_it(views, fitted, name):
    cameras = look_at(np.array([[1.5, -1.7, 1.0], [-1.2, 0.9, -1.8]]))
    scene = unit_scene(cube(), MATT, UnitFrame.from_dict(views.attributes["frame"]))
    shots = Shots(cameras, np.ones((2, 3)), np.arange(2), 128, 40, 40, 39.6, environment=named_map(name))
    truth = render_in_children(scene, shots).astype(np.float32)
    answer = fitted.render(cameras, Environment.of(name), 40, 39.6)
    assert psnr(truth, answer) > 32
    # Another light is another picture.
    wrong = fitted.render(cameras, Environment.of(named_map(name)[:, ::-1]), 40, 39.6)
    assert psnr(truth, wrong) < psnr(truth, answer) - 4


def test_the_truth_of_held_out_views_plays_no_part_in_the_fit(views):
    rgba = views["rgba"].copy()
    rgba[views["held_out"]] = 0.5
    spoilt = Product(
        {**views.arrays, "rgba": dataclasses.replace(views.arrays["rgba"], data=rgba)}, views.attributes
    )
    frame, few = UnitFrame.from_dict(views.attributes["frame"]), TINY | {"steps": 20}
    first, again = (fit_visionnet(cube().surface, frame, truth, **few, seed=0) for truth in (views, spoilt))
    for name, tensor in first.tensors().items():
        np.testing.assert_array_equal(tensor, again.tensors()[name], err_msg=name)


def test_a_batch_answers_as_its_views_do_and_survives_its_tensors(views, fitted):
    surface, frame = cube().surface, UnitFrame.from_dict(views.attributes["frame"])
    again = VisionNet.from_tensors(fitted.tensors(), fitted.metadata(), surface, frame)
    cameras, lights = views["camera_to_world"][:3], views["light_position"][:3]
    batch = fitted.render(cameras, lights, (30, 44), 39.6, 16)
    assert batch.shape == (3, 30, 44, 4)
    assert batch.dtype == np.float32
    for index in range(3):
        np.testing.assert_array_equal(
            again.render(cameras[index], lights[index], (30, 44), 39.6, 16)[0], batch[index]
        )


def test_weights_are_half_precision_and_tensors_are_named(fitted):
    tensors = fitted.tensors()
    assert all(name.startswith("vision.") for name in tensors)
    assert {tensor.dtype for tensor in tensors.values()} == {np.dtype(np.float16), np.dtype(np.uint8)}


def test_few_rays_in_even_pixels_change_little(views, fitted):
    camera, light = views["camera_to_world"][-1], views["light_position"][-1]
    assert psnr(fitted.render(camera, light, 40, 39.6, 256), fitted.render(camera, light, 40, 39.6, 64)) > 40


def test_queries_without_an_answer_are_refused(subtests, fitted):
    for change, word in [
        ({"lights": np.zeros((2, 3))}, r"lights.*one light a camera"),
        ({"camera_to_world": np.diag([2.0, 2, 2, 1])}, "camera_to_object: not a rigid pose"),
        ({"passes": ["shine"]}, "passes: 'shine'"),
        ({"crop": (0, 0, 9, 8)}, "crop: 9 x 8 pixels at row 0, column 0. Stay within the image, 8 x 8"),
        ({"crop": (-1, 0, 2, 2)}, "crop"),
        ({"crop": (0, 0, 0, 2)}, "crop"),
        ({"crop": (0, 0, 2)}, "crop: 3 numbers"),
        ({"lights": np.full((1, 3), np.nan)}, "finite"),
        ({"resolution": 0}, "resolution"),
        ({"sub_rays": 0}, "sub_rays"),
    ]:
        with subtests.test(change=change):
            query = {
                "camera_to_world": look_at(np.array([[0.0, 0.0, 2.5]])),
                "lights": np.array([[0.0, 0.0, 1.0]]),
                "resolution": 8,
                "field_of_view_deg": 39.6,
            }
            with pytest.raises(QueryError, match=word):
                fitted.render(**{**query, **change})


def test_foreign_tensors_are_refused_by_name(views, fitted):
    surface, frame = cube().surface, UnitFrame.from_dict(views.attributes["frame"])
    tensors = fitted.tensors()
    without = {name: tensor for name, tensor in tensors.items() if name != "vision.grid"}
    with pytest.raises(FormatError, match=r"vision\.grid"):
        VisionNet.from_tensors(without, fitted.metadata(), surface, frame)
    misshapen = {**tensors, "vision.albedo.weight": tensors["vision.albedo.weight"][:, 1:]}
    with pytest.raises(FormatError, match=r"vision\.albedo\.weight"):
        VisionNet.from_tensors(misshapen, fitted.metadata(), surface, frame)


def test_views_that_never_show_the_object_cannot_be_fitted(views):
    empty = dataclasses.replace(views.arrays["rgba"], data=np.zeros_like(views["rgba"]))
    blank = Product({**views.arrays, "rgba": empty}, views.attributes)
    with pytest.raises(InputError, match="no training view"):
        fit_visionnet(cube().surface, UnitFrame.from_dict(views.attributes["frame"]), blank, **TINY, seed=0)
