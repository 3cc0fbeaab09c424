"""Solved modes against an Object File, at held-out points of the surface."""

from typing import Any

import numpy as np

from objectfolder.audio.synthesis import mode_bank
from objectfolder.audio.synthesis.struck_body import RMS
from objectfolder.fidelity.sounds import (
    cents,
    envelope_distance,
    gain_error_by_mode_db,
    gain_error_by_point_db,
    gain_error_db,
    stft_distance,
)
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import Array, Product

SOUNDS_COMPARED = 24
DURATION_S = 1.0
SAMPLE_RATE_HZ = 44100.0

SOUND_DEFINITIONS = {
    "audio.frequency_error_cents": "Largest |1200 log2(f / f solver)| over the modes of the Object File",
    "audio.damping_error_relative": "Largest relative error of a damping, Object File against the solver",
    "audio.gain_error_db": "20 log10(|g - g truth| / |g truth|) over held-out points, directions and modes",
    "audio.gain_error_by_mode_median_db": "The same for each mode alone; median over modes",
    "audio.gain_error_by_point_p95_db": "The same for each held-out point alone; 95th percentile over points",
    "audio.gain_error_by_point_worst_db": "The same for each held-out point alone; the worst point",
    "audio.stft_distance": "Mean |STFT difference|^2 over the truth's peak; Hann 400, hop 160, 512 bins",
    "audio.envelope_distance": "Root mean square difference of Hilbert envelopes over the truth's peak",
    "audio.solver_error_estimate_cents": "Estimated discretisation error of the solver on the first modes",
    "audio.solver_geometry_error_cents": "1200 log2(volume of the solid / of the surface): walls in the mean",
}


def measure_sound(file: ObjectFile, modes: Product) -> dict[str, Any]:
    """Compare the file's modes and gains with the solver's; numbers are None for a silent object."""
    truth = held_out_gains(modes)
    frequencies = modes["frequencies_hz"]
    result: dict[str, Any] = {
        "audible": bool(modes.attributes["audible"]),
        "absent": modes.attributes.get("absent"),
        "modes": len(frequencies),
        "first_frequency_hz": float(frequencies[0]) if len(frequencies) else None,
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        "solver_error_estimate_cents": modes.attributes["error_estimate_cents"],
        "solver_geometry_error_cents": modes.attributes["geometry_error_estimate_cents"],
        "count_certificate": modes.attributes["count_certificate"],
        "training_points": int((~modes["held_out"]).sum()),
        "held_out_points": len(truth),
        "damping": modes.attributes.get("damping"),
        "modes_table": [
            {
                "frequency_hz": float(f),
                "damping_per_s": float(c),
                "t60_s": float(np.log(1000.0) / c) if c else None,
            }
            for f, c in zip(frequencies, modes["dampings_per_s"], strict=True)
        ],
    }
    keys = (
        "frequency_error_cents",
        "damping_error_relative",
        "gain_error_db",
        "gain_error_by_mode_median_db",
        "gain_error_by_point_p95_db",
        "gain_error_by_point_worst_db",
    )
    if len(frequencies) == 0:
        return {**result, **dict.fromkeys((*keys, "stft_distance", "envelope_distance"))}
    answer = file.modes.gains(modes["points"][modes["held_out"]])
    ringing = modes["frequencies_hz"] > 0
    damping = modes["dampings_per_s"]
    by_point = gain_error_by_point_db(truth, answer)
    true_sounds, file_sounds = sound_pairs(file, modes)
    values = (
        float(np.abs(cents(file.modes.frequencies_hz[ringing], frequencies[ringing])).max()),
        float(np.max(np.abs(file.modes.dampings_per_s - damping) / np.maximum(damping, 1e-300))),
        gain_error_db(truth, answer),
        float(np.median(gain_error_by_mode_db(truth, answer))),
        float(np.percentile(by_point, 95)),
        float(by_point.max()),
        stft_distance(true_sounds, file_sounds, SAMPLE_RATE_HZ),
        envelope_distance(true_sounds, file_sounds),
    )
    return {**result, **dict(zip((*keys, "stft_distance", "envelope_distance"), values, strict=True))}


def held_out_gains(modes: Product) -> np.ndarray:
    """Return the solver's gains (n, 3, modes) at the held-out points."""
    return modes["mode_shapes"][modes["held_out"]].astype(np.float64)


def struck(modes: Product, count: int | None = SOUNDS_COMPARED) -> tuple[np.ndarray, np.ndarray]:
    """Return the first `count` held-out points (n, 3), or all, and impulses of 1 N s along x, y and z."""
    points = modes["points"][modes["held_out"]][:count]
    return points, np.eye(3)[np.arange(len(points)) % 3]


def struck_amplitudes(file: ObjectFile, modes: Product) -> np.ndarray:
    """Return what each mode adds to the sound of each held-out point: (2, n, modes) m/s.

    Truth first, then the Object File; points are struck as by `struck`.
    """
    points, impulses = struck(modes, None)
    answer = np.einsum("nk,nkm->nm", impulses, file.modes.gains(points))
    return np.stack([true_amplitudes(modes, None), answer * file.modes.radiation_weights])


def true_amplitudes(modes: Product, count: int | None = SOUNDS_COMPARED) -> np.ndarray:
    """Return the truth's part (n, modes) of `struck_amplitudes`, of the first `count` points or of all."""
    points, impulses = struck(modes, count)
    gains = held_out_gains(modes)[: len(points)]
    return np.einsum("nk,nkm->nm", impulses, gains) * modes["radiation_weights"]


def true_sounds(modes: Product) -> np.ndarray:
    """Return the truth's part (n, samples) of `sound_pairs`."""
    amplitudes = true_amplitudes(modes)
    sounds = mode_bank(
        modes["eigenvalues"],
        modes["dampings_per_s"],
        amplitudes,
        duration_s=DURATION_S,
        sample_rate_hz=SAMPLE_RATE_HZ,
    )
    return sounds.astype(np.float32)


def sound_pairs(file: ObjectFile, modes: Product) -> tuple[np.ndarray, np.ndarray]:
    """Strike held-out points (see `struck`): truth and Object File, (n, samples) each.

    They are observed in the papers' way, so that their distances are of what the papers compare.
    """
    points, impulses = struck(modes)
    answer = file.strike(points, impulses, DURATION_S, SAMPLE_RATE_HZ, observed=RMS)
    return true_sounds(modes), answer


def strike_arrays(file: ObjectFile, modes: Product) -> dict[str, Array]:
    """Return what the sounds of all held-out points are made from, truth and Object File, for a product.

    The truth's amplitudes of a strike are stored in steps of 1/32767 of the largest, and the Object File's
    difference from them in steps of 1/127 of its own largest.
    """
    description, dims = "truth and Object File", ("which", "mode")
    columns = {"eigenvalues": "rad^2/s^2", "dampings_per_s": "1/s"}
    modal = {name: np.stack([modes[name], getattr(file.modes, name)]) for name in columns}
    amplitudes = struck_amplitudes(file, modes)
    truth, step_of_truth = in_steps(amplitudes[0], np.int16)
    difference, step_of_difference = in_steps(amplitudes[1] - amplitudes[0], np.int8)
    steps = np.stack([step_of_truth, step_of_difference])
    differences = strike_differences_db(modal["eigenvalues"], modal["dampings_per_s"], amplitudes).astype(
        np.float32
    )
    strikes = ("strike", "mode")
    return {
        "strike_truth": Array(truth, strikes, "step", "amplitudes of held-out strikes: truth"),
        "strike_difference": Array(difference, strikes, "step", "Object File's amplitudes less the truth's"),
        "strike_steps": Array(steps, ("which", "strike"), "m/s", "steps of truth and of difference"),
        "strike_difference_db": Array(differences, ("strike",), "dB", "energy of difference over truth's"),
        **{f"strike_{name}": Array(modal[name], dims, unit, description) for name, unit in columns.items()},
    }


def in_steps(values: np.ndarray, kind: type[np.signedinteger]) -> tuple[np.ndarray, np.ndarray]:
    """Return rows as whole numbers of a step of their own, (n, modes), and the steps (n,) float32."""
    steps = (np.abs(values).max(axis=1) / np.iinfo(kind).max).astype(np.float32)
    return np.rint(values / np.where(steps > 0, steps, 1)[:, None]).astype(kind), steps


def strike_differences_db(
    eigenvalues: np.ndarray, dampings_per_s: np.ndarray, amplitudes: np.ndarray
) -> np.ndarray:
    """Return the energy of each strike's difference over the truth's, in `DURATION_S` at `SAMPLE_RATE_HZ`.

    The energy of a sum of modes is a quadratic form of their amplitudes.

    Parameters
    ----------
    eigenvalues, dampings_per_s
        (2, modes) rad^2/s^2 and 1/s: truth and Object File.
    amplitudes
        (2, n, modes) m/s.

    Returns
    -------
    ndarray
        (n,) dB; infinite where the truth alone is silent, NaN where both are.
    """
    units = [
        mode_bank(*own, np.eye(len(own[0])), duration_s=DURATION_S, sample_rate_hz=SAMPLE_RATE_HZ)
        for own in zip(eigenvalues, dampings_per_s, strict=True)
    ]
    products = np.concatenate(units) @ np.concatenate(units).T
    truth = np.concatenate([amplitudes[0], np.zeros_like(amplitudes[0])], axis=1)
    difference = np.concatenate([-amplitudes[0], amplitudes[1]], axis=1)
    size, error = (np.einsum("nm,nm->n", part @ products, part) for part in (truth, difference))
    with np.errstate(divide="ignore", invalid="ignore"):
        return 10 * np.log10(np.maximum(error, 1e-30 * size) / size)


def stored_strike(fidelity: Product, which: int, row: int) -> np.ndarray:
    """Return (samples,) m/s of a strike of `strike_arrays`; `which` is 0 for truth, 1 for the Object File."""
    eigenvalues, dampings_per_s = (
        fidelity[f"strike_{name}"][which] for name in ("eigenvalues", "dampings_per_s")
    )
    steps = fidelity["strike_steps"][:, row].astype(np.float64)
    amplitudes = steps[0] * fidelity["strike_truth"][row]
    if which:
        amplitudes = amplitudes + steps[1] * fidelity["strike_difference"][row]
    return mode_bank(
        eigenvalues, dampings_per_s, amplitudes, duration_s=DURATION_S, sample_rate_hz=SAMPLE_RATE_HZ
    )[0]
