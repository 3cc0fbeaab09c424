"""The committed Object File of the tests is what the real tasks make, within what processors differ by."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import objectfolder
from objectfolder.products.store import Product, read_product
from tests.cache_key import cache_key
from tests.small_file import FOLDER, MATERIALS, NAME, make

MADE_ANEW = (
    "what the tasks make has changed: where it is meant to, `python -m tests.small_file` commits to it"
)
SENSORS = Path(objectfolder.__file__).parent / "touch" / "sensor" / "sensors"
LARGEST_BYTES = 100_000
PACKAGES = (
    "bpy", "embreex", "mkl", "numba", "numcodecs", "numpy", "pypardiso", "pytetwild", "scipy", "torch",
    "trimesh", "zarr",
)  # fmt: skip
FIDELITY_DB = 0.5  # sums in another order move the fit's minimum by less


@pytest.fixture(scope="module")
def made(make_once: Callable[..., Path]) -> Path:
    """The file and its truth, kept between runs until the code that makes them changes."""
    files = [MATERIALS, *sorted(SENSORS.iterdir())]
    return make_once("small-file", make, cache_key(["tests.small_file"], files, PACKAGES))


def truths(folder: Path, name: str) -> tuple[Product, Product]:
    """What is committed and what was made."""
    return read_product(FOLDER / f"{name}.zarr.zip"), read_product(folder / f"{name}.zarr.zip")


def test_it_is_small() -> None:
    assert (FOLDER / NAME).stat().st_size <= LARGEST_BYTES


@pytest.mark.slow
def test_the_truth_made_anew_is_that_beside_the_small_file(made: Path) -> None:
    views, views_anew = truths(made, "views")
    modes, modes_anew = truths(made, "modes")
    for truth, anew in ((views, views_anew), (modes, modes_anew)):
        assert anew.arrays.keys() == truth.arrays.keys(), MADE_ANEW
        assert anew.attributes.keys() == truth.attributes.keys(), MADE_ANEW
        for name in truth.arrays:
            assert anew[name].shape == truth[name].shape, MADE_ANEW
            assert anew[name].dtype == truth[name].dtype, MADE_ANEW
    for name in ("camera_to_world", "depth", "held_out"):
        np.testing.assert_allclose(views_anew[name], views[name], rtol=1e-5, atol=1e-5, err_msg=MADE_ANEW)
    # Of the darkest training views one path of light may go another way.
    assert np.abs(views_anew["rgba"] - views["rgba"]).mean() < 1e-3 * views["rgba"].mean(), MADE_ANEW
    np.testing.assert_allclose(modes_anew["eigenvalues"], modes["eigenvalues"], rtol=1e-6, err_msg=MADE_ANEW)
    of_material, of_material_anew = (
        product["dampings_per_s"] - product["radiation_dampings_per_s"] for product in (modes, modes_anew)
    )
    np.testing.assert_allclose(of_material_anew, of_material, rtol=1e-6, err_msg=MADE_ANEW)
    # Coarse boundary elements turn with the last bits of what they are given: 2e-3 without AVX2.
    np.testing.assert_allclose(
        modes_anew["dampings_per_s"], modes["dampings_per_s"], rtol=5e-3, err_msg=MADE_ANEW
    )
    np.testing.assert_array_equal(modes_anew["points"], modes["points"], err_msg=MADE_ANEW)
    # The sign of a mode is any.
    size = np.abs(modes["mode_shapes"]).max()
    np.testing.assert_allclose(
        np.abs(modes_anew["mode_shapes"]), np.abs(modes["mode_shapes"]), atol=1e-4 * size, err_msg=MADE_ANEW
    )


@pytest.mark.slow
def test_the_small_file_made_anew_is_the_one_that_tests_ask(made: Path) -> None:
    file, anew = (objectfolder.load(folder / NAME) for folder in (FOLDER, made))
    np.testing.assert_array_equal(anew.surface.vertices, file.surface.vertices, err_msg=MADE_ANEW)
    np.testing.assert_array_equal(anew.surface.faces, file.surface.faces, err_msg=MADE_ANEW)
    for part in ("object", "material", "body", "touch", "vision"):
        assert anew.description[part] == file.description[part], MADE_ANEW
    for sense, measures in file.description["fidelity"].items():
        for name, value in measures.items():
            expected = value
            if isinstance(value, float):
                error = FIDELITY_DB if name.endswith("_db") else 1e-2 * abs(value) + 1e-4
                expected = pytest.approx(value, abs=error)
            assert anew.description["fidelity"][sense][name] == expected, MADE_ANEW
