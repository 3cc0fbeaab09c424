"""How a surface moves in each mode where it is struck, and what a channel hears of it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.bank import Pulse, drive, ring
from objectfolder.audio.synthesis.resonators import Resonators

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """How the surface moves in each mode at contacts.

    Attributes
    ----------
    shapes : (n, 3, modes) mass-normalised mode shapes, kg^-1/2
    normals : asked for (n, 3), the outward unit normals
    """

    shapes: Floats
    normals: Callable[[], Floats]

    @cached_property
    def normal(self) -> Floats:
        """Components (n, modes) of the shapes along the outward normals."""
        return along(self.normals(), self.shapes) if self.shapes.size else self.shapes[:, 0]

    def each(self) -> list["Motion"]:
        """Return those of the contacts one by one."""
        return [self._at(slice(row, row + 1)) for row in range(len(self.shapes))]

    def _at(self, row: slice) -> "Motion":
        return Motion(self.shapes[row], lambda: self.normals()[row])


@dataclass(frozen=True)
class Source:
    """Resonators as one channel hears them.

    Attributes
    ----------
    bank : of a contact's modes those that sound
    observed : (modes,) what is heard of a unit of modal velocity; None: the normal velocity of the contact
    gains : (3, modes) of a source that does not depend on the contact; None for the modes of the surface
    delay_s : on the way to the listener
    """

    bank: Resonators
    observed: Floats | None
    gains: Floats | None
    delay_s: float

    def field(self, motion: Motion) -> Floats:
        """Gains (n, 3, modes): its own, or what is heard of a contact's."""
        if self.gains is not None:
            return np.broadcast_to(self.gains, (len(motion.shapes), *self.gains.shape))
        observed = motion.normal[:, None] if self.observed is None else self.observed
        return motion.shapes * observed

    @property
    def delay_samples(self) -> int:
        """Nearest whole number of samples."""
        return round(self.delay_s * self.bank.oscillators.sample_rate_hz)

    def write(self, motion: Motion, forces: Floats, pulse: Pulse, sound: Floats) -> None:
        """Write the sound (n, samples) of contacts; `sound` is overwritten."""
        field = self.field(motion)
        if forces.ndim == 3:
            drive(self.bank, field, forces, sound, delay_samples=self.delay_samples)
        else:
            ring(self.bank, along(forces, field), sound, pulse=pulse, delay_s=self.delay_s)


def along(forces: Floats, gains: Floats) -> Floats:
    """Amplitudes (n, modes) of forces (n, 3) on gains (n, 3, modes), a row like it is alone."""
    return np.asarray((forces[:, :, None] * gains).sum(axis=1))
