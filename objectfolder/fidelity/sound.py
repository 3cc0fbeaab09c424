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
from objectfolder.object_file import ObjectFile
from objectfolder.products.store import Array, Product

SOUNDS_COMPARED = 24
DURATION_S = 1.0
SAMPLE_RATE_HZ = 44100.0

DEFINITIONS = {
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
        "per_strike": [],
        "absent": modes.attributes.get("absent"),
        "modes": len(frequencies),
        "first_frequency_hz": float(frequencies[0]) if len(frequencies) else None,
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        "solver_error_estimate_cents": modes.attributes["error_estimate_cents"],
        "solver_geometry_error_cents": modes.attributes["geometry_error_estimate_cents"],
        "count_certificate": modes.attributes["count_certificate"],
        "training_points": int((~modes["held_out"]).sum()),
        "held_out_points": len(truth),
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
    differences = [gain_error_db(*pair) for pair in zip(true_sounds, file_sounds, strict=True)]
    result["per_strike"] = [
        {"difference_db": None if np.isnan(difference) else difference} for difference in differences
    ]
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


def struck(modes: Product, count: int = SOUNDS_COMPARED) -> tuple[np.ndarray, np.ndarray]:
    """Return held-out points (n, 3) and impulses of 1 N s along x, y and z in turn."""
    points = modes["points"][modes["held_out"]][:count]
    return points, np.eye(3)[np.arange(len(points)) % 3]


def struck_amplitudes(file: ObjectFile, modes: Product) -> np.ndarray:
    """Return what each mode adds to the sounds of `sound_pairs`: (2, n, modes) m/s, truth and Object File."""
    points, impulses = struck(modes)
    answer = np.einsum("nk,nkm->nm", impulses, file.modes.gains(points))
    return np.stack([true_amplitudes(modes), answer * file.modes.radiation_weights])


def true_amplitudes(modes: Product) -> np.ndarray:
    """Return the truth's part (n, modes) of `struck_amplitudes`."""
    points, impulses = struck(modes)
    return (
        np.einsum("nk,nkm->nm", impulses, held_out_gains(modes)[: len(points)]) * modes["radiation_weights"]
    )


def true_sounds(modes: Product) -> np.ndarray:
    """Return the truth's part (n, samples) of `sound_pairs`."""
    amplitudes = true_amplitudes(modes)
    sounds = mode_bank(modes["eigenvalues"], modes["dampings_per_s"], amplitudes, DURATION_S, SAMPLE_RATE_HZ)
    return sounds.astype(np.float32)


def sound_pairs(file: ObjectFile, modes: Product) -> tuple[np.ndarray, np.ndarray]:
    """Strike held-out points (see `struck`): truth and Object File, (n, samples) each.

    They are observed in the papers' way, so that their distances are of what the papers compare.
    """
    points, impulses = struck(modes)
    answer = file.strike(points, impulses, DURATION_S, SAMPLE_RATE_HZ, observed=RMS)
    return true_sounds(modes), answer


def strike_arrays(file: ObjectFile, modes: Product) -> dict[str, Array]:
    """Return what the sounds of `sound_pairs` are made from, truth and Object File, for a product."""
    said, dims = "truth and Object File", ("which", "mode")
    columns = {"eigenvalues": "rad^2/s^2", "dampings_per_s": "1/s"}
    amplitudes = struck_amplitudes(file, modes).astype(np.float32)
    return {
        "strike_amplitudes": Array(amplitudes, ("which", "strike", "mode"), "m/s", f"held out: {said}"),
        **{
            f"strike_{name}": Array(np.stack([modes[name], getattr(file.modes, name)]), dims, unit, said)
            for name, unit in columns.items()
        },
    }


def stored_strike(fidelity: Product, which: int, row: int) -> np.ndarray:
    """Return (samples,) m/s of a strike of `strike_arrays`; `which` is 0 for truth, 1 for the Object File."""
    named = (fidelity[f"strike_{name}"][which] for name in ("eigenvalues", "dampings_per_s", "amplitudes"))
    eigenvalues, dampings_per_s, amplitudes = named
    return mode_bank(eigenvalues, dampings_per_s, amplitudes[row], DURATION_S, SAMPLE_RATE_HZ)[0]
