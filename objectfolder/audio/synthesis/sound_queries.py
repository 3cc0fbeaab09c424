"""What an Object File answers when it is struck."""

import math
import reprlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.audionet.audionet import AudioNet
from objectfolder.audio.synthesis.bank import samples_of
from objectfolder.audio.synthesis.earlier_forces import earlier_forces
from objectfolder.audio.synthesis.hertz import ContactBody
from objectfolder.audio.synthesis.object_stream import ObjectStream
from objectfolder.audio.synthesis.sound import Sound, StrikeEnergy
from objectfolder.audio.synthesis.sources import along
from objectfolder.audio.synthesis.struck_body import (
    CONTACT,
    RMS,
    Observed,
    Pulse,
    RigidBody,
    StrikeQuery,
    StruckBody,
    named_striker,
)
from objectfolder.audio.synthesis.support import Support, named_support
from objectfolder.errors import QueryError
from objectfolder.forks import hold_forks
from objectfolder.query_values import point_rows, real, real_array, require_room, whole
from objectfolder.renaming import formerly_positional, renamed_keywords
from objectfolder.signatures import same_arguments
from objectfolder.surface.contact_surface import ContactSurface
from objectfolder.surface.surface import ClosestPoints

LARGEST_FORCE = 1e12
SAMPLE_RATES_HZ = (1.0, 1e8)
LONGEST_S = 1e6
MOST_MODES = 10**9  # that a query may name: more than there are stands for all
Parts = Iterator[tuple[slice, NDArray[np.float32], StrikeEnergy | None]]
LEAST_KG = 1e-9  # of a body whose mass is not known


class SoundQueries:
    """The sound of contacts: `ObjectFile.sound`.

    Parameters
    ----------
    net
        The encoder of sound.
    contacts
        The surface, metres, that contacts are brought onto.
    description
        Of the Object File: its ``body`` and ``material``.
    """

    def __init__(self, net: AudioNet, contacts: ContactSurface, description: Mapping[str, Any]) -> None:
        self.net = net
        self.contacts = contacts
        self.description = description

    @renamed_keywords(duration="duration_s", sample_rate="sample_rate_hz")
    @formerly_positional
    @earlier_forces("forces", "impulses_n_s", "forces_n", 3, stacklevel=4)
    @hold_forks
    def strike(
        self,
        points: ArrayLike,
        impulses_n_s: ArrayLike | None = None,
        duration_s: float = 2.0,
        sample_rate_hz: float = 44100,
        *,
        modes: int | None = None,
        forces_n: ArrayLike | None = None,
        velocities_m_s: ArrayLike | None = None,
        pulse: Pulse = None,
        observed: str | ArrayLike = CONTACT,
        listener: ArrayLike | None = None,
        support: Support | str | None = None,
    ) -> Sound:
        """Sound the object under contacts.

        Parameters
        ----------
        points
            (3,) or (n, 3) contacts, metres, within `surface_tolerance_m` of the surface.
        impulses_n_s
            (3,) or (n, 3) newton seconds (the papers' unit forces lasting one second). None, without forces
            and velocities, strikes each point with 1 N s inwards, against the surface's normal, and a striker
            with 1 m/s. Impulses with a striker are those that it would pass on to the object as a rigid body
            without loss, and set its speed.
        duration_s
            Seconds.
        sample_rate_hz
            Hertz; modes above 0.454 of it are left out, they would alias.
        modes
            Number of the lowest modes to sound; all by default.
        forces_n
            In place of impulses: (k, 3) or (n, k, 3) newtons at the samples from t = 0 on, linear between
            them.
        velocities_m_s
            In place of impulses: (3,) or (n, 3) of the striker that `pulse` is.
        pulse
            How an impulse is spent: None, at once; seconds, one or (n,), as half a sine of that length; or
            what strikes, a `ContactBody`, ``"wood"``, ``"steel"`` or ``"finger"``. Striker, object and its
            modes then move together through Hertz's contact, the object flat where it is struck, until they
            part; the force acts along the velocity. `energy_j` of the sound is where the energy went.
        observed
            Where the velocity of the surface along its outward normal is asked, without a listener:
            ``"contact"``, at the struck point itself (on an edge, of one of its faces); (3,) or (channels, 3)
            points of the surface; or ``"rms"``, the sum over modes of modal velocity times the rms over the
            surface of the mode's normal component. The last depends on the signs of mode shapes, which are
            arbitrary: fidelity compares sounds so, as the papers do.
        listener
            (3,) or (channels, 3) metres, object frame, for instance two ears. The answer is then the pressure
            in free air of the modes and of the accelerating body (its click), later by the way from the
            object. Where the file has each mode's transfer (`modes.transfer`), a mode is heard through it, in
            every direction as it radiates there; places are then outside of the sphere round the object.
            Without it, and for the click, models are used, described in `objectfolder.audio.synthesis.air`.
        support
            What holds or carries the object: a `Support`, or ``"lying"`` for `Support.lying`; None, nothing:
            it is free.

        Returns
        -------
        Sound
            An array (n, samples) float32 that notebooks play, at true amplitude: metres a second, linear in
            the force, zeros for an object without audible modes (`modes.frequencies_hz` is empty). With a
            listener pascals. (n, channels, samples) for points or listeners (channels, 3).

        Raises
        ------
        QueryError
            A contact off the surface (with its distance), or values that are not finite; impulses beside
            forces; a listener to an object of unknown mass.
        FormatError
            A file whose gains no body of its mass has.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> import numpy as np
        >>> points, normals = bar.sample_contacts()
        >>> sound = bar.strike(points, duration_s=1.0)  # 1 N s inwards
        >>> sound.shape, sound.dtype.name
        ((1, 44100), 'float32')
        >>> bool(np.allclose(bar.strike(points, -2 * normals, 1.0), 2 * sound))  # twice as hard
        True
        """
        query = StrikeQuery(
            points, impulses_n_s, duration_s, sample_rate_hz, modes=modes, forces_n=forces_n,
            velocities_m_s=velocities_m_s, pulse=pulse, observed=observed, listener=listener, support=support,
        )  # fmt: skip
        shape, single, parts = self._struck(query)
        remedy = "Use `strikes`, which answers in parts, or ask for less at a time."
        require_room("points, duration_s", 4 * math.prod(shape), remedy)
        sound, energies = np.empty(shape, dtype=np.float32), []
        for rows, part, energy in parts:
            sound[rows] = part
            energies.append(energy)
        return Sound.of(sound[:, 0] if single else sound, sample_rate_hz, StrikeEnergy.of_all(energies))

    @renamed_keywords(duration="duration_s", sample_rate="sample_rate_hz")
    @formerly_positional
    @earlier_forces("forces", "impulses_n_s", "forces_n", 3, stacklevel=4)
    @same_arguments(strike)
    def strikes(self, *arguments: Any, **keywords: Any) -> Iterator[tuple[slice, NDArray[np.float32]]]:
        """Sound any number of contacts in bounded memory: yield rows and what `strike` answers for them.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(100)
        >>> sum(len(part) for rows, part in bar.strikes(points, duration_s=0.1))
        100
        """
        _, single, parts = self._struck(StrikeQuery(*arguments, **keywords))
        for rows, part, _ in iter(hold_forks(lambda: next(parts, None)), None):
            yield rows, part[:, 0] if single else part

    @renamed_keywords(impulses="impulses_n_s", times="times_s")
    @hold_forks
    def rms_velocity(
        self, points: ArrayLike, impulses_n_s: ArrayLike, times_s: ArrayLike, modes: int | None = None
    ) -> NDArray[np.float64]:
        """Return how fast the whole surface moves after impulses: (n, times) metres a second.

        It is the rms over the surface of the velocity along the normal, with the modes' powers added up and
        each taken in the mean over its period: `sqrt(sum_i (r_i a_i exp(-c_i t))^2 / 2)`, `a_i` the modal
        velocity that the impulse gives and `r_i` the rms of the mode's normal component. Modes that do not
        ring are left out.

        Parameters
        ----------
        points, impulses_n_s, modes
            (n, 3) as for `strike`, newton seconds.
        times_s
            (times,) seconds after the impulse.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(1, seed=0)
        >>> level = bar.rms_velocity(points, -normals, [0.0, 0.1])
        >>> level.shape, bool(level[0, 1] < level[0, 0])
        ((1, 2), True)
        """
        seconds = real_array("times_s", times_s).reshape(-1)
        if not (seconds >= 0).all():
            raise QueryError("times_s", reprlib.repr(seconds.tolist()), "Give seconds after the impulse.")
        contacts, pushes = self._impulses(points, impulses_n_s)
        body = self._struck_body(modes)
        numbers = len(seconds) * (len(contacts) + len(body.eigenvalues))
        require_room("points, times_s", 8 * numbers, "Ask for fewer times, or fewer contacts.")
        return body.rms_velocity(contacts, pushes, seconds)

    @renamed_keywords(impulses="impulses_n_s")
    @hold_forks
    def mode_velocities(
        self, points: ArrayLike, impulses_n_s: ArrayLike, modes: int | None = None
    ) -> NDArray[np.float64]:
        """Return what each mode adds to `strike` at first: (n, modes) metres a second.

        It is the velocity along the normal at the struck point that an impulse gives each mode.

        Parameters
        ----------
        points, impulses_n_s, modes
            As for `rms_velocity`.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(2, seed=0)
        >>> velocities = bar.mode_velocities(points, -normals)
        >>> velocities.shape == (2, len(bar.modes.frequencies_hz)), bool((velocities <= 0).all())
        (True, True)
        """
        contacts, pushes = self._impulses(points, impulses_n_s)
        motion = self._struck_body(modes).motion(contacts)
        return along(pushes, motion.shapes) * motion.normal

    def _impulses(self, points: ArrayLike, impulses_n_s: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return contacts on the surface and impulses, (n, 3) each."""
        places, pushes = self._pushes(points, real_array("impulses_n_s", impulses_n_s), None)
        return places.points, pushes

    @renamed_keywords(sample_rate="sample_rate_hz")
    @hold_forks
    def stream(
        self,
        sample_rate_hz: float = 44100,
        *,
        observed: str | ArrayLike = CONTACT,
        listener: ArrayLike | None = None,
        support: Support | str | None = None,
    ) -> ObjectStream:
        """Return a silent stream: contacts are added as they come, sound is taken in blocks.

        Parameters
        ----------
        observed, listener, support
            As for `strike`.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> stream = bar.stream()
        >>> stream.strike([0, 0, 0.004], [0, 0, -0.1])
        >>> block = stream.block(512)
        >>> block.shape, stream.now, stream.silent
        ((1, 512), 512, False)
        """
        ears = self._listeners(listener)
        places = self._places(observed)
        rate_hz = real("sample_rate_hz", sample_rate_hz, *SAMPLE_RATES_HZ, " Hz")
        return ObjectStream(self._struck_body(None, support), self._pushes, rate_hz, places, ears)

    @hold_forks
    def _struck(self, query: StrikeQuery) -> tuple[tuple[int, int, int], bool, Parts]:
        """Return the shape (n, channels, samples), whether there is one channel by name, and its parts."""
        points, observed, listener = query.points, query.observed, query.listener
        impulses_n_s, forces_n, velocities_m_s = query.impulses_n_s, query.forces_n, query.velocities_m_s
        pulse = named_striker(query.pulse)
        if velocities_m_s is not None and not isinstance(pulse, ContactBody):
            raise QueryError("velocities_m_s", "given without a striker", 'Name it: pulse="steel".')
        if velocities_m_s is not None and (impulses_n_s is not None or forces_n is not None):
            raise QueryError("velocities_m_s", "given beside impulses or forces", "Give one of them.")
        if velocities_m_s is None:
            at, pushes = self._pushes(points, impulses_n_s, forces_n)
        else:
            at, pushes = self._pushes(points, velocities_m_s, None, "velocities_m_s")
        ears = self._listeners(listener)
        rate_hz = real("sample_rate_hz", query.sample_rate_hz, *SAMPLE_RATES_HZ, " Hz")
        duration_s = real("duration_s", query.duration_s, 1 / rate_hz, LONGEST_S, " s")
        places = self._places(observed)
        heard = places if listener is None else ears
        body = self._struck_body(query.modes, query.support)
        if isinstance(pulse, ContactBody) and impulses_n_s is None and forces_n is None:
            pushes = body.passed_on(at.points, pushes, pulse)
        channels = len(heard) if isinstance(heard, np.ndarray) else 1
        samples = samples_of(duration_s, rate_hz)
        remedy = "Ask for less time at once, or a lower rate."
        require_room("duration_s, sample_rate_hz", 4 * channels * samples, remedy)
        parts = body.sounds(at, pushes, duration_s, rate_hz, pulse=pulse, observed=places, listeners=ears)
        single = np.ndim(observed if listener is None else listener) < 2
        return (len(at), channels, samples), single, parts

    def _places(self, observed: str | ArrayLike) -> Observed:
        """Return a name, or points (channels, 3) on the surface."""
        if not isinstance(observed, str):
            return self.contacts.project(point_rows(observed, "observed", 1), name="observed").points
        if observed not in (CONTACT, RMS):
            raise QueryError(
                "observed", f"{observed!r}", f"Use {CONTACT!r}, {RMS!r} or points of the surface."
            )
        return observed

    def _pushes(
        self,
        points: ArrayLike | ClosestPoints,
        impulses_n_s: ArrayLike | None,
        forces_n: ArrayLike | None,
        name: str = "impulses_n_s",
    ) -> tuple[ClosestPoints, np.ndarray]:
        """Return n contacts on the surface, and impulses (n, 3) by their name or forces (n, k, 3) on them."""
        places = points if isinstance(points, ClosestPoints) else self.contacts.project(points)
        count = len(places)
        if forces_n is not None and impulses_n_s is not None:
            raise QueryError("impulses_n_s, forces_n", "both given", "Give one of them.")
        if forces_n is not None:
            name, remedy = "forces_n", "Give (n, k, 3) newtons at the samples."
            pushes = real_array(name, forces_n, remedy)
            pushes = pushes[None] if pushes.ndim == 2 else pushes
        elif impulses_n_s is not None:
            remedy = "Give (n, 3), one for each point."
            pushes = real_array(name, impulses_n_s, remedy)
            pushes = pushes[None] if pushes.ndim == 1 else pushes
        else:
            return places, -self.contacts.normals(places)
        if pushes.ndim != (2 if forces_n is None else 3) or pushes.shape[-1] != 3 or 0 in pushes.shape[1:]:
            raise QueryError(name, f"shape {pushes.shape}", remedy)
        if not np.abs(pushes).max(initial=0.0) <= LARGEST_FORCE:
            raise QueryError(name, f"above {LARGEST_FORCE:g}", remedy)
        if len(pushes) not in (1, count):
            raise QueryError(name, f"{len(pushes)} for {count} points", "Give one a point.")
        return places, np.broadcast_to(pushes, (count, *pushes.shape[1:]))

    def _listeners(self, listener: ArrayLike | None) -> np.ndarray | None:
        return None if listener is None else point_rows(listener, "listener", 1)

    def _gains(self, points: np.ndarray | ClosestPoints) -> np.ndarray:
        """Return `AudioNet.gains_of_mass` of the body."""
        body = self.description.get("body")
        return self.net.gains_of_mass(points, float(body["filled_mass_kg"]) if body else LEAST_KG)

    def _struck_body(self, modes: int | None, support: Support | str | None = None) -> StruckBody:
        """Modes, as a support changes them, and body as synthesis takes them.

        Raises
        ------
        QueryError
            The object has no sound: with the reason.
        """
        if self.net.absent is not None:
            finding = f"the object has no sound: {self.net.absent}"
            raise QueryError("audio", finding, "It can be seen and felt.")
        modes = None if modes is None else whole("modes", modes, 0, MOST_MODES)
        support = named_support(support)
        net, body, material = self.net, self.description.get("body"), self.description.get("material")
        rigid = RigidBody.of(body, self.contacts.surface) if body else None
        eigenvalues, dampings = net.eigenvalues[:modes], net.dampings_per_s[:modes]
        if support is not None:
            support_gains = self._gains(self.contacts.project(support.points, name="support").points)[
                :, :, : len(eigenvalues)
            ]
            radiated = net.radiation_dampings_per_s
            stiffer, faster = support.added(support_gains, None if radiated is None else radiated[:modes])
            eigenvalues, dampings = eigenvalues + stiffer, dampings + faster
        return StruckBody(
            eigenvalues,
            dampings,
            net.radiation_weights[:modes],
            self._gains,
            self.contacts.normals,
            rigid,
            (material["youngs_modulus_pa"], material["poisson_ratio"]) if material else None,
            net.transfer,
            None if net.radiation_dampings_per_s is None else net.radiation_dampings_per_s[:modes],
        )
