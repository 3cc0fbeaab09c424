"""Hard cases of modal sound by name: known frequencies, meshes and materials that lose modes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from solved_bodies import modes_of
from structured_solids import ball, box, material

from objectfolder.making.materials import Material
from objectfolder.making.modes.spectrum import solve_spectrum, space_on
from objectfolder.making.solid.solid import Solid, clean
from objectfolder.products.store import Product
from tests.references.sphere import sphere

DEFAULT = {"accuracy_cents": 5.0, "highest_order": 4}
FINEST = {"accuracy_cents": 0.1, "highest_order": 5}
RELEASE = pytest.mark.release("objectfolder.audio.synthesis", "objectfolder.making.modes")
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


def complete(product: Product) -> bool:
    """Whether the count found every mode, and six rigid motions."""
    certificate = product.attributes["count_certificate"]
    count = len(product["eigenvalues"])
    return bool(certificate["holds"] and certificate["counted"] == count + 6)


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
        pytest.param(plate, 0.05, DEFAULT, 1e-3, marks=RELEASE),
        pytest.param(plate, 0.01, DEFAULT, 1.3e-3, marks=RELEASE),
        pytest.param(even_plate, 0.002, DEFAULT, 4e-2, marks=RELEASE),
        pytest.param(plate, 0.1, FINEST, 1e-4, marks=RELEASE),
        pytest.param(plate, 0.002, FINEST, 2.5e-4, marks=RELEASE),
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
    modes = modes_of(make(6, thickness), stuff, limit, **options)
    np.testing.assert_allclose(wavenumbers(modes, stuff), truth, rtol=tolerance)
    assert complete(modes)


@pytest.mark.parametrize(
    ("options", "cells", "tolerance"),
    [(DEFAULT, 10, 1e-3), pytest.param(FINEST, 14, 1e-4, marks=RELEASE)],
)
def test_a_beam_bends_and_twists(options: dict[str, Any], cells: int, tolerance: float) -> None:
    modes = modes_of(box((cells, 2, 2), (0.1, 0.01, 0.005)), undamped(), 14000.0, **options)
    np.testing.assert_allclose(modes["frequencies_hz"], BEAM, rtol=tolerance)
    assert complete(modes)


@pytest.mark.parametrize(
    ("options", "tolerance"), [(DEFAULT, 1e-3), pytest.param(FINEST, 1e-4, marks=RELEASE)]
)
def test_a_cube_has_its_multiplicities_and_the_exact_lame_mode(
    options: dict[str, Any], tolerance: float
) -> None:
    """Demarest's cube, nu 0.3; the Lame mode pi sqrt 2 is three-fold."""
    stuff = undamped(0.3)
    truth = np.repeat([2.85608, 3.84599, 3.91127, LAME, 4.57281], [2, 3, 3, 3, 3])
    modes = modes_of(box((3, 3, 3), (1, 1, 1)), stuff, 4.65 * stuff.shear_speed_m_s / (2 * np.pi), **options)
    np.testing.assert_allclose(wavenumbers(modes, stuff), truth, rtol=tolerance)
    assert complete(modes)


@pytest.mark.slow
def test_a_nearly_incompressible_ball_does_not_lock() -> None:
    """Lamb's sphere: as many modes, in the same groups, at the same frequencies."""
    truth = sphere(1.0, 0.499, 4.0)
    below = (0.5 * (truth.wavenumbers[-1] + 4.0)) ** 2
    solid = ball(0)
    bent, _ = space_on(solid, 4, 1.0, bend=True)
    spectrum = solve_spectrum(bent, solid.component, 0.499, below=below, max_modes=80, seed=0)
    assert spectrum.certificate["holds"]
    np.testing.assert_allclose(np.sqrt(spectrum.eta_squared), truth.repeated, rtol=1e-3)
    assert truth.multiplicities[:2].tolist() == [5, 5]
