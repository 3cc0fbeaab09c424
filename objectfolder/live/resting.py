"""What a body at rest loses through its contacts: to the table, and in the contact itself."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.renaming import formerly_positional

Floats = NDArray[np.float64]
# 2 (1 - nu) / (2 - nu) of a Poisson ratio of 0.25 (R. D. Mindlin, J. Appl. Mech. 16, 1949).
ACROSS = 6 / 7


@dataclass(frozen=True)
class Rest:
    """What stands under bodies: a contact, a spring k (1 + i eta), on a plate of a real impedance Z.

    Attributes
    ----------
    impedance_n_s_m : Z, force over velocity of the plate at a point; 0 carries and damps nothing
    loss_factor : eta, of the spring

    Raises
    ------
    QueryError
        Negative values, or none.

    Examples
    --------
    >>> import numpy as np
    >>> Rest(10.0, 0.0).resistance_n_s_m(np.array([1e3]), 1e9)[0].round(3).tolist()  # stiff contact: Z
    [10.0]
    """

    impedance_n_s_m: float
    loss_factor: float

    def __post_init__(self) -> None:
        if not (self.impedance_n_s_m >= 0 and 0 <= self.loss_factor < math.inf):
            raise QueryError("rest", f"{self}", "Give numbers that are not negative.")

    @classmethod
    @formerly_positional
    def on_plate(
        cls,
        *,
        youngs_modulus_pa: float,
        poisson_ratio: float,
        density_kg_m3: float,
        thickness_m: float,
        loss_factor: float,
    ) -> "Rest":
        """Stand on a wide plate: Z = 8 (B m)^(1/2), bending stiffness times mass an area.

        L. Cremer, M. Heckl and B. A. T. Petersson, "Structure-Borne Sound", 3rd edition, 2005, section 5.3.
        """
        bending = youngs_modulus_pa * thickness_m**3 / (12 * (1 - poisson_ratio**2))
        return cls(8 * math.sqrt(bending * density_kg_m3 * thickness_m), loss_factor)

    def resistance_n_s_m(self, angular_per_s: Floats, stiffness_n_m: float) -> tuple[Floats, Floats]:
        """Return what damps at angular frequencies (n,), the real part of force over velocity.

        Along the normal, (n,), and across it, (n,), where only the spring gives way and does not slip: its
        stiffness there is `ACROSS` of that along the normal.
        """
        if not (self.impedance_n_s_m and stiffness_n_m):
            return np.zeros(len(angular_per_s)), np.zeros(len(angular_per_s))
        spring = stiffness_n_m * (1 + 1j * self.loss_factor) / (1j * angular_per_s)
        return (1 / (1 / self.impedance_n_s_m + 1 / spring)).real, ACROSS * spring.real


# A table top of 25 mm: the wood of the table of materials (Gao et al. 2022), and a loss factor within the
# 0.02 to 0.04 of solid wood (Bies, Hansen and Howard, "Engineering Noise Control", 5th ed., 2017, table C.1).
WOODEN_TOP = Rest.on_plate(
    youngs_modulus_pa=1.1e10, poisson_ratio=0.25, density_kg_m3=750.0, thickness_m=0.025, loss_factor=0.022
)
