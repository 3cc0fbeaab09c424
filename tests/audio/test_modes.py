"""From a surface and a material to the product of modes."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from solved_bodies import CELLS_BAR_M, CELLS_LIMIT_HZ, UNDAMPED, bar_of_cells, modes_of
from structured_solids import box, material

from objectfolder.making.modes.modes import modes_of_solid, simulate_modes
from objectfolder.making.modes.product_arrays import accuracy_attributes
from objectfolder.products.store import Product, read_product, write_product
from objectfolder.surface.surface import Surface


@pytest.fixture(scope="module")
def bar(solved: Callable[[str], Product]) -> Product:
    return solved("bar of cells")


@pytest.fixture(scope="module")
def undamped_bar(solved: Callable[[str], Product]) -> Product:
    return solved("undamped bar of cells")


def test_the_product_says_what_it_holds(bar: Product, tmp_path: Path) -> None:
    count = len(bar["frequencies_hz"])
    assert bar.attributes["audible"]
    assert count == bar.attributes["count_certificate"]["elastic_found"]
    assert bar.attributes["count_certificate"]["counted"] == count + 6
    assert bar.attributes["count_certificate"]["holds"]
    assert bar["mode_shapes"].shape == (150, 3, count)
    assert bar["mode_shapes"].dtype == np.float32
    assert bar["held_out"].sum() == 30
    assert bar.attributes["mass_kg"] == pytest.approx(2700 * np.prod(CELLS_BAR_M))
    assert bar.attributes["volume_m3"] == pytest.approx(np.prod(CELLS_BAR_M))
    squared = np.square(CELLS_BAR_M)
    inertia = np.diag(bar.attributes["mass_kg"] / 12 * (squared.sum() - squared))
    np.testing.assert_allclose(bar.attributes["inertia_kg_m2"], inertia, rtol=1e-9, atol=1e-15)
    assert np.all(np.diff(bar["frequencies_hz"]) >= 0)
    assert bar["residuals"].max() < 1e-4
    assert bar.attributes["rigid_frequency_hz"] < 0.1
    assert 0 < bar.attributes["error_estimate_cents"] < 300
    write_product(tmp_path / "bar.zarr.zip", bar)
    again = read_product(tmp_path / "bar.zarr.zip")
    np.testing.assert_array_equal(again["mode_shapes"], bar["mode_shapes"])


def test_damping_is_rayleighs_where_no_loss_factor_is_stated(bar: Product) -> None:
    eigenvalues, dampings = bar["eigenvalues"], bar["dampings_per_s"]
    np.testing.assert_array_equal(dampings, (6 + 1e-7 * eigenvalues) / 2)
    np.testing.assert_allclose(bar["frequencies_hz"], np.sqrt(eigenvalues - dampings**2) / (2 * np.pi))
    assert bar.attributes["damping"] == {"law": "rayleigh", "alpha_per_s": 6.0, "beta_s": 1e-7}


@pytest.mark.parametrize("exponent", [0.0, -0.3])
def test_a_loss_factor_damps_in_proportion_to_frequency(bar: Product, exponent: float) -> None:
    """c = eta omega / 2, eta a power of the undamped frequency over 1 kHz; the modes stay what they are."""
    lossy = bar_of_cells(loss_factor=2e-3, loss_exponent=exponent)
    eigenvalues = bar["eigenvalues"]
    undamped_hz = np.sqrt(eigenvalues) / (2 * np.pi)
    expected = np.pi * undamped_hz * 2e-3 * (undamped_hz / 1000) ** exponent
    np.testing.assert_array_equal(lossy["eigenvalues"], eigenvalues)
    np.testing.assert_allclose(lossy["dampings_per_s"], expected, rtol=1e-12)
    stated = {"law": "loss_factor", "loss_factor": 2e-3, "loss_exponent": exponent}
    assert lossy.attributes["damping"] == stated


def test_the_papers_law_is_an_option_to_the_bit(bar: Product) -> None:
    papers = bar_of_cells(damping="rayleigh", loss_factor=2e-3)
    np.testing.assert_array_equal(papers["dampings_per_s"], bar["dampings_per_s"])
    assert papers.attributes["damping"] == bar.attributes["damping"]


def test_mode_shapes_have_unit_modal_mass(bar: Product) -> None:
    """A bar's bending modes: the mean over the volume of |u|^2 is 1 / mass; the surface's is near it."""
    mean = np.mean(np.sum(bar["mode_shapes"].astype(float) ** 2, axis=1), axis=0)
    assert np.all((mean * bar.attributes["mass_kg"] > 0.8) & (mean * bar.attributes["mass_kg"] < 2.5))
    assert np.all(bar["radiation_weights"] ** 2 < 3 / bar.attributes["mass_kg"])
    assert np.all(bar["radiation_weights"] > 0)


def test_without_damping_nothing_decays(undamped_bar: Product) -> None:
    undamped_hz = np.sqrt(undamped_bar["eigenvalues"]) / (2 * np.pi)
    np.testing.assert_array_equal(undamped_bar["dampings_per_s"], 0)
    np.testing.assert_allclose(undamped_bar["frequencies_hz"], undamped_hz, rtol=1e-12)
    assert undamped_bar.attributes["overdamped_modes"] == 0


def test_size_scales_frequencies_and_loses_no_mode(undamped_bar: Product) -> None:
    """A bar of a tenth of a millimetre."""
    scale = 1e-3
    miniature = bar_of_cells(scale, **UNDAMPED)
    assert len(miniature["frequencies_hz"]) == len(undamped_bar["frequencies_hz"])
    np.testing.assert_allclose(miniature["eigenvalues"] * scale**2, undamped_bar["eigenvalues"], rtol=1e-7)
    norms, miniature_norms = (
        np.linalg.norm(product["mode_shapes"], axis=(0, 1)) for product in (undamped_bar, miniature)
    )
    np.testing.assert_allclose(miniature_norms * scale**1.5, norms, rtol=1e-4)


def test_too_many_modes_end_the_band_in_a_gap(bar: Product) -> None:
    fewer = bar_of_cells(max_modes=4)
    count = len(fewer["frequencies_hz"])
    limit = fewer.attributes["stated_frequency_limit_hz"]
    assert 1 <= count <= 4
    assert bar["frequencies_hz"][count - 1] < limit < bar["frequencies_hz"][count]
    assert fewer.attributes["count_certificate"]["holds"]
    assert bar.attributes["stated_frequency_limit_hz"] == pytest.approx(CELLS_LIMIT_HZ)


def test_an_accuracy_that_is_not_reached_and_a_doubtful_solid_are_said(bar: Product) -> None:
    report = {"doubts": ["its wall is thick"], "closing_share": 0.2}
    solid = dataclasses.replace(box((2, 1, 1), CELLS_BAR_M), report=report)
    coarse = modes_of(solid, material(), CELLS_LIMIT_HZ, accuracy_cents=1.0, highest_order=3)
    assert bar.attributes["accuracy_reached"]
    assert not bar.attributes["warnings"]
    assert not coarse.attributes["accuracy_reached"]
    warnings = " ".join(coarse.attributes["warnings"])
    errors = coarse["error_estimates_cents"]
    of_all = f"{errors.max():.1f} may be left in {np.count_nonzero(errors > 1.0)} of {len(errors)}"
    for warning in (
        f"1 cents wanted (accuracy_cents), {of_all} modes",
        "its wall is thick",
        "20% of the solid's outside closes openings",
    ):
        assert warning in warnings


@pytest.mark.parametrize("order", [2, 6])
def test_an_order_whose_error_is_not_estimated_is_refused(order: int) -> None:
    solid = box((2, 1, 1), CELLS_BAR_M)
    with pytest.raises(ValueError, match=f"highest order {order}: .* 3 to 5"):
        # Refused before anything is solved.
        modes_of(solid, material(), CELLS_LIMIT_HZ, highest_order=order, time_limit_s=0.0)


@pytest.mark.slow
def test_what_does_not_ring_is_kept_and_counted(bar: Product) -> None:
    creeping = bar_of_cells(rayleigh_beta_s=3e-5)
    still = creeping["dampings_per_s"] ** 2 >= creeping["eigenvalues"]
    assert 0 < still.sum() == creeping.attributes["overdamped_modes"]
    np.testing.assert_array_equal(still, creeping["frequencies_hz"] == 0)
    np.testing.assert_allclose(creeping["eigenvalues"], bar["eigenvalues"])


@pytest.mark.slow
def test_repeated_modes_are_the_same_with_any_seed() -> None:
    """A cube has pairs and triplets of equal frequency, which any rotation may mix."""
    solid = box((2, 2, 2), (0.1, 0.1, 0.1))
    finest = {"accuracy_cents": 1e-3, "highest_order": 3}
    first, second = (
        modes_of(solid, material(), 22000.0, training_points=seed, seed=seed, **finest) for seed in (50, 51)
    )
    values = first["eigenvalues"]
    assert np.any(np.diff(values) < 1e-6 * values[1:])
    np.testing.assert_allclose(first["radiation_weights"], second["radiation_weights"], rtol=1e-4)


@pytest.mark.slow
def test_a_die_is_silent_and_still_an_object(tmp_path: Path) -> None:
    die = box((2, 2, 2), (0.016, 0.016, 0.016))
    product = modes_of(die, material(0.37, 2.4e9, density_kg_m3=1190.0), 20000.0)
    assert not product.attributes["audible"]
    assert product.attributes["count_certificate"]["counted"] == 6
    assert product["frequencies_hz"].shape == (0,)
    assert product["mode_shapes"].shape == (16, 3, 0)
    assert product.attributes["mass_kg"] == pytest.approx(1190 * 0.016**3, rel=0.01)
    write_product(tmp_path / "die.zarr.zip", product)
    assert read_product(tmp_path / "die.zarr.zip")["mode_shapes"].shape == (16, 3, 0)


@pytest.mark.slow
def test_an_open_overlapping_surface_becomes_one_solid_with_the_frequencies_of_a_bar() -> None:
    """Two boxes that overlap, one without its lid: their union is a bar of 100 x 10 x 5 mm."""
    left, right = (
        trimesh.creation.box((0.06, 0.01, 0.005)).apply_translation((x, 0, 0)) for x in (0.03, 0.07)
    )
    hidden = left.face_normals[:, 0] > 0.5
    product = simulate_modes(
        Surface(
            np.concatenate([left.vertices, right.vertices]),
            np.concatenate([left.faces[~hidden], right.faces + len(left.vertices)]),
        ),
        material(),
        max_frequency_hz=6000.0,
        training_points=40,
        held_out_points=10,
        seed=1,
        accuracy_cents=20.0,
    )
    assert product.attributes["discretisation"]["bodies"] == 1
    np.testing.assert_allclose(product["frequencies_hz"], [2631.6, 5134.8], rtol=0.01)


@pytest.mark.slow
def test_hidden_points_are_read_where_they_lie() -> None:
    solid = box((8, 2, 2), (0.1, 0.02, 0.02))
    inside = Surface(
        np.array([[0.02, 0.01, 0.01], [0.08, 0.01, 0.01], [0.08, 0.012, 0.012]]), np.array([[0, 1, 2]])
    )
    product = modes_of_solid(
        inside,
        solid,
        material(),
        max_frequency_hz=20000.0,
        max_modes=3,
        training_points=20,
        held_out_points=2,
        seed=0,
        highest_order=3,
    )
    assert product.attributes["transfer_distance_max_m"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("cents", "above", "below"), [(-2.0, 1, 0), (2.0, 0, 1), (-80.0, 0, 0)])
def test_modes_near_the_limit_are_counted_on_either_side_of_it(
    bar: Product, cents: float, above: int, below: int
) -> None:
    """A limit 2 cents from a mode, where the elements or the shape may be more than that off."""
    solid = box((6, 2, 1), CELLS_BAR_M)
    solid = dataclasses.replace(solid, report={**solid.report, "volume_error": -0.002})
    undamped = np.sqrt(bar["eigenvalues"]) / (2 * np.pi)
    product = modes_of(solid, material(), undamped[2] * 2 ** (cents / 1200), accuracy_cents=20.0)
    certificate = product.attributes["count_certificate"]
    assert product.attributes["geometry_error_estimate_cents"] == pytest.approx(3.5, abs=0.1)
    assert certificate["left_within_error_above_limit"] == above
    assert certificate["found_within_error_below_limit"] == below
    assert np.isfinite(product["error_estimates_cents"]).all()


@pytest.mark.release("objectfolder.making.elements", "objectfolder.making.modes", "objectfolder.making.solid")
def test_a_scanned_mug_has_few_elements_and_rings(shared_objects: Path) -> None:
    from objectfolder.making.materials import read_materials
    from objectfolder.making.mesh.readers.load import load_mesh

    steel = read_materials(Path(__file__).parents[2] / "data" / "materials.csv")["steel"]
    mesh = load_mesh(shared_objects / "025_mug" / "model.obj", with_textures=False)
    product = simulate_modes(
        mesh.surface,
        steel,
        max_frequency_hz=4500.0,
        max_modes=40,
        training_points=150,
        held_out_points=20,
        seed=0,
    )
    attributes = product.attributes
    assert attributes["count_certificate"]["holds"]
    assert attributes["error_estimate_cents"] < 40
    solid = attributes["discretisation"]
    assert (solid["way"], solid["bodies"], solid["doubts"]) == ("envelope", 1, [])
    assert solid["elements"] < 4300
    assert solid["surface_error_rms_m"] < 0.5 * solid["wall_thin_m"]
    assert abs(solid["volume_error"]) < 0.01
    # Two and a half times as many bent tetrahedra, half as far from the scan, 180 000 unknowns.
    np.testing.assert_allclose(product["frequencies_hz"][:3], [2809, 2880, 3131], rtol=0.02)


@pytest.mark.slow
def test_the_wall_that_a_solid_lost_is_stated_in_cents() -> None:
    """A plate's bending frequencies are proportional to its thickness: 2 % of it are 34 cents.

    Its sides are known to a millionth of its length each.
    """
    solid = box((2, 2, 1), (0.1, 0.1, 0.005))
    report = {**solid.report, "volume_error": -0.02}
    attributes = modes_of(dataclasses.replace(solid, report=report), material(), 8000, max_modes=4).attributes
    wall_m = 2 * (0.1 * 0.1 * 0.005) / (2 * 0.1 * 0.1 + 4 * 0.1 * 0.005)
    stated = 1200 * (-np.log2(0.98) + np.log2(1 + 2e-7 / wall_m))
    assert attributes["geometry_error_estimate_cents"] == pytest.approx(stated, rel=1e-9)


def test_the_geometry_counts_in_whether_an_accuracy_was_reached() -> None:
    """What is stated is mostly more than the error: the worst is judged by half of it."""
    errors = np.array([1.0, 3.0])
    near, far = (accuracy_attributes(5.0, errors, geometry) for geometry in (6.0, 8.0))
    assert near["accuracy_reached"]
    assert near["warnings"] == []
    assert far["accuracy_reached"] is False
    assert "11.0 may be left in 2 of 2 modes" in far["warnings"][0]
    assert accuracy_attributes(5.0, np.zeros(0), None)["accuracy_reached"] is None
