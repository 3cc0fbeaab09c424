"""Bodies with a known spectrum, from triangles to frequencies: thin walls, and bars at several accuracies."""

from collections.abc import Callable
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


def bar_surface() -> Surface:
    drawn = trimesh.creation.box(BAR)
    return Surface(np.array(drawn.vertices), np.array(drawn.faces))


def small_cup() -> Surface:
    """60 mm wide, walls of 3 mm, a rounded rim."""
    path = Meridian((0.0, 0.0), ((0.012, 0.0), (0.020, np.radians(83.0)), (0.022, 0.0)))
    length, half = float(path.knots[-1]), constant(0.0015)
    wall = Wall(path, half, half, (length - 0.008, length - 0.003), 0.010)
    return Body(wall.meridian("small cup"), "glass", 0.0025).surface()


def modes_of(surface: Surface, accuracy_cents: float = 5.0) -> Product:
    return simulate_modes(
        surface, material("glass"), max_frequency_hz=LIMIT_HZ, accuracy_cents=accuracy_cents, **COUNTS
    )


def turned(surface: Surface) -> Surface:
    return Surface(Rotation.from_rotvec([0.3, 0.7, -0.4]).apply(surface.vertices), surface.faces)


def mirrored(surface: Surface) -> Surface:
    return Surface(surface.vertices * (-1, 1, 1), surface.faces[:, ::-1])


def subdivided(surface: Surface) -> Surface:
    return Surface(*trimesh.remesh.subdivide(surface.vertices, surface.faces))


def noisy(surface: Surface) -> Surface:
    """Every vertex off by a millionth of the longest side."""
    size = 1e-6 * np.ptp(surface.vertices, axis=0).max()
    return Surface(
        surface.vertices + np.random.default_rng(0).normal(0, size, surface.vertices.shape), surface.faces
    )


@pytest.mark.slow
def test_a_bar_reaches_what_is_asked_or_says_so_and_works_as_hard_as_that_takes() -> None:
    """Its torsion, as r^2 log r at the edges, converges slowest: order 4 leaves 5 cents at every wish."""
    asked = (20.0, 5.0, 1.0)
    products = [modes_of(bar_surface(), accuracy) for accuracy in asked]
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


@cache
def as_given(shape: Callable[[], Surface]) -> Product:
    return modes_of(shape())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "change"),
    [
        (shape, change)
        for shape in (bar_surface, small_cup)
        for change in (turned, mirrored, subdivided, noisy)
    ],
    ids=lambda one: one.__name__,
)
def test_another_description_of_a_body_moves_no_mode_by_more_than_is_stated(
    shape: Callable[[], Surface], change: Callable[[Surface], Surface]
) -> None:
    before, after = as_given(shape), modes_of(change(shape()))
    moved = 600 * np.log2(after["eigenvalues"] / before["eigenvalues"])
    stated = np.maximum(*(stated_cents(product) for product in (before, after)))
    assert np.all(np.abs(moved) <= stated + 0.02), (moved, stated)


def stated_cents(product: Product) -> np.ndarray:
    """Of the elements and of the geometry."""
    return np.asarray(product["error_estimates_cents"] + product.attributes["geometry_error_estimate_cents"])


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
    assert np.mean(error <= stated_cents(product)) >= 0.8
