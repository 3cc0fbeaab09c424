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
    lost_j : to the contact itself
    vibration_j : (colliders,) of the modes when they part
    """

    step_s: float
    forces_n: Floats
    lost_j: float
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
    motion, forces = np.zeros((4, len(gains))), np.zeros(4 * IN_CONTACT)
    rigid, lost, step_count = np.array([0.0, speed_m_s]), np.zeros(1), 0
    viscosity_s_m = _viscosity(restitution) / speed_m_s
    while True:
        step_count = _collide(
            modes, (1 / contact.mass_kg, contact.stiffness, viscosity_s_m), step_s,
            (motion, rigid, forces, lost), step_count,
        )  # fmt: skip
        if step_count < len(forces):
            break
        if step_count >= CONTACT_STEPS:
            finding = f"the bodies have not parted after {step_s * step_count:g} s"
            raise QueryError("contact", finding, "Give a lighter or a harder striker.")
        forces = np.concatenate([forces, np.zeros(len(forces))])
    energies = (motion[3] ** 2 + eigenvalues * motion[2] ** 2) / 2
    borders = np.cumsum([0, *(len(collider.gains) for collider in colliders)])
    vibration_j = [energies[begin:end].sum() for begin, end in pairwise(borders)]
    forces = forces[: np.flatnonzero(forces[:step_count])[-1] + 1].copy()
    return Collision(step_s, forces, float(lost[0]), np.array(vibration_j))


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
def _energy(approach: float, stiffness: float) -> float:
    """Return what the spring holds: 2/5 k d^(5/2)."""
    if approach <= 0.0:
        return 0.0
    return 0.4 * stiffness * approach * approach * math.sqrt(approach)


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
        middle, apart = (before + after) / 2, after - before
        root = math.sqrt(max(middle, 0.0))
        spring, slope = stiffness * middle * root, 0.75 * stiffness * root
        if middle <= 0.0:
            spring = 0.0
        push = resistance * spring
        if abs(apart) > 1e-4 * abs(middle):
            exact = (_energy(after, stiffness) - _energy(before, stiffness)) / apart
            end = max(after, 0.0)
            push, spring, slope = push, exact, (stiffness * end * math.sqrt(end) - exact) / apart
        force = spring + push * apart
        slope += push + resistance * 0.75 * stiffness * root * apart
        if force < 0.0:
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
    state: tuple[Floats, Floats, Floats, Floats],
    start: int,
) -> int:
    """Step until the bodies have parted for good or the forces are full; return the number of steps taken.

    Parameters
    ----------
    modes_of_both
        Steps (6, modes), gains and angular frequencies (modes,).
    contact
        Mobility of the bodies, stiffness and viscosity.
    state
        Motion (4, modes): displacements and velocities now, and when the bodies parted last. How near the
        bodies have come to each other without their modes, and how fast. Forces, and the energy (1,) lost.
    """
    (steps, gains, angular), (mobility, stiffness, viscosity) = modes_of_both, contact
    motion, rigid, forces, lost = state
    q, v = motion[0], motion[1]
    modes = len(gains)
    compliance = mobility * step_s * step_s / 2
    for j in range(modes):
        compliance += gains[j] * gains[j] * steps[4, j]
    before = rigid[0]
    for j in range(modes):
        before -= gains[j] * q[j]
    for k in range(start, len(forces)):
        free = rigid[0] + step_s * rigid[1]
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
            spring = _energy(before, stiffness) - _energy(after, stiffness)
            lost[0] += force * (after - before) + spring
        if before > 0.0 and after <= 0.0:
            for j in range(modes):
                motion[2, j], motion[3, j] = q[j], v[j]
        rigid[0] += step_s * rigid[1] - mobility * step_s * step_s / 2 * force
        rigid[1] -= mobility * step_s * force
        forces[k] = force
        if rigid[1] < 0.0 and after <= 0.0 and (before > 0.0 or k % 16 == 0):
            # No mode reaches farther than its amplitude, and the bodies go on parting.
            reach = rigid[0]
            for j in range(modes):
                reach += abs(gains[j]) * math.sqrt(q[j] * q[j] + (v[j] / angular[j]) ** 2)
            if reach <= 0.0:
                return k + 1
        before = after
    return len(forces)
