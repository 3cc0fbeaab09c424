"""Modes as damped oscillators, and their free motion in closed form whatever their damping.

A mass-normalised mode obeys q'' + 2 c q' + lambda q = f(t). With D = lambda - c^2 its free motions are

    C(t) = exp(-c t) cos(sqrt(D) t),    S(t) = exp(-c t) sin(sqrt(D) t) / sqrt(D),

which are smooth in D through zero: at critical damping they are exp(-c t) and t exp(-c t), beyond it cos
and sin become cosh and sinh. Far beyond it both approach the same slow exponential, and what is wanted
of them is a small difference; there the two exponentials themselves are kept.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import QueryError

Floats = NDArray[np.float64]
# Of the sample rate: modes above it are left out, those above half of it would sound at another pitch. At
# 44.1 kHz all up to 20 kHz are heard.
HIGHEST_RATIO = 0.454
# From lambda < this c^2 on the two exponentials are apart enough to be kept as such.
APART = 0.75
LARGEST_ROOT = 1e60  # squares stay finite

RESPONSES = ("displacement", "velocity", "acceleration")


@dataclass(frozen=True)
class Oscillators:
    """Damped oscillators heard at a sample rate.

    Attributes
    ----------
    eigenvalues : (modes,) float64, undamped omega^2, rad^2/s^2, positive
    dampings_per_s : (modes,) float64, c, not negative
    sample_rate_hz : of all offsets, which count samples and need not be whole
    """

    eigenvalues: Floats
    dampings_per_s: Floats
    sample_rate_hz: float

    @classmethod
    def checked(
        cls, eigenvalues: ArrayLike, dampings_per_s: ArrayLike, sample_rate_hz: float
    ) -> "Oscillators":
        """Return oscillators of values that are possible.

        Raises
        ------
        QueryError
            Values that are not finite, eigenvalues that are not positive, negative dampings, a rate that is
            not positive, or shapes that do not agree.
        """
        squares = np.asarray(eigenvalues, dtype=np.float64).reshape(-1)
        dampings = np.asarray(dampings_per_s, dtype=np.float64).reshape(-1)
        if squares.shape != dampings.shape:
            raise QueryError(
                "dampings_per_s", f"{len(dampings)} for {len(squares)} eigenvalues", "Give one a mode."
            )
        if not (np.isfinite(squares).all() and (squares > 0).all() and (squares < LARGEST_ROOT).all()):
            raise QueryError("eigenvalues", "not positive or not finite", "Leave out rigid modes.")
        if not (
            np.isfinite(dampings).all() and (dampings >= 0).all() and (dampings < LARGEST_ROOT**0.5).all()
        ):
            raise QueryError("dampings_per_s", "negative or not finite", "Give decay rates of the amplitude.")
        if not (math.isfinite(sample_rate_hz) and sample_rate_hz > 0):
            raise QueryError("sample_rate_hz", f"{sample_rate_hz} Hz", "Give a positive number.")
        return cls(squares, dampings, float(sample_rate_hz))

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def take(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> "Oscillators":
        """Return some of the oscillators."""
        return Oscillators(self.eigenvalues[which], self.dampings_per_s[which], self.sample_rate_hz)

    @cached_property
    def discriminants(self) -> Floats:
        """D = lambda - c^2, (modes,); negative where a mode does not ring."""
        return self.eigenvalues - self.dampings_per_s**2

    @cached_property
    def roots_per_s(self) -> Floats:
        """sqrt(|D|), (modes,): the damped angular frequency, or how far the two decay rates are from c."""
        return np.sqrt(np.abs(self.discriminants))

    @property
    def frequencies_hz(self) -> Floats:
        """Damped frequencies (modes,), 0 where a mode does not ring."""
        return np.where(self.discriminants > 0, self.roots_per_s, 0.0) / (2 * np.pi)

    @cached_property
    def apart(self) -> NDArray[np.bool_]:
        """Modes kept as two exponentials, (modes,)."""
        return self.eigenvalues < APART * self.dampings_per_s**2

    @cached_property
    def rates_per_s(self) -> tuple[Floats, Floats]:
        """The slower and the faster decay rate, (modes,) each; both c for a mode that rings."""
        spread = np.where(self.discriminants < 0, self.roots_per_s, 0.0)
        fast = self.dampings_per_s + spread
        # lambda / fast is c - spread without cancellation.
        return np.where(spread > 0, self.eigenvalues / np.where(fast > 0, fast, 1.0), fast), fast

    def audible(self) -> NDArray[np.bool_]:
        """Modes up to 0.454 of the sample rate, (modes,); others would alias."""
        return np.asarray(self.frequencies_hz <= HIGHEST_RATIO * self.sample_rate_hz)

    def basis(self, offsets: ArrayLike) -> tuple[Floats, Floats]:
        """Free motions C and S (seconds), or the slow and the fast exponential where `apart`.

        Parameters
        ----------
        offsets
            (n,) samples >= 0, whole or not.

        Returns
        -------
        tuple of ndarray
            (n, modes) each. The error is about 2^-52 of the phase sqrt(D) t times exp(-c t): without damping,
            2e-8 at 20 kHz after 10 minutes.
        """
        time = np.asarray(offsets, dtype=np.float64).reshape(-1, 1) / self.sample_rate_hz
        ringing = self.discriminants > 0
        if ringing.all():
            return self._ringing(time)
        first, second = (np.empty((len(time), len(self))) for _ in range(2))
        first[:, ringing], second[:, ringing] = self.take(ringing)._ringing(time)
        apart = self.apart
        close = ~(ringing | apart)
        first[:, close], second[:, close] = self.take(close)._close(time)
        slow, fast = self.rates_per_s
        first[:, apart], second[:, apart] = np.exp(-time * slow[apart]), np.exp(-time * fast[apart])
        return first, second

    def _ringing(self, time: Floats) -> tuple[Floats, Floats]:
        phase = time * self.roots_per_s
        decay = np.exp(-time * self.dampings_per_s)
        return decay * np.cos(phase), decay * (np.sin(phase) / self.roots_per_s)

    def _close(self, time: Floats) -> tuple[Floats, Floats]:
        """C and S at and just beyond critical damping."""
        spread = self.roots_per_s
        angle = time * spread
        slow, fast = (np.exp(-time * rate) for rate in self.rates_per_s)
        small = np.minimum(angle, 1.0)
        series = np.where(small > 0, np.sinh(small) / np.where(small > 0, small, 1.0), 1.0)
        near = time * np.exp(-time * self.dampings_per_s) * series
        return (slow + fast) / 2, np.where(
            angle <= 1, near, (slow - fast) / np.where(spread > 0, 2 * spread, 1)
        )

    def shift_matrix(self, basis: tuple[Floats, Floats]) -> tuple[Floats, Floats, Floats, Floats]:
        """Return what moves the origin of time: coefficients (a, b) become (m0 a + m1 b, m2 a + m3 b).

        `basis` is that of the offset the new origin has; all arrays are (n, modes).
        """
        first, second = basis
        apart = self.apart
        if not apart.any():
            return first, second, -self.discriminants * second, first
        zero = np.zeros_like(first)
        return (
            first,
            np.where(apart, zero, second),
            np.where(apart, zero, -self.discriminants * second),
            np.where(apart, second, first),
        )

    def shifted(self, coefficients: tuple[Floats, Floats], offsets: ArrayLike) -> tuple[Floats, Floats]:
        """Coefficients (n, modes) counted from a later origin; `offsets` (n,) or (1,) samples."""
        a, b = coefficients
        m0, m1, m2, m3 = self.shift_matrix(self.basis(offsets))
        return m0 * a + m1 * b, m2 * a + m3 * b

    def coefficients(
        self, weights: tuple[Floats, Floats], displacement: Floats, velocity: Floats
    ) -> tuple[Floats, Floats]:
        """Coefficients of the basis for the free response from a state.

        Parameters
        ----------
        weights
            (modes,) of displacement and of velocity in what is heard, see `response_weights`.
        displacement, velocity
            (n, modes) at the origin of time.
        """
        of_displacement, of_velocity = weights
        squares, damping = self.eigenvalues, self.dampings_per_s
        first = of_displacement * displacement + of_velocity * velocity
        second = of_displacement * (damping * displacement + velocity) - of_velocity * (
            damping * velocity + squares * displacement
        )
        apart = self.apart
        if apart.any():
            slow, fast = self.rates_per_s
            width = np.where(apart, 2 * self.roots_per_s, 1.0)
            slow_part = (velocity + fast * displacement) / width * (of_displacement - slow * of_velocity)
            fast_part = -(slow * displacement + velocity) / width * (of_displacement - fast * of_velocity)
            first, second = np.where(apart, slow_part, first), np.where(apart, fast_part, second)
        return first, second

    def response_weights(self, response: str) -> tuple[Floats, Floats]:
        """Weights (modes,) of displacement and velocity that make a response.

        Raises
        ------
        QueryError
            A response that is not one of `RESPONSES`.
        """
        ones, zeros = np.ones(len(self)), np.zeros(len(self))
        if response == "displacement":
            return ones, zeros
        if response == "velocity":
            return zeros, ones
        if response == "acceleration":
            return -self.eigenvalues, -2 * self.dampings_per_s
        raise QueryError("response", f"{response!r}", f"Give one of {', '.join(RESPONSES)}.")

    def lifetimes(self, floor_db: float) -> Floats:
        """Samples (modes,) after which a mode stays below `floor_db` of its start; inf without damping.

        With r the slower rate and w the damped angular frequency, |C| + max(w, c) |S| is at most twice
        exp(-r t) (1 + c min(t, 1 / w)); the time is where this envelope has fallen by `floor_db`.
        """
        slow, _ = self.rates_per_s
        period = np.where(self.discriminants > 0, 1 / np.maximum(self.roots_per_s, 1e-300), np.inf)
        needed = -floor_db / 20 * math.log(10)
        safe = np.where(slow > 0, slow, 1.0)
        time = np.full(len(self), needed) / safe
        for _ in range(12):
            before = time
            time = (needed + np.log1p(self.dampings_per_s * np.minimum(time, period))) / safe
            if (time == before).all():
                break
        return np.where(slow > 0, np.ceil(time * self.sample_rate_hz), np.inf)
