"""Sound of real objects at contacts that no fit has seen: AudioNet against the published ways.

Run as ``python -m bench.senses.sound_rivals``. Truth are the modes of `simulate_modes` at held-out points.
Compared:

- AudioNet, this project's;
- the gains network of ObjectFolder 2.0 and the spectrogram network of 1.0, trained on the same points for so
  many steps, by default well under a minute of one core each. The published code wants a GPU: these figures
  say what the networks reach at this cost, not what they can reach. So short a training leaves the
  spectrogram network near silence;
- the mean over the four nearest vertices, once of the modes of 32^3 cubes (the published truth), once of true
  gains at the training points (what the mean alone costs);
- silence, by which to read the distances.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import REPOSITORY, arguments, save, subplots, write
from bench.rivals.audio.gains_network import fit_gains_network
from bench.rivals.audio.spectrogram import SAMPLE_RATE_HZ, SAMPLES
from bench.rivals.audio.spectrogram_network import fit_spectrogram_network
from bench.rivals.audio.vertex_mean import nearest_vertex_mean
from bench.rivals.audio.voxels import VoxelModes, voxel_modes
from objectfolder.audio.audionet.fitting import fit_audionet
from objectfolder.audio.materials import Material, find_material, read_materials
from objectfolder.audio.modes.modes import simulate_modes
from objectfolder.audio.synthesis import mode_bank
from objectfolder.catalogue import read_catalogue
from objectfolder.fidelity.sounds import cents, envelope_distance, gain_error_db, stft_distance
from objectfolder.mesh.ingest import ingest_object
from objectfolder.mesh.mesh import textured_mesh_of
from objectfolder.products.store import Product, read_product, write_product
from objectfolder.products.tensor_file import TensorFile, write_tensor_file
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.surface import Surface

OBJECTS = ("025_mug", "Room_Essentials_Salad_Plate_Turquoise", "031_spoon")
MAX_FREQUENCY_HZ, MAX_MODES = 20000.0, 128
TRAINING_POINTS, HELD_OUT_POINTS = 4000, 400
CONTACTS = 12
SECONDS = SAMPLES / SAMPLE_RATE_HZ
FULL_RATE_HZ = 44100.0
RADIATION_POINTS = 4000
SEED = 1


def amplitudes_of(gains: np.ndarray, impulses: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Amplitudes (n, modes) of impulses (n, 3) on gains (n, 3, modes), weighted by radiation (modes,)."""
    return np.einsum("nk,nkm->nm", impulses, gains) * weights


def cpu_median(call: Callable[[int], Any], count: int) -> float:
    """Median CPU seconds of call(0) .. call(count - 1), after one call that is not counted."""
    call(0)
    seconds = []
    for index in range(count):
        start = time.process_time()
        call(index)
        seconds.append(time.process_time() - start)
    return float(np.median(seconds))


@dataclass(frozen=True)
class Contacts:
    """Held-out points, impulses of 1 N s along x, y and z in turn, and their true sounds at two rates."""

    truth: Product
    points: np.ndarray
    impulses: np.ndarray

    def ring(self, amplitudes: np.ndarray, rate_hz: float) -> np.ndarray:
        """Sounds (n, samples) of the true modes with amplitudes (n, modes)."""
        return mode_bank(
            self.truth["eigenvalues"], self.truth["dampings_per_s"], amplitudes, SECONDS, rate_hz
        )

    def sounds(self, rate_hz: float) -> np.ndarray:
        """The truth (n, samples)."""
        gains = self.truth["mode_shapes"][self.truth["held_out"]][: len(self.points)].astype(np.float64)
        return self.ring(amplitudes_of(gains, self.impulses, self.truth["radiation_weights"]), rate_hz)

    def distances(self, sounds: dict[float, np.ndarray]) -> dict[str, float]:
        """STFT and ENV distance of sounds by rate."""
        result = {}
        for rate_hz, answer in sounds.items():
            name = f"{rate_hz / 1000:.0f}_khz"
            true = self.sounds(rate_hz)
            result[f"stft_distance_{name}"] = stft_distance(true, answer, rate_hz)
            result[f"envelope_distance_{name}"] = envelope_distance(true, answer)
        return result


def by_gains(contacts: Contacts, gains: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    """Measures of a way that answers gains (n, 3, modes) of the true modes at points (n, 3)."""
    held_out = contacts.truth["held_out"]
    points = contacts.truth["points"][held_out]
    true = contacts.truth["mode_shapes"][held_out].astype(np.float64)
    answer = gains(points)
    weights = contacts.truth["radiation_weights"]
    amplitudes = amplitudes_of(answer[: len(contacts.points)], contacts.impulses, weights)

    def query(index: int) -> np.ndarray:
        found = gains(contacts.points[index : index + 1])
        amplitude = amplitudes_of(found, contacts.impulses[index : index + 1], weights)
        return contacts.ring(amplitude, SAMPLE_RATE_HZ)

    return {
        "gain_error_db": gain_error_db(true, answer),
        **contacts.distances(
            {rate: contacts.ring(amplitudes, rate) for rate in (SAMPLE_RATE_HZ, FULL_RATE_HZ)}
        ),
        "query_cpu_s": cpu_median(query, len(contacts.points)),
    }


def of_audionet(contacts: Contacts, surface: Surface) -> dict[str, Any]:
    start = time.process_time()
    stored = decode_surface(encode_surface(surface))
    net = fit_audionet(stored, contacts.truth)
    training = time.process_time() - start
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "audio.safetensors"
        write_tensor_file(path, TensorFile(net.tensors(), {}))
        size = path.stat().st_size
    return {**by_gains(contacts, net.gains), "bytes": size, "training_cpu_s": training}


def of_gains_network(contacts: Contacts, steps: int, device: str) -> dict[str, Any]:
    chosen = ~contacts.truth["held_out"]
    points, shapes = contacts.truth["points"][chosen], contacts.truth["mode_shapes"][chosen]
    net = fit_gains_network(points, shapes, steps=steps, seed=SEED, device=device)
    return {
        **by_gains(contacts, net.gains),
        "gain_error_at_training_points_db": gain_error_db(shapes, net.gains(points)),
        "bytes": net.bytes,
        "parameters": net.network.weights,
        "training_cpu_s": net.training.cpu_s,
        "training_losses": thinned(net.training.losses),
    }


def of_spectrogram_network(contacts: Contacts, steps: int, device: str) -> dict[str, Any]:
    chosen = ~contacts.truth["held_out"]
    shapes = contacts.truth["mode_shapes"][chosen]
    sounds = contacts.ring(np.eye(shapes.shape[2]), SAMPLE_RATE_HZ)
    net = fit_spectrogram_network(
        contacts.truth["points"][chosen],
        shapes * contacts.truth["radiation_weights"],
        sounds,
        steps=steps,
        seed=SEED,
        device=device,
    )
    answer = net.sounds(contacts.points, contacts.impulses)
    return {
        "gain_error_db": None,
        **contacts.distances({SAMPLE_RATE_HZ: answer}),
        "query_cpu_s": cpu_median(
            lambda index: net.sounds(contacts.points[index], contacts.impulses[index]),
            min(3, len(contacts.points)),
        ),
        "bytes": net.bytes,
        "parameters": net.network.weights,
        "training_cpu_s": net.training.cpu_s,
        "training_losses": thinned(net.training.losses),
    }


def of_vertex_mean(contacts: Contacts) -> dict[str, Any]:
    chosen = ~contacts.truth["held_out"]
    points, shapes = contacts.truth["points"][chosen], contacts.truth["mode_shapes"][chosen]
    return {
        **by_gains(contacts, lambda asked: nearest_vertex_mean(points, shapes, asked)),
        "bytes": 4 * (points.size + shapes.size) + 24 * shapes.shape[2],
        "training_cpu_s": 0.0,
    }


def radiation_weights(surface: Surface, modes: VoxelModes) -> np.ndarray:
    """Root mean square (modes,) over the surface of the normal component, by the papers' mean."""
    samples = surface.sample(RADIATION_POINTS, SEED)
    total = np.zeros(len(modes.eigenvalues))
    for part in np.array_split(np.arange(RADIATION_POINTS), 16):
        values = nearest_vertex_mean(modes.nodes, modes.vectors, samples.points[part])
        normals = surface.face_normals[samples.face[part]]
        total += np.sum(np.einsum("nk,nkm->nm", normals, values) ** 2, axis=0)
    return np.sqrt(total / RADIATION_POINTS)


def of_voxels(contacts: Contacts, surface: Surface, material: Material) -> dict[str, Any]:
    """Sound of the modes of 32^3 cubes, those of which any of 4^3 points is inside."""
    start = time.process_time()
    modes = voxel_modes(
        surface,
        material,
        resolution=32,
        rule="samples",
        max_frequency_hz=MAX_FREQUENCY_HZ,
        max_modes=MAX_MODES,
        seed=SEED,
    )
    weights = radiation_weights(surface, modes)
    making = time.process_time() - start

    def ring(points: np.ndarray, impulses: np.ndarray, rate_hz: float) -> np.ndarray:
        gains = nearest_vertex_mean(modes.nodes, modes.vectors, points)
        amplitudes = amplitudes_of(gains, impulses, weights)
        return mode_bank(modes.eigenvalues, modes.dampings_per_s, amplitudes, SECONDS, rate_hz)

    count = min(len(modes.eigenvalues), len(contacts.truth["eigenvalues"]))
    true = contacts.truth["eigenvalues"]
    apart = np.abs(cents(np.sqrt(modes.eigenvalues[:count]), np.sqrt(true[:count])))
    where, push = contacts.points, contacts.impulses
    return {
        "gain_error_db": None,
        **contacts.distances({rate: ring(where, push, rate) for rate in (SAMPLE_RATE_HZ, FULL_RATE_HZ)}),
        "query_cpu_s": cpu_median(
            lambda index: ring(where[index : index + 1], push[index : index + 1], SAMPLE_RATE_HZ), len(where)
        ),
        "bytes": 4 * (modes.nodes.size + modes.vectors.size) + 24 * len(modes.eigenvalues),
        "training_cpu_s": making,
        "modes": len(modes.eigenvalues),
        "components": modes.components,
        "unknowns": modes.unknowns,
        "mass_ratio": modes.mass_ratio,
        "first_frequency_error_percent": float(100 * (np.sqrt(modes.eigenvalues[0] / true[0]) - 1))
        if count
        else None,
        "median_frequency_error_cents": float(np.median(apart)) if count else None,
    }


def of_silence(contacts: Contacts) -> dict[str, Any]:
    return contacts.distances(
        {
            rate: np.zeros((len(contacts.points), round(SECONDS * rate)))
            for rate in (SAMPLE_RATE_HZ, FULL_RATE_HZ)
        }
    )


def thinned(losses: np.ndarray) -> list[float]:
    """Means of ten equal spans of the training."""
    return [float(part.mean()) for part in np.array_split(losses, 10) if len(part)]


def prepare(object_id: str, scans: Path, cache: Path) -> tuple[Surface, Material, Product]:
    """Surface, material and true modes of a scan; the modes are kept in `cache`."""
    materials = read_materials(REPOSITORY / "data" / "materials.csv")
    records = {record.id: record for record in read_catalogue(scans / "catalogue.csv", materials).records}
    record = records[object_id]
    mesh = ingest_object(record.mesh, None, record.length_m, object_id, with_textures=False)
    surface = textured_mesh_of(mesh).surface
    material = find_material(materials, record.material, object_id)
    path = cache / f"{object_id}.zarr.zip"
    if not path.exists():
        modes = simulate_modes(
            surface,
            material,
            max_frequency_hz=MAX_FREQUENCY_HZ,
            max_modes=MAX_MODES,
            training_points=TRAINING_POINTS,
            held_out_points=HELD_OUT_POINTS,
            seed=SEED,
            name=object_id,
        )
        cache.mkdir(parents=True, exist_ok=True)
        write_product(path, modes)
    return surface, material, read_product(path)


def measure(object_id: str, options: argparse.Namespace) -> dict[str, Any]:
    """All ways on one object."""
    surface, material, truth = prepare(object_id, options.scans, options.cache)
    points = truth["points"][truth["held_out"]][:CONTACTS]
    contacts = Contacts(truth, points, np.eye(3)[np.arange(len(points)) % 3])
    ways = {
        "AudioNet": lambda: of_audionet(contacts, surface),
        "2.0 gains network": lambda: of_gains_network(contacts, options.gains_steps, options.device),
        "1.0 spectrogram network": lambda: of_spectrogram_network(
            contacts, options.spectrogram_steps, options.device
        ),
        "4-nearest mean of truth": lambda: of_vertex_mean(contacts),
        "4-nearest mean of voxel 32^3 modes": lambda: of_voxels(contacts, surface, material),
        "silence": lambda: of_silence(contacts),
    }
    result: dict[str, Any] = {
        "material": material.name,
        "modes": len(truth["eigenvalues"]),
        "modes_below_7_2_khz": int(np.count_nonzero(truth["frequencies_hz"] <= 0.45 * SAMPLE_RATE_HZ)),
        "truth_error_estimate_cents": truth.attributes["error_estimate_cents"],
        "ways": {},
    }
    for name, way in ways.items():
        result["ways"][name] = way()
        shown = {key: value for key, value in result["ways"][name].items() if key != "training_losses"}
        print(object_id, name, shown, flush=True)
    return result


PANELS = (
    ("gain_error_db", "held-out gain error, dB", False),
    ("stft_distance_16_khz", "STFT distance, 16 kHz", True),
    ("envelope_distance_16_khz", "ENV distance, 16 kHz", True),
    ("bytes", "stored bytes", True),
    ("training_cpu_s", "CPU-s to make", True),
    ("query_cpu_s", "CPU-s for a contact's 2 s of sound", True),
)


def plot(figures: dict[str, Any]) -> None:
    """Draw every measure, a row a way, a mark an object."""
    names = list(next(iter(figures.values()))["ways"])
    figure, axes = subplots(2, 3, figsize=(15, 6.5), sharey=True)
    for panel, (key, title, logarithmic) in zip(axes.ravel(), PANELS, strict=True):
        for mark, (object_id, found) in zip("os^Dv", figures.items(), strict=False):
            placed = [(found["ways"][name].get(key), row) for row, name in enumerate(names)]
            known = [(x, row) for x, row in placed if x is not None and (x > 0 or not logarithmic)]
            panel.plot(*zip(*known, strict=True), mark, label=object_id.replace("_", " "), alpha=0.8)
        panel.set_title(title, fontsize=11)
        panel.set_yticks(range(len(names)), names)
        panel.grid(alpha=0.3)
        if logarithmic:
            panel.set_xscale("log")
    axes[0, 0].invert_yaxis()
    axes[0, 0].legend(fontsize=8)
    save(figure, "sound_rivals")


def main() -> None:
    parser = arguments(__doc__)
    default = Path(os.environ.get("OBJECTFOLDER_SCANS", REPOSITORY.parent / "shared" / "objects"))
    parser.add_argument("--scans", type=Path, default=default, help="folder of scans with catalogue.csv")
    parser.add_argument("--objects", nargs="+", default=OBJECTS)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "sound_rivals_modes")
    parser.add_argument("--gains-steps", type=int, default=1000, help="training of the 2.0 network")
    parser.add_argument("--spectrogram-steps", type=int, default=400, help="training of the 1.0 network")
    parser.add_argument("--device", default="cpu", help="device the networks are trained on")
    options = parser.parse_args()
    figures = {object_id: measure(object_id, options) for object_id in options.objects}
    settings = {
        "contacts": CONTACTS,
        "training_points": TRAINING_POINTS,
        "held_out_points": HELD_OUT_POINTS,
        "max_frequency_hz": MAX_FREQUENCY_HZ,
        "max_modes": MAX_MODES,
        "seconds": SECONDS,
        "gains_steps": options.gains_steps,
        "spectrogram_steps": options.spectrogram_steps,
        "device": options.device,
        "threads": os.environ.get("OMP_NUM_THREADS"),
        "published_by_unpublished_formulas": {
            "2.0 gains network": {"stft": 0.19e-5, "env": 1.29e-4},
            "1.0 spectrogram network": {"stft": 4.94e-5, "env": 7.65e-4},
        },
    }
    write(
        "sound_rivals",
        figures,
        settings,
        "AudioNet, the papers' networks and the papers' mean over vertices against solved modes at held-out "
        "points: relative error of gains in dB, STFT and ENV distance of 2 s of sound by "
        "objectfolder.fidelity.sounds from modes up to 0.45 of the rate, stored bytes, and CPU seconds",
    )
    plot(figures)


if __name__ == "__main__":
    main()
