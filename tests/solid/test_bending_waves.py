"""The shortest bending waves of walls, and elements that carry them."""

import math

import numpy as np
import pytest
from small_meshes import CUBE_FACES, CUBE_VERTICES

from objectfolder.making.solid.bending_waves import BendingWaves
from objectfolder.making.solid.filling import Filling, fill
from objectfolder.surface.connectivity import edge_table
from objectfolder.surface.surface import Surface

STEEL_PLATE_SPEED_M_S = 5300.0


def test_a_wave_is_that_of_kirchhoffs_plate() -> None:
    """D k^4 = rho h omega^2, D = E h^3 / (12 (1 - nu^2))."""
    youngs_pa, density, poisson, wall_m, hertz = 200e9, 7800.0, 0.3, 0.002, 20_000.0
    speed = math.sqrt(youngs_pa / density / (1 - poisson**2))
    stiffness = youngs_pa * wall_m**3 / (12 * (1 - poisson**2))
    wavenumber = (density * wall_m * (2 * math.pi * hertz) ** 2 / stiffness) ** 0.25
    wavelength_m = BendingWaves.up_to(hertz, speed, modes=10**9).shortest_m(wall_m, area_m2=1.0)
    assert wavelength_m == pytest.approx(2 * math.pi / wavenumber)


def test_few_modes_end_at_longer_waves() -> None:
    """A simply supported square of side a has modes of wavenumbers pi/a (m, n): pi/4 k^2 a^2/pi^2 of them."""
    side_m, modes = 1.0, 2000
    grid = np.arange(1, 200)
    squares = np.sort((np.pi / side_m) ** 2 * (grid[:, None] ** 2 + grid**2).ravel())
    shortest_m = 2 * np.pi / np.sqrt(squares[modes - 1])
    waves = BendingWaves.up_to(1e9, STEEL_PLATE_SPEED_M_S, modes)
    assert waves.shortest_m(1e-3, area_m2=2 * side_m**2) == pytest.approx(shortest_m, rel=0.05)


@pytest.mark.slow
def test_a_wide_thin_plate_has_no_element_longer_than_a_bending_wave() -> None:
    wall_m = 0.002
    surface = Surface(CUBE_VERTICES * [0.16, 0.16, wall_m], CUBE_FACES)
    waves = BendingWaves.up_to(20_000.0, STEEL_PLATE_SPEED_M_S, modes=256)
    wave_m = waves.shortest_m(wall_m, surface.area)
    longest = {}
    for limit in (None, waves):
        solid = fill(surface, waves=limit)
        edges = solid.vertices[edge_table(solid.boundary()[0]).vertices]
        longest[limit] = float(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).max())
    assert solid.report["edge_m"] == pytest.approx(Filling().edge_per_wave * wave_m, rel=1e-3)
    assert longest[waves] < wave_m < longest[None]
