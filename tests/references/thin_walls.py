"""Thin-walled bodies of revolution, some with walls that vary, with a known spectrum: metres and degrees."""

from collections.abc import Callable

import numpy as np

from tests.references.bodies import Body, constant, fading
from tests.references.meridian import Path, Wall

RIM = 0.008, 0.002  # distances from the rim at which elements end, besides its last wall
TRIANGLE_M = 0.0025


def tulip() -> Body:
    """Glass, 3.6 mm at the foot and 1.1 mm at the lip, 105 mm high: a round belly that opens again."""
    return _body("tulip", "glass", ((0.016, 0), (0.04, 95), (0.03, -25), (0.045, -5)), (0.0036, 0.0011, 0.05))


def funnel() -> Body:
    """Ceramic, 4 mm at a round tip and 1.5 mm at the rim: a cone with straight sides."""
    return _body("funnel", "ceramic", ((0.014, 50), (0.09, 0)), (0.004, 0.0015, 0.04))


def swan() -> Body:
    """Steel, 2.4 mm and then 1 mm: a bowl whose profile is an S."""
    return _body("swan", "steel", ((0.02, 0), (0.035, 70), (0.045, -65)), (0.0024, 0.001, 0.045))


def beaker() -> Body:
    """Glass, 1 mm throughout: a round floor, 70 mm high."""
    return _body("beaker", "glass", ((0.018, 0), (0.016, 88), (0.06, 0)), (0.001, 0.001, 0.04))


def shield() -> Body:
    """Bronze-like iron, 1.3 mm throughout: a shallow disc of 170 mm."""
    return _body("shield", "iron", ((0.03, 20), (0.05, -12)), (0.0013, 0.0013, 0.04))


def flute() -> Body:
    """Glass, 1 mm throughout: narrow and tall, 150 mm, as of champagne without its stem."""
    return _body("flute", "glass", ((0.006, 0), (0.03, 84), (0.12, 4)), (0.001, 0.001, 0.04))


BODIES: dict[str, Callable[[], Body]] = {
    body.__name__: body for body in (tulip, funnel, swan, beaker, shield, flute)
}


def _body(
    name: str,
    material: str,
    pieces: tuple[tuple[float, float], ...],
    walls_m: tuple[float, float, float],
) -> Body:
    """Walls pass from the first thickness to the second about a distance along the path, symmetric to it."""
    path = Path((0.0, 0.0), tuple((length, float(np.radians(turn))) for length, turn in pieces))
    first, last, centre = walls_m
    half = constant(first / 2) if first == last else fading(first / 2, last / 2, centre, centre / 2)
    length = float(path.knots[-1])
    wall = Wall(path, half, half, (length - RIM[0], length - RIM[1]), 0.006)
    return Body(wall.meridian(name), material, TRIANGLE_M)
