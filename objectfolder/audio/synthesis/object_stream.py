"""An object's sound in blocks, for scenes that go on."""

from collections.abc import Callable

import numpy as np

from objectfolder.audio.synthesis.struck_body import BodyStream, Pulse

ContactQuery = Callable[
    [np.ndarray, np.ndarray, np.ndarray | None], tuple[np.ndarray, np.ndarray, np.ndarray | None]
]


class ObjectStream:
    """The sound of an object in a scene that goes on; `ObjectFile.stream` makes one.

    Parameters
    ----------
    contacts
        Checks points and forces, and brings the points onto the surface.
    stream
        The struck body, silent.

    Attributes
    ----------
    now : samples given so far, the index of the next one
    silent : whether nothing sounds and nothing waits
    """

    def __init__(self, contacts: ContactQuery, stream: BodyStream) -> None:
        self._contacts = contacts
        self._stream = stream

    @property
    def now(self) -> int:
        """Samples given so far."""
        return self._stream.now

    @property
    def silent(self) -> bool:
        """Whether nothing sounds and nothing waits."""
        return self._stream.silent

    def strike(
        self, point: np.ndarray, force: np.ndarray, *, at: float | None = None, pulse: Pulse = None
    ) -> None:
        """Let a contact begin.

        Parameters
        ----------
        point
            (3,) metres, within the tolerance of the surface.
        force
            (3,) newton seconds, or (k, 3) newtons at the samples.
        at
            Sample at which it begins, `now` or later.
        pulse
            As for `ObjectFile.strike`.

        Raises
        ------
        QueryError
            As for `ObjectFile.strike`; a sample that has passed.
        """
        pushed = np.asarray(force, dtype=np.float64)
        given = pushed[None] if pushed.ndim == 2 else pushed
        contacts, pushes, _ = self._contacts(np.reshape(point, (1, 3)), given, None)
        self._stream.strike(contacts[0], pushes[0], at, pulse)

    def block(self, samples: int) -> np.ndarray:
        """Return the next samples (channels, samples) float64, in the unit `ObjectFile.strike` answers in."""
        return self._stream.block(samples)
