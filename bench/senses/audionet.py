"""AudioNet on real objects: error at points it has not seen, bytes, cost of fitting and of queries.

    python -m bench audionet --folder FOLDER [--objects CATALOGUE.csv] [--only ID ...]

Solved modes are read from FOLDER as ``id.zarr.zip``, or solved and written there. Each object's row is kept
beside them as ``id.json`` and not measured again: remove the rows when the code has changed.
"""

import time
from pathlib import Path

import numpy as np

from bench.record import conclude, rows_of, spread
from bench.senses.catalogue import Scans, scan_arguments, scan_set
from objectfolder.audio.audionet.audionet import AudioNet
from objectfolder.audio.synthesis import mode_bank
from objectfolder.fidelity.sounds import (
    envelope_distance,
    gain_error_by_mode_db,
    gain_error_by_point_db,
    gain_error_db,
    stft_distance,
    unscaled_stft_distance,
)
from objectfolder.making.audionet.fitting import fit_audionet
from objectfolder.products.store import Product
from objectfolder.surface.codec import decode_surface, encode_surface

OBJECTS = scan_set("sounding")
TRAINING_POINTS, HELD_OUT_POINTS, MOST_MODES = 16_000, 1_000, 128
SOUNDS, DURATION_S, SAMPLE_RATE_HZ = 24, 2.0, 44_100.0
SINGLE_QUERIES = 50
# ObjectFolder 2.0; loudness and length of its sounds are unpublished.
PUBLISHED = {"stft": 0.19e-5, "envelope": 1.29e-4}


def main() -> None:
    """Measure the objects."""
    options = scan_arguments("AudioNet on real objects", "solved modes", only=OBJECTS).parse_args()
    scans = Scans(options.objects)
    table = rows_of(options.only, lambda name: measure(scans, name, options.folder), options.folder)
    columns = [key for key in next(iter(table.values())) if key != "commit"]
    figures = {
        "objects": table,
        "spread": {key: spread(table.values(), key, max) for key in columns},
        "published_objectfolder_2": PUBLISHED,
        "objects_below_published": {
            key: sum(row[key] < bar for row in table.values())
            for key, bar in (
                ("stft_distance", PUBLISHED["stft"]),
                ("unscaled_stft_distance", PUBLISHED["stft"]),
                ("envelope_distance", PUBLISHED["envelope"]),
            )
        },
        "gain_error_db_rms_over_objects": float(
            10 * np.log10(np.mean([10 ** (row["gain_error_db"] / 10) for row in table.values()]))
        ),
    }
    settings = {
        "training_points": TRAINING_POINTS,
        "held_out_points": HELD_OUT_POINTS,
        "most_modes": MOST_MODES,
        "sounds": f"{SOUNDS} unit impulses along x, y, z in turn at held-out points, {DURATION_S} s, "
        f"{SAMPLE_RATE_HZ} Hz",
        "times": "CPU seconds",
    }
    compared = (
        "AudioNet with its defaults against the solved modes it was fitted to, at points of the true surface "
        "that it has not seen: gain error 20 log10(|g - g truth| / |g truth|) over points, directions, modes"
    )
    conclude("audionet", figures, settings, compared)


def measure(scans: Scans, name: str, folder: Path) -> dict[str, float]:
    """Solve one object, fit it and measure the fit."""
    surface = scans.surface(name)
    settings = {
        "max_modes": MOST_MODES,
        "training_points": TRAINING_POINTS,
        "held_out_points": HELD_OUT_POINTS,
    }
    modes = scans.modes(name, surface, folder / f"{name}.zarr.zip", seed=0, **settings)
    stored = decode_surface(encode_surface(surface))
    start = time.process_time()
    fitted = fit_audionet(stored, modes)
    fit_s = time.process_time() - start
    start = time.process_time()
    net = AudioNet.from_tensors(fitted.tensors(), fitted.metadata(), stored)
    open_s = time.process_time() - start
    held_out = modes["held_out"]
    points, truth = modes["points"][held_out], modes["mode_shapes"][held_out].astype(np.float64)
    start = time.process_time()
    net.gains(points[:1])
    first_s = time.process_time() - start
    single = []
    for point in points[:SINGLE_QUERIES]:
        start = time.process_time()
        net.gains(point[None])
        single.append(time.process_time() - start)
    start = time.process_time()
    answer = net.gains(points)
    batch_s = time.process_time() - start
    by_mode, by_point = gain_error_by_mode_db(truth, answer), gain_error_by_point_db(truth, answer)
    sounds = [struck(modes, gains[:SOUNDS], SAMPLE_RATE_HZ) for gains in (truth, answer)]
    return {
        "modes": float(truth.shape[2]),
        "gain_error_db": gain_error_db(truth, answer),
        "gain_error_median_mode_db": float(np.median(by_mode)),
        "gain_error_worst_mode_db": float(by_mode.max()),
        "gain_error_95_percent_of_points_db": float(np.quantile(by_point, 0.95)),
        "gain_error_worst_point_db": float(by_point.max()),
        "stft_distance": stft_distance(sounds[0], sounds[1], SAMPLE_RATE_HZ),
        "unscaled_stft_distance": unscaled_stft_distance(sounds[0], sounds[1]),
        "envelope_distance": envelope_distance(sounds[0], sounds[1]),
        "silence_unscaled_stft_distance": unscaled_stft_distance(sounds[0], 0 * sounds[0]),
        "silence_envelope_distance": envelope_distance(sounds[0], 0 * sounds[0]),
        "bytes": float(sum(tensor.nbytes for tensor in net.tensors().values())),
        "control_points": float(net.metadata()["control_points"]),
        "corrections": float(net.metadata()["corrections"]),
        "fit_cpu_s": fit_s,
        "open_cpu_s": open_s,
        "first_query_cpu_s": first_s,
        "single_query_cpu_ms": 1e3 * float(np.median(single)),
        "batch_points_per_cpu_s": len(points) / batch_s,
    }


def struck(modes: Product, gains: np.ndarray, rate_hz: float) -> np.ndarray:
    """Sounds (n, samples) of unit impulses along x, y and z in turn on gains (n, 3, modes)."""
    impulses = np.eye(3)[np.arange(len(gains)) % 3]
    amplitudes = np.einsum("nk,nkm->nm", impulses, gains) * modes["radiation_weights"]
    sounds = mode_bank(
        modes["eigenvalues"],
        modes["dampings_per_s"],
        amplitudes,
        duration_s=DURATION_S,
        sample_rate_hz=rate_hz,
    )
    return np.asarray(sounds, dtype=np.float64)
