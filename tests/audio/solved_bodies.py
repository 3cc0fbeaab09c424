"""Bodies whose modes several tests take: the fixture ``solved`` solves each once."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from structured_solids import box
from structured_solids import material as ceramic

from objectfolder.making.damping import LOSS_FACTOR
from objectfolder.making.materials import Material, read_materials
from objectfolder.making.modes.modes import modes_of_solid, simulate_modes
from objectfolder.making.solid.solid import Solid
from objectfolder.products.store import Product
from objectfolder.surface.surface import Surface
from tests.references.bodies import Body, constant
from tests.references.cuboid import cuboid
from tests.references.meridian import Path as Meridian
from tests.references.meridian import Wall

BAR_M = (0.25, 0.02, 0.01)
LIMIT_HZ = 8000.0
# Frequencies below that of the bar and of the small cup, of glass: `bar_truth` and `Body.spectrum`, which a
# release computes again.
BAR_HZ = np.array([798.749, 1571.828, 2180.348, 4176.071, 4215.411, 4671.794, 6845.686, 7801.806])
CUP_HZ = np.array([3060.305, 3060.305, 7667.751, 7667.751])
CELLS_BAR_M = (0.1, 0.02, 0.01)
CELLS_LIMIT_HZ = 25000.0
UNDAMPED = {"rayleigh_alpha_per_s": 0.0, "rayleigh_beta_s": 0.0}


def material(name: str) -> Material:
    """Return a row of the table."""
    return read_materials(Path(__file__).parents[2] / "data" / "materials.csv")[name]


def bar_surface() -> Surface:
    """Twelve triangles."""
    mesh = trimesh.creation.box(BAR_M)
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


@cache
def bar_truth(limit_hz: float) -> np.ndarray:
    """Frequencies (mode,) of the bar of glass, to 5 % above a limit."""
    glass = material("glass")
    limit = 2 * np.pi * 1.05 * limit_hz / glass.shear_speed_m_s
    return cuboid(BAR_M, glass.poisson_ratio, limit).frequencies_hz(glass)


def small_cup() -> Body:
    """60 mm wide, walls of 3 mm, a rounded rim."""
    path = Meridian((0.0, 0.0), ((0.012, 0.0), (0.020, np.radians(83.0)), (0.022, 0.0)))
    length, half = float(path.knots[-1]), constant(0.0015)
    wall = Wall(path, half, half, (length - 0.008, length - 0.003), 0.010)
    return Body(wall.meridian("small cup"), "glass", 0.0025)


def solve(surface: Surface, accuracy_cents: float = 5.0, limit_hz: float = LIMIT_HZ) -> Product:
    """Return the modes of a body of glass."""
    counts = {"training_points": 200, "held_out_points": 20, "seed": 0}
    return simulate_modes(
        surface, material("glass"), max_frequency_hz=limit_hz, accuracy_cents=accuracy_cents, **counts
    )


def surface_of(solid: Solid) -> Surface:
    """Return the boundary."""
    return Surface(solid.vertices, solid.boundary()[0])


def modes_of(solid: Solid, stuff: Material, max_frequency_hz: float, **options: Any) -> Product:
    """Return the modes of a solid at few points, damped by the material alone."""
    few = {"max_modes": 60, "training_points": 8, "held_out_points": 8, "seed": 0, "radiation": "sphere"}
    return modes_of_solid(surface_of(solid), solid, stuff, max_frequency_hz=max_frequency_hz, **few | options)


def bar_of_cells(
    scale: float = 1.0, max_modes: int = 256, damping: str = LOSS_FACTOR, **changes: float
) -> Product:
    """Return the modes of a ceramic bar of 72 tetrahedra, apart from the mesher."""
    solid = box((6, 2, 1), tuple(scale * side for side in CELLS_BAR_M))
    points = {"training_points": 120, "held_out_points": 30}
    options = {"max_modes": max_modes, "accuracy_cents": 20.0, "damping": damping, **points}
    return modes_of(solid, ceramic(**changes), CELLS_LIMIT_HZ / scale, **options)


SOLUTIONS: Mapping[str, Callable[[], Product]] = {
    "bar to 20 cents": lambda: solve(bar_surface(), 20.0),
    "bar of cells": bar_of_cells,
    "undamped bar of cells": lambda: bar_of_cells(**UNDAMPED),
    "small cup": lambda: solve(small_cup().surface()),
}
