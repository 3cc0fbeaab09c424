"""How short the bending waves of a wall are, which its elements have to carry."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class BendingWaves:
    """Waves in the walls of a body up to a frequency, and up to a number of modes.

    Attributes
    ----------
    per_wall_m : square of the shortest wavelength over the thickness of the wall
    modes : of the body, at most; where its walls have more, the band ends at longer waves
    """

    per_wall_m: float
    modes: int

    @classmethod
    def up_to(cls, frequency_hz: float, plate_speed_m_s: float, modes: int) -> "BendingWaves":
        """Waves of a thin plate: omega = k^2 c h / sqrt(12), c = sqrt(E / (rho (1 - nu^2))) its plate speed.

        (L. Cremer, M. Heckl and B. A. T. Petersson, Structure-Borne Sound, 2005, ch. 3.)
        """
        return cls(2 * math.pi * plate_speed_m_s / (math.sqrt(12) * frequency_hz), modes)

    def shortest_m(self, wall_m: float, area_m2: float) -> float:
        """Shortest wavelength in walls of a thickness with a surface, both sides, of an area.

        A plate of area S has S k^2 / (4 pi) modes of wavenumbers up to k, whatever its thickness.
        """
        of_modes = math.pi * area_m2 / 2 / self.modes
        return math.sqrt(max(self.per_wall_m * wall_m, of_modes))
