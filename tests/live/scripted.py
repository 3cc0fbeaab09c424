"""A simulation whose one contact is as it is told: a body that slides, rolls or rests on the ground."""

import numpy as np

from objectfolder.live import Touching

UP = np.array([0.0, 0.0, 1.0])


class Scripted:
    """A body named ``mug`` that moves along x over the ground, ``world``.

    Parameters
    ----------
    mass_kg, force_n, speed_m_s
        Of the body, of the contact, along the ground.
    radius_m
        Of a body that rolls; None: it slides on one point of its own.
    lifted_s
        When the contact ends.
    """

    timestep_s = 0.002

    def __init__(self, mass_kg, force_n, speed_m_s, *, radius_m=None, lifted_s=np.inf):
        self._mass_kg, self._force_n, self._speed_m_s = mass_kg, force_n, speed_m_s
        self._radius_m, self._lifted_s = radius_m, lifted_s
        self._steps = 0

    @property
    def time_s(self):
        return self._steps * self.timestep_s

    def step(self):
        self._steps += 1

    @property
    def _begun_s(self):
        return (self._steps - 1) * self.timestep_s

    def pose(self, body):
        pose = np.eye(4)
        if body == "mug":
            pose[0, 3] = self._speed_m_s * self._begun_s
            if self._radius_m:
                turn = pose[0, 3] / self._radius_m
                pose[:3, :3] = [
                    [np.cos(turn), 0, np.sin(turn)],
                    [0, 1, 0],
                    [-np.sin(turn), 0, np.cos(turn)],
                ]
        return pose

    def mass_kg(self, body):
        return self._mass_kg

    def mass_at_kg(self, touching):
        return self._mass_kg

    def touching(self):
        if self._begun_s >= self._lifted_s:
            return []
        below = np.array([self._speed_m_s * self._begun_s, 0.0, -(self._radius_m or 0.04)])
        own = np.zeros(3) if self._radius_m else np.array([self._speed_m_s, 0.0, 0.0])
        return [Touching(("world", "mug"), below, UP, self._force_n, np.stack([np.zeros(3), own]))]
