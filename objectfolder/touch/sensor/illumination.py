"""From a stated illumination to a photometric table: diffuse paint on a flat gel, lit by near strips.

For sensors of which no calibration may be copied. Each strip is a row of points; a point of the painted
membrane with normal n reflects, of the light from a point at distance d in direction l, max(0, n . l) / d^2
(Lambert), without shadows, and a share that reaches it from all sides after reflection in the gel. The
exposure of each channel brings the undeformed gel's centre to a stated pixel value.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.touch.sensor.photometric_table import PhotometricTable, place_terms
from objectfolder.touch.sensor.sensor import Sensor, Vector

SHADING_PLACES = 21


@dataclass(frozen=True)
class Strip:
    """A row of `points` equal lights between two ends (sensor frame, metres) of one colour (linear RGB)."""

    ends_m: tuple[Vector, Vector]
    colour: Vector
    points: int = 16

    def positions(self) -> np.ndarray:
        """Its points (points, 3), metres."""
        share = (np.arange(self.points) + 0.5)[:, None] / self.points
        start, end = np.asarray(self.ends_m)
        return np.asarray(start + share * (end - start))


@dataclass(frozen=True)
class Illumination:
    """What lights a painted membrane, and how it is exposed.

    Parameters
    ----------
    strips
        Where the light comes from.
    ambient
        Light from all sides, as a share of the direct light at the centre of the undeformed gel.
    centre_value
        Pixel value, 0..1, of each channel there.
    display_gamma
        Pixel value = radiance ** (1 / display_gamma).
    slopes, directions
        Nodes of the table.
    """

    strips: tuple[Strip, ...]
    ambient: float = 0.25
    centre_value: float = 0.45
    display_gamma: float = 2.2
    slopes: int = 13
    directions: int = 24

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Illumination":
        """Return what the section ``photometry.made_from`` of a sensor file states."""
        strips = tuple(
            Strip((strip["ends_m"][0], strip["ends_m"][1]), strip["colour"], strip["points"])
            for strip in values["strips"]
        )
        return cls(strips, **{key: value for key, value in values.items() if key != "strips"})

    def pixel_values(self, sensor: Sensor, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Pixel values (n, 3), 0..1, of membrane points (n, 3), metres, with unit normals (n, 3)."""
        centre = np.asarray(sensor.gel_apex_m)[None]
        whole = self._direct(centre, np.array([[-1.0, 0.0, 0.0]]))
        radiance = (self._direct(points, normals) / whole + self.ambient) / (1 + self.ambient)
        return np.minimum(self.centre_value * radiance ** (1 / self.display_gamma), 1.0)

    def _direct(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        total = np.zeros((len(points), 3))
        for strip in self.strips:
            for position in strip.positions():
                towards = position - points
                squared = np.einsum("ij,ij->i", towards, towards)
                facing = np.maximum(np.einsum("ij,ij->i", normals, towards), 0.0)
                total += (facing / squared**1.5 / strip.points)[:, None] * np.asarray(strip.colour)
        return total


def membrane_normals(slope: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Unit normals (n, 3), sensor frame, of a membrane of this slope, leaning in this direction (radians)."""
    lean = np.sin(slope)
    return np.stack([-np.cos(slope), -lean * np.cos(direction), lean * np.sin(direction)], axis=-1)


def photometric_table(sensor: Sensor, illumination: Illumination) -> PhotometricTable:
    """Fit, at each node, the polynomials of the place to `illumination`, by least squares over the gel.

    Lights are so far away that depths of millimetres change nothing: the membrane is taken to lie where
    the undeformed gel does, whatever its slope.

    Raises
    ------
    ValueError
        A gel that is not flat.
    """
    if sensor.gel_sagitta_m != 0:
        raise ValueError(f"{sensor.name}: a photometric table of lights is for a flat gel")
    side = np.linspace(-1, 1, SHADING_PLACES)
    across, up = (part.ravel() for part in np.meshgrid(side, side))
    apex = np.asarray(sensor.gel_apex_m)
    half = np.array([0.0, -sensor.gel_width_m / 2, sensor.gel_height_m / 2])
    points = apex + half * np.stack([np.zeros_like(across), across, up], axis=-1)
    fit = np.linalg.pinv(place_terms(across, up))
    shape = (3, illumination.slopes, illumination.directions, fit.shape[0])
    coefficients = np.zeros(shape, dtype=np.float16)
    for i, slope in enumerate(np.linspace(0, np.pi / 2, illumination.slopes)):
        for j in range(illumination.directions if i else 1):
            normal = membrane_normals(slope, np.asarray(2 * np.pi * j / illumination.directions))
            values = illumination.pixel_values(sensor, points, np.broadcast_to(normal, points.shape))
            coefficients[:, i, j] = (fit @ values).T
    coefficients[:, 0] = coefficients[:, 0, :1]
    return PhotometricTable(coefficients)
