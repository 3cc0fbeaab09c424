"""An object's sound in blocks, for scenes that go on."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.struck_body import Observed, Pulse, StruckBody, along
from objectfolder.audio.synthesis.voices import Voices
from objectfolder.errors import QueryError
from objectfolder.query_values import point_rows, real, real_array

Floats = NDArray[np.float64]
LATEST = 2.0**53  # sample: the last that a float64 counts to
ContactQuery = Callable[[Floats, Floats, Floats | None], tuple[Floats, Floats, Floats | None]]


class ObjectStream:
    """The sound of an object in a scene that goes on; `ObjectFile.stream` makes one.

    Parameters
    ----------
    body
        The struck object.
    contacts
        Checks points and forces, and brings the points onto the surface.
    sample_rate_hz
        Of the sound.
    observed
        Where the surface velocity is asked, see `StruckBody.sounds`.
    listeners
        (channels, 3) metres, or None for the surface velocity.

    Examples
    --------
    >>> import objectfolder
    >>> bar = objectfolder.load("bar.safetensors")
    >>> stream = bar.stream()
    >>> stream.strike([0, 0, 0.004], [0, 0, -0.1], at=100)
    >>> block = stream.block(256)
    >>> bool((block[0, :100] == 0).all()), bool(abs(block[0, 100]) > 0)
    (True, True)
    """

    def __init__(
        self,
        body: StruckBody,
        contacts: ContactQuery,
        sample_rate_hz: float,
        observed: Observed,
        listeners: Floats | None,
    ) -> None:
        self._body = body
        self._contacts = contacts
        self._rate = sample_rate_hz
        self._channels = [
            [
                (
                    source,
                    Voices(
                        source.oscillators,
                        source.weights,
                        columns=source.columns,
                        all_modes=len(body.eigenvalues) if source.gains is None else 1,
                    ),
                )
                for source in sources
            ]
            for sources in body.channels(sample_rate_hz, observed, listeners)
        ]

    @property
    def now(self) -> int:
        """Samples given so far, the index of the next one."""
        return self._channels[0][0][1].now

    @property
    def silent(self) -> bool:
        """Whether nothing sounds and nothing waits."""
        return all(voices.silent for sources in self._channels for _, voices in sources)

    def strike(self, point: Floats, force: Floats, *, at: float | None = None, pulse: Pulse = None) -> None:
        """Let a contact begin; each listener hears it later by the way from the object.

        Parameters
        ----------
        point
            (3,) metres, within the tolerance of the surface.
        force
            (3,) newton seconds, or (k, 3) newtons at the samples (then `at` and the way are whole samples).
        at
            Sample at which it begins, `now` or later.
        pulse
            As for `ObjectFile.strike`.

        Raises
        ------
        QueryError
            As for `ObjectFile.strike`; a sample that has passed.
        """
        at = self.now if at is None else real("at", at, self.now, LATEST)
        pushed, place = real_array("force", force), point_rows(point, "point")
        if len(place) != 1:
            raise QueryError("point", f"{len(place)} points", "Add contacts one by one.")
        given = pushed[None] if pushed.ndim == 2 else pushed
        points, forces, _ = self._contacts(place, given, None)
        pulses = self._body.pulses(points, forces, pulse)
        pulse_s = None if pulses is None else float(np.asarray(pulses).reshape(-1)[0])
        motion = self._body.motion(points)
        for source, voices in (pair for sources in self._channels for pair in sources):
            field = source.field(motion)
            if forces.ndim == 3:
                voices.push(field[0], forces[0], at=round(at) + source.delay_samples)
            else:
                voices.strike(along(forces, field)[0], at=at + source.delay_s * self._rate, pulse_s=pulse_s)

    def block(self, samples: int) -> Floats:
        """Return the next samples (channels, samples) float64, in the unit `ObjectFile.strike` answers in."""
        return np.stack([sum(voices.block(samples) for _, voices in sources) for sources in self._channels])
