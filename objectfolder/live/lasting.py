"""Contacts followed while they last: how hard two bodies press, and how far the contact has run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from objectfolder.live.contacts import Touching

Floats = NDArray[np.float64]
# Engines hold a round body by a few of its corners, which take turns: what a contact runs is spread out.
SPREAD_S = 0.01
# A contact runs at most so much faster than the bodies move to each other: a plate that wobbles at 3 degrees.
# Corners of a body at rest take turns too, and are not read.
FASTEST = 20.0
AT_REST_M_S = 1e-9  # of a contact: what it rubs is far below any hearing
# Corners farther apart than this share of an object are different contacts.
LEAP_SHARE = 0.2


@dataclass(eq=False)
class LastingContact:
    """A contact while it lasts.

    Attributes
    ----------
    bodies : names of the two
    points_m : (2, 3) where it is, in the frame of each
    began_s : when
    normals : (2, 3) of its normal, in the frame of each
    way_m_s : (2, 3) velocity of the contact over each, in its frame
    times_s, forces_n : of each knot, linear between them
    paths_m : of each knot, (2,) how far it has run over each
    touched : whether it was there when last looked
    """

    bodies: tuple[str, str]
    points_m: Floats
    began_s: float
    normals: Floats = field(default_factory=lambda: np.zeros((2, 3)))
    way_m_s: Floats = field(default_factory=lambda: np.zeros((2, 3)))
    times_s: list[float] = field(default_factory=list)
    forces_n: list[float] = field(default_factory=list)
    paths_m: list[Floats] = field(default_factory=list)
    touched: bool = True

    def add(self, time_s: float, force_n: float, path_m: Floats) -> None:
        """Add a knot."""
        self.times_s.append(time_s)
        self.forces_n.append(force_n)
        self.paths_m.append(path_m)

    @property
    def runs_m(self) -> Floats:
        """How far (2,) it runs over each body from the first to the last knot."""
        return self.paths_m[-1] - self.paths_m[0]

    @property
    def rests(self) -> bool:
        """Whether it has run nowhere since the first knot: those of a contact at rest share one path."""
        return self.paths_m[-1] is self.paths_m[0]

    def at(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return force (n,) in newtons and paths (2, n) in metres at times (n,); none beyond the knots."""
        force = np.interp(times_s, self.times_s, self.forces_n, left=0.0, right=0.0)
        return force, np.stack(
            [np.interp(times_s, self.times_s, path) for path in np.transpose(self.paths_m)]
        )

    def run(self, points: Floats, normals: Floats, interval_s: float, longest_m: float) -> None:
        """Take on where the contact is now, and how fast it has run since it was last looked at.

        Parameters
        ----------
        points, normals
            (2, 3) in the frame of each body.
        longest_m
            That it can have run.
        """
        way = points - self.points_m
        way -= (way * normals).sum(axis=1, keepdims=True) * normals  # a soft contact gives way
        lengths = np.sqrt((way**2).sum(axis=1, keepdims=True))
        way *= np.minimum(1.0, longest_m / np.maximum(lengths, 1e-300)) / interval_s
        self.way_m_s = self.way_m_s + (way - self.way_m_s) * min(1.0, interval_s / SPREAD_S)
        self.points_m, self.normals, self.touched = points, normals, True

    def forget(self, time_s: float) -> None:
        """Drop knots that lie before the last one up to a time."""
        passed = max(0, int(np.searchsorted(self.times_s, time_s, side="right")) - 1)
        del self.times_s[:passed], self.forces_n[:passed], self.paths_m[:passed]


class LastingContacts:
    """All contacts of some objects.

    Parameters
    ----------
    sizes_m
        The longest side of each object, by name; every contact followed is of one of them.
    interval_s
        Between two looks.
    held_m_s
        Speed up to which roughness holds two bodies by each other, and a contact does not run.
    """

    def __init__(
        self, sizes_m: Mapping[str, float], interval_s: float, held_m_s: Callable[[tuple[str, str]], float]
    ) -> None:
        self._sizes_m, self._interval_s, self._held_m_s = sizes_m, interval_s, held_m_s
        self._places: dict[tuple[str, str], Floats] = {}
        self.contacts: list[LastingContact] = []

    def look(self, time_s: float, touching: Sequence[Touching], poses: Mapping[str, Floats]) -> None:
        """Follow the contacts there are at a time.

        Parameters
        ----------
        touching
            The contacts.
        poses
            (4, 4) of all bodies that touch.
        """
        moved = self._moved_m({touch.bodies for touch in touching}, poses)
        until_s = time_s + self._interval_s
        resting = self._resting(moved)
        for contact in self.contacts:
            contact.touched = contact.bodies in resting
            if contact.touched:
                contact.add(until_s, contact.forces_n[-1], contact.paths_m[-1])
        for touch in touching:
            if touch.bodies in resting:
                continue
            frames = [poses[body] for body in touch.bodies]
            points = np.stack([(touch.point_m - frame[:3, 3]) @ frame[:3, :3] for frame in frames])
            normals = np.stack([touch.normal @ frame[:3, :3] for frame in frames])
            contact = self._nearest(touch.bodies, points) or self._begin(touch.bodies, points, time_s)
            sticks = moved[touch.bodies] <= self._held_m_s(touch.bodies) * self._interval_s
            contact.run(points, normals, self._interval_s, 0.0 if sticks else FASTEST * moved[touch.bodies])
            steps = np.sqrt((contact.way_m_s**2).sum(axis=1)) * self._interval_s
            contact.add(until_s, touch.force_n, contact.paths_m[-1] + steps)
        for contact in self.contacts:
            if not contact.touched and contact.forces_n[-1] > 0:
                contact.add(until_s, 0.0, contact.paths_m[-1])

    def _resting(self, moved_m: Mapping[tuple[str, str], float]) -> set[tuple[str, str]]:
        """Return the pairs that hold each other, whose contacts have all come to rest: they make no sound.

        A scene's bodies stand on tens of corners, which are then not followed one by one.
        """
        fastest = dict[tuple[str, str], float]()
        for contact in self.contacts:
            speed = float(np.abs(contact.way_m_s).max())
            fastest[contact.bodies] = max(speed, fastest.get(contact.bodies, 0.0))
        return {
            pair
            for pair, distance in moved_m.items()
            if distance <= self._held_m_s(pair) * self._interval_s and fastest.get(pair, np.inf) < AT_REST_M_S
        }

    def forget(self, time_s: float) -> None:
        """Drop what lies before a time."""
        for contact in self.contacts:
            contact.forget(time_s)
        self.contacts = [
            contact for contact in self.contacts if contact.touched or contact.times_s[-1] > time_s
        ]

    def _begin(self, bodies: tuple[str, str], points: Floats, time_s: float) -> LastingContact:
        contact = LastingContact(bodies, points, time_s)
        contact.add(time_s, 0.0, np.zeros(2))
        self.contacts.append(contact)
        return contact

    def _nearest(self, bodies: tuple[str, str], points: Floats) -> LastingContact | None:
        """Return the contact last looked at that lies nearest on both bodies, None where all lie far."""
        nearest, reach = (
            None,
            LEAP_SHARE * min(self._sizes_m[name] for name in bodies if name in self._sizes_m),
        )
        for contact in self.contacts:
            if not contact.touched and contact.bodies == bodies:
                distance = float(np.abs(points - contact.points_m).max())
                if distance < reach:
                    nearest, reach = contact, distance
        return nearest

    def _moved_m(
        self, pairs: set[tuple[str, str]], poses: Mapping[str, Floats]
    ) -> dict[tuple[str, str], float]:
        """Return how far points of an object have moved over the other body since the last look, at most."""
        places, moved = {}, {}
        for pair in pairs:
            first, second = pair if pair[0] in self._sizes_m else pair[::-1]
            turned = poses[second][:3, :3].T
            places[pair] = turned @ np.column_stack(
                [poses[first][:3, :3], poses[first][:3, 3] - poses[second][:3, 3]]
            )
            change = places[pair] - self._places.get(pair, places[pair])
            moved[pair] = float(
                np.linalg.norm(change[:, 3]) + self._sizes_m[first] * np.abs(change[:, :3]).max()
            )
        self._places = places
        return moved
