"""A struck object: its modes and its mass under contacts, as surface velocity or pressure at listeners."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.air.transfer import AirTransfer
from objectfolder.audio.synthesis.air import Air, Listener
from objectfolder.audio.synthesis.bank import Pulse as PulseOfRows
from objectfolder.audio.synthesis.bank import samples_of
from objectfolder.audio.synthesis.collision import Collider, collide
from objectfolder.audio.synthesis.hertz import STRIKERS, ContactBody, HertzContact, mass_at_contact
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.audio.synthesis.pulses import ForceProfile
from objectfolder.audio.synthesis.resonators import Resonators
from objectfolder.audio.synthesis.sound import StrikeEnergy
from objectfolder.audio.synthesis.sources import Motion, Source, along
from objectfolder.audio.synthesis.support import Support
from objectfolder.errors import QueryError
from objectfolder.query_values import real_array
from objectfolder.surface.surface import ClosestPoints, Surface

Floats = NDArray[np.float64]
Pulse = float | ArrayLike | ContactBody | str | None
CONTACT, RMS = "contact", "rms"
Observed = str | Floats
CHUNK_NUMBERS = 1 << 22  # of gains and of samples at once
FLAT = np.inf
INAUDIBLE_DB = -100.0  # of a mode at a listener, for one modal velocity, below the loudest
NO_FORCE = ForceProfile(1e-6, np.full(1, 1e6))  # of contacts without an impulse
SHORTEST_PULSE_S, LONGEST_PULSE_S = 1e-12, 1e5


@dataclass(frozen=True)
class RigidBody:
    """An object as a whole.

    Attributes
    ----------
    mass_kg : positive
    centre_m : (3,) centre of mass
    inertia_kg_m2 : (3, 3) about it, None where it is not known
    area_m2 : of the surface
    """

    mass_kg: float
    centre_m: Floats
    inertia_kg_m2: Floats | None
    area_m2: float

    @classmethod
    def of(cls, body: Mapping[str, Any], surface: Surface) -> "RigidBody":
        """Return the `body` of an Object File; one without an inertia is about the middle of its box."""
        closed = body["inertia_kg_m2"] is not None
        # The solid that sounds may be lighter than the closed surface: a container with a stated wall.
        share = body["filled_mass_kg"] / body["mass_kg"] if closed else 1.0
        return cls(
            float(body["filled_mass_kg"]),
            np.asarray(body["centre_of_mass_m"]) if closed else surface.bounds.mean(axis=0),
            share * np.asarray(body["inertia_kg_m2"]) if closed else None,
            float(surface.area),
        )

    def mass_towards(self, point: Floats, direction: Floats) -> float:
        """Mass offered to a push at a point; the whole mass where the inertia is not known."""
        if self.inertia_kg_m2 is None:
            return self.mass_kg
        return mass_at_contact(
            self.mass_kg,
            inertia_kg_m2=self.inertia_kg_m2,
            centre_of_mass_m=self.centre_m,
            point_m=point,
            normal=direction,
        )


@dataclass(frozen=True)
class StruckBody:
    """Modes on a surface, and what is known of the body.

    Attributes
    ----------
    eigenvalues, dampings_per_s : (modes,) as in `mode_bank`
    radiation_weights : (modes,) kg^-1/2, rms over the surface of the normal component of each mode shape
    gains : from points (n, 3) to (n, 3, modes), modal velocity an impulse of 1 N s along each axis gives
    normals : from points (n, 3) to outward unit normals of the surface (n, 3); both also from known places
    rigid : mass and area, None where unknown: then nothing is heard at a listener
    elasticity : Young's modulus (Pa) and Poisson's ratio, None where unknown
    transfer : the way of each mode through the air, None where a model stands for it
    radiation_dampings_per_s : (modes,) 1/s, what radiation has of the decays, None where it was not solved
    """

    eigenvalues: Floats
    dampings_per_s: Floats
    radiation_weights: Floats
    gains: Callable[[Floats | ClosestPoints], Floats]
    normals: Callable[[Floats | ClosestPoints], Floats]
    rigid: RigidBody | None
    elasticity: tuple[float, float] | None
    transfer: AirTransfer | None = None
    radiation_dampings_per_s: Floats | None = None

    def sounds(
        self,
        points: Floats | ClosestPoints,
        forces: Floats,
        duration_s: float,
        sample_rate_hz: float,
        *,
        pulse: Pulse = None,
        observed: Observed = CONTACT,
        listeners: Floats | None = None,
    ) -> Iterator[tuple[slice, NDArray[np.float32], StrikeEnergy | None]]:
        """Yield the sounds of some contacts at a time; see `ObjectFile.strike`.

        Parameters
        ----------
        points
            (n, 3) on the surface, or known places of it.
        forces
            (n, 3) newton seconds, or (n, k, 3) newtons at the samples.
        observed
            Where the surface velocity is asked: `CONTACT`, `RMS` or points (channels, 3) of the surface.
        listeners
            (channels, 3), or None for the surface velocity.

        Returns
        -------
        iterator
            Rows, their sounds (rows, channels, samples) float32 and, of a striker, where its energy went.
            Each row is what it is alone; working memory does not grow with n.
        """
        striker = pulse if isinstance(pulse, ContactBody) else None
        durations = None if striker else self.durations(len(points), forces, pulse)
        samples = samples_of(duration_s, sample_rate_hz)
        channels = list(self.channels(sample_rate_hz, observed, listeners))
        numbers = 3 * len(self.eigenvalues) + len(channels) * samples + 1
        step = max(1, CHUNK_NUMBERS // numbers)
        for start in range(0, len(points), step):
            rows = slice(start, min(start + step, len(points)))
            sound = np.zeros((rows.stop - start, len(channels), samples), dtype=np.float32)
            places = points[rows]
            motion = self.motion(places)
            own: PulseOfRows = durations[rows] if isinstance(durations, np.ndarray) else durations
            pushes, energy = forces[rows], None
            if striker:
                at = places.points if isinstance(places, ClosestPoints) else places
                collisions = self.collisions(at, motion, pushes, striker)
                pushes, own, energy = collisions.impulses_n_s, collisions.profiles, collisions.energy_j
            total, part = (np.empty((len(sound), samples)) for _ in range(2))
            for channel, (first, *others) in enumerate(channels):
                first.write(motion, pushes, own, total)
                for source in others:
                    source.write(motion, pushes, own, part)
                    total += part
                sound[:, channel] = total
            yield rows, sound, energy

    def motion(self, points: Floats | ClosestPoints) -> Motion:
        """Return how each mode moves where it is struck."""
        modes = len(self.eigenvalues)
        shapes = self.gains(points)[:, :, :modes] if modes else np.zeros((len(points), 3, 0))
        return Motion(shapes, lambda: self.normals(points))

    def rms_velocity(self, points: Floats, impulses: Floats, times_s: Floats) -> Floats:
        """Return the level (n, times) of `ObjectFile.rms_velocity`."""
        ringing = self.eigenvalues > self.dampings_per_s**2
        amplitudes = along(impulses, self.motion(points).shapes) * self.radiation_weights * ringing
        decay = np.exp(-2 * np.outer(self.dampings_per_s, times_s))
        return np.sqrt((amplitudes**2)[:, None, :] @ decay / 2)[:, 0]

    def velocity_weights(self, observed: Observed) -> list[Floats | None]:
        """Return (modes,) what each channel hears of modal velocity; None: as the contact moves."""
        if isinstance(observed, str):
            return [None if observed == CONTACT else self.radiation_weights]
        return list(self.motion(observed).normal)

    def durations(self, contacts: int, forces: Floats, pulse: Pulse) -> float | Floats | None:
        """Return the lengths of half-sines, seconds: one, one each, or None."""
        if pulse is None:
            return None
        if forces.ndim == 3:
            raise QueryError("pulse", "given with sampled forces", "Forces (n, k, 3) are their own profile.")
        durations = real_array("pulse", pulse, "Give seconds, or a `ContactBody`.")
        if ((durations < SHORTEST_PULSE_S) | (durations > LONGEST_PULSE_S)).any():
            remedy = f"Give {SHORTEST_PULSE_S:g} s to {LONGEST_PULSE_S:g} s; None for an instant."
            raise QueryError("pulse", "a length out of range", remedy)
        if durations.shape not in ((), (contacts,)):
            finding = f"shape {durations.shape} for {contacts} contacts"
            raise QueryError("pulse", finding, "Give one duration, or one each.")
        return float(durations) if durations.ndim == 0 else durations

    def contact(self, striker: ContactBody, point: Floats, direction: Floats) -> HertzContact:
        """Return the contact with a striker; the object counts as flat.

        Its own curvature is not known, and a striker is nearly always the sharper one.

        Raises
        ------
        QueryError
            An object of unknown mass or elasticity.
        """
        if self.rigid is None or self.elasticity is None:
            raise QueryError("pulse", "the object's mass or elasticity is unknown", "Give seconds.")
        mass = self.rigid.mass_towards(point, direction)
        return HertzContact.between(striker, ContactBody(*self.elasticity, FLAT, mass))

    def passed_on(self, points: Floats, velocities: Floats, striker: ContactBody) -> Floats:
        """Return impulses (n, 3) that a striker would pass on at velocities (n, 3) as a rigid body."""
        moving = velocities.any(axis=1)
        masses = np.zeros(len(points))
        for row in np.flatnonzero(moving):
            masses[row] = self.contact(striker, points[row], velocities[row]).mass_kg
        return 2 * masses[:, None] * velocities

    @cached_property
    def modes(self) -> Oscillators:
        """Its modes as collisions take them, at rates of their own."""
        return Oscillators(self.eigenvalues, self.dampings_per_s, 1.0)

    def collisions(
        self, points: Floats, motion: Motion, impulses: Floats, striker: ContactBody
    ) -> "Collisions":
        """Let a striker collide at points (n, 3), at speeds at which rigid bodies would pass on impulses."""
        if impulses.ndim == 3:
            raise QueryError("pulse", "given with sampled forces", "Forces (n, k, 3) are their own profile.")
        profiles, passed, energies = [], np.zeros_like(impulses), np.zeros((5, len(points)))
        for row in range(len(points)):
            size = float(np.linalg.norm(impulses[row]))
            if size == 0:
                profiles.append(NO_FORCE)
                continue
            direction = impulses[row] / size
            contact = self.contact(striker, points[row], direction)
            speed = float(contact.speed_m_s(size))
            collider = Collider(self.modes, along(direction[None], motion.shapes[row : row + 1])[0])
            collision = collide([collider], contact, speed, striker.restitution)
            profiles.append(collision.profile)
            impulse, vibration = collision.impulse_n_s, float(collision.vibration_j[0])
            passed[row] = impulse * direction
            before, rebound = (striker.mass_kg * v**2 / 2 for v in (speed, speed - impulse / striker.mass_kg))
            moved = impulse**2 / 2 * (1 / contact.mass_kg - 1 / striker.mass_kg)
            lost = impulse * speed - impulse**2 / (2 * contact.mass_kg) - vibration
            energies[:, row] = before, rebound, vibration, moved, lost
        return Collisions(passed, profiles, StrikeEnergy(*energies))

    def channels(
        self, sample_rate_hz: float, observed: Observed, listeners: Floats | None
    ) -> Iterator[list[Source]]:
        """Yield the sources of what is heard in each channel."""
        oscillators = Oscillators.checked(self.eigenvalues, self.dampings_per_s, sample_rate_hz)
        columns = np.flatnonzero(oscillators.audible())
        modes, width = oscillators.take(columns), len(oscillators)
        still = np.zeros(len(modes))
        if listeners is None:
            bank = Resonators.of(modes, (still, still + 1), columns, width)
            for surface_weights in self.velocity_weights(observed):
                yield [Source(bank, surface_weights, None, 0.0)]
            return
        if self.rigid is None:
            raise QueryError("listener", "the file does not say the object's mass", "Build the file again.")
        for position in listeners:
            listener = Listener.at(position, self.rigid.centre_m, self.rigid.area_m2, Air())
            gains, delay = listener.click_gains(self.rigid.mass_kg), listener.delay_s
            click = Source(Resonators.of(*listener.click_oscillator(sample_rate_hz)), None, gains, delay)
            observed_modes = np.ones(width)
            if self.transfer is not None:
                bank = _through_air(self.transfer.delayed(position, delay)[columns], modes, columns, width)
            elif self.radiation_dampings_per_s is not None:
                heard = listener.radiated_weights(self.radiation_dampings_per_s[columns])
                bank = Resonators.of(modes, (still, heard), columns, width)
            else:
                heard, observed_modes = listener.modal_weights(modes.frequencies_hz), self.radiation_weights
                bank = Resonators.of(modes, (still, heard), columns, width)
            yield [Source(bank, observed_modes, None, delay), click]


def _through_air(
    heard: NDArray[np.complex128], modes: Oscillators, columns: NDArray[np.int64], width: int
) -> Resonators:
    """Return the modes as they are heard through transfers (modes,), without the inaudible.

    The pressure is Re(H V), V the velocity with exp(-i w t), so that displacement has a part in it as
    well: of exp(-c t) motions Re(H V) = Re(H) q' + Im(H) ((lambda / w) q + (c / w) q').
    """
    loud = np.abs(heard) > 10 ** (INAUDIBLE_DB / 20) * np.abs(heard).max(initial=0.0)
    modes, heard = modes.take(loud), heard[loud]
    weights = (
        heard.imag * modes.eigenvalues / modes.roots_per_s,
        heard.real + heard.imag * modes.dampings_per_s / modes.roots_per_s,
    )
    return Resonators.of(modes, weights, columns[loud], width)


@dataclass(frozen=True)
class Collisions:
    """What a striker did at contacts.

    Attributes
    ----------
    impulses_n_s : (n, 3) on the object
    profiles : courses of the forces
    energy_j : where its energy went
    """

    impulses_n_s: Floats
    profiles: list[ForceProfile]
    energy_j: StrikeEnergy


def named_striker(pulse: Pulse) -> Pulse:
    """Return one of `STRIKERS` for its name, and anything else as it is.

    Raises
    ------
    QueryError
        Another name.
    """
    if not isinstance(pulse, str):
        return pulse
    if pulse not in STRIKERS:
        remedy = f"Give seconds, a `ContactBody` or one of {', '.join(STRIKERS)}."
        raise QueryError("pulse", repr(pulse), remedy)
    return STRIKERS[pulse]


@dataclass(frozen=True)
class StrikeQuery:
    """The arguments of `SoundQueries.strike`."""

    points: ArrayLike
    impulses_n_s: ArrayLike | None = None
    duration_s: float = 2.0
    sample_rate_hz: float = 44100
    _: KW_ONLY
    modes: int | None = None
    forces_n: ArrayLike | None = None
    velocities_m_s: ArrayLike | None = None
    pulse: Pulse = None
    observed: str | ArrayLike = CONTACT
    listener: ArrayLike | None = None
    support: Support | str | None = None
