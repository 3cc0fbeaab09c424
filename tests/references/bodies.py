"""Thin-walled bodies of revolution with a known spectrum: bowl, drinking glass, bell, cup and plate."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.materials import Material
from objectfolder.surface.surface import Surface
from tests.references.axisymmetric import FINER, body_of_revolution
from tests.references.meridian import Meridian, Path, Wall
from tests.references.revolution import surface_of_revolution
from tests.references.spectrum import ReferenceSpectrum, wavenumber_limit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A body of revolution, metres.

    Attributes
    ----------
    meridian : its half section
    material : name of the material it is usually made of
    edge_m : edge of the triangles of its surface, unless another is asked for
    """

    meridian: Meridian
    material: str
    edge_m: float

    def surface(self, edge_m: float | None = None) -> Surface:
        """Closed outward triangles, their vertices on the true surface; see `surface_of_revolution`."""
        return surface_of_revolution(self.meridian, self.edge_m if edge_m is None else edge_m)

    def spectrum(self, material: Material, limit_hz: float, *, check: bool = True) -> ReferenceSpectrum:
        """Every elastic mode below a frequency; see `body_of_revolution`."""
        limit = wavenumber_limit(material, limit_hz)
        finer = FINER if check else None
        return body_of_revolution(self.meridian, material.poisson_ratio, limit, finer=finer)


def bowl() -> Body:
    """Spherical cap of 3 mm, the rim cut along the radius; mid-surface 79.5 mm in radius and 53 mm high."""
    rim, height, wall = 0.0795, 0.053, 0.003
    radius = (rim**2 + height**2) / (2 * height)
    angle = float(np.arccos(1 - height / radius))
    length = radius * angle
    path = Path((0.0, 0.0), ((length, angle),))
    cuts = (length - 3 * wall, length - wall)
    shape = Wall(path, constant(wall / 2), constant(wall / 2), cuts, 0.012)
    return Body(shape.meridian("bowl", round_rim=False), "ceramic", 0.003)


def glass() -> Body:
    """Drinking glass 100 mm high, 69 mm wide: wall 1.5 mm, base 6 mm, a rounded rim."""
    path = Path((0.0, 0.0), ((0.016, 0.0), (0.018, np.radians(86.0)), (0.088, 0.0)))
    above = fading(0.00525, 0.00075, 0.028, 0.005)
    length = float(path.knots[-1])
    wall = Wall(path, constant(0.00075), above, (length - 0.005, length - 0.0015), 0.008)
    return Body(wall.meridian("glass"), "glass", 0.002)


def bell() -> Body:
    """Bell 105 mm wide, mouth up: wall 3 mm, 5 mm at the rounded lip, flared."""
    pieces = ((0.010, 0.0), (0.026, np.radians(80.0)), (0.028, 0.0), (0.032, np.radians(-45.0)))
    path = Path((0.0, 0.0), pieces)
    length = float(path.knots[-1])
    half = fading(0.0015, 0.0025, length - 0.020, 0.005)
    wall = Wall(path, half, half, (length - 0.010, length - 0.003), 0.008)
    return Body(wall.meridian("bell"), "iron", 0.003)


def cup() -> Body:
    """Cup 96 mm wide and 60 mm high: wall 4 mm, a rounded rim."""
    path = Path((0.0, 0.0), ((0.018, 0.0), (0.034, np.radians(83.0)), (0.038, 0.0)))
    length = float(path.knots[-1])
    wall = Wall(path, constant(0.002), constant(0.002), (length - 0.012, length - 0.004), 0.010)
    return Body(wall.meridian("cup"), "ceramic", 0.003)


def plate() -> Body:
    """Plate of 238 mm, 5 mm thick, with a raised rim and a foot ring 4 mm high below."""
    pieces = ((0.068, 0.0), (0.026, np.radians(38.0)), (0.027, np.radians(-28.0)))
    path = Path((0.0, 0.0), pieces)
    length = float(path.knots[-1])
    foot, width = 0.055, 0.0035

    def below(distance: Floats) -> Floats:
        return 0.0025 + 0.004 * np.exp(-(((distance - foot) / width) ** 2))

    cuts = (*np.arange(foot - 0.012, foot + 0.0121, 0.002).tolist(), length - 0.015, length - 0.005)
    wall = Wall(path, below, constant(0.0025), cuts, 0.015)
    return Body(wall.meridian("plate"), "ceramic", 0.004)


BODIES: dict[str, Callable[[], Body]] = {
    "bowl": bowl,
    "glass": glass,
    "bell": bell,
    "cup": cup,
    "plate": plate,
}


def constant(thickness: float) -> Callable[[Floats], Floats]:
    """Thickness that is everywhere the same."""
    return lambda distance: np.full(np.shape(distance), thickness)


def fading(first: float, last: float, centre: float, width: float) -> Callable[[Floats], Floats]:
    """Thickness that passes from `first` to `last` within about `width` of `centre`."""
    return lambda distance: (first + last) / 2 + (last - first) / 2 * np.tanh((distance - centre) / width)
