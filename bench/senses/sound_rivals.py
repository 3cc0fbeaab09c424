"""Sound of real objects at contacts that no fit has seen: AudioNet against the published ways.

    python -m bench sound_rivals --folder FOLDER [--objects CATALOGUE.csv]

Truth are solved modes at held-out points; FOLDER keeps them. Compared:

- AudioNet, this project's;
- the gains network of ObjectFolder 2.0 and the spectrogram network of 1.0, trained on the same points for
  well under a minute of one core each. The published code wants a GPU: these figures say what the networks
  reach at this cost, not what they can reach. So short a training leaves the spectrogram network near
  silence;
- the papers' mean over the four nearest vertices, here of true gains at the training points;
- silence, by which to read the distances.
"""

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench.record import conclude
from bench.rivals.audio.gains_network import fit_gains_network
from bench.rivals.audio.spectrogram import SAMPLE_RATE_HZ
from bench.rivals.audio.spectrogram_network import fit_spectrogram_network
from bench.rivals.audio.vertex_mean import nearest_vertex_mean
from bench.senses.audionet import DURATION_S, struck
from bench.senses.catalogue import Scans, scan_arguments
from objectfolder.audio.audionet.fitting import fit_audionet
from objectfolder.audio.synthesis import mode_bank
from objectfolder.fidelity.sounds import envelope_distance, gain_error_db, stft_distance
from objectfolder.products.store import Product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface

OBJECTS = ("025_mug", "Room_Essentials_Salad_Plate_Turquoise", "031_spoon")
MODES = {"max_modes": 128, "training_points": 4000, "held_out_points": 400}
CONTACTS = 12
SEED = 1
COMPARED = (
    "AudioNet, the papers' networks and the papers' mean over vertices against solved modes at held-out "
    "points: relative error of gains in dB, STFT and ENV distance of 2 s of sound by "
    "objectfolder.fidelity.sounds from modes up to 0.45 of the rate, stored bytes, and CPU seconds"
)


class Contest:
    """One object's truth, and every way's distance from it.

    Parameters
    ----------
    surface
        Of the object.
    truth
        Its modes.
    steps
        Training of the gains network and of the spectrogram network.
    """

    def __init__(self, surface: Surface, truth: Product, steps: tuple[int, int]) -> None:
        self._surface, self._truth, self._steps = surface, truth, steps
        held_out = truth["held_out"]
        shapes = truth["mode_shapes"].astype(np.float64)
        self._points, self._shapes = truth["points"][~held_out], shapes[~held_out]
        self._asked, self._gains = truth["points"][held_out], shapes[held_out]
        self._sounds = struck(truth, self._gains[:CONTACTS], SAMPLE_RATE_HZ)

    def ways(self) -> dict[str, Callable[[], dict[str, Any]]]:
        """Every way by name."""
        return {
            "AudioNet": self._audionet,
            "2.0 gains network": self._gains_network,
            "1.0 spectrogram network": self._spectrogram_network,
            "4-nearest mean of truth": self._vertex_mean,
            "silence": lambda: self._distances(0 * self._sounds),
        }

    def _audionet(self) -> dict[str, Any]:
        start = time.process_time()
        net = fit_audionet(decode_surface(encode_surface(self._surface)), self._truth)
        training = time.process_time() - start
        size = sum(tensor.nbytes for tensor in net.tensors().values())
        return {**self._by_gains(net.gains), "bytes": size, "training_cpu_s": training}

    def _gains_network(self) -> dict[str, Any]:
        net = fit_gains_network(self._points, self._shapes, steps=self._steps[0], seed=SEED)
        training = {"bytes": net.bytes, "training_cpu_s": net.training.cpu_s}
        return {**self._by_gains(net.gains), **training}

    def _spectrogram_network(self) -> dict[str, Any]:
        truth, each = self._truth, np.eye(self._shapes.shape[2])
        sounds = mode_bank(
            truth["eigenvalues"],
            truth["dampings_per_s"],
            each,
            duration_s=DURATION_S,
            sample_rate_hz=SAMPLE_RATE_HZ,
        )
        net = fit_spectrogram_network(
            self._points,
            self._shapes * truth["radiation_weights"],
            sounds,
            steps=self._steps[1],
            seed=SEED,
        )
        impulses = np.eye(3)[np.arange(CONTACTS) % 3]
        start = time.process_time()
        answer = net.sounds(self._asked[:CONTACTS], impulses)
        return {
            **self._distances(answer),
            "query_cpu_s": (time.process_time() - start) / CONTACTS,
            "bytes": net.bytes,
            "training_cpu_s": net.training.cpu_s,
        }

    def _vertex_mean(self) -> dict[str, Any]:
        size = 4 * (self._points.size + self._shapes.size) + 24 * self._shapes.shape[2]
        mean = self._by_gains(lambda asked: nearest_vertex_mean(self._points, self._shapes, asked))
        return {**mean, "bytes": size}

    def _by_gains(self, gains: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
        """Measures of a way that answers gains (n, 3, modes) of the true modes at points (n, 3)."""
        answer = gains(self._asked)
        seconds = []
        for point in self._asked[:CONTACTS]:
            start = time.process_time()
            struck(self._truth, gains(point[None]), SAMPLE_RATE_HZ)
            seconds.append(time.process_time() - start)
        return {
            "gain_error_db": gain_error_db(self._gains, answer),
            **self._distances(struck(self._truth, answer[:CONTACTS], SAMPLE_RATE_HZ)),
            "query_cpu_s": float(np.median(seconds)),
        }

    def _distances(self, answer: np.ndarray) -> dict[str, Any]:
        return {
            "stft_distance_16_khz": stft_distance(self._sounds, answer, SAMPLE_RATE_HZ),
            "envelope_distance_16_khz": envelope_distance(self._sounds, answer),
        }


def main() -> None:
    parser = scan_arguments("AudioNet against the published ways", "solved modes")
    parser.add_argument("--only", nargs="+", default=OBJECTS)
    parser.add_argument("--gains-steps", type=int, default=1000, help="training of the 2.0 network")
    parser.add_argument("--spectrogram-steps", type=int, default=400, help="training of the 1.0 network")
    given = parser.parse_args()
    scans = Scans(given.objects)
    figures = {}
    for name in given.only:
        surface = scans.surface(name)
        truth = scans.modes(name, surface, given.folder / f"{name}.zarr.zip", seed=SEED, **MODES)
        contest = Contest(surface, truth, (given.gains_steps, given.spectrogram_steps))
        figures[name] = {"modes": len(truth["eigenvalues"]), "ways": {}}
        for way, measure in contest.ways().items():
            figures[name]["ways"][way] = measure()
            print(name, way, figures[name]["ways"][way], flush=True)
    settings = {
        **MODES,
        "contacts": CONTACTS,
        "seconds": DURATION_S,
        "sample_rate_hz": SAMPLE_RATE_HZ,
        "gains_steps": given.gains_steps,
        "spectrogram_steps": given.spectrogram_steps,
        "threads": os.environ.get("OMP_NUM_THREADS"),
    }
    conclude("sound_rivals", figures, settings, COMPARED)
