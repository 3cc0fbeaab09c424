"""Sound of real objects at contacts that no fit has seen: AudioNet against the published ways.

    python -m bench sound_rivals --folder FOLDER [--objects CATALOGUE.csv] [--only ID ...]

Truth are solved modes at held-out points; FOLDER keeps them. Compared:

- AudioNet, this project's;
- the gains network of ObjectFolder 2.0 and the spectrogram network of 1.0, trained on the same points for
  well under a minute of one core each. The published code wants a GPU: these figures say what the networks
  reach at this cost, not what they can reach. So short a training leaves the spectrogram network near
  silence;
- the papers' mean over the four nearest vertices, here of true gains at the training points;
- silence, by which to read the distances.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench.record import conclude
from bench.rivals.audio.gains_network import fit_gains_network
from bench.rivals.audio.spectrogram_network import SAMPLE_RATE_HZ, fit_spectrogram_network
from bench.rivals.audio.vertex_mean import nearest_vertex_mean
from bench.senses.audionet import DURATION_S, struck
from bench.senses.catalogue import Scans, scan_arguments
from objectfolder.audio.synthesis import mode_bank
from objectfolder.fidelity.sounds import envelope_distance, gain_error_db, stft_distance
from objectfolder.making.audionet.fitting import fit_audionet
from objectfolder.products.store import Product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface

OBJECTS = ("025_mug", "Room_Essentials_Salad_Plate_Turquoise", "031_spoon")
MODES = {"max_modes": 128, "training_points": 4000, "held_out_points": 400}
CONTACTS, SEED = 12, 1
GAINS_STEPS, SPECTROGRAM_STEPS = 1000, 400
COMPARED = (
    "AudioNet, the papers' networks and the papers' mean over vertices against solved modes at held-out "
    "points: relative error of gains in dB, STFT and ENV distance of 2 s of sound by "
    "objectfolder.fidelity.sounds from modes up to 0.45 of the rate, stored bytes, and CPU seconds"
)


def ways(surface: Surface, truth: Product) -> dict[str, Any]:
    """Distances of every way from the truth of an object."""
    held_out, shapes = truth["held_out"], truth["mode_shapes"].astype(np.float64)
    points, training_shapes = truth["points"][~held_out], shapes[~held_out]
    queries, true = truth["points"][held_out], shapes[held_out]
    sounds = struck(truth, true[:CONTACTS], SAMPLE_RATE_HZ)

    def distances(answer: np.ndarray) -> dict[str, Any]:
        return {
            "stft_distance_16_khz": stft_distance(sounds, answer, SAMPLE_RATE_HZ),
            "envelope_distance_16_khz": envelope_distance(sounds, answer),
        }

    def by_gains(gains: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
        """Measures of a way that answers gains (n, 3, modes) of the true modes at points (n, 3)."""
        answer, seconds = gains(queries), []
        for point in queries[:CONTACTS]:
            start = time.process_time()
            struck(truth, gains(point[None]), SAMPLE_RATE_HZ)
            seconds.append(time.process_time() - start)
        return {
            "gain_error_db": gain_error_db(true, answer),
            **distances(struck(truth, answer[:CONTACTS], SAMPLE_RATE_HZ)),
            "query_cpu_s": float(np.median(seconds)),
        }

    start = time.process_time()
    net = fit_audionet(decode_surface(encode_surface(surface)), truth)
    own_cpu_s = time.process_time() - start
    gains_network = fit_gains_network(points, training_shapes, steps=GAINS_STEPS, seed=SEED)
    mode_sounds = mode_bank(
        truth["eigenvalues"],
        truth["dampings_per_s"],
        np.eye(training_shapes.shape[2]),
        duration_s=DURATION_S,
        sample_rate_hz=SAMPLE_RATE_HZ,
    )
    spectrograms = fit_spectrogram_network(
        points, training_shapes * truth["radiation_weights"], mode_sounds, steps=SPECTROGRAM_STEPS, seed=SEED
    )
    start = time.process_time()
    heard = spectrograms.sounds(queries[:CONTACTS], np.eye(3)[np.arange(CONTACTS) % 3])
    query_cpu_s = (time.process_time() - start) / CONTACTS
    costs = {
        "AudioNet": (sum(tensor.nbytes for tensor in net.tensors().values()), own_cpu_s),
        "2.0 gains network": (gains_network.bytes, gains_network.training.cpu_s),
        "1.0 spectrogram network": (spectrograms.bytes, spectrograms.training.cpu_s),
        "4-nearest mean of truth": (
            4 * (points.size + training_shapes.size) + 24 * training_shapes.shape[2],
            None,
        ),
    }
    rows: dict[str, dict[str, Any]] = {
        "AudioNet": by_gains(net.gains),
        "2.0 gains network": by_gains(gains_network.gains),
        "1.0 spectrogram network": {**distances(heard), "query_cpu_s": query_cpu_s},
        "4-nearest mean of truth": by_gains(
            lambda places: nearest_vertex_mean(points, training_shapes, places)
        ),
        "silence": distances(0 * sounds),
    }
    for way, (size, spent) in costs.items():
        rows[way] |= {"bytes": size, "training_cpu_s": spent}
    return rows


def main() -> None:
    options = scan_arguments("AudioNet against the published ways", "solved modes", only=OBJECTS).parse_args()
    scans, figures = Scans(options.objects), {}
    for name in options.only:
        surface = scans.surface(name)
        truth = scans.modes(name, surface, options.folder / f"{name}.zarr.zip", seed=SEED, **MODES)
        figures[name] = {"modes": len(truth["eigenvalues"]), "ways": ways(surface, truth)}
        print(name, figures[name], flush=True)
    settings = {
        **MODES,
        "contacts": CONTACTS,
        "seconds": DURATION_S,
        "sample_rate_hz": SAMPLE_RATE_HZ,
        "gains_steps": GAINS_STEPS,
        "spectrogram_steps": SPECTROGRAM_STEPS,
    }
    conclude("sound_rivals", figures, settings, COMPARED)
