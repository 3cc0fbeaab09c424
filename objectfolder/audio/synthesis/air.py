"""From a moving surface to pressure at a listener, in the free field: models, said as such.

What is heard of the modes. Where the rates are known at which radiation damps them, that power, spread evenly
over directions. Where they are not, a sphere's: the power a vibrating surface radiates is rho c S sigma v^2,
v the rms normal velocity, S the area and sigma the radiation efficiency (Fahy and Gardonio, "Sound and
Structural Vibration", 2007, section 3.1), and sigma is that of a sphere of the same area moving in its
quadrupole (n = 2): a solid's elastic motion keeps its momentum and nearly its volume, so a small body has
neither monopole nor dipole. An open shell radiates up to 12 dB less. Either is approximate: no directivity,
phase that of the velocity.

What is heard of the whole body. A body pushed by a force F accelerates by F / m, which sounds at once
("acceleration noise": Koss and Alfredson, J. Sound Vib. 27, 1973; Chadwick, Zheng and James, "Precomputed
Acceleration Noise for Improved Rigid-Body Sound", 2012). For a sphere of radius a it is exact: the potential
is the derivative along r of f(t - (r - a) / c) / r times cos(theta), and with g = f'

    g'' + 2 (c / a) g' + 2 (c / a)^2 g = a c^2 F(t) / m,    p = rho cos(theta) (g' / (c r) + g / r^2):

one more damped oscillator. Other bodies are taken as the sphere of the same area: a disc moving broadside
pushes the air of a sphere of 0.75 times its radius, and has the area of one of 0.71.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.errors import QueryError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Air:
    """The medium; by default at 20 degrees Celsius and 1013 hPa.

    Attributes
    ----------
    density_kg_m3, sound_speed_m_s : positive
    """

    density_kg_m3: float = 1.204
    sound_speed_m_s: float = 343.2


@dataclass(frozen=True)
class Listener:
    """Where a body is heard from.

    Attributes
    ----------
    offset_m : (3,) from the body's centre
    radius_m : of the sphere that stands for the body
    air : the medium

    Examples
    --------
    >>> listener = Listener.at([1.0, 0, 0], [0, 0, 0], area_m2=0.01)
    >>> round(1e3 * listener.delay_s, 2)  # milliseconds
    2.83
    """

    offset_m: Floats
    radius_m: float
    air: Air

    @classmethod
    def at(
        cls, position_m: ArrayLike, centre_m: ArrayLike, area_m2: float, air: Air | None = None
    ) -> "Listener":
        """Return the listener at a position (3,) to a body with its centre and surface area.

        Raises
        ------
        QueryError
            A position that is not finite or within the sphere of the same area.
        """
        position = np.asarray(position_m, dtype=np.float64)
        radius = float(np.sqrt(area_m2 / (4 * np.pi)))
        if position.shape != (3,) or not np.isfinite(position).all():
            raise QueryError("listener", f"{position_m!r}", "Give a position (3,), metres, object frame.")
        offset = position - np.asarray(centre_m, dtype=np.float64)
        listener = cls(offset, radius, air or Air())
        if listener.distance_m <= radius:
            raise QueryError(
                "listener",
                f"{listener.distance_m:.3g} m from the centre, within the sphere of its area, {radius:.3g} m",
                "Listen from farther away.",
            )
        return listener

    @property
    def distance_m(self) -> float:
        """From the body's centre."""
        return float(np.linalg.norm(self.offset_m))

    @property
    def delay_s(self) -> float:
        """Time from the equivalent sphere to the listener."""
        return (self.distance_m - self.radius_m) / self.air.sound_speed_m_s

    def modal_weights(self, frequencies_hz: ArrayLike) -> Floats:
        """Pascals (modes,) for a metre a second of rms normal velocity at a frequency.

        rho c sqrt(S sigma / 4 pi) / r, with S / 4 pi = a^2.
        """
        frequencies = np.asarray(frequencies_hz, dtype=np.float64)
        efficiency = quadrupole_efficiency(2 * np.pi * frequencies * self.radius_m / self.air.sound_speed_m_s)
        impedance = self.air.density_kg_m3 * self.air.sound_speed_m_s
        return np.asarray(impedance * self.radius_m * np.sqrt(efficiency) / self.distance_m)

    def radiated_weights(self, radiation_dampings_per_s: Floats) -> Floats:
        """Pascals (modes,) for a modal velocity of 1 (m/s kg^1/2) of modes that radiation damps at rates.

        Such a mode has the energy 1/2 and radiates twice the rate times it, which is 2 pi r^2 p^2 / (rho c).
        """
        impedance = self.air.density_kg_m3 * self.air.sound_speed_m_s
        return np.asarray(np.sqrt(impedance * radiation_dampings_per_s / (2 * np.pi)) / self.distance_m)

    def click_oscillator(self, sample_rate_hz: float) -> tuple[Oscillators, tuple[Floats, Floats]]:
        """Return the oscillator whose sound is the click, and the weights of g and g' in its pressure.

        It is driven by `click_gains`.
        """
        rate = self.air.sound_speed_m_s / self.radius_m
        oscillator = Oscillators.checked([2 * rate**2], [rate], sample_rate_hz)
        density, r = self.air.density_kg_m3, self.distance_m
        return oscillator, (np.array([density / r**2]), np.array([density / (self.air.sound_speed_m_s * r)]))

    def click_gains(self, mass_kg: float) -> Floats:
        """What 1 N s along each axis does to that oscillator, (3, 1): a c^2 cos(theta) / m."""
        direction = self.offset_m / self.distance_m
        return np.asarray(direction[:, None] * self.radius_m * self.air.sound_speed_m_s**2 / mass_kg)


def quadrupole_efficiency(wavenumber_radius: ArrayLike) -> Floats:
    """Radiation efficiency of a sphere moving in order 2: 1 / (x^2 |h_2'(x)|^2), x = k a.

    x^6 / (81 + 9 x^2 - 2 x^4 + x^6): x^6 / 81 for a small sphere, 1 for a large one.
    """
    x2 = np.asarray(wavenumber_radius, dtype=np.float64) ** 2
    return np.asarray(x2**3 / (81 + x2 * (9 + x2 * (-2 + x2))))
