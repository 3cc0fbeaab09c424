"""The mode bank under forces given as samples: exact for the force that is linear between its samples."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.synthesis.bank import FLOOR_DB, samples_of, sound_array
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.audio.synthesis.resonators import Resonators
from objectfolder.errors import QueryError
from objectfolder.renaming import formerly_positional, renamed_keywords

Floats = NDArray[np.float64]


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
    bank = Resonators.of(oscillators, weights, floor_db)
    # Forces that end after the sound are not needed to their end.
    during = min(forces.shape[1], max(sound.shape[1] - delay_samples, 0))
    buffer = np.empty((1, sound.shape[1]))
    for row, gain, force in zip(sound, gains[:, :, bank.order], forces, strict=True):
        buffer[:] = 0
        coefficients = bank.drive(gain, force, buffer[0, delay_samples : delay_samples + during])
        bank.ring(coefficients[None], buffer, min(delay_samples + during, buffer.shape[1]))
        row[:] = buffer[0]
