"""Laws by which a material loses energy, and the decay rates they give the modes of a body.

Of its energy a solid loses a share a period that hardly depends on frequency: a loss factor says how large.
Rayleigh's law, whose decay rates grow with the square of frequency, is that of the papers.
"""

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.audionet.audionet import LAWS, LOSS_FACTOR, RAYLEIGH
from objectfolder.errors import InputError
from objectfolder.making.materials import Material

Floats = NDArray[np.float64]
REFERENCE_HZ = 1000.0  # where a loss factor is the table's


@dataclass(frozen=True)
class LossFactor:
    """Structural damping: c = eta(f) omega / 2 with eta(f) = loss_factor (f / 1 kHz)^loss_exponent.

    Eta is the imaginary part of the modulus over its real part: a mode loses 2 pi eta of its energy a period
    (L. Cremer, M. Heckl and B. A. T. Petersson, "Structure-Borne Sound", 3rd edition, 2005, chapter 4).
    """

    law: ClassVar[str] = LOSS_FACTOR
    loss_factor: float
    loss_exponent: float = 0.0

    def decay_rates(self, eigenvalues: Floats) -> Floats:
        """Return c (modes,) 1/s of squared angular eigenfrequencies (modes,) rad^2/s^2."""
        angular = np.sqrt(eigenvalues)
        eta = self.loss_factor * (angular / (2 * np.pi * REFERENCE_HZ)) ** self.loss_exponent
        return np.asarray(eta * angular / 2)


@dataclass(frozen=True)
class Rayleigh:
    """Damping matrix alpha M + beta K: c = (alpha + beta omega^2) / 2."""

    law: ClassVar[str] = RAYLEIGH
    alpha_per_s: float
    beta_s: float

    def decay_rates(self, eigenvalues: Floats) -> Floats:
        """Return c (modes,) 1/s of squared angular eigenfrequencies (modes,) rad^2/s^2."""
        return np.asarray((self.alpha_per_s + self.beta_s * eigenvalues) / 2)


def damping_of(material: Material, law: str = LOSS_FACTOR) -> LossFactor | Rayleigh:
    """Return how a material damps.

    Parameters
    ----------
    law
        `LOSS_FACTOR`, or Rayleigh's where the material states no loss factor; `RAYLEIGH` in any case.

    Raises
    ------
    ValueError
        Another law.
    InputError
        A material without Rayleigh's coefficients where they are needed.

    Examples
    --------
    >>> from objectfolder.making import read_materials
    >>> glass = read_materials("materials.csv")["glass"]
    >>> damping_of(glass).decay_rates(np.array([(2 * np.pi * 1000) ** 2])).round(3).tolist()
    [3.142]
    """
    if law not in LAWS:
        raise ValueError(f"damping {law!r}: use one of {', '.join(LAWS)}")
    if law == LOSS_FACTOR and material.loss_factor is not None:
        return LossFactor(material.loss_factor, material.loss_exponent)
    alpha, beta = material.rayleigh_alpha_per_s, material.rayleigh_beta_s
    if alpha is None or beta is None:
        raise InputError(
            f"material {material.name}",
            "it states no rayleigh_alpha_per_s and rayleigh_beta_s",
            f"State them in the table of materials, or damp by {LOSS_FACTOR}.",
        )
    return Rayleigh(alpha, beta)


def describe_damping(damping: LossFactor | Rayleigh) -> dict[str, Any]:
    """Return the law and its numbers, as products and Object Files state them."""
    return {"law": damping.law, **asdict(damping)}
