"""What is heard of objects that collide in a running simulation, block by block."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.hertz import HertzContact
from objectfolder.audio.synthesis.object_stream import ObjectStream
from objectfolder.errors import QueryError
from objectfolder.live.contacts import Simulation, Touching
from objectfolder.object_file import ObjectFile
from objectfolder.query_values import real, whole

Floats = NDArray[np.float64]
SAMPLE_RATE_HZ, BLOCK_SAMPLES = 44100.0, 512
# Engines leave bodies at rest in motion: they fall for a step, then are pushed up. What closes more slowly
# than a fall of two steps does not collide; with steps of 2 ms that is 39 mm/s, a drop by .08 mm.
GRAVITY_M_S2, STEPS_OF_FALL = 9.81, 2
# Radius of curvature where objects touch, over the longest side: edges and rims. The duration of a contact
# goes with its -1/5 power.
CURVATURE_SHARE = 0.02
# Young's modulus in pascals and Poisson's ratio of wood, as in the table of materials.
WOOD = (1.1e10, 0.25)
# An asset's mass and its Object File's differ by rounding; a scale of 1.01 is three times as much.
MASS_TOLERANCE = 0.01


@dataclass(frozen=True)
class Impact:
    """A collision that was heard.

    Attributes
    ----------
    time_s : of the simulation
    bodies : names of the two
    point_m : (3,) in the world
    impulse_n_s : (3,) on the second body, in the world; the first takes its opposite
    duration_s : of the contact, by Hertz
    """

    time_s: float
    bodies: tuple[str, str]
    point_m: Floats
    impulse_n_s: Floats
    duration_s: float


class LiveSound:
    """The sound of a simulation's objects at a listener, made while it runs.

    A collision is a half-sine pulse of Hertz's duration on both bodies, with the impulse (1 + e) m v of the
    approach. What lasts (rolling, scraping, a hand) is not heard and does not damp.

    Parameters
    ----------
    simulation
        The engine, see `contacts.Simulation`.
    files
        Object Files by the names of their bodies.
    listener_m
        (3,) in the world. Distances are those at the start: the model of the air has no direction.
    restitution
        e of every collision, 0 to 1.
    others
        Young's modulus in pascals and Poisson's ratio of bodies without a file.
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
        sample_rate_hz: float = SAMPLE_RATE_HZ,
        block_samples: int = BLOCK_SAMPLES,
    ) -> None:
        self._simulation, self._files = simulation, dict(files)
        self._restitution = real("restitution", restitution, 0.0, 1.0)
        self._others = real("others[0]", others[0], 1e-3, 1e15, " Pa"), real("others[1]", others[1], -1, 0.5)
        self._rate = real("sample_rate_hz", sample_rate_hz, 1e3, 1e6)
        self._samples = whole("block_samples", block_samples, 1, 1 << 20)
        if simulation.timestep_s * self._rate > self._samples:
            finding = f"a time step of {simulation.timestep_s:g} s is longer than a block"
            raise QueryError("block_samples", finding, "Take shorter steps or longer blocks.")
        for body, file in files.items():
            _require_same_body(body, simulation.mass_kg(body), file)
        self._streams = {body: self._stream(body, np.asarray(listener_m, np.float64)) for body in files}
        self._start_s = simulation.time_s
        self._now = 0
        self._least_m_s = STEPS_OF_FALL * GRAVITY_M_S2 * simulation.timestep_s
        self._closing: set[frozenset[str]] = set()
        self.impacts: list[Impact] = []

    def block(self) -> Floats:
        """Run the simulation for a block, and return the sound pressure (samples,) in pascals meanwhile."""
        self._now += self._samples
        end_s = self._start_s + self._now / self._rate
        while self._simulation.time_s < end_s:
            began_s = self._simulation.time_s
            self._simulation.step()
            self._hear(began_s)
        sounds = [stream.block(self._samples)[0] for stream in self._streams.values()]
        return np.sum(sounds, axis=0) if sounds else np.zeros(self._samples)

    def _hear(self, time_s: float) -> None:
        """Strike bodies that have begun to close at a point; soft contacts slow them over several steps."""
        fastest: dict[frozenset[str], Touching] = {}
        for touching in self._simulation.touching():
            pair = frozenset(touching.bodies)
            slow = max(self._least_m_s, fastest[pair].approach_m_s if pair in fastest else 0.0)
            if touching.approach_m_s > slow and pair & self._files.keys():
                fastest[pair] = touching
        for pair, touching in fastest.items():
            if pair not in self._closing:
                self._strike(time_s, touching)
        self._closing = set(fastest)

    def _strike(self, time_s: float, touching: Touching) -> None:
        contact = self._contact(touching)
        size = contact.impulse_n_s(touching.approach_m_s, self._restitution)
        duration_s = float(contact.duration_s(touching.approach_m_s))
        impact = Impact(time_s, touching.bodies, touching.point_m, size * touching.normal, duration_s)
        self.impacts.append(impact)
        for body, sign in zip(touching.bodies, (-1.0, 1.0), strict=True):
            if body not in self._files:
                continue
            pose = self._simulation.pose(body)
            local = (touching.point_m - pose[:3, 3]) @ pose[:3, :3]
            # Collision shapes lie up to centimetres beside a surface.
            point = self._files[body].surface.closest_points(local[None]).points[0]
            force = sign * impact.impulse_n_s @ pose[:3, :3]
            at = max((time_s - self._start_s) * self._rate, self._streams[body].now)  # but for rounding
            self._streams[body].strike(point, force, at=at, pulse=duration_s)

    def _contact(self, touching: Touching) -> HertzContact:
        """Return Hertz's contact of two bodies, of which the sharper one counts."""
        compliance, curvatures = 0.0, [0.0]
        for body in touching.bodies:
            youngs_modulus_pa, poisson_ratio = self._others
            if body in self._files:
                file = self._files[body]
                material = file.description["material"]
                youngs_modulus_pa, poisson_ratio = material["youngs_modulus_pa"], material["poisson_ratio"]
                curvatures.append(1 / (CURVATURE_SHARE * float(np.ptp(file.surface.bounds, axis=0).max())))
            compliance += (1 - poisson_ratio**2) / youngs_modulus_pa
        return HertzContact(1 / compliance, 1 / max(curvatures), touching.mass_kg)

    def _stream(self, body: str, listener_m: Floats) -> ObjectStream:
        file = self._files[body]
        pose = self._simulation.pose(body)
        return file.stream(self._rate, listener=(listener_m - pose[:3, 3]) @ pose[:3, :3])


def _require_same_body(body: str, mass_kg: float, file: ObjectFile) -> None:
    """Refuse a body whose mass in the simulation is none of its Object File's."""
    if not (file.description.get("body") and file.description.get("material")):
        finding = f"the file of {body!r} does not say the object's mass and material"
        raise QueryError("files", finding, "Build the file again.")
    known = [file.description["object"].get("mass_kg")]
    known += [file.description["body"].get(name) for name in ("mass_kg", "filled_mass_kg")]
    stated = [float(value) for value in known if value]
    if not any(abs(mass_kg / value - 1) <= MASS_TOLERANCE for value in stated):
        finding = f"{body!r} weighs {mass_kg:.4g} kg in the simulation, {stated[0]:.4g} kg in its Object File"
        raise QueryError("files", finding, "Give the file of that object, at the scale of the simulation.")
