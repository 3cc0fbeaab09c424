"""One contact as it is heard: what rough surfaces do to both bodies as it runs, and how it damps them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.hertz import HertzContact
from objectfolder.audio.synthesis.roughness import RoughProfile
from objectfolder.audio.synthesis.sources import Motion, along
from objectfolder.live.heard_body import HeardBody
from objectfolder.live.lasting import LastingContact
from objectfolder.live.resting import Rest

Floats = NDArray[np.float64]
Pushes = list[tuple[Motion, Floats, Floats]]  # places, unit vectors in the object frame, and newtons (n,)
GRAVITY_M_S2 = 9.81
# That is heard; what passes more slowly than a share of it is not read.
LOWEST_RUBBING_HZ, SLOWEST = 20.0, 0.1
COLLISION_S = 0.03
STEADY_M = 1e-4  # that a contact may move while its damping is that of the place where it was


class Rubbing:
    """A lasting contact as it is heard.

    Parameters
    ----------
    contact
        What happens there.
    bodies
        Those of the two that sound, by name.
    hertz
        Of the pair.
    profile
        Of unit roughness.
    starts_m, roughness_m
        Of the two surfaces: where on the profile the contact begins, and the factor of its heights.
    """

    def __init__(
        self,
        contact: LastingContact,
        bodies: Mapping[str, HeardBody],
        hertz: HertzContact,
        profile: RoughProfile,
        starts_m: Floats,
        roughness_m: tuple[float, float],
    ) -> None:
        self.contact, self._bodies, self._profile, self._roughness_m = contact, bodies, profile, roughness_m
        self._hertz = hertz
        # Of the weight, not of the present force, so that the sound is linear in that.
        weight_n = GRAVITY_M_S2 * min(body.mass_kg for body in bodies.values())
        self._width_m = 2 * float(hertz.patch_radius_m(weight_n))
        self._starts_m = starts_m
        self._driven: dict[str, tuple[Motion, Floats]] = {}
        # Where (2, 3), and mode shapes squared along the normal and across it, there.
        self._damped: dict[str, tuple[Floats, Floats, Floats]] = {}
        # The force under which a body was damped last, and what that added.
        self._added: dict[str, tuple[float, Floats]] = {}

    def force_n(self, times_s: Floats) -> Floats:
        """Return what roughness pushes (n,) along the way, newtons, at times (n,) evenly apart."""
        total, apart_s = np.zeros(len(times_s)), float(times_s[1] - times_s[0])
        span_s = self.contact.times_s[-1] - self.contact.times_s[0]
        if self.contact.runs_m.max() <= SLOWEST * LOWEST_RUBBING_HZ * self._width_m * span_s:
            return total
        force, paths = self.contact.at(times_s)
        for path, start_m, roughness_m in zip(paths, self._starts_m, self._roughness_m, strict=True):
            speed = np.gradient(path, apart_s)
            # Slopes that pass too slowly to be heard are faded out: a body that stops leaves no step behind.
            heard = np.clip(speed / (LOWEST_RUBBING_HZ * self._width_m) - SLOWEST, 0.0, 1.0)
            if heard.any():
                # At least over what runs by in a sample, for what is shorter would alias.
                width_m = max(self._width_m, float(speed.max()) * apart_s)
                total += heard * roughness_m * self._profile.slopes(start_m + path, width_m)
        return force * total

    def pushes(self, times_s: Floats, rotations: Mapping[str, Floats]) -> dict[str, Pushes]:
        """Return how each body is pushed during a block: from where and as before to where and as now.

        Parameters
        ----------
        times_s
            Of its samples, and of the next block's first.
        rotations
            (3, 3) of both bodies.
        """
        pushes = np.zeros(len(times_s)) if self.contact.rests else self.force_n(times_s)
        pushes[0] = 0.0  # the last of the block before
        if not pushes.any():
            self._driven.clear()
            return {}
        ways = [
            rotations[name] @ way for name, way in zip(self.contact.bodies, self.contact.way_m_s, strict=True)
        ]
        way = max(ways, key=np.linalg.norm)
        direction = way / max(float(np.linalg.norm(way)), 1e-300)
        share, by_body = np.linspace(0, 1, len(pushes)), {}
        for name, sign in zip(self.contact.bodies, (-1.0, 1.0), strict=True):
            if name in self._bodies:
                now = self.motion(name), sign * direction @ rotations[name]
                before = self._driven.get(name, now)
                by_body[name] = [(*before, (1 - share) * pushes), (*now, share * pushes)]
                self._driven[name] = now
        return by_body

    def damps(self, time_s: float) -> bool:
        """Whether the contact has lasted long enough to damp: engines draw collisions out."""
        return self.contact.forces_n[-1] > 0 and time_s - self.contact.began_s > COLLISION_S

    def damping_per_s(self, name: str, rest: Rest) -> Floats:
        """Return what the contact adds to the decay rates (modes,) of a body.

        To first order, as `Support`: half the sum of resistance times mode shape squared.
        """
        side, points_m = self.contact.bodies.index(name), self.contact.points_m
        record = self._damped.get(name)
        if record is None or (
            points_m is not record[0] and np.abs(points_m[side] - record[0][side]).max() > STEADY_M
        ):
            shapes = self.motion(name).shapes
            along_normal = along(self.contact.normals[side][None], shapes)[0] ** 2
            across = (shapes[0] ** 2).sum(axis=0) - along_normal
            record = self._damped[name] = points_m, along_normal, across
            self._added.pop(name, None)
        force_n, added = self.contact.forces_n[-1], self._added.get(name)
        if added is None or added[0] != force_n:
            # Of Hertz's force k d^(3/2), by the approach d.
            stiffness = 1.5 * self._hertz.stiffness ** (2 / 3) * force_n ** (1 / 3)
            angular = np.sqrt(self._bodies[name].file.modes.eigenvalues)
            normal, across = rest.resistance_n_s_m(angular, stiffness)
            added = self._added[name] = force_n, (normal * record[1] + across * record[2]) / 2
        return added[1]

    def motion(self, name: str) -> Motion:
        """Return how a body's modes move at the contact."""
        return self._bodies[name].motion(self.contact.points_m[self.contact.bodies.index(name)])
