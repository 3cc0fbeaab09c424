"""Bodies with a known spectrum, from triangles to frequencies: thin walls, and bars at several accuracies."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from bench.references.bodies import Body, constant
from bench.references.cuboid import cuboid
from bench.references.meridian import Path as Meridian
from bench.references.meridian import Wall
from objectfolder.audio.materials import Material, read_materials
from objectfolder.audio.modes.modes import simulate_modes
from objectfolder.products.store import Product
from objectfolder.surface.surface import Surface

BAR = (0.25, 0.02, 0.01)
LIMIT_HZ = 20000.0
COUNTS = {"training_points": 200, "held_out_points": 20, "seed": 0}


def material(name: str) -> Material:
    return read_materials(Path(__file__).parents[2] / "data" / "materials.csv")[name]


@cache
def bar_truth() -> np.ndarray:
    glass = material("glass")
    limit = 2 * np.pi * 1.05 * LIMIT_HZ / glass.shear_speed_m_s
    return cuboid(BAR, glass.poisson_ratio, limit).frequencies_hz(glass)


def cents(product: Product, truth: np.ndarray) -> np.ndarray:
    found = np.sqrt(product["eigenvalues"]) / (2 * np.pi)
    return np.asarray(1200 * np.log2(found / truth[: len(found)]))


def bar_modes(accuracy_cents: float, turn: Rotation | None = None) -> Product:
    drawn = trimesh.creation.box(BAR)
    vertices = np.array(drawn.vertices)
    surface = Surface(vertices if turn is None else turn.apply(vertices), np.array(drawn.faces))
    return simulate_modes(
        surface, material("glass"), max_frequency_hz=LIMIT_HZ, accuracy_cents=accuracy_cents, **COUNTS
    )


@pytest.mark.slow
def test_a_bar_reaches_what_is_asked_or_says_so_and_works_as_hard_as_that_takes() -> None:
    """Its torsion, as r^2 log r at the edges, converges slowest: order 4 leaves 5 cents at every wish."""
    asked = (20.0, 5.0, 1.0)
    products = [bar_modes(accuracy) for accuracy in asked]
    within: list[bool] = []
    for accuracy, product in zip(asked, products, strict=True):
        error, stated = np.abs(cents(product, bar_truth())), product["error_estimates_cents"]
        assert len(error) == np.count_nonzero(bar_truth() < LIMIT_HZ)
        assert error.max() < 1.2 * accuracy
        within += (error <= stated + 0.02).tolist()
        assert product.attributes["accuracy_reached"] == (stated.max() <= accuracy)
        assert bool(product.attributes["warnings"]) != product.attributes["accuracy_reached"]
    assert np.mean(within) >= 0.95
    assert products[0].attributes["accuracy_reached"]
    assert products[1].attributes["accuracy_reached"]
    unknowns = [product.attributes["discretisation"]["unknowns"] for product in products]
    assert unknowns[0] < unknowns[1] < unknowns[2]


@pytest.mark.slow
def test_a_turned_bar_rings_as_before_within_what_is_stated() -> None:
    straight, turned = bar_modes(5.0), bar_modes(5.0, Rotation.from_rotvec([0.3, 0.7, -0.4]))
    moved = 600 * np.log2(turned["eigenvalues"] / straight["eigenvalues"])
    stated = np.maximum(straight["error_estimates_cents"], turned["error_estimates_cents"])
    assert np.all(np.abs(moved) <= stated + 0.02)


def wine_glass() -> Body:
    """98 mm high, walls of 1.2 mm, a rounded rim."""
    pieces = ((0.006, 0.0), (0.016, np.radians(70.0)), (0.060, np.radians(25.0)), (0.03, np.radians(5)))
    path = Meridian((0.0, 0.0), pieces)
    length, half = float(path.knots[-1]), constant(0.0006)
    wall = Wall(path, half, half, (length - 0.012, length - 0.004), 0.010)
    return Body(wall.meridian("wine glass"), "glass", 0.002)


@pytest.mark.slow
def test_a_glass_with_thin_walls_has_every_mode_and_none_far_off() -> None:
    """Its last mode lies above the limit in functions of low order, and leads their choice all the same."""
    body, glass = wine_glass(), material("glass")
    truth = body.spectrum(glass, 1.05 * LIMIT_HZ, check=False).frequencies_hz(glass)
    product = simulate_modes(body.surface(), glass, max_frequency_hz=LIMIT_HZ, **COUNTS)
    error = np.abs(cents(product, truth))
    assert len(error) == np.count_nonzero(truth < LIMIT_HZ)
    assert error.max() < 10
    assert np.median(error) < 2
    stated = product["error_estimates_cents"] + product.attributes["geometry_error_estimate_cents"]
    assert np.mean(error <= stated) >= 0.8
