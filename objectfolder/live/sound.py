"""What is heard of objects that collide, roll and scrape in a running simulation, block by block."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.collision import collide
from objectfolder.audio.synthesis.hertz import LEAST_RESTITUTION, HertzContact
from objectfolder.audio.synthesis.pulses import ForceProfile
from objectfolder.audio.synthesis.roughness import LENGTH_M, RoughProfile
from objectfolder.errors import QueryError
from objectfolder.forks import hold_forks
from objectfolder.live.contacts import Simulation, Touching, finite_pose
from objectfolder.live.heard_body import HeardBody, Matter
from objectfolder.live.lasting import LastingContact, LastingContacts
from objectfolder.live.resting import WOODEN_TOP, Rest
from objectfolder.live.rubbing import GRAVITY_M_S2, Pushes, Rubbing
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.query_values import generator, real, real_array, whole

Floats = NDArray[np.float64]
SAMPLE_RATE_HZ, BLOCK_SAMPLES = 44100.0, 512
# Engines leave bodies at rest in motion: they fall for a step, then are pushed up. What closes more slowly
# than a fall of two steps does not collide; with steps of 2 ms that is 39 mm/s, a drop by .08 mm.
STEPS_OF_FALL = 2
CORRECTIONS = 2  # of a speed that passes on an impulse; the rest, below 1 %, is a factor of the force
LOOK_S = 8e-3  # between looks at what lasts
# Young's modulus in pascals and Poisson's ratio of wood, as in the table of materials.
WOOD = (1.1e10, 0.25)


@dataclass(frozen=True)
class Impact:
    """A collision that was heard.

    Attributes
    ----------
    time_s : of the simulation
    bodies : names of the two
    point_m : (3,) in the world
    impulse_n_s : (3,) on the second body, in the world; the first takes its opposite
    profile : how the impulse is spent
    """

    time_s: float
    bodies: tuple[str, str]
    point_m: Floats
    impulse_n_s: Floats
    profile: ForceProfile

    @property
    def duration_s(self) -> float:
        """Of the contact."""
        return self.profile.duration_s


class LiveSound:
    """The sound of a simulation's objects at a listener, made while it runs.

    In a collision Hertz's spring, the modes of both bodies and their motion as a whole are moved together
    until they part. A contact that lasts pushes both by the slopes of their rough surfaces, times the force
    between them, as it runs along these; and it damps both.

    Parameters
    ----------
    simulation
        The engine, see `contacts.Simulation`.
    files
        Object Files by the names of their bodies.
    listener_m
        (3,) in the world. Distances are those at the start: the model of the air has no direction.
    restitution
        e of every collision, 0 to 1, if nothing rang; less than .01 is taken as .01.
    others
        Young's modulus in pascals and Poisson's ratio of bodies without a file.
    known
        The same of some of them, by name.
    rest
        What bodies stand on, see `Rest`; None: it damps nothing.
    seed
        Of the rough surfaces.
    sample_rate_hz, block_samples
        Of the sound.

    Attributes
    ----------
    impacts : list of Impact, every collision heard so far

    Raises
    ------
    QueryError
        A body that the simulation lacks or whose mass is another there, a file without sound, a time step
        longer than a block, values out of range.
    """

    def __init__(
        self,
        simulation: Simulation,
        files: Mapping[str, ObjectFile],
        *,
        listener_m: Floats | tuple[float, float, float] = (0.0, -0.5, 0.5),
        restitution: float = 0.5,
        others: tuple[float, float] = WOOD,
        known: Mapping[str, tuple[float, float]] | None = None,
        rest: Rest | None = WOODEN_TOP,
        seed: int = 0,
        sample_rate_hz: float = SAMPLE_RATE_HZ,
        block_samples: int = BLOCK_SAMPLES,
    ) -> None:
        self._simulation = simulation
        self._restitution = real("restitution", restitution, 0.0, 1.0)
        self._default = _matter("others", others)
        self._matters = {name: _matter(f"known[{name!r}]", matter) for name, matter in (known or {}).items()}
        self._rest = rest
        self._rate = real("sample_rate_hz", sample_rate_hz, 1e3, 1e6)
        self._samples = whole("block_samples", block_samples, 1, 1 << 20)
        if simulation.timestep_s * self._rate > self._samples:
            finding = f"a time step of {simulation.timestep_s:g} s is longer than a block"
            raise QueryError("block_samples", finding, "Take shorter steps or longer blocks.")
        self._profile, self._random = RoughProfile(seed), generator(seed)
        self._start_s, self._now = simulation.time_s, 0
        self._least_m_s = STEPS_OF_FALL * GRAVITY_M_S2 * simulation.timestep_s
        self._poses: dict[str, Floats] = {}
        ears = np.asarray(listener_m, np.float64)
        self._bodies = {name: self._body(name, file, ears) for name, file in files.items()}
        self._steps, self._between = 0, max(1, round(LOOK_S / simulation.timestep_s))
        sizes_m = {name: body.size_m for name, body in self._bodies.items()}
        self._lasting = LastingContacts(sizes_m, self._between * simulation.timestep_s, self._held_m_s)
        self._rubbing: dict[LastingContact, Rubbing] = {}
        self._closing: set[frozenset[str]] = set()
        self.impacts: list[Impact] = []

    @hold_forks
    def block(self) -> Floats:
        """Run the simulation for a block, and return the sound pressure (samples,) in pascals meanwhile.

        Raises
        ------
        QueryError
            A pose that is not finite.
        """
        begin = self._now
        self._now += self._samples
        while self._simulation.time_s < self._start_s + self._now / self._rate:
            began_s = self._simulation.time_s
            self._simulation.step()
            self._hear(began_s)
        self._rub(begin)
        sounds = [body.stream.block(self._samples)[0] for body in self._bodies.values()]
        return np.sum(sounds, axis=0) if sounds else np.zeros(self._samples)

    def strike(self, body: str, point_m: Floats, impulse_n_s: Floats) -> None:
        """Let a body ring as a hammer of the `others` material strikes it now; the engine is told apart.

        It collides with such a wall, at the speed at which that passes the impulse on.

        Parameters
        ----------
        body
            One with an Object File.
        point_m, impulse_n_s
            (3,) in the world.

        Raises
        ------
        QueryError
            A body without an Object File, values that are not finite.
        """
        if body not in self._bodies:
            raise QueryError("body", f"{body!r} has no Object File", f"Strike {' or '.join(self._bodies)}.")
        struck, impulse = self._bodies[body], real_array("impulse_n_s", impulse_n_s)
        size = float(np.linalg.norm(impulse))
        if size > 0:
            contact = struck.matter.against(self._default, struck.mass_kg)
            speed_m_s = float(contact.speed_m_s(size, self._restitution))
            point, bodies = real_array("point_m", point_m), ("hammer", body)
            self._sound(self._simulation.time_s, bodies, point, impulse / size, contact, speed_m_s, size)

    def _body(self, name: str, file: ObjectFile, listener_m: Floats) -> HeardBody:
        mass_kg, pose = self._simulation.mass_kg(name), finite_pose(self._simulation, name)
        return HeardBody.of(name, file, mass_kg, self._rate, (listener_m - pose[:3, 3]) @ pose[:3, :3])

    def _matter(self, name: str) -> Matter:
        return self._bodies[name].matter if name in self._bodies else self._matters.get(name, self._default)

    def _held_m_s(self, bodies: tuple[str, str]) -> float:
        """Return the speed of bodies that do not climb each other's roughness: v^2 / 2 < g h."""
        height_m = math.hypot(*(self._matter(name).roughness_m for name in bodies))
        return math.sqrt(2 * GRAVITY_M_S2 * height_m)

    def _hear(self, time_s: float) -> None:
        """Take on the contacts of a step."""
        touching = [
            touch for touch in self._simulation.touching() if not self._bodies.keys().isdisjoint(touch.bodies)
        ]
        self._collide(time_s, touching)
        self._steps += 1
        if self._steps % self._between == 0:
            names = {name for touch in touching for name in touch.bodies}
            self._poses |= {name: finite_pose(self._simulation, name) for name in names}
            self._lasting.look(time_s, touching, self._poses)

    def _collide(self, time_s: float, touching: list[Touching]) -> None:
        """Strike bodies that have begun to close at a point; soft contacts slow them over several steps."""
        fastest: dict[frozenset[str], Touching] = {}
        for touch in touching:
            pair = frozenset(touch.bodies)
            if touch.approach_m_s > (fastest[pair].approach_m_s if pair in fastest else self._least_m_s):
                fastest[pair] = touch
        for pair, touch in fastest.items():
            if pair not in self._closing:
                self._strike(time_s, touch)
        self._closing = set(fastest)

    def _strike(self, time_s: float, touch: Touching) -> None:
        first, second = (self._matter(name) for name in touch.bodies)
        contact = first.against(second, self._simulation.mass_at_kg(touch))
        self._sound(time_s, touch.bodies, touch.point_m, touch.normal, contact, touch.approach_m_s)

    def _sound(
        self, time_s: float, bodies: tuple[str, str], point_m: Floats, normal: Floats, contact: HertzContact,
        speed_m_s: float, impulse_n_s: float | None = None,
    ) -> None:  # fmt: skip
        """Let two bodies collide at a speed, or at one near it that passes on an impulse, and ring."""
        sides = []
        for name, sign in zip(bodies, (-1.0, 1.0), strict=True):
            if name in self._bodies:
                body, pose = self._bodies[name], finite_pose(self._simulation, name)
                motion = body.stream.motion(body.nearest((point_m - pose[:3, 3]) @ pose[:3, :3]))
                sides.append((body.stream, motion, sign * normal @ pose[:3, :3]))
        colliders = [stream.collider(motion, direction) for stream, motion, direction in sides]
        restitution = max(self._restitution, LEAST_RESTITUTION)
        collision = collide(colliders, contact, speed_m_s, restitution)
        if impulse_n_s is not None:
            for _ in range(CORRECTIONS):
                speed_m_s *= impulse_n_s / collision.impulse_n_s
                collision = collide(colliders, contact, speed_m_s, restitution)
        size, profile = impulse_n_s or collision.impulse_n_s, collision.profile
        self.impacts.append(Impact(time_s, bodies, point_m, size * normal, profile))
        for stream, motion, direction in sides:
            at = max((time_s - self._start_s) * self._rate, stream.now)  # but for rounding
            stream.spend(motion, size * direction, at, profile)

    def _rub(self, begin: int) -> None:
        """Let contacts that last drive and damp the bodies for a block, which begins at a sample."""
        times_s = self._start_s + np.arange(begin, self._now + 1) / self._rate
        contacts = self._lasting.contacts
        self._rubbing = {contact: self._rubbing.get(contact) or self._rubbed(contact) for contact in contacts}
        rotations = {name: pose[:3, :3] for name, pose in self._poses.items()}
        added = {name: np.zeros(len(body.file.modes.eigenvalues)) for name, body in self._bodies.items()}
        pushes: dict[str, Pushes] = {name: [] for name in self._bodies}
        for contact, rubbing in self._rubbing.items():
            for name, some in rubbing.pushes(times_s, rotations).items():
                pushes[name] += some
            if self._rest and rubbing.damps(float(times_s[0])):
                for name in set(contact.bodies) & self._bodies.keys():
                    added[name] += rubbing.damping_per_s(name, self._rest)
        for name, body in self._bodies.items():
            body.stream.damp(added[name])
            if pushes[name]:
                body.stream.drive(pushes[name], at=begin)
        self._lasting.forget(float(times_s[-1]))

    def _rubbed(self, contact: LastingContact) -> Rubbing:
        first, second = (self._matter(name) for name in contact.bodies)
        bodies = {name: self._bodies[name] for name in contact.bodies if name in self._bodies}
        hertz = first.against(second, min(body.mass_kg for body in bodies.values()))
        starts_m = LENGTH_M * self._random.random(2)
        return Rubbing(
            contact, bodies, hertz, self._profile, starts_m, (first.roughness_m, second.roughness_m)
        )


def _matter(name: str, stated: tuple[float, float]) -> Matter:
    """Return a Young's modulus in pascals and a Poisson's ratio, if they can be."""
    return Matter(real(f"{name}[0]", stated[0], 1e-3, 1e15, " Pa"), real(f"{name}[1]", stated[1], -1, 0.5))
