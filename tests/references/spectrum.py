"""What every reference returns: the modes of a free body below a limit, with their multiplicities."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.materials import Material

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class ReferenceSpectrum:
    """Elastic modes of a free body, ascending; rigid motions left out.

    Attributes
    ----------
    wavenumbers : (k,) float64, omega / c_s in radians per unit of length, c_s = sqrt(mu / rho)
    multiplicities : (k,) int64
    families : (k,) what each is: the degree, circumferential order or parity class
    convergence : largest relative change of a wavenumber under the last refinement, 0 for a closed form
    """

    wavenumbers: Floats
    multiplicities: Integers
    families: tuple[str, ...]
    convergence: float = 0.0

    def __len__(self) -> int:
        return int(self.multiplicities.sum())

    @property
    def repeated(self) -> Floats:
        """Wavenumbers with each repeated by its multiplicity, ascending, (len,)."""
        return np.repeat(self.wavenumbers, self.multiplicities)

    def frequencies_hz(self, material: Material) -> Floats:
        """Undamped eigenfrequencies with multiplicities, (len,) float64, for lengths in metres."""
        return self.repeated * material.shear_speed_m_s / (2 * np.pi)

    @classmethod
    def collect(
        cls, modes: list[tuple[float, int, str]], limit: float, convergence: float = 0.0
    ) -> "ReferenceSpectrum":
        """Sort (wavenumber, multiplicity, family) and keep those below `limit`."""
        below = sorted(mode for mode in modes if mode[0] < limit)
        return cls(
            np.array([mode[0] for mode in below], dtype=np.float64),
            np.array([mode[1] for mode in below], dtype=np.int64),
            tuple(mode[2] for mode in below),
            convergence,
        )


def wavenumber_limit(material: Material, limit_hz: float) -> float:
    """Return omega / c_s of a frequency, radians per metre."""
    return 2 * np.pi * limit_hz / material.shear_speed_m_s
