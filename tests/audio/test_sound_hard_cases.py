"""Hard cases of modal sound by name: known frequencies, meshes and materials that lose modes."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import trimesh
from structured_solids import box, filled_ball, material, moved, together

from bench.references.sphere import sphere
from objectfolder.audio.elements.elasticity import assemble
from objectfolder.audio.materials import Material
from objectfolder.audio.modes.eigen import weigh
from objectfolder.audio.modes.modes import modes_of_solid, simulate_modes
from objectfolder.audio.modes.spectrum import solve_spectrum, space_on
from objectfolder.products.store import Product
from objectfolder.solid.solid import Solid, clean
from objectfolder.surface.surface import Surface

DEFAULT = {"accuracy_cents": 5.0, "highest_order": 4}
FINEST = {"accuracy_cents": 0.1, "highest_order": 5}
LAME = np.sqrt(2) * np.pi
# omega a^2 sqrt(rho h / D) by thickness, nu 0.3: `references.cuboid` at its default tolerance, 2e-6.
PLATES = {
    0.1: [12.72302, 18.95445, 23.34487, 31.95423, 31.95423],
    0.05: [13.14522, 19.42494, 24.01691, 33.72216, 33.72216],
    0.01: [13.41304, 19.58820, 24.25706, 34.65493, 34.65493],
    0.002: [13.45759, 19.59563, 24.26911, 34.77476, 34.77476],
}
# Hz, 100 x 10 x 5 mm of the material of `structured_solids`: `references.cuboid`, likewise.
BEAM = [2631.673, 5134.954, 7146.157, 12404.445, 13405.996, 13718.667]


def undamped(poisson_ratio: float = 0.19) -> Material:
    return material(poisson_ratio, rayleigh_alpha_per_s=0.0, rayleigh_beta_s=0.0)


def modes_of(solid: Solid, stuff: Material, max_frequency_hz: float, **options: Any) -> Product:
    return modes_of_solid(
        Surface(solid.vertices, solid.boundary()[0]),
        solid,
        stuff,
        max_frequency_hz=max_frequency_hz,
        max_modes=60,
        training_points=5,
        held_out_points=0,
        seed=0,
        **options,
    )


def ring(surface: Surface, max_frequency_hz: float, stuff: Material | None = None, seed: int = 0) -> Product:
    return simulate_modes(
        surface,
        undamped() if stuff is None else stuff,
        max_frequency_hz=max_frequency_hz,
        max_modes=40,
        training_points=20,
        held_out_points=0,
        seed=seed,
        accuracy_cents=20.0,
        highest_order=3,
    )


def complete(product: Product, bodies: int = 1) -> bool:
    """Whether the count found every mode, and six rigid motions a body."""
    certificate = product.attributes["count_certificate"]
    found = len(product["eigenvalues"])
    return bool(certificate["holds"] and certificate["counted"] == found + 6 * bodies)


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def bar() -> Surface:
    return surface_of(trimesh.creation.box((0.1, 0.02, 0.01)))


@cache
def bar_rings() -> Product:
    return ring(bar(), 20000.0)


def wavenumbers(product: Product, stuff: Material) -> np.ndarray:
    return np.asarray(np.sqrt(product["eigenvalues"]) / stuff.shear_speed_m_s)


def plate(cells: int, thickness: float) -> Solid:
    """A unit square, with a row of cells as wide as it is thick along its edge where it is thin."""
    solid = box((cells + 2, cells + 2, 1), (1, 1, thickness))
    lines = np.linspace(0, 1, cells + 3)
    if thickness < 0.1:
        lines = np.array([0, thickness, *np.linspace(0, 1, cells + 1)[1:-1], 1 - thickness, 1])
    vertices = solid.vertices.copy()
    vertices[:, :2] = lines[np.rint(vertices[:, :2] * (cells + 2)).astype(int)]
    return clean(vertices, solid.tetrahedra, {})


def even_plate(cells: int, thickness: float) -> Solid:
    return box((cells, cells, 1), (1, 1, thickness))


@pytest.mark.parametrize(
    ("make", "thickness", "options", "tolerance"),
    [
        (plate, 0.1, DEFAULT, 1.1e-3),
        pytest.param(plate, 0.05, DEFAULT, 1e-3, marks=pytest.mark.slow),
        pytest.param(plate, 0.01, DEFAULT, 1.3e-3, marks=pytest.mark.slow),
        pytest.param(even_plate, 0.002, DEFAULT, 4e-2, marks=pytest.mark.slow),
        pytest.param(plate, 0.1, FINEST, 1e-4, marks=pytest.mark.slow),
        pytest.param(plate, 0.002, FINEST, 2.5e-4, marks=pytest.mark.slow),
    ],
)
def test_plates_from_thick_to_a_500th(
    make: Callable[[int, float], Solid], thickness: float, options: dict[str, Any], tolerance: float
) -> None:
    """Twisting bends sharply within a thickness of a free edge: only elements that small see all of it."""
    stuff = undamped(0.3)
    rigidity = 2.6 * thickness**3 / (12 * (1 - 0.3**2))
    truth = np.array(PLATES[thickness]) * np.sqrt(rigidity / thickness)
    limit = (1 + max(0.03, 1.5 * tolerance)) * truth[-1] * stuff.shear_speed_m_s / (2 * np.pi)
    found = modes_of(make(6, thickness), stuff, limit, **options)
    np.testing.assert_allclose(wavenumbers(found, stuff), truth, rtol=tolerance)
    assert complete(found)


@pytest.mark.parametrize(
    ("options", "cells", "tolerance"),
    [(DEFAULT, 10, 1e-3), pytest.param(FINEST, 14, 1e-4, marks=pytest.mark.slow)],
)
def test_a_beam_bends_and_twists(options: dict[str, Any], cells: int, tolerance: float) -> None:
    found = modes_of(box((cells, 2, 2), (0.1, 0.01, 0.005)), undamped(), 14000.0, **options)
    np.testing.assert_allclose(found["frequencies_hz"], BEAM, rtol=tolerance)
    assert complete(found)


@pytest.mark.parametrize(
    ("options", "tolerance"), [(DEFAULT, 1e-3), pytest.param(FINEST, 1e-4, marks=pytest.mark.slow)]
)
def test_a_cube_has_its_multiplicities_and_the_exact_lame_mode(
    options: dict[str, Any], tolerance: float
) -> None:
    """Demarest's cube, nu 0.3; the Lame mode pi sqrt 2 is three-fold."""
    stuff = undamped(0.3)
    truth = np.repeat([2.85608, 3.84599, 3.91127, LAME, 4.57281], [2, 3, 3, 3, 3])
    found = modes_of(box((3, 3, 3), (1, 1, 1)), stuff, 4.65 * stuff.shear_speed_m_s / (2 * np.pi), **options)
    np.testing.assert_allclose(wavenumbers(found, stuff), truth, rtol=tolerance)
    assert complete(found)


@pytest.mark.parametrize(("poisson_ratio", "order"), [(0.45, 3), (0.499, 4)])
@pytest.mark.slow
def test_a_nearly_incompressible_ball_does_not_lock(poisson_ratio: float, order: int) -> None:
    """Lamb's sphere: as many modes, in the same groups, at the same frequencies."""
    truth = sphere(1.0, poisson_ratio, 4.0)
    below = (0.5 * (truth.wavenumbers[-1] + 4.0)) ** 2
    solid = filled_ball()
    bent, _ = space_on(solid, order, 1.0, bend=True)
    found = solve_spectrum(bent, solid.component, poisson_ratio, below=below, max_modes=80, seed=0)
    assert found.certificate["holds"]
    np.testing.assert_allclose(np.sqrt(found.eta_squared), truth.repeated, rtol=1e-3)
    assert truth.multiplicities[:2].tolist() == [5, 5]


@pytest.mark.slow
def test_two_bodies_have_the_modes_of_both() -> None:
    """A bar, and one 1.25 times as large: the spectra side by side, 12 rigid motions."""
    one, two = box((6, 2, 1), (0.1, 0.02, 0.01)), box((6, 2, 1), (0.125, 0.025, 0.0125))
    options: dict[str, Any] = {"accuracy_cents": 1e-3, "highest_order": 3}
    alone = [modes_of(solid, undamped(), 20000.0, **options) for solid in (one, two)]
    both = modes_of(together(one, moved(two, (0, 0.1, 0))), undamped(), 20000.0, **options)
    assert complete(both, bodies=2)
    union = np.sort(np.concatenate([product["eigenvalues"] for product in alone]))
    np.testing.assert_allclose(both["eigenvalues"], union, rtol=1e-6)


@pytest.mark.slow
def test_two_bars_that_touch_along_an_edge_ring_as_two() -> None:
    """A weld of no area would be a hinge: 11 or 12 motions without energy, and wrong bending modes."""
    one = trimesh.creation.box((0.1, 0.02, 0.01))
    two = one.copy()
    two.apply_translation((0, 0.02, 0.01))
    found = ring(surface_of(trimesh.util.concatenate([one, two])), 20000.0)
    assert complete(found, bodies=2)
    single = bar_rings()["frequencies_hz"]
    np.testing.assert_allclose(found["frequencies_hz"], np.repeat(single, 2), rtol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("change", ["scale 1e-3", "scale 240", "moved", "vertex order"])
def test_size_place_and_vertex_order_leave_the_spectrum(change: str) -> None:
    surface, scale = bar(), 1.0
    vertices, faces = surface.vertices, surface.faces
    if change.startswith("scale"):
        scale = float(change.split()[1])
        vertices = vertices * scale
    elif change == "moved":
        vertices = vertices + np.array([3.0, -0.7, 11.0])
    else:
        order = np.random.default_rng(0).permutation(len(vertices))
        vertices, faces = vertices[order], np.roll(np.argsort(order)[faces], 5, axis=0)
    found = ring(Surface(vertices, faces), 20000.0 / scale)
    assert complete(found)
    np.testing.assert_allclose(
        found["frequencies_hz"] * scale, bar_rings()["frequencies_hz"], rtol=1e-6, atol=0
    )


@pytest.mark.slow
def test_a_turned_bar_rings_alike() -> None:
    """The mesher makes another solid of it: alike to the accuracy asked for."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    found = ring(Surface(bar().vertices @ turn.T, bar().faces), 20000.0)
    assert complete(found)
    np.testing.assert_allclose(found["frequencies_hz"], bar_rings()["frequencies_hz"], rtol=5e-3)


@pytest.mark.slow
def test_a_rod_of_200_triangles() -> None:
    """A prism of 50 sides; torsion of a round rod is c_s / 2 L."""
    rod = trimesh.creation.cylinder(radius=0.01, height=0.2, sections=50)
    assert len(rod.faces) == 200
    found = ring(surface_of(rod), 9000.0)
    assert complete(found)
    torsion = undamped().shear_speed_m_s / 0.4
    assert np.abs(found["frequencies_hz"] / torsion - 1).min() < 5e-3


@pytest.mark.slow
def test_needles_and_non_manifold_edges_leave_the_spectrum() -> None:
    """A face cut into a fan of needles, and a fin inside on two edges of the bar."""
    vertices, faces = bar().vertices, bar().faces
    a, b, c = faces[0]
    weights = np.linspace(0, 1, 12)[1:-1, None]
    on_edge = vertices[a] * (1 - weights) + vertices[b] * weights
    chain = [a, *range(len(vertices), len(vertices) + len(on_edge)), b]
    fan = [[p, q, c] for p, q in pairwise(chain)]
    corner = np.argmin(vertices @ [1, 1, 1])
    far = np.argmax(vertices @ [1, 1, 1])
    side = next(i for i in range(8) if np.sum(vertices[i] == vertices[corner]) == 2)
    dirty = np.concatenate([faces[1:], fan, [[corner, side, far]]])
    found = ring(Surface(np.concatenate([vertices, on_edge]), dirty), 20000.0)
    assert complete(found)
    np.testing.assert_allclose(found["frequencies_hz"], bar_rings()["frequencies_hz"], rtol=5e-3)


@pytest.mark.slow
def test_without_damping_nothing_decays_and_nothing_is_nan() -> None:
    found = bar_rings()
    np.testing.assert_array_equal(found["dampings_per_s"], 0)
    np.testing.assert_allclose(
        found["frequencies_hz"], np.sqrt(found["eigenvalues"]) / (2 * np.pi), rtol=1e-12
    )
    assert found.attributes["overdamped_modes"] == 0
    assert found["frequencies_hz"].min() > 100


@pytest.mark.slow
def test_beta_1e_4_silences_what_lies_above_its_limit() -> None:
    """c = beta lambda / 2 reaches omega at omega = 2 / beta, 3183 Hz: kept, counted, and without a tone."""
    creeping = ring(bar(), 20000.0, material(rayleigh_alpha_per_s=0.0, rayleigh_beta_s=1e-4))
    assert complete(creeping)
    np.testing.assert_allclose(creeping["eigenvalues"], bar_rings()["eigenvalues"], rtol=1e-9)
    still = np.sqrt(creeping["eigenvalues"]) >= 2e4
    assert creeping.attributes["overdamped_modes"] == still.sum() > 0
    np.testing.assert_array_equal(creeping["frequencies_hz"] == 0, still)
    assert np.isfinite(creeping["dampings_per_s"]).all()


@pytest.mark.slow
def test_two_seeds_find_the_same_frequencies_and_spaces() -> None:
    """Vectors of a repeated frequency are any rotation of each other; the space they span is not."""
    solid = box((3, 3, 3), (1, 1, 1))
    space = space_on(solid, 3, 1.0)[0]
    first, second = (
        solve_spectrum(space, solid.component, 0.3, below=4.65**2, max_modes=40, seed=seed) for seed in (0, 7)
    )
    np.testing.assert_allclose(first.eta_squared, second.eta_squared, rtol=1e-6)
    mass = assemble(space, 0.3)[1]
    vectors = [found.vectors.reshape(-1, len(found.eta_squared)) for found in (first, second)]
    start = 0
    for many in (2, 3, 3, 3, 3):
        group = slice(start, start + many)
        start += many
        overlap = vectors[0][:, group].T @ weigh(mass, vectors[1][:, group])
        # The smallest principal cosine squared is the worst MAC of any vector of one space in the other.
        assert np.linalg.svd(overlap, compute_uv=False).min() ** 2 > 1 - 1e-6
    assert start == len(first.eta_squared)
