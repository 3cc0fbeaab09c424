"""How long and how hard two bodies touch when they collide.

Hertz's theory of the impact of elastic bodies: K. L. Johnson, "Contact Mechanics", 1985, section 11.4. The
contact force is k d^(3/2) at approach d, with k = 4/3 E* sqrt(R). It holds while the impact is slow against
the waves in the bodies, they are smooth near the contact, and nothing yields.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import QueryError
from objectfolder.query_values import real
from objectfolder.renaming import formerly_positional

Floats = NDArray[np.float64]
# Twice the integral of (1 - x^(5/2))^(-1/2) over 0 to 1: 4/5 Beta(2/5, 1/2) = 2.9432 (Johnson, 11.24).
DURATION_FACTOR = 0.8 * math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9)


LEAST_RESTITUTION = 0.01


@dataclass(frozen=True)
class ContactBody:
    """One of two bodies near the point where they touch.

    Attributes
    ----------
    youngs_modulus_pa, poisson_ratio : of its material
    radius_m : of curvature at the contact; inf for flat
    mass_kg : inf for a support that does not move
    restitution : over the speed of a collision with it, the speed of parting if nothing rings; above 0, to 1

    Examples
    --------
    >>> from objectfolder.audio import HertzContact
    >>> ball = ContactBody(2e11, 0.29, radius_m=0.01, mass_kg=0.033)
    >>> floor = ContactBody(2e11, 0.29, radius_m=float("inf"), mass_kg=float("inf"))
    >>> contact = HertzContact.between(ball, floor)
    >>> float(contact.duration_s(1.0).round(6))  # seconds
    7.1e-05
    """

    youngs_modulus_pa: float
    poisson_ratio: float
    radius_m: float
    mass_kg: float
    restitution: float = 1.0

    def __post_init__(self) -> None:
        real("contact.restitution", self.restitution, LEAST_RESTITUTION, 1.0)
        real("contact.youngs_modulus_pa", self.youngs_modulus_pa, 1e-3, 1e15, " Pa")
        real("contact.poisson_ratio", self.poisson_ratio, -1.0 + 1e-9, 0.5)
        for name in ("radius_m", "mass_kg"):
            if getattr(self, name) != math.inf:
                real(f"contact.{name}", getattr(self, name), 1e-15, 1e15)


# What strikes in the command line and by name. Steel and wood are those of the table of materials, balls of
# 8 mm and 12 mm; the restitutions, and all of the fingertip, are round numbers of ours: its duration of some
# 10 ms is that of a tap.
STRIKERS = {
    "steel": ContactBody(2.0e11, 0.29, radius_m=0.008, mass_kg=0.0168, restitution=0.9),
    "wood": ContactBody(1.1e10, 0.25, radius_m=0.012, mass_kg=0.0054, restitution=0.6),
    "finger": ContactBody(2e5, 0.45, radius_m=0.008, mass_kg=0.01, restitution=0.2),
}


@dataclass(frozen=True)
class HertzContact:
    """Two bodies in collision.

    Attributes
    ----------
    modulus_pa : effective, 1 / E* = (1 - nu1^2) / E1 + (1 - nu2^2) / E2
    radius_m : effective, 1 / R = 1 / R1 + 1 / R2
    mass_kg : effective, 1 / m = 1 / m1 + 1 / m2

    Examples
    --------
    >>> from objectfolder.audio import ContactBody
    >>> ball = ContactBody(2e11, 0.29, radius_m=0.01, mass_kg=0.033)
    >>> contact = HertzContact.between(ball, ball)
    >>> round(contact.radius_m, 4), round(contact.mass_kg, 4)
    (0.005, 0.0165)
    >>> float(contact.impulse_n_s(1.0).round(4))  # newton seconds, without loss
    0.033
    """

    modulus_pa: float
    radius_m: float
    mass_kg: float

    @classmethod
    def between(cls, one: ContactBody, other: ContactBody) -> "HertzContact":
        """Return the contact of two bodies.

        Raises
        ------
        QueryError
            Two flat bodies, or two that cannot move.
        """
        compliance = sum((1 - body.poisson_ratio**2) / body.youngs_modulus_pa for body in (one, other))
        curvature = sum(1 / body.radius_m for body in (one, other))
        mobility = sum(1 / body.mass_kg for body in (one, other))
        if curvature == 0 or mobility == 0:
            raise QueryError(
                "contact", "two flat bodies, or none that moves", "Give one a radius, one a mass."
            )
        return cls(1 / compliance, 1 / curvature, 1 / mobility)

    @property
    def stiffness(self) -> float:
        """k of the force k d^(3/2), newtons a metre to the 3/2."""
        return 4 / 3 * self.modulus_pa * math.sqrt(self.radius_m)

    def approach_m(self, speed_m_s: ArrayLike) -> Floats:
        """Greatest approach (15 m v^2 / (16 sqrt(R) E*))^(2/5) of a collision at a speed (Johnson, 11.23)."""
        speed = _speeds(speed_m_s)
        return np.asarray((1.25 * self.mass_kg * speed**2 / self.stiffness) ** 0.4)

    def duration_s(self, speed_m_s: ArrayLike) -> Floats:
        """Time of contact, 2.9432 of the greatest approach over the speed."""
        return np.asarray(DURATION_FACTOR * self.approach_m(speed_m_s) / _speeds(speed_m_s))

    def peak_force_n(self, speed_m_s: ArrayLike) -> Floats:
        """Force at the greatest approach."""
        return np.asarray(self.stiffness * self.approach_m(speed_m_s) ** 1.5)

    def patch_radius_m(self, force_n: ArrayLike) -> Floats:
        """Radius (3 F R / (4 E*))^(1/3) of the area of contact under a force (Johnson, 4.22)."""
        return np.asarray((0.75 * np.asarray(force_n) * self.radius_m / self.modulus_pa) ** (1 / 3))

    def impulse_n_s(self, speed_m_s: ArrayLike, restitution: float = 1.0) -> Floats:
        """Impulse (1 + e) m v."""
        return np.asarray((1 + _share(restitution)) * self.mass_kg * _speeds(speed_m_s))

    def speed_m_s(self, impulse_n_s: ArrayLike, restitution: float = 1.0) -> Floats:
        """Speed of approach of a collision that passes on an impulse."""
        return np.asarray(_speeds(impulse_n_s) / ((1 + _share(restitution)) * self.mass_kg))


@formerly_positional
def mass_at_contact(
    mass_kg: float,
    *,
    inertia_kg_m2: ArrayLike,
    centre_of_mass_m: ArrayLike,
    point_m: ArrayLike,
    normal: ArrayLike,
) -> float:
    """Mass that a free rigid body offers to a push at a point along a direction.

    1 / m_eff = 1 / m + (r x n) . I^-1 (r x n), r from the centre of mass; a push beside the centre also
    turns the body, which gives way more easily. B. Mirtich, PhD thesis, Berkeley 1996, section 3.2.

    Examples
    --------
    >>> import numpy as np
    >>> ball = {"inertia_kg_m2": 0.4 * np.eye(3), "centre_of_mass_m": [0, 0, 0]}  # 1 kg, of a radius of 1 m
    >>> mass_at_contact(1.0, **ball, point_m=[0, 0, 1], normal=[0, 0, 1])  # pushed through its centre
    1.0
    >>> round(mass_at_contact(1.0, **ball, point_m=[0, 0, 1], normal=[1, 0, 0]), 3)  # along its surface
    0.286
    """
    arm = np.asarray(point_m, dtype=np.float64) - np.asarray(centre_of_mass_m, dtype=np.float64)
    direction = np.asarray(normal, dtype=np.float64)
    turned = np.cross(arm, direction / np.linalg.norm(direction))
    turning = np.linalg.solve(np.asarray(inertia_kg_m2, dtype=np.float64), turned)
    return float(1 / (1 / mass_kg + turned @ turning))


def _speeds(values: ArrayLike) -> Floats:
    speeds = np.asarray(values, dtype=np.float64)
    if not (np.isfinite(speeds).all() and (speeds > 0).all()):
        raise QueryError(
            "contact", "speed or impulse not positive", "Bodies that do not collide do not sound."
        )
    return speeds


def _share(restitution: float) -> float:
    if not 0 <= restitution <= 1:
        raise QueryError("restitution", f"{restitution}", "Give 0 to 1.")
    return restitution
