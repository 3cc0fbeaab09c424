"""Figures of views in other conditions: those of the file's own images, and of wrong ones."""

import numpy as np
import pytest

import objectfolder
from objectfolder.fidelity.conditions import measure_conditions
from objectfolder.products.store import Array, Product
from objectfolder.vision.conditions import CONDITIONS
from pipeline.dataset.measures import CONDITION_LABELS, IN_CONDITIONS
from pipeline.publish.queries.description import fidelity_lines

NAMES = ("512_px", "window")
PART = (200, 216, 64, 64), (30, 32, 64, 64)


def own_views(file: objectfolder.ObjectFile) -> Product:
    """Return a file's own answers as the truth of two conditions."""
    cameras, lamps = file.sample_views(2, seed=3, lit=True)
    images = [
        file.render_linear(cameras[0], lamps[0], resolution=512, crop=PART[0]),
        file.render_linear(cameras[1], "window", resolution=128, crop=PART[1]),
    ]
    arrays = {
        "rgba": np.concatenate(images),
        "camera_to_world": file.frame.camera_to_unit(cameras),
        "light_position": file.frame.to_unit(lamps),
        "part": np.array(PART),
    }
    settings = {name: vars(CONDITIONS[name]) | {"noise_floor_db": 50.0} for name in NAMES}
    return Product(
        {
            f"condition_{name}": Array(value, tuple("abcd"[: value.ndim]), "1", name)
            for name, value in arrays.items()
        },
        {"conditions": settings, "field_of_view_deg": 39.6},
    )


@pytest.mark.slow
def test_the_own_images_of_a_file_have_no_error_and_those_of_another_lamp_have() -> None:
    file = objectfolder.example("bowl")
    views = own_views(file)
    measured = measure_conditions(file, views)
    for name in NAMES:
        # Rounding to 8 bits bounds what is measured; frames change by rounding.
        assert measured[f"psnr_{name}_db"] > 55 > 35 > measured[f"trivial_psnr_{name}_db"]
        assert measured[f"noise_floor_{name}_db"] == 50
    lamps = Array(1.5 * views["condition_light_position"], ("a", "b"), "1", "lamps")
    wrong = Product({**views.arrays, "condition_light_position": lamps}, views.attributes)
    of_wrong = measure_conditions(file, wrong)
    assert of_wrong["psnr_512_px_db"] < 40
    assert of_wrong["psnr_window_db"] == measured["psnr_window_db"]
    assert measure_conditions(file, Product({}, {})) == {}


def test_a_file_says_its_figures_in_other_conditions() -> None:
    file = objectfolder.example("bowl")
    assert list(CONDITION_LABELS) == list(CONDITIONS)
    fidelity, finer = file.description["fidelity"], IN_CONDITIONS[1]
    figures = {finer.name: 41.0, finer.trivial: 12.0, finer.noise_floor: 50.0}
    stated = file.with_description(fidelity={**fidelity, "vision": {**fidelity["vision"], **figures}})
    added = set(fidelity_lines(stated)) - set(fidelity_lines(file))
    assert added == {"             256 px: PSNR of the foreground 41.0 dB (noise floor 50.0, trivial 12.0)"}
