"""Two bodies in collision: Hertz's spring between them, their modes and their motion as a whole, together.

Over a step the force between the bodies is constant, and what it does to each mode and to the bodies is
exact. Its size is the change of the spring's energy over that of the approach (a discrete gradient:
O. Gonzalez, J. Nonlinear Sci. 6, 1996), so that at any step the spring takes what the bodies give, to
rounding.
Energy goes only to the damping of the modes and to the loss of the contact, after K. H. Hunt and
F. R. E. Crossley (J. Appl. Mech. 42, 1975): k d^(3/2) (1 + a d') at approach d, a set by the restitution that
the pair has without modes at that speed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.hertz import HertzContact
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.audio.synthesis.pulses import ForceProfile
from objectfolder.errors import QueryError
from objectfolder.jit import inner, relaxed_kernel

Floats = NDArray[np.float64]
# Steps in the contact of the pair without modes at least, and in a period of the highest mode, as far as
# the former are not more than `MOST_IN_CONTACT`: a very soft contact does not see the highest modes.
IN_CONTACT, IN_PERIOD, MOST_IN_CONTACT = 100, 8, 1 << 14
CONTACT_STEPS = 1 << 20


@dataclass(frozen=True)
class Collider:
    """A body where another touches it.

    Attributes
    ----------
    modes : at any sample rate
    gains : (modes,) how far each mode moves there along the push of the other body, kg^-1/2
    """

    modes: Oscillators
    gains: Floats


@dataclass(frozen=True)
class Collision:
    """A collision that is over.

    Attributes
    ----------
    step_s : over which the force is constant
    forces_n : (k,) from first to last contact
    vibration_j : (colliders,) of the modes when they part
    """

    step_s: float
    forces_n: Floats
    vibration_j: Floats

    @property
    def impulse_n_s(self) -> float:
        """What each body gives to the other."""
        return float(self.step_s * self.forces_n.sum())

    @property
    def profile(self) -> ForceProfile:
        """Course of the force."""
        return ForceProfile(self.step_s, self.forces_n / self.impulse_n_s)


def collide(
    colliders: Sequence[Collider], contact: HertzContact, speed_m_s: float, restitution: float = 1.0
) -> Collision:
    """Let two bodies at rest in themselves collide.

    Parameters
    ----------
    colliders
        Those of the two that vibrate.
    contact
        Of the pair; its mass is that of both as rigid bodies.
    speed_m_s
        At which they close.
    restitution
        Over that speed, the speed at which they would part if neither had modes: above 0, to 1.

    Raises
    ------
    QueryError
        A restitution out of range, or bodies that do not part within `CONTACT_STEPS` steps.

    Examples
    --------
    >>> contact = HertzContact(modulus_pa=1e11, radius_m=0.01, mass_kg=0.02)
    >>> rebound = collide([], contact, 1.0, restitution=0.5)
    >>> round(rebound.impulse_n_s, 4), round(rebound.profile.duration_s / float(contact.duration_s(1.0)), 1)
    (0.03, 1.1)
    """
    alone_s = float(contact.duration_s(speed_m_s))
    eigenvalues = np.concatenate([collider.modes.eigenvalues for collider in colliders] or [np.zeros(0)])
    gains = np.concatenate([collider.gains for collider in colliders] or [np.zeros(0)])
    angular = np.sqrt(eigenvalues)
    most_s = alone_s / IN_CONTACT
    if len(gains):
        in_period_s = 2 * math.pi / (IN_PERIOD * angular.max())
        most_s = min(most_s, max(in_period_s, alone_s / MOST_IN_CONTACT))
    rate_hz = 2.0 ** math.ceil(-math.log2(most_s))
    step_s = 1 / rate_hz
    tables = [collider.modes.at_rate(rate_hz).held_steps for collider in colliders]
    modes = np.concatenate(tables or [np.zeros((6, 0))], axis=1), gains, angular
    spring = 1 / contact.mass_kg, contact.stiffness, _viscosity(restitution) / speed_m_s
    forces, parting = _collide(modes, spring, step_s, speed_m_s, CONTACT_STEPS)
    if len(forces) == CONTACT_STEPS:
        finding = f"the bodies have not parted after {step_s * len(forces):g} s"
        raise QueryError("contact", finding, "Give a lighter or a harder striker.")
    energies = (parting[1] ** 2 + eigenvalues * parting[0] ** 2) / 2
    borders = np.cumsum([0, *(len(collider.gains) for collider in colliders)])
    vibration_j = [energies[begin:end].sum() for begin, end in pairwise(borders)]
    forces = forces[: np.flatnonzero(forces)[-1] + 1].copy()
    return Collision(step_s, forces, np.array(vibration_j))


@lru_cache(maxsize=64)
def _viscosity(restitution: float) -> float:
    """Return a v of bodies that part at e v after they met at v: z (1 + e) = log((1 + z) / (1 - e z))."""
    from scipy.optimize import brentq

    e = restitution
    if not 0 < e <= 1:
        raise QueryError("restitution", f"{e}", "Give more than 0, to 1.")
    if e > 1 - 1e-9:
        return 0.0

    def difference(z: float) -> float:
        return z * (1 + e) - math.log1p(z) + math.log1p(-e * z)

    most = (1 - 1e-15) / e  # of small e the root is nearer to 1 / e than to this
    return most if difference(most) > 0 else float(brentq(difference, 1e-12, most))


@inner(relaxed_kernel)
def _spring(before: float, after: float, stiffness: float) -> tuple[float, float]:
    """Return the change of the spring's energy 2/5 k d^(5/2) over that of the approach d, and its slope."""
    s, t = math.sqrt(max(before, 0.0)), math.sqrt(max(after, 0.0))
    force, slope = 0.0, 0.0
    if s > 0.0 and t > 0.0:  # t^5 - s^5 divided by t^2 - s^2, without a difference
        force = 0.4 * stiffness * (t**4 + t**3 * s + t**2 * s**2 + t * s**3 + s**4) / (s + t)
        slope = 0.2 * stiffness * (3 * t**3 + 6 * t**2 * s + 4 * t * s**2 + 2 * s**3) / (s + t) ** 2
    elif s > 0.0 or t > 0.0:
        force = 0.4 * stiffness * (t**5 - s**5) / (after - before)
        slope = (stiffness * t**3 - force) / (after - before)
    return force, slope


@inner(relaxed_kernel)
def _force(
    before: float, free: float, compliance: float, stiffness: float, resistance: float, start: float
) -> float:
    """Return the force over a step that begins at an approach `before` and would end at `free` without it.

    Newton's method for the approach at the end, kept between bounds.

    Parameters
    ----------
    resistance
        Of the contact: viscosity over the step, 1/m.
    start
        Force to begin from.
    """
    high, low = free, -math.inf
    after = free - compliance * start
    force = 0.0
    for _ in range(60):
        spring, slope = _spring(before, after, stiffness)
        push = 1.0 + resistance * (after - before)
        force, slope = spring * push, slope * push + spring * resistance
        if push < 0.0:
            force, slope = 0.0, 0.0
        error = after + compliance * force - free
        if error > 0.0:
            high = after
        else:
            low = after
        change = -error / (1.0 + compliance * max(slope, 0.0))
        if abs(change) <= 4e-16 * (abs(after) + abs(before)):
            break
        after += change
        if not low < after < high:
            after = (low + high) / 2 if low > -math.inf else free - compliance * force
    return force


@relaxed_kernel
def _collide(
    modes_of_both: tuple[Floats, Floats, Floats],
    contact: tuple[float, float, float],
    step_s: float,
    speed_m_s: float,
    most: int,
) -> tuple[Floats, Floats]:
    """Step until the bodies have parted for good; return forces and how the modes moved when they parted.

    Parameters
    ----------
    modes_of_both
        Steps (6, modes), gains and angular frequencies (modes,).
    contact
        Mobility of the bodies, stiffness and viscosity.
    most
        Steps after which it ends anyway.

    Returns
    -------
    tuple
        (steps,), and displacements and velocities (2, modes).
    """
    (steps, gains, angular), (mobility, stiffness, viscosity) = modes_of_both, contact
    modes = len(gains)
    motion, parting, forces = np.zeros((2, modes)), np.zeros((2, modes)), np.zeros(512)
    q, v = motion[0], motion[1]
    compliance = mobility * step_s * step_s / 2
    for j in range(modes):
        compliance += gains[j] * gains[j] * steps[4, j]
    # How near the bodies have come, and how near and how fast they would without their modes.
    before, near, speed = 0.0, 0.0, speed_m_s
    for k in range(most):
        if k == len(forces):
            forces = np.append(forces, np.zeros(k))
        free = near + step_s * speed
        for j in range(modes):
            x, y = q[j], v[j]
            q[j] = steps[0, j] * x + steps[1, j] * y
            v[j] = steps[2, j] * x + steps[3, j] * y
            free -= gains[j] * q[j]
        force, after = 0.0, free
        if before > 0.0 or free > 0.0:
            force = _force(before, free, compliance, stiffness, viscosity / step_s, forces[max(k - 1, 0)])
            after = free - compliance * force
            for j in range(modes):
                push = gains[j] * force
                q[j] += steps[4, j] * push
                v[j] += steps[5, j] * push
        if before > 0.0 and after <= 0.0:
            parting[:] = motion
        near += step_s * speed - mobility * step_s * step_s / 2 * force
        speed -= mobility * step_s * force
        forces[k] = force
        if speed < 0.0 and after <= 0.0 and (before > 0.0 or k % 16 == 0):
            # No mode reaches farther than its amplitude, and the bodies go on parting.
            reach = near
            for j in range(modes):
                reach += abs(gains[j]) * math.sqrt(q[j] * q[j] + (v[j] / angular[j]) ** 2)
            if reach <= 0.0:
                return forces[: k + 1], parting
        before = after
    return forces[:most], parting
