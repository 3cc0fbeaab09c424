"""The mode bank under forces given as samples: exact for the force that is linear between its samples.

A block of the sound is the free motion from the state at its start plus what the force in it does, which is
one lower triangular Toeplitz product with the response of all modes together; the state at its end is
the free one plus a product of the force in it with one table. So everything but the hand-over from
block to block is a product, and no frequency or damping meets a step of integration.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.bank import FLOOR_DB, Bank, samples_of, sound_array
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.errors import QueryError
from objectfolder.renaming import formerly_positional, renamed_keywords

Floats = NDArray[np.float64]
FORCE_BLOCK = 128
SERIES_TERMS = 24
SERIES_REACH = 1.0  # of (c + omega) h, up to which the Taylor series is summed


@renamed_keywords(forces="forces_n")
@formerly_positional
def driven_bank(
    eigenvalues: ArrayLike,
    dampings_per_s: ArrayLike,
    gains: ArrayLike,
    forces_n: ArrayLike,
    *,
    duration_s: float = 2.0,
    sample_rate_hz: float = 44100.0,
    response: str = "velocity",
    delay_samples: int = 0,
    floor_db: float = FLOOR_DB,
    out: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    """Sound of modes under sampled forces.

    Parameters
    ----------
    eigenvalues, dampings_per_s, response, floor_db, out
        As for `mode_bank`.
    gains
        (n, directions, modes) or (directions, modes): modal velocity an impulse of 1 N s gives.
    forces_n
        (n, k, directions) or (k, directions) newtons at the samples from t = 0 on, linear between them, and
        to zero within one sample after the last; a first sample that is not zero is a jump.
    delay_samples
        When the force begins.

    Returns
    -------
    ndarray
        (n, samples) float64 or `out`. Linear in the forces; a contact does not depend on others.

    Raises
    ------
    QueryError
        As for `mode_bank`.

    Examples
    --------
    >>> import numpy as np
    >>> push = np.zeros((100, 1))
    >>> push[50] = 44100.0  # newtons, over one sample: an impulse of 1 N s
    >>> tone = driven_bank([(2 * np.pi * 440) ** 2], [3.0], [[1.0]], push, duration_s=0.1)
    >>> bool((tone[0, :50] == 0).all()), float(tone[0, 51].round(2))
    (True, 1.0)
    """
    oscillators = Oscillators.checked(eigenvalues, dampings_per_s, sample_rate_hz)
    fields, pushes = _checked(gains, forces_n, len(oscillators))
    if not delay_samples >= 0:
        raise QueryError("delay_samples", f"{delay_samples}", "Give a delay that is not negative.")
    sound = sound_array(out, len(fields), samples_of(duration_s, sample_rate_hz))
    audible = np.flatnonzero(oscillators.audible())
    sounding = oscillators.take(audible)
    drive(
        sounding,
        sounding.response_weights(response),
        fields[:, :, audible],
        pushes,
        sound,
        delay_samples=delay_samples,
        floor_db=floor_db,
    )
    return sound


def _checked(gains: ArrayLike, forces: ArrayLike, modes: int) -> tuple[Floats, Floats]:
    """Gains (n, directions, modes) and forces (n, k, directions) that agree."""
    fields, pushes = np.asarray(gains, dtype=np.float64), np.asarray(forces, dtype=np.float64)
    fields = fields[None] if fields.ndim == 2 else fields
    pushes = pushes[None] if pushes.ndim == 2 else pushes
    agree = fields.ndim == pushes.ndim == 3 and fields.shape[:2] == (len(pushes), pushes.shape[2])
    if not agree or fields.shape[2] != modes:
        raise QueryError(
            "gains, forces_n",
            f"shapes {fields.shape} and {pushes.shape} for {modes} modes",
            "Give (n, directions, modes) and (n, k, directions).",
        )
    if not (np.isfinite(fields).all() and np.isfinite(pushes).all()):
        raise QueryError("gains, forces_n", "not finite", "Give numbers.")
    return fields, pushes


def drive(
    oscillators: Oscillators,
    weights: tuple[Floats, Floats],
    gains: Floats,
    forces: Floats,
    sound: NDArray[np.floating],
    *,
    delay_samples: int = 0,
    floor_db: float = FLOOR_DB,
) -> None:
    """Write into `sound` (n, samples) oscillators under forces (n, k, directions); see `driven_bank`."""
    sound[:, :delay_samples] = 0
    heard = sound[:, delay_samples:]
    bank = Bank(oscillators, weights, heard.shape[1], floor_db)
    # Forces that end after the sound are not needed to their end.
    forces = forces[:, : heard.shape[1] + 1]
    during = min(forces.shape[1], heard.shape[1])
    table = ForceTables(bank.oscillators, bank.weights, FORCE_BLOCK)
    for contact, (gain, force) in enumerate(zip(gains[:, :, bank.order], forces, strict=True)):
        onset, state = table.respond(gain, force, during)
        heard[contact, :during] = onset
        if during < heard.shape[1]:
            bank.free(bank.coefficients(state, 0.0), heard[contact : contact + 1, during:])


class ForceTables:
    """What a force that is linear over a sample does to oscillators, for blocks of samples.

    Attributes
    ----------
    block : samples of a block
    """

    def __init__(self, oscillators: Oscillators, weights: tuple[Floats, Floats], block: int) -> None:
        self.oscillators = oscillators
        self.block = block
        self._weights = np.stack(weights)
        self._basis = oscillators.basis(np.arange(block + 1))
        one, zero = np.ones(len(oscillators)), np.zeros(len(oscillators))
        # (displacement or velocity, begun with which of them, samples later, modes)
        self._motion = np.array(
            [
                [self._heard((heard, 1 - heard), state) for state in ((one, zero), (zero, one))]
                for heard in (one, zero)
            ]
        )
        # (falling from 1 or rising to 1 over a sample, displacement or velocity, samples after it, modes)
        self._after = np.array(
            [
                self._motion[:, 0] * ramp[0] + self._motion[:, 1] * ramp[1]
                for ramp in ramp_responses(oscillators)
            ]
        )
        self._block_ends = self._ends(block)
        # What is heard of each mode, (falling or rising, samples after it, modes).
        heard = np.einsum("rhkm,hm->rkm", self._after[:, :, :block], self._weights)
        self._heard_after = np.ascontiguousarray(heard)

    def respond(self, gains: Floats, forces: Floats, samples: int) -> tuple[Floats, tuple[Floats, Floats]]:
        """Sound (samples,) from rest, and displacement and velocity (1, modes) of the sample after.

        Parameters
        ----------
        gains
            (directions, modes).
        forces
            (k, directions) at the samples; zero after them.
        """
        block, modes = self.block, len(self.oscillators)
        blocks = -(-samples // block)
        padded = np.zeros((max(blocks * block + 1, len(forces)), forces.shape[1]))
        padded[: len(forces)] = forces
        frames = np.lib.stride_tricks.sliding_window_view(padded, block + 1, axis=0)[::block][:blocks]
        by_direction = np.ascontiguousarray(frames.transpose(1, 0, 2))
        matrices = self._toeplitz(*(self._heard_after @ gains.T).transpose(0, 2, 1))
        sound = np.ascontiguousarray(frames).reshape(blocks, -1) @ matrices.reshape(-1, block)
        kicks = np.zeros((2, blocks, modes))
        for frame, gain in zip(by_direction, gains, strict=True):
            kicks += np.matmul(frame, self._block_ends) * gain
        states = np.zeros((2, blocks + 1, modes))
        for index in range(blocks):
            step = min(block, samples - index * block)
            states[:, index + 1] = (self._motion[:, :, step] * states[None, :, index]).sum(axis=1)
            if step == block:
                states[:, index + 1] += kicks[:, index]
            else:
                modal = frames[index, :, : step + 1].T @ gains
                states[:, index + 1] += np.einsum("km,hkm->hm", modal, self._ends(step))
        first, second = (part[:block] for part in self._basis)
        a, b = self.oscillators.coefficients((self._weights[0], self._weights[1]), *states[:, :-1])
        sound += a @ first.T + b @ second.T
        return sound.reshape(-1)[:samples], (states[0, -1:], states[1, -1:])

    def _heard(self, weights: tuple[Floats, Floats], state: tuple[Floats, Floats]) -> Floats:
        """Free motion (block + 1, modes) from a state."""
        a, b = self.oscillators.coefficients(weights, *state)
        return np.asarray(a * self._basis[0] + b * self._basis[1])

    def _ends(self, samples: int) -> Floats:
        """Weights (2, samples + 1, modes) of the force at each sample in the state at the last."""
        fall, rise = self._after[:, :, :samples][:, :, ::-1]
        table = np.zeros((2, samples + 1, len(self.oscillators)))
        table[:, :-1] += fall
        table[:, 1:] += rise
        return table

    def _toeplitz(self, fall: Floats, rise: Floats) -> Floats:
        """Matrices (directions, block + 1, block) from forces to sound, of responses (directions, block)."""
        # A force falls over the sample after its own and rises over the one before, which the first lacks.
        both = np.zeros((len(fall), 2 * self.block + 1))
        both[:, self.block : -1] += rise
        both[:, self.block + 1 :] += fall
        windows = np.lib.stride_tricks.sliding_window_view(both, self.block, axis=1)
        matrices = windows[:, self.block :: -1].copy()
        matrices[:, 0] -= rise
        return matrices


def ramp_responses(oscillators: Oscillators) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """State after one sample from rest under a force falling from 1 to 0, and rising from 0 to 1.

    With S the impulse response, I its integral and K that of I over the sample h, the rising force leaves
    displacement K / h and velocity I / h; with the constant force, I and S, the falling one follows.

    Returns
    -------
    tuple
        ((modes,), (modes,)) displacement and velocity of each.
    """
    h = 1 / oscillators.sample_rate_hz
    once, twice, thrice = _integrals(oscillators, h)
    return (twice - thrice / h, once - twice / h), (thrice / h, twice / h)


def _integrals(oscillators: Oscillators, h: float) -> tuple[Floats, Floats, Floats]:
    """S(h), its integral and its second integral, (modes,) each, without cancellation."""
    squares, damping = oscillators.eigenvalues, oscillators.dampings_per_s
    first, second = (row[0] for row in oscillators.basis([1.0]))
    with np.errstate(over="ignore", invalid="ignore"):
        cosine_like = 1 - first - damping * second
        once = second
        twice = cosine_like / squares
        thrice = (h - second - 2 * damping * twice) / squares
    apart = oscillators.apart
    if apart.any():
        slow, fast = (rate[apart] for rate in oscillators.rates_per_s)
        width = fast - slow
        once, twice, thrice = once.copy(), twice.copy(), thrice.copy()
        for target, order in ((once, 0), (twice, 1), (thrice, 2)):
            target[apart] = h**order * (_phi(-slow * h, order) - _phi(-fast * h, order)) / width
    small = (damping + np.sqrt(squares)) * h < SERIES_REACH
    if small.any():
        taylor = _taylor(squares[small], damping[small], h)
        for target, values in zip((once, twice, thrice), taylor, strict=True):
            target[small] = values
    return once, twice, thrice


def _taylor(squares: Floats, damping: Floats, h: float) -> tuple[Floats, Floats, Floats]:
    """The same by S(h) = sum of s_k h^k / k!, s_0 = 0, s_1 = 1, s_(k+2) = -2 c s_(k+1) - lambda s_k."""
    sums = [np.zeros_like(squares) for _ in range(3)]
    before, now = np.zeros_like(squares), np.full_like(squares, h)  # s_k h^k
    for k in range(1, SERIES_TERMS):
        for order, total in enumerate(sums):
            total += now * (h**order / math.factorial(k + order))
        before, now = now, -2 * damping * h * now - squares * h * h * before
    return sums[0], sums[1], sums[2]


def _phi(z: Floats, order: int) -> Floats:
    """exp(z), (exp(z) - 1) / z, (exp(z) - 1 - z) / z^2 for orders 0, 1, 2."""
    if order == 0:
        return np.exp(z)
    safe = np.where(z == 0, 1.0, z)
    once = np.where(z == 0, 1.0, np.expm1(safe) / safe)
    if order == 1:
        return once
    series, near = np.zeros_like(z), np.clip(z, -1, 1)
    for k in range(SERIES_TERMS, 1, -1):
        series = 1 / math.factorial(k) + near * series
    # The loop ends with 1 / 2! + z / 3! + ...
    return np.where(np.abs(z) < 1, series, (once - 1) / safe)
