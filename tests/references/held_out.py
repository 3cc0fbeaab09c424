"""More bodies with known spectra: vessels, and cuboids that are cut from boards."""

from collections.abc import Callable

import numpy as np

from tests.references.bodies import Body, constant, fading
from tests.references.meridian import Path, Wall

RIM = 0.010, 0.004  # distances from the rim at which elements end


def vase() -> Body:
    """Glass, 3 mm: a belly and a neck, some 120 mm high."""
    return _vessel("vase", "glass", 0.003, ((0.025, 0), (0.02, 60), (0.05, 55), (0.05, -45)))


def tumbler() -> Body:
    """Glass, walls 2 mm on a foot of 10 mm: straight, 80 mm high."""
    path = Path((0.0, 0.0), _pieces(((0.022, 0), (0.014, 89), (0.07, 0))))
    length = float(path.knots[-1])
    above = fading(0.009, 0.001, 0.032, 0.006)
    wall = Wall(path, constant(0.001), above, (length - RIM[0], length - RIM[1]), 0.008)
    return Body(wall.meridian("tumbler"), "glass", 0.002)


def dish() -> Body:
    """Steel, 2 mm: shallow, 170 mm wide."""
    return _vessel("dish", "steel", 0.002, ((0.05, 0), (0.03, 35), (0.012, -20)))


def gong() -> Body:
    """Iron, 2.5 mm: flat with a turned edge, 190 mm wide."""
    return _vessel("gong", "iron", 0.0025, ((0.08, 0), (0.02, 75), (0.014, 0)))


def cone() -> Body:
    """Ceramic, 3.5 mm: a round tip and straight sides."""
    return _vessel("cone", "ceramic", 0.0035, ((0.012, 55), (0.085, 0)))


def pan() -> Body:
    """Iron, 4 mm: flat with a low side, 190 mm wide."""
    return _vessel("pan", "iron", 0.004, ((0.075, 0), (0.02, 70), (0.03, 0)))


BODIES: dict[str, Callable[[], Body]] = {
    body.__name__: body for body in (vase, tumbler, dish, gong, cone, pan)
}
# Edges in metres, material, and whether it is turned in space.
CUBOIDS: dict[str, tuple[tuple[float, float, float], str, bool]] = {
    "chime": ((0.12, 0.03, 0.01), "iron", False),
    "plank": ((0.2, 0.06, 0.02), "wood", True),
    "tile": ((0.12, 0.08, 0.01), "glass", True),
    "brick": ((0.2, 0.1, 0.06), "ceramic", False),
}


def _vessel(name: str, material: str, wall_m: float, pieces: tuple[tuple[float, float], ...]) -> Body:
    path = Path((0.0, 0.0), _pieces(pieces))
    length = float(path.knots[-1])
    half = constant(wall_m / 2)
    wall = Wall(path, half, half, (length - RIM[0], length - RIM[1]), 0.010)
    return Body(wall.meridian(name), material, 0.003)


def _pieces(degrees: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    return tuple((length, float(np.radians(turn))) for length, turn in degrees)
