"""Two bodies in collision, their modes with them, by an adaptive Runge-Kutta of order 8."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from objectfolder.audio.synthesis import HertzContact
from objectfolder.audio.synthesis.collision import Collider

Floats = NDArray[np.float64]
LONGEST_STEP_S = 2e-6


def viscosity_s_m(restitution: float, speed_m_s: float) -> float:
    """Hunt and Crossley's a = z / v of bodies that meet at v and part at e v.

    z (1 + e) = log((1 + z) / (1 - e z)).
    """
    e = restitution
    if e == 1:
        return 0.0
    root = brentq(lambda z: z * (1 + e) - np.log((1 + z) / (1 - e * z)), 1e-3, (1 - 1e-15) / e)
    return float(root) / speed_m_s


def coupled_contact(
    colliders: Sequence[Collider], contact: HertzContact, speed_m_s: float, restitution: float, end_s: float
) -> tuple[float, Floats]:
    """Impulse, and energies of the modes of each body, a time after the bodies met."""
    squares = np.concatenate([collider.modes.eigenvalues for collider in colliders])
    dampings = np.concatenate([collider.modes.dampings_per_s for collider in colliders])
    gains = np.concatenate([collider.gains for collider in colliders])
    modes, loss_s_m = len(gains), viscosity_s_m(restitution, speed_m_s)

    def rates(_: float, state: Floats) -> Floats:
        q, v, (near, speed) = state[:modes], state[modes : 2 * modes], state[2 * modes :]
        approach, closing = near - gains @ q, speed - gains @ v
        force = contact.stiffness * max(approach, 0.0) ** 1.5 * max(1 + loss_s_m * closing, 0.0)
        pushed = gains * force - 2 * dampings * v - squares * q
        return np.concatenate([v, pushed, [speed, -force / contact.mass_kg]])

    start = np.append(np.zeros(2 * modes + 1), speed_m_s)
    tolerances = {"rtol": 1e-8, "atol": 1e-13, "max_step": LONGEST_STEP_S}
    end = solve_ivp(rates, (0, end_s), start, "DOP853", **tolerances).y[:, -1]
    energies = (end[modes : 2 * modes] ** 2 + squares * end[:modes] ** 2) / 2
    borders = np.cumsum([len(collider.gains) for collider in colliders])[:-1]
    each = np.array([part.sum() for part in np.split(energies, borders)])
    return contact.mass_kg * (speed_m_s - end[-1]), each
